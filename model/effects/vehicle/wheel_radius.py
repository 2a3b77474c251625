"""The rolling radius in vehicle.toml is not the wheel's: every slip is off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Conditions


class WheelRadius(Effect):
    """True r (1 + e) in the slip, not in the stresses: true V/(r omega) = measured V/(r omega) / (1 + e)."""

    name = "wheel_radius"
    kind = "measurement"
    summary = (
        "The rolling radius from which the slip is computed is wrong by a share: slip is not zero where it should be."
    )
    source = "Yang et al. (2016), Eq. 6; the effective radius of a tyre changes by 1 to 3 % with load and wear"
    shows = ("wheel_speed",)
    parameters = (
        Parameter("relative", "1", 0.0, 0.02, -0.2, 0.2, 0.03, "effective rolling radius against the declared one"),
    )

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the slip of the true radius."""
        return conditions.with_speed_ratio_times(1.0 / (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the wheel speed of the larger wheel: slower at the same speed of its rim."""
        return replace(signals, wheel_speed_radps=signals.wheel_speed_radps / (1.0 + values["relative"]))
