"""Tilt of the frame in whose axes the transducer reads: a share of the vertical load shows in drawbar pull.

A frame that is tilted by an angle a, nose up, reads Dp cos a + W sin a, to first order Dp + a W; the load loses a Dp,
which is neglected. A constant angle is cross-talk; here the frame pitches with the body. The tilt comes before the
gains: what the bridges feel is in the frame's axes already.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.base import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class BodyPitch(Effect):
    """Measured Dp = true Dp + q p W, with p the pitch of the body under acceleration, nose up."""

    name = "body_pitch"
    kind = "measurement"
    summary = "The transducer's frame pitches with the body under acceleration: vertical load shows in drawbar pull."
    source = "Gillespie (1992), Fundamentals of Vehicle Dynamics: squat and dive of the body on its springs"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter(
            "share",
            "1",
            0.0,
            0.5,
            0.0,
            3.0,
            0.6,
            "0: the stator is held by the hub's carrier; 1: by the body; links of the suspension may add to it",
            side=1,
        ),
    )
    needs = Needs(roles=("pitch",), conditions=("body_pitch_rad",), channels=("drawbar_pull",))

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces in the axes of the tilted frame."""
        angle = values["share"] * state.conditions.body_pitch_rad
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + angle * state.conditions.vertical_load_n)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with the pull in the axes of the tilted frame."""
        angle = values["share"] * signals.body_pitch_rad
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n + angle * signals.vertical_load_n)
