"""A model's curve over the slip, for sliders: one load, a steady drive, no fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.effects import EFFECTS
from model.soils import Soil
from model.wheel import Wheel
from model.wheel_soil import Reading, WheelSoilModel

FloatArray = NDArray[np.float64]

SLIPS = np.linspace(-0.3, 0.8, 120)


@dataclass(frozen=True)
class Base:
    """What the curve of a campaign is drawn for, where effects ask for more than slip and load.

    Attributes
    ----------
    wheel : Wheel
    soil : Soil
    load_n : float
        Median of the used samples.
    ground_speed_mps : float
        The same; it is held, and the wheel turns as the slip has it.
    direction : 1 or -1
    pass_number : float
        The highest of the runs.
    inflation_kpa : float
        The lowest of the runs; NaN where none is known.
    """

    wheel: Wheel
    soil: Soil
    load_n: float
    ground_speed_mps: float
    direction: float = 1.0
    pass_number: float = 1.0
    inflation_kpa: float = float("nan")

    def conditions(self) -> Conditions:
        """Return the conditions at `SLIPS`: unaccelerated, at the far end of the line and the end of the campaign."""
        ratio = np.where(SLIPS > 0, 1.0 / (1.0 - np.maximum(SLIPS, 0.0)), 1.0 + SLIPS)

        def held(value: float) -> FloatArray:
            return np.full(len(SLIPS), value)

        return Conditions(
            slip=SLIPS,
            vertical_load_n=held(self.load_n),
            ground_speed_mps=held(self.ground_speed_mps),
            wheel_speed_radps=self.ground_speed_mps * ratio / self.wheel.radius_m,
            ground_acceleration_mps2=held(0.0),
            ground_jerk_mps3=held(0.0),
            wheel_acceleration_radps2=held(0.0),
            line_position=held(1.0),
            campaign_time=held(0.5),
            direction=held(self.direction),
            pass_number=held(self.pass_number),
            inflation_kpa=held(self.inflation_kpa),
            unit_weight_n_m3=held(self.soil.unit_weight_n_m3),
        )


def curve_of(
    base: Base, effects: Sequence[str], reading: Reading, values: Mapping[str, float]
) -> dict[str, FloatArray | float]:
    """Return slip, drawbar pull, torque and sinkage, each of shape (120,), NaN where the model has no answer.

    Parameters
    ----------
    base : Base
    effects : sequence of str
        Keys of `EFFECTS`.
    reading : "balanced" or "literal"
    values : mapping
        Parameters that differ from the soil's and the effects' neutral ones.

    Raises
    ------
    ConfigError
        An unknown parameter, or two effects that share one.
    """
    model = WheelSoilModel(base.wheel, base.soil, [EFFECTS[key] for key in effects], reading)
    found = model.predict(base.conditions(), values)
    return {
        "slip": SLIPS,
        "drawbar_pull_n": found.drawbar_pull_n,
        "driving_torque_nm": found.driving_torque_nm,
        "sinkage_m": found.sinkage_m,
        "load_n": base.load_n,
    }
