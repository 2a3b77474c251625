"""Conditions with everything filled in, and effects as models take them, for tests of the library of effects."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.effects import EFFECTS, Effect
from model.wheel_soil import SOILS, Conditions, Prediction, Quadrature, Reading, Wheel, WheelSoilModel, speed_ratio

WHEEL = Wheel(0.47, 0.318)
FINE = Quadrature(40, 4)
OUTPUTS = ("sinkage_m", "vertical_load_n", "drawbar_pull_n", "driving_torque_nm")


def full_conditions(count: int = 21, seed: int = 3) -> Conditions:
    """Return driven and braked samples at two loads, two directions and three passes, with every field known."""
    rng = np.random.default_rng(seed)
    braked = count // 3
    slip = np.concatenate([np.linspace(-0.6, -0.05, braked), np.linspace(0.02, 0.95, count - braked)])
    rim = rng.uniform(1.0, 4.0, count)
    every = np.arange(count)
    return Conditions(
        slip=slip,
        vertical_load_n=np.where(every % 2, 8e3, 1e4),
        ground_speed_mps=rim * speed_ratio(slip),
        wheel_speed_radps=rim / WHEEL.radius_m,
        ground_acceleration_mps2=rng.normal(0.0, 0.6, count),
        ground_jerk_mps3=rng.normal(0.0, 0.3, count),
        wheel_acceleration_radps2=rng.normal(0.0, 2.0, count),
        line_position=rng.uniform(-1.0, 1.0, count),
        campaign_time=rng.uniform(-0.5, 0.5, count),
        direction=np.where(every % 4 < 2, 1.0, -1.0),
        pass_number=1.0 + every % 3,
        inflation_kpa=np.where(every % 5 < 2, 340.0, 250.0),
        unit_weight_n_m3=np.full(count, 16_500.0),
        body_pitch_rad=rng.normal(0.0, 5e-3, count),
    )


def reading_of(effect: type[Effect]) -> Reading:
    """Return the reading in which an effect shows."""
    return "literal" if effect.reading == "literal" else "balanced"


def model_with(key: str, soil: str = "sandy", **options: Any) -> WheelSoilModel:
    """Return a model with one effect of the library, in the reading in which it shows."""
    return WheelSoilModel(WHEEL, SOILS[soil], (EFFECTS[key],), reading_of(EFFECTS[key]), **options)


def away(key: str, share: float) -> dict[str, float]:
    """Return the effect's values so many prior scales off neutral, to the plausible side, as a model takes them."""
    effect = EFFECTS[key]
    return effect.keyed({p.name: p.neutral + share * (p.side or 1) * p.scale(WHEEL) for p in effect.parameters})


def measured(prediction: Prediction) -> np.ndarray:
    """Return drawbar pull (N) and torque (N m) one after the other."""
    return np.concatenate([prediction.drawbar_pull_n, prediction.driving_torque_nm])


def slopes(prediction: Prediction, names: tuple[str, ...]) -> np.ndarray:
    """Return the derivatives of `measured` by each name, shape (2 n, names)."""
    found = [prediction.sensitivities[name] for name in names]
    return np.stack([np.concatenate([s.drawbar_pull_n, s.driving_torque_nm]) for s in found], axis=1)
