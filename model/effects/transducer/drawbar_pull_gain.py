"""The transducer shows drawbar pull too large or too small by a share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class DrawbarPullGain(Effect):
    """Measured Dp = (1 + e) true Dp."""

    name = "drawbar_pull_gain"
    kind = "measurement"
    summary = "Drawbar pull is scaled by a wrong gain of the transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: gains of the bridges; data sheets usually state 0.5 to 2 %"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter(
            "relative",
            "1",
            0.0,
            0.05,
            -0.5,
            0.5,
            0.08,
            "static weighing and pulling; an uncalibrated bridge may be off by several per cent",
        ),
    )
    needs = Needs(channels=("drawbar_pull",))
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, drawbar_pull=reaction.drawbar_pull * (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n * (1.0 + values["relative"]))
