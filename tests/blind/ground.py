"""The soils of the study, how far the field may be from the laboratory, and what varies along the track."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blind.rim import Column

from daq import FloatArray

KEYS = ("cohesion", "friction", "shear_modulus", "exponent", "cohesive", "frictional")
SPREAD = {
    "cohesion": 0.10,
    "friction": 0.06,
    "shear_modulus": 0.20,
    "exponent": 0.04,
    "cohesive": 0.10,
    "frictional": 0.10,
}
"""Laboratory's relative one-sigma, stated in terrain.toml; the field is drawn from it (log-normal)."""
PATCH = 0.02
"""Usual one-sigma of the stiffness along a track; of the friction half of it."""
RUN_SCATTER = {"stiffness": 0.03, "friction": 0.015, "cohesion": 0.03}
"""Relative one-sigma from run to run."""
UNIT_WEIGHT_N_M3 = 16_500.0


@dataclass(frozen=True)
class Ground:
    """Bekker's and Janosi's parameters, SI; `friction` is tan phi."""

    name: str
    cohesion: Column
    friction: Column
    shear_modulus: Column
    exponent: Column
    cohesive: Column
    frictional: Column
    factor: Column = 1.0

    def stiffness(self, width: float) -> Column:
        """k of Eq. 2, with whatever makes it stiffer."""
        return (self.cohesive / width + self.frictional) * self.factor

    def changed(self, logs: dict[str, Column]) -> Ground:
        """Return the ground with some parameters times exp(logs); ``stiffness`` is both moduli at once."""
        logs = dict(logs)
        factor = self.factor * np.exp(logs.pop("stiffness", 0.0))
        return replace(self, factor=factor, **{key: getattr(self, key) * np.exp(x) for key, x in logs.items()})


LABORATORY = {
    "clay": Ground("clay", 7580.0, float(np.tan(np.radians(14.0))), 0.025, 0.85, 43.68e3, 499.3e3),
    "sandy": Ground("sandy", 1000.0, float(np.tan(np.radians(25.0))), 0.025, 1.04, 1.00e3, 580.0e3),
    **{
        name: Ground(name, cohesion, float(np.tan(np.radians(angle))), modulus, exponent, cohesive, frictional)
        for name, cohesion, angle, modulus, exponent, cohesive, frictional in (
            ("soft clay", 4140.0, 13.0, 0.006, 0.5, 13.19e3, 692.15e3),
            ("dry sand", 1040.0, 28.0, 0.010, 1.10, 0.99e3, 1528.43e3),
            ("lunar", 170.0, 35.0, 0.018, 1.0, 1.4e3, 820e3),
            ("HIT-LSS1", 250.0, 31.9, 0.010, 1.10, 15.6e3, 2407.4e3),
            ("Mars sand", 462.3, 35.0, 0.015, 0.92, 13.6e3, 2259.1e3),
            ("Pavlov sand", 1000.0, 29.0, 0.021, 1.46, 1.0e3, 8000e3),
            ("sandy loam", 3300.0, 33.7, 0.025, 1.1, 74.6e3, 2080e3),
        )
    },
}
"""Yang et al. (2016), Tab. 1; then soils of Ding (2015), Zhou (2023), Pavlov and Wong, as peers have them.

Wong's lean clay (n .2, c 69 kPa) is omitted: a wheel hardly sinks in it. Pavlov gives k for one width; k_c is ours.
"""


def drawn_field(soil: str | Ground, rng: np.random.Generator) -> Ground:
    """Return the soil of the field, for a laboratory's soil or its name."""
    logs = {key: SPREAD[key] * rng.standard_normal() for key in KEYS}
    return (LABORATORY[soil] if isinstance(soil, str) else soil).changed(logs)


def run_scatter(rng: np.random.Generator, factor: float = 1.0) -> dict[str, Column]:
    """Return the logs by which one run's soil differs."""
    return {key: factor * sigma * rng.standard_normal() for key, sigma in RUN_SCATTER.items()}


@dataclass(frozen=True)
class Patchiness:
    """In-run variation: Ornstein-Uhlenbeck in distance, of ln k and of ln tan phi."""

    stiffness: float
    friction: float
    length_m: float

    @staticmethod
    def drawn(rng: np.random.Generator) -> Patchiness:
        """`PATCH` of the stiffness, half of that of the friction, more or less."""
        size = PATCH * float(np.exp(0.25 * rng.standard_normal()))
        return Patchiness(size, 0.5 * size, float(rng.uniform(1.5, 4.0)))

    def along(self, distance_m: FloatArray, rng: np.random.Generator) -> dict[str, Column]:
        """Return ln k and ln tan phi along a run, shape (n,)."""
        memory = np.exp(-np.diff(distance_m, prepend=distance_m[0]) / self.length_m)
        fresh = np.sqrt(1 - memory**2)
        out: dict[str, Column] = {}
        for key, sigma in (("stiffness", self.stiffness), ("friction", self.friction)):
            white, state = rng.standard_normal(len(distance_m)), rng.standard_normal()
            path = np.empty(len(distance_m))
            for i, (keep, new) in enumerate(zip(memory.tolist(), (fresh * white).tolist(), strict=True)):
                state = keep * state + new
                path[i] = state
            out[key] = sigma * path
        return out
