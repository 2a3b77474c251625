"""The paper's tables, and what follows from them and from its equations alone, whatever the wheel."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from daq import FloatArray
from model.effects import EFFECTS
from model.fit import MODELS
from model.wheel_soil import SOILS, Conditions, Prediction, Wheel, WheelSoilModel

WHEEL = Wheel(0.47, 0.318)
STATIC_LOAD_N = 8000.0
RADII_M = np.arange(0.30, 0.551, 0.05)
WIDTHS_M = np.arange(0.15, 0.451, 0.05)
LOADS_N = np.arange(3000.0, 14501.0, 250.0)


@dataclass(frozen=True)
class Published:
    """What the paper prints of a soil.

    Attributes
    ----------
    threshold : slip from which on Tab. 2 or 4 counts
    coefficients : Tab. 3, by the names of parameters
    criteria : Tab. 2 or 4: model -> M0 in percent, R0 in N, R2
    soil : Tab. 1, in its units
    """

    name: str
    threshold: float
    added_load_n: float
    coefficients: dict[str, float]
    criteria: dict[str, tuple[float, float, float]]
    soil: dict[str, float]

    @property
    def slip(self) -> FloatArray:
        """Slips of a curve like that of Fig. 4 and 5."""
        return np.linspace(self.threshold, 1.0, 81)

    def predict(self, law: str, load_n: float, wheel: Wheel = WHEEL) -> Prediction:
        """Return the paper's own model: sinkage by Eq. 10 to 13, put into Eq. 1 and 3 to 9."""
        effects = () if law == "wong" else (EFFECTS[law],)
        model = WheelSoilModel(wheel, SOILS[self.name], effects, "literal")
        values = {p.name: self.coefficients[p.name] for e in effects for p in e.parameters}
        return model.predict(Conditions(self.slip, np.full_like(self.slip, load_n)), values)


def read() -> dict[str, Published]:
    """Return the tables of both soils."""
    tables = tomllib.loads((Path(__file__).parent / "tables.toml").read_text(encoding="utf-8"))
    found = {}
    for name, one in tables.items():
        coefficients = {key: one[key] for key in ("m1", "m2", "n1")} | {"H_m": one["H_m"]}
        criteria = {model: tuple(values) for model, values in one["criteria"].items()}
        soil = {key: one[key] for key in ("c_kpa", "phi_deg", "K_m", "n", "kc", "kphi")}
        found[name] = Published(name, one["threshold"], 1e3 * one["added_load_kn"], coefficients, criteria, soil)
    return found


def equations(paper: Published) -> dict[str, Any]:
    """Return what Eq. 2 and 10 give at the static load, and the load of Eq. 7 with Tab. 3."""
    soil = SOILS[paper.name]
    static = paper.predict("wong", STATIC_LOAD_N).sinkage_m[0]
    half = Conditions(np.array([0.5]), np.array([STATIC_LOAD_N]))
    balance = WheelSoilModel(WHEEL, soil).predict(half, {}).sinkage_m[0]
    wrong = paper.soil["kc"] / (WHEEL.width_m + paper.soil["kphi"])
    plain, sunk = (paper.predict(law, STATIC_LOAD_N) for law in ("wong", "lyasko"))
    carried = sunk.vertical_load_n / STATIC_LOAD_N
    softer = replace(
        soil, cohesive_modulus=0.8 * soil.cohesive_modulus, frictional_modulus=0.8 * soil.frictional_modulus
    )
    every = Conditions(paper.slip, np.full_like(paper.slip, STATIC_LOAD_N))
    yielding = WheelSoilModel(WHEEL, softer, reading="literal").predict(every, {})
    return {
        "softer_n": rms(yielding.drawbar_pull_n - plain.drawbar_pull_n),
        "sinkage_n": rms(sunk.drawbar_pull_n - plain.drawbar_pull_n),
        "static_mm": 1e3 * static,
        "balance_mm": 1e3 * balance,
        "printed_kpa": wrong * static**soil.sinkage_exponent,
        "right_kpa": 1e-3 * soil.stiffness(WHEEL.width_m) * static**soil.sinkage_exponent,
        "carried_low": carried.min(),
        "carried_high": carried.max(),
    }


def equivalents(paper: Published, load_n: float) -> dict[str, float]:
    """Return H and n1 whose pull is nearest to that of Lyasko's law with Tab. 3, at a constant load."""
    lyasko = paper.predict("lyasko", load_n)

    def nearest(law: str, name: str, most: float) -> float:
        def miss(value: float) -> float:
            changed = replace(paper, coefficients={name: value})
            pull = changed.predict(law, load_n).drawbar_pull_n
            return rms(pull - lyasko.drawbar_pull_n) if np.isfinite(pull).all() else np.inf

        tried = np.linspace(0.0, most, 61)
        misses = [miss(value) for value in tried]
        best = int(np.argmin(misses))
        if best in (0, 60) or not np.isfinite(misses[best + 1]):
            return float("nan")
        return float(minimize_scalar(miss, bounds=(tried[best - 1], tried[best + 1]), method="bounded").x)

    return {
        "load_kn": 1e-3 * load_n,
        "static_m": paper.predict("wong", load_n).sinkage_m[0],
        "H_m": nearest("vasilev", "H_m", 0.3),
        "n1": nearest("ding", "n1", 2.0),
    }


def affine_share(paper: Published) -> float:
    """Return the least share of Wong's mean square error that an offset and a gain of its prediction remove, percent.

    What is left after the best offset and gain is ``var(y) (1 - R2)``; ``var(y) <= R0^2 / (1 - R2)`` of any row.
    """
    largest = min(r0**2 / (1 - r2) for _, r0, r2 in paper.criteria.values())
    _, r0, r2 = paper.criteria["wong"]
    return 100 * (1 - largest * (1 - r2) / r0**2)


def largest_spread_n(paper: Published) -> float:
    """Return the largest standard deviation that the measured curve can have."""
    return float(min(r0 / np.sqrt(1 - r2) for _, r0, r2 in paper.criteria.values()))


def bounds(paper: Published) -> dict[str, tuple[float, float, float, float]]:
    """Return what the table allows two predictions to differ by: Lyasko's law and another model, at the same samples.

    Their distance is between the difference and the sum of their R0; the angle between them (its cosine is the
    correlation) is between the difference and the sum of their angles to the measured values.

    Returns
    -------
    mapping model -> least and largest distance, N; least and largest R2
    """
    _, base, r2 = paper.criteria["lyasko"]
    angle = np.arccos(np.sqrt(r2))
    found = {}
    for name, (_, r0, own) in paper.criteria.items():
        other = np.arccos(np.sqrt(own))
        low, high = np.cos([angle + other, angle - other]) ** 2
        found[name] = (abs(r0 - base), r0 + base, float(low), float(high))
    return found


@dataclass(frozen=True)
class ConstantLoad:
    """The paper's models with Tab. 3 on one wheel at one load."""

    wheel: Wheel
    load_n: float
    pull_n: FloatArray
    distance_n: dict[str, float]
    R2: dict[str, float]

    @property
    def known(self) -> bool:
        """Whether every model has an answer at every slip."""
        return bool(np.isfinite([*self.distance_n.values(), *self.R2.values()]).all())

    def fits(self, allowed: dict[str, tuple[float, float, float, float]], models: Sequence[str]) -> bool:
        """Whether the distances and correlations of these models are within `bounds`."""
        return all(
            allowed[m][0] <= self.distance_n[m] <= allowed[m][1] and allowed[m][2] <= self.R2[m] <= allowed[m][3]
            for m in models
        )


def at_constant_load(paper: Published, wheel: Wheel, load_n: float) -> ConstantLoad:
    """Return how far the other models' pull is from that of Lyasko's law."""
    base = paper.predict("lyasko", load_n, wheel).drawbar_pull_n
    pulls = {m: paper.predict(m, load_n, wheel).drawbar_pull_n for m in MODELS if m != "lyasko"}
    return ConstantLoad(
        wheel,
        load_n,
        base,
        {m: rms(pull - base) for m, pull in pulls.items()},
        {m: float(np.corrcoef(pull, base)[0, 1] ** 2) for m, pull in pulls.items()},
    )


def grid(paper: Published) -> Iterator[ConstantLoad]:
    """Return every wheel and load of the search where all models have an answer."""
    for radius, width, load in product(RADII_M.tolist(), WIDTHS_M.tolist(), LOADS_N.tolist()):
        found = at_constant_load(paper, Wheel(radius, width), load)
        if found.known:
            yield found


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
