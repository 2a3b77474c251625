"""Gains of the wheel force transducer, and its cross-talk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import value_of, where

if TYPE_CHECKING:
    from model.effects.base import Signals
    from model.wheel_soil.conditions import Conditions, Reaction, WheelState

_SOURCE = "MTS Systems (2008), SWIFT 30 manual: gains of the bridges; data sheets usually state 0.5 to 2 %"


def _relative(*, start: float, scale: float) -> Parameter:
    source = "static weighing and pulling; an uncalibrated bridge may be off by several per cent"
    return Parameter("relative", "1", 0.0, start, -0.5, 0.5, scale, source)


class DrawbarPullGain(Effect):
    """Measured Dp = (1 + e)(true Dp - m a) + m a: m a of the outboard mass is added to what the transducer reads."""

    name = "drawbar_pull_gain"
    kind = "measurement"
    summary = "Drawbar pull is scaled by a wrong gain of the transducer."
    source = _SOURCE
    shows = ("drawbar_pull",)
    parameters = (_relative(start=0.05, scale=0.08),)
    needs = Needs(channels=("drawbar_pull",))
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads, compensated for the outboard mass."""
        mass = state.conditions.compensated_mass_kg
        added = where(value_of(mass) > 0.0, mass * state.conditions.ground_acceleration_mps2, 0.0)
        read = reaction.drawbar_pull - added
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["relative"] * read)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n * (1.0 + values["relative"]))


class TorqueGain(Effect):
    """Measured T = (1 + e)(true T + I a) - I a: I a of the outboard inertia is taken off what the transducer reads."""

    name = "torque_gain"
    kind = "measurement"
    summary = "Driving torque is scaled by a wrong gain of the transducer."
    source = _SOURCE
    shows = ("driving_torque",)
    parameters = (_relative(start=0.04, scale=0.06),)
    needs = Needs(channels=("driving_torque",))
    stage = 1

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads, compensated for the outboard inertia."""
        inertia = state.conditions.compensated_inertia_kgm2
        taken_off = where(value_of(inertia) > 0.0, inertia * state.conditions.wheel_acceleration_radps2, 0.0)
        read = reaction.driving_torque + taken_off
        return replace(reaction, driving_torque=reaction.driving_torque + values["relative"] * read)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, driving_torque_nm=signals.driving_torque_nm * (1.0 + values["relative"]))


class LoadGain(Effect):
    """Measured W = (1 + e) true W."""

    name = "load_gain"
    kind = "measurement"
    summary = "Vertical load is scaled by a wrong gain of the transducer."
    source = _SOURCE
    shows = ("vertical_load",)
    parameters = (_relative(start=0.04, scale=0.06),)
    needs = Needs(two_loads=True)
    stage = 3

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n / (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, vertical_load_n=signals.vertical_load_n * (1.0 + values["relative"]))


class Crosstalk(Effect):
    """Measured Dp = true Dp + k W with the true load; a tilt of the transducer by k rad does the same."""

    name = "crosstalk"
    kind = "measurement"
    summary = "A share of the vertical load shows in drawbar pull: cross-talk of the bridges, or a tilted transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: cross-talk matrix (KFXFZ -0.003); usually 0.3 to 1 %"
    shows = ("drawbar_pull",)
    parameters = (Parameter("coefficient", "1", 0.0, 0.01, -0.3, 0.3, 0.02, "1 deg of tilt is 0.017"),)
    needs = Needs(channels=("drawbar_pull",), two_loads=True, standstill=True)
    at_standstill = True
    stage = 2

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        load = state.conditions.vertical_load_n
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["coefficient"] * load)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        pull = signals.drawbar_pull_n + values["coefficient"] * signals.vertical_load_n
        return replace(signals, drawbar_pull_n=pull)
