"""Tilts of the frame in whose axes the transducer reads: a share of the vertical load shows in drawbar pull.

A frame that is tilted by an angle a, nose up, reads Dp cos a + W sin a, to first order Dp + a W; of the load a Dp is
missing, 10 N at most, which is neglected. A constant angle is cross-talk. Here it grows with torque, or with the pitch
of the body. The tilt comes before the gains: what the bridges feel is in the frame's axes already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.effects.hub_tilt import hub_tilt_per_torque

if TYPE_CHECKING:
    from model.effects.base import Signals
    from model.wheel_soil.conditions import Reaction, WheelState
    from processing import ProcessedRun

_PER_KILO = 1e-3


class AxleWindup(Effect):
    """Measured Dp = true Dp + c T W, with c in rad per kN m of driving torque."""

    name = "axle_windup"
    kind = "measurement"
    summary = "The axle winds up under torque and tilts the transducer's frame: vertical load shows in drawbar pull."
    source = "SAE HS-788 (1982), Manual on Design and Application of Leaf Springs: wind-up under driving torque"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter(
            "angle_rad_per_knm",
            "rad/(kN m)",
            0.0,
            0.001,
            -0.02,
            0.02,
            0.002,
            "0.1 to 0.5 deg at the full torque of such a wheel, 2 to 3 kN m; nose up on a beam axle",
        ),
    )
    needs = Needs(roles=("wheel_acceleration_x",), channels=("drawbar_pull",))

    @classmethod
    def direct_estimate(cls, runs: Sequence[ProcessedRun]) -> tuple[float, float] | None:
        """Return the angle of the accelerometer at the hub over the torque, in rad per kN m, and its one-sigma."""
        return hub_tilt_per_torque(runs)

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces in the axes of the tilted frame."""
        angle = values["angle_rad_per_knm"] * _PER_KILO * reaction.driving_torque
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + angle * state.conditions.vertical_load_n)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with the pull in the axes of the tilted frame."""
        angle = values["angle_rad_per_knm"] * _PER_KILO * signals.driving_torque_nm
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n + angle * signals.vertical_load_n)


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
