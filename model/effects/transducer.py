"""Errors of the wheel force transducer: gains, cross-talk, zeros and their drift, and the tilt of its frame.

A frame that is tilted by an angle a, nose up, reads Dp cos a + W sin a, to first order Dp + a W; the load loses a Dp,
which is neglected. A constant angle is cross-talk; `BodyPitch` is a frame that pitches with the body. The tilt comes
before the gains: what the bridges feel is in the frame's axes already.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from daq import ROLES
from model.effects.base import Effect, Needs, Parameter, Remedy, Signals, Values
from model.wheel_soil import Conditions, Reaction, WheelState, value_of, where


def _relative(*, start: float, scale: float) -> Parameter:
    source = "static weighing and pulling; an uncalibrated bridge may be off by several per cent"
    return Parameter("relative", "1", 0.0, start, -0.5, 0.5, scale, source)


class _Gain(Effect):
    """Measured = (1 + e) true, of the one channel that it shows in."""

    kind = "measurement"
    source = "MTS Systems (2008), SWIFT 30 manual: gains of the bridges; data sheets usually state 0.5 to 2 %"
    remedy = Remedy(scales=True)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        field = ROLES[self.shows[0]].field
        return replace(signals, **{field: getattr(signals, field) * (1.0 + values["relative"])})


class DrawbarPullGain(_Gain):
    """Measured Dp = (1 + e)(true Dp - m a) + m a: m a of the outboard mass is added to what the transducer reads."""

    name = "drawbar_pull_gain"
    summary = "Drawbar pull is scaled by a wrong gain of the transducer."
    error_text = "The drawbar pull reads {percent} {too much/too little}, in proportion to its size"
    abscissa = "prediction"
    shows = ("drawbar_pull",)
    parameters = (_relative(start=0.05, scale=0.08),)
    needs = Needs(channels=("drawbar_pull",))
    of_radius = -1
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads, compensated for the outboard mass."""
        mass = state.conditions.compensated_mass_kg
        added = where(value_of(mass) > 0.0, mass * state.conditions.ground_acceleration_mps2, 0.0)
        read = reaction.drawbar_pull - added
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["relative"] * read)


class TorqueGain(_Gain):
    """Measured T = (1 + e)(true T + I a) - I a: I a of the outboard inertia is taken off what the transducer reads."""

    name = "torque_gain"
    summary = "Driving torque is scaled by a wrong gain of the transducer."
    error_text = "The driving torque reads {percent} {too much/too little}, in proportion to its size"
    abscissa = "prediction"
    shows = ("driving_torque",)
    parameters = (_relative(start=0.04, scale=0.06),)
    needs = Needs(channels=("driving_torque",))
    of_radius = 1
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads, compensated for the outboard inertia."""
        inertia = state.conditions.compensated_inertia_kgm2
        taken_off = where(value_of(inertia) > 0.0, inertia * state.conditions.wheel_acceleration_radps2, 0.0)
        read = reaction.driving_torque + taken_off
        return replace(reaction, driving_torque=reaction.driving_torque + values["relative"] * read)


class LoadGain(_Gain):
    """Measured W = (1 + e) true W."""

    name = "load_gain"
    summary = "Vertical load is scaled by a wrong gain of the transducer."
    error_text = "The vertical load reads {percent} {too much/too little}"
    abscissa = "load"
    shows = ("vertical_load",)
    parameters = (_relative(start=0.04, scale=0.06),)
    needs = Needs(two_loads=True)
    stage = 3

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n / (1.0 + values["relative"]))


class Crosstalk(Effect):
    """Measured Dp = true Dp + k W with the true load; a tilt of the transducer by k rad does the same."""

    name = "crosstalk"
    kind = "measurement"
    summary = "A share of the vertical load shows in drawbar pull: cross-talk of the bridges, or a tilted transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: cross-talk matrix (KFXFZ -0.003); usually 0.3 to 1 %"
    error_text = "{percent} of the vertical load is {added to/taken off} the {channel}"
    abscissa = "load"
    shows = ("drawbar_pull",)
    parameters = (Parameter("coefficient", "1", 0.0, 0.01, -0.3, 0.3, 0.02, "1 deg of tilt is 0.017"),)
    needs = Needs(channels=("drawbar_pull",), two_loads=True, standstill=True)
    at_standstill = True
    remedy = Remedy("Check the transducer's tilt on the hub and its cross-talk matrix, and repeat the diagnosis.")
    stage = 2

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        load = state.conditions.vertical_load_n
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["coefficient"] * load)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        pull = signals.drawbar_pull_n + values["coefficient"] * signals.vertical_load_n
        return replace(signals, drawbar_pull_n=pull)


class _Zero(Effect):
    """Measured = true + o, of the one channel that it shows in; o is the only parameter."""

    kind = "measurement"
    source = "MTS Systems (2008), SWIFT 30 manual: zeros of the bridges; usually 0.1 to 0.5 % of the range"
    stage = 4

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        field = ROLES[self.shows[0]].field
        return replace(signals, **{field: getattr(signals, field) + values[self.parameters[0].name]})


class DrawbarPullZero(_Zero):
    """Measured Dp = true Dp + o, at standstill too."""

    name = "drawbar_pull_zero"
    summary = "Drawbar pull carries a constant offset."
    error_text = "The drawbar pull reads {size} {too much/too little} at every slip"
    abscissa = "slip"
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
    needs = Needs(channels=("drawbar_pull",), two_loads=True, standstill=True, zero_of="drawbar_pull")
    at_standstill = True

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["offset_n"])


class TorqueZero(_Zero):
    """Measured T = true T + o, at standstill too."""

    name = "torque_zero"
    summary = "Driving torque carries a constant offset."
    error_text = "The driving torque reads {size} {too much/too little} at every slip"
    abscissa = "slip"
    shows = ("driving_torque",)
    parameters = (Parameter("offset_nm", "N m", 0.0, 40.0, -1000.0, 1000.0, 60.0, "0.5 to 1 % of a 10 kN m range"),)
    needs = Needs(channels=("driving_torque",), standstill=True, zero_of="driving_torque")
    at_standstill = True

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, driving_torque=reaction.driving_torque + values["offset_nm"])


class LoadZero(_Zero):
    """Measured W = true W + o."""

    name = "load_zero"
    summary = "Vertical load carries a constant offset."
    error_text = "The vertical load reads {size} {too much/too little}"
    abscissa = "load"
    shows = ("vertical_load",)
    parameters = (
        Parameter(
            "offset_n",
            "N",
            0.0,
            300.0,
            -3000.0,
            3000.0,
            500.0,
            "1 to 2 % of a 25 kN range, or outboard weight taken off twice (75 kg: 740 N)",
        ),
    )
    needs = Needs(two_loads=True, zero_of="vertical_load")

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n - values["offset_n"])


class ZeroDrift(Effect):
    """Measured Dp = true Dp + d (t/T - 1/2) over the campaign's clock."""

    name = "zero_drift"
    kind = "measurement"
    summary = "The zero of drawbar pull drifts from the first run to the last, as a bridge does that warms up."
    each_wheel = True
    source = "MTS Systems (2008), SWIFT 30 manual: warm-up and zeros; usually 0.05 % of the range in 10 K"
    error_text = "The zero of the drawbar pull drifts by {size} over the campaign, {up/down}wards"
    abscissa = "time"
    shows = ("drawbar_pull",)
    parameters = (Parameter("campaign_span_n", "N", 0.0, 100.0, -2000.0, 2000.0, 150.0, "six runs of 5 to 50 N each"),)
    needs = Needs(conditions=("campaign_time",), channels=("drawbar_pull",), several_runs=True, standstill=True)
    at_standstill = True
    remedy = Remedy(
        "Determine the zero with the wheel lifted before and after the runs; processing interpolates between them.",
        paste="# record before.mcap and after.mcap, then:\n"
        "wheelsoil zero before.mcap after.mcap --vehicle vehicle.toml",
    )
    stage = 5

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        drift = values["campaign_span_n"] * state.conditions.campaign_time
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + drift)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        pull = signals.drawbar_pull_n + values["campaign_span_n"] * signals.campaign_time
        return replace(signals, drawbar_pull_n=pull)


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
    remedy = Remedy("Hold the transducer's stator at the hub's carrier, not at the body, and repeat the runs.")

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces in the axes of the tilted frame."""
        angle = values["share"] * state.conditions.body_pitch_rad
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + angle * state.conditions.vertical_load_n)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with the pull in the axes of the tilted frame."""
        angle = values["share"] * signals.body_pitch_rad
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n + angle * signals.vertical_load_n)
