"""The world of a campaign: soil, vehicle, runs, and how far its noise is from what the engine expects of noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blind.colour import Colour, drawn_forces, drawn_speed
from blind.ground import LABORATORY, Ground, Patchiness
from blind.rim import Rim, sums
from blind.sensors import Suite
from blind.standing import towed
from blind.wheel import YANG, Vehicle

from daq import Channel

GRAVITY_MPS2 = 9.80665
_LOAD_STEPS = (1.0, 1.375, 1.625)
_MOST_PRESSURE_PA = 250e3
_LEAST_LOAD_N = 150.0


@dataclass(frozen=True)
class World:
    """Everything of a campaign that is drawn once; the defaults are Yang's vehicle and noise as the engine assumes it.

    Attributes
    ----------
    soil : str
        Of `LABORATORY`.
    vehicle : Vehicle
    runs : int
    duration_s : float
        Of each run.
    scatter : float
        Factor on how the soil varies, from run to run and within a run.
    length_m : float
        Correlation length of the soil within a run; 0: drawn by the campaign.
    force, speed : Colour, optional
        Spectra of the noise of forces and of the GNSS speed; the vendor's where there is none.
    tails : float
        Degrees of freedom of Student's distribution that every noise has; 0: normal.
    lost : float
        Share of frames that are lost, one by one.
    """

    soil: str = "clay"
    vehicle: Vehicle = YANG
    runs: int = 6
    duration_s: float = 40.0
    scatter: float = 1.0
    length_m: float = 0.0
    force: Colour | None = None
    speed: Colour | None = None
    tails: float = 0.0
    lost: float = 0.0

    def ground(self, patchiness: Patchiness) -> Patchiness:
        """Return how the soil varies within a run."""
        length = self.length_m or patchiness.length_m
        return Patchiness(self.scatter * patchiness.stiffness, self.scatter * patchiness.friction, length)

    def instruments(self, suite: Suite) -> Suite:
        """Return the suite with this world's noise, in proportion to the vehicle's forces."""
        suite = suite.on(self.vehicle)
        return replace(suite, force=self.force or suite.force, speed=self.speed or suite.speed, tails=self.tails)

    def received(self, channels: dict[str, Channel], rng: np.random.Generator) -> dict[str, Channel]:
        """Return the channels without the frames that are lost; channels of one frame are lost together."""
        if not self.lost:
            return channels
        kept: dict[bytes, np.ndarray] = {}
        out = {}
        for role, channel in channels.items():
            keep = kept.setdefault(channel.time_ns.tobytes(), rng.random(len(channel.time_ns)) >= self.lost)
            out[role] = Channel(channel.name, channel.unit, channel.time_ns[keep], channel.values[keep])
        return out


def drawn_world(rng: np.random.Generator) -> World:
    """Draw a world in which the laboratory's soil carries the wheel."""
    while True:
        soil = str(rng.choice(list(LABORATORY)))
        vehicle = drawn_vehicle(LABORATORY[soil], rng)
        if vehicle is not None:
            break
    return replace(drawn_noise_world(rng), soil=soil, vehicle=vehicle)


def drawn_noise_world(rng: np.random.Generator) -> World:
    """Draw runs, soil scatter and noise, with everything else as it is by default."""
    return World(
        runs=int(rng.integers(3, 13)),
        duration_s=float(round(rng.uniform(15.0, 60.0))),
        scatter=float(rng.uniform(0.7, 1.5)),
        length_m=float(np.exp(rng.uniform(np.log(1.5), np.log(12.0)))),
        force=drawn_forces(rng),
        speed=drawn_speed(rng),
        tails=4.0 if rng.random() < 0.5 else 0.0,
        lost=float(rng.uniform(0.0, 0.03)) if rng.random() < 0.7 else 0.0,
    )


def drawn_vehicle(ground: Ground, rng: np.random.Generator) -> Vehicle | None:
    """Draw a wheel and loads that sink it by .08 to .3 of its radius; None where the soil does not carry it."""
    radius = round(float(rng.uniform(0.15, 0.6)), 3)
    width = round(radius * float(rng.uniform(0.55, 0.8)), 3)
    stiffness = float(np.asarray(ground.stiffness(width)))
    deepest = (_MOST_PRESSURE_PA / stiffness) ** (1 / float(np.asarray(ground.exponent)))
    sinkage = min(radius * float(rng.uniform(0.08, 0.3)), deepest)
    load = carried(ground, radius, width, sinkage)
    mass = load * (YANG.mass_kg / YANG.loads_n[0])
    outboard = float(rng.uniform(0.0, min(0.18 * load / GRAVITY_MPS2, 150.0))) if rng.random() < 0.75 else 0.0
    inertia = outboard * radius**2 * (YANG.outboard_kgm2 / YANG.outboard_kg / YANG.radius_m**2)
    first, second, third = (round(load * step, 1) for step in _LOAD_STEPS)
    pace = (radius / YANG.radius_m) ** (1 / 3) * float(rng.uniform(0.85, 1.15))
    vehicle = Vehicle(
        radius, width, round(outboard, 2), round(inertia, 4), round(mass, 1), (first, second, third), pace
    )
    if sinkage < 0.03 * radius or load < _LEAST_LOAD_N or not np.isfinite(towed(ground, third, vehicle)).all():
        return None
    return vehicle


def carried(ground: Ground, radius_m: float, width_m: float, sinkage_m: float) -> float:
    """Return the load that a wheel carries at a sinkage without slip, N."""
    rim = Rim(
        1.0,
        radius_m,
        width_m,
        ground.cohesion,
        ground.friction,
        ground.shear_modulus,
        ground.stiffness(width_m),
        ground.exponent,
    )
    found = sums(rim, np.array([[sinkage_m]]))
    return float((found.load + found.load_cohesion)[0, 0])
