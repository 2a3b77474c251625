"""The ground speed is off by a constant while the vehicle moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import value_of, where

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Conditions

STANDSTILL_MPS = 0.05
"""Below it a receiver holds its speed at zero, so that no bias shows."""


class SpeedBias(Effect):
    """V_m = V + b, but not at standstill."""

    name = "speed_bias"
    kind = "measurement"
    summary = "The ground speed is off by a constant: slip is wrong by more, the slower the vehicle goes."
    source = "Racelogic (2014), VBOX data sheets: 0.1 km/h as a mean of four samples"
    shows = ("ground_speed",)
    parameters = (Parameter("offset_mps", "m/s", 0.0, 0.05, -0.5, 0.5, 0.10, "receivers' data sheets"),)
    needs = Needs(conditions=("ground_speed_mps",))
    stage = 4

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true ground speed."""
        shown = conditions.ground_speed_mps
        moving = value_of(shown) > STANDSTILL_MPS
        return conditions.with_ground_speed(where(moving, shown - values["offset_mps"], shown))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the ground speed with its offset."""
        speed = signals.ground_speed_mps
        shown = where(speed > STANDSTILL_MPS, (speed + values["offset_mps"]).clip(min=0.0), speed)
        return replace(signals, ground_speed_mps=shown)
