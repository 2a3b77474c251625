"""The transducer shows torque too large or too small by a share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class TorqueGain(Effect):
    """Measured T = (1 + e) true T."""

    name = "torque_gain"
    kind = "measurement"
    summary = "Driving torque is scaled by a wrong gain of the transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: gains of the bridges; data sheets usually state 0.5 to 2 %"
    shows = ("driving_torque",)
    parameters = (
        Parameter(
            "relative",
            "1",
            0.0,
            0.04,
            -0.5,
            0.5,
            0.06,
            "static weighing and pulling; an uncalibrated bridge may be off by several per cent",
        ),
    )
    needs = Needs(channels=("driving_torque",))
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, driving_torque=reaction.driving_torque * (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, driving_torque_nm=signals.driving_torque_nm * (1.0 + values["relative"]))
