"""Benches with a known truth, for tests of their diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians

import numpy as np

from model.diagnosis import Bench
from model.effects import EFFECTS
from model.fit import Observations
from model.wheel_soil import SOIL_PARAMETERS, Conditions, Soil, SoilPrior, Wheel, WheelSoilModel

WHEEL = Wheel(0.058, 0.050)
SAND = Soil("sand", 500.0, radians(29), 0.0112, 1.468, 0.0, 8.476e6, 13_050.0)
SPREAD = {
    "cohesion_pa": 250.0,
    "tan_phi": 0.0456,
    "shear_modulus_m": 0.0046,
    "sinkage_exponent": 0.03,
    "frictional_modulus": 1.2e6,
}
"""One-sigmas of a laboratory that knows its sand."""
REPEATS = {"dp": 0.3, "t": 0.015, "z": 0.6e-3}
SLIPS = (0.0, 0.15, 0.3, 0.5, 0.7, 0.9)


def prior(spread: Mapping[str, float] = SPREAD, soil: Soil = SAND) -> SoilPrior:
    """Return a laboratory's uncertainty with the given one-sigmas; what is not given is exactly known."""
    mean = np.array([getattr(soil, name) for name in SOIL_PARAMETERS])
    sigma = np.array([spread.get(name, 0.0) for name in SOIL_PARAMETERS])
    return SoilPrior(mean, np.diag(sigma**2), "test")


def bench(
    rng: np.random.Generator,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    *,
    soil: Soil = SAND,
    slips: Sequence[float] = SLIPS,
    loads_n: Sequence[float] = (25.0,),
    repeats: int = 3,
    noise: float = 1.0,
    spread: Mapping[str, float] = SPREAD,
    tyre: str = "smooth",
) -> Bench:
    """Return a bench on which some effects act: key -> parameter -> value."""
    effects = effects or {}
    slip, load = (x.ravel() for x in np.meshgrid(np.repeat(slips, repeats), loads_n))
    load = load * (1.0 + 0.03 * rng.standard_normal(load.size))
    values = {k: v for key, own in effects.items() for k, v in EFFECTS[key].keyed(own).items()}
    model = WheelSoilModel(WHEEL, soil, [EFFECTS[key] for key in effects])
    said = model.predict(Conditions(slip, load, unit_weight_n_m3=soil.unit_weight_n_m3), values)

    def measured(true: np.ndarray, sigma: float) -> np.ndarray:
        return true + noise * sigma * rng.standard_normal(true.size)

    rows = Observations(
        slip=slip,
        vertical_load_n=load,
        drawbar_pull_n=measured(said.drawbar_pull_n, REPEATS["dp"]),
        driving_torque_nm=np.full(slip.size, np.nan),
        sinkage_m=measured(said.sinkage_m, REPEATS["z"]),
        slip_sigma=np.zeros(slip.size),
        vertical_load_sigma_n=np.zeros(slip.size),
        time_s=np.arange(slip.size, dtype=float),
        run=np.zeros(slip.size, np.intp),
        names=("",),
        independent=True,
    )
    return Bench("bench", rows, WHEEL, SAND, prior(spread), {}, tyre)
