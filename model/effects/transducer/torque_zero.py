"""The transducer's zero of torque is off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class TorqueZero(Effect):
    """Measured T = true T + o, at standstill too."""

    name = "torque_zero"
    kind = "measurement"
    summary = "Driving torque carries a constant offset."
    source = "MTS Systems (2008), SWIFT 30 manual: zeros of the bridges; usually 0.1 to 0.5 % of the range"
    shows = ("driving_torque",)
    parameters = (Parameter("offset_nm", "N m", 0.0, 40.0, -1000.0, 1000.0, 60.0, "0.5 to 1 % of a 10 kN m range"),)
    needs = Needs(channels=("driving_torque",), standstill=True)
    at_standstill = True
    stage = 4

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, driving_torque=reaction.driving_torque + values["offset_nm"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, driving_torque_nm=signals.driving_torque_nm + values["offset_nm"])
