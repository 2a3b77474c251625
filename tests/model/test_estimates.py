"""Intervals of a fit: Student's t, correlated samples, bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.effects import EFFECTS
from model.fit import Estimate, FitOptions, Observations, fit_observations
from model.wheel_soil import SOILS, Conditions, Wheel, WheelSoilModel

WHEEL = Wheel(0.47, 0.318)
COUNT = 360
HELD = 12
"""Neighbours that share their noise."""


def measured(H_m: float, seed: int = 1, noise_n: float = 50.0) -> Observations:
    """Return driven samples at 10 Hz with noise that stays as it is for 1.2 s, on true slip and load."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) / 10.0
    slip, load = 0.5 + 0.35 * np.sin(1.7 * time), np.full(COUNT, 8e3)
    model = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["vasilev"],))
    found = model.predict(Conditions(slip, load), {"H_m": H_m})
    none, zero = np.full(COUNT, np.nan), np.zeros(COUNT)
    noise = noise_n * np.repeat(rng.standard_normal(COUNT // HELD), HELD)
    pull, torque = found.drawbar_pull_n + noise, found.driving_torque_nm
    return Observations(slip, load, pull, torque, none, zero, zero, time, np.zeros(COUNT, np.intp), ("a",))


def fitted(data: Observations) -> Estimate:
    options = FitOptions(models=("vasilev",), channels=("dp",))
    return fit_observations(data, WHEEL, SOILS["clay"], options).model("vasilev").estimate("H_m")


def test_an_interval_of_many_independent_rows_is_1_96_sigma_to_either_side() -> None:
    found = fitted(replace(measured(0.05), independent=True))
    low, high = found.interval
    assert 1.95 < (high - found.value) / found.sigma < 2.02
    assert high - found.value == pytest.approx(found.value - low, rel=1e-9)


def test_samples_that_share_their_noise_do_not_count_singly() -> None:
    """Twelve that are one make sigma the root of twelve as large."""
    data = measured(0.05)
    alone, together = fitted(replace(data, independent=True)), fitted(data)
    assert together.sigma / alone.sigma == pytest.approx(np.sqrt(HELD), rel=0.35)
    assert 1.95 < (together.interval[1] - together.value) / together.sigma < 2.6


def test_an_interval_ends_at_the_bound_of_what_can_be() -> None:
    """H_m near 0, and not held there: no law makes a wheel rise with slip."""
    low, high = next(
        (one.interval for one in (fitted(measured(0.001, seed)) for seed in range(8)) if not one.at_bound),
    )
    assert low == 0.0
    assert high > 0.0


def test_noise_that_is_larger_where_it_matters_widens_the_interval() -> None:
    """Weights are those of the mean noise: where slip is high, and tells H_m, it is three times as large."""
    calm = measured(0.05)
    exact = measured(0.05, noise_n=0.0).drawbar_pull_n
    large = np.where(calm.slip > 0.6, 3.0, 0.1)
    rough = replace(calm, drawbar_pull_n=exact + large * (calm.drawbar_pull_n - exact))
    spread = [np.std(np.where(large > 1, x.drawbar_pull_n - exact, np.nan)[large > 1]) for x in (calm, rough)]
    assert fitted(rough).sigma > 0.9 * spread[1] / spread[0] * fitted(calm).sigma
