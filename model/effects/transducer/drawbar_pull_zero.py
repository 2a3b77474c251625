"""The transducer's zero of drawbar pull is off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class DrawbarPullZero(Effect):
    """Measured Dp = true Dp + o, at standstill too."""

    name = "drawbar_pull_zero"
    kind = "measurement"
    summary = "Drawbar pull carries a constant offset."
    source = "MTS Systems (2008), SWIFT 30 manual: zeros of the bridges; usually 0.1 to 0.5 % of the range"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter(
            "offset_n",
            "N",
            0.0,
            100.0,
            -2000.0,
            2000.0,
            150.0,
            "stationary bridge offset, or 1 deg of tilt at 8 kN (140 N)",
        ),
    )
    needs = Needs(channels=("drawbar_pull",), two_loads=True, standstill=True)
    at_standstill = True
    stage = 4

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["offset_n"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n + values["offset_n"])
