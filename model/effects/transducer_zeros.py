"""Zeros of the wheel force transducer, and their drift over a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.base import Signals
    from model.wheel_soil.conditions import Conditions, Reaction, WheelState

_SOURCE = "MTS Systems (2008), SWIFT 30 manual: zeros of the bridges; usually 0.1 to 0.5 % of the range"


class DrawbarPullZero(Effect):
    """Measured Dp = true Dp + o, at standstill too."""

    name = "drawbar_pull_zero"
    kind = "measurement"
    summary = "Drawbar pull carries a constant offset."
    source = _SOURCE
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
    stage = 4

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["offset_n"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, drawbar_pull_n=signals.drawbar_pull_n + values["offset_n"])


class TorqueZero(Effect):
    """Measured T = true T + o, at standstill too."""

    name = "torque_zero"
    kind = "measurement"
    summary = "Driving torque carries a constant offset."
    source = _SOURCE
    shows = ("driving_torque",)
    parameters = (Parameter("offset_nm", "N m", 0.0, 40.0, -1000.0, 1000.0, 60.0, "0.5 to 1 % of a 10 kN m range"),)
    needs = Needs(channels=("driving_torque",), standstill=True, zero_of="driving_torque")
    at_standstill = True
    stage = 4

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        return replace(reaction, driving_torque=reaction.driving_torque + values["offset_nm"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, driving_torque_nm=signals.driving_torque_nm + values["offset_nm"])


class LoadZero(Effect):
    """Measured W = true W + o."""

    name = "load_zero"
    kind = "measurement"
    summary = "Vertical load carries a constant offset."
    source = _SOURCE
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
    stage = 4

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n - values["offset_n"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, vertical_load_n=signals.vertical_load_n + values["offset_n"])


class ZeroDrift(Effect):
    """Measured Dp = true Dp + d (t/T - 1/2) over the campaign's clock."""

    name = "zero_drift"
    kind = "measurement"
    summary = "The zero of drawbar pull drifts from the first run to the last, as a bridge does that warms up."
    each_wheel = True
    source = "MTS Systems (2008), SWIFT 30 manual: warm-up and zeros; usually 0.05 % of the range in 10 K"
    shows = ("drawbar_pull",)
    parameters = (Parameter("campaign_span_n", "N", 0.0, 100.0, -2000.0, 2000.0, 150.0, "six runs of 5 to 50 N each"),)
    needs = Needs(conditions=("campaign_time",), channels=("drawbar_pull",), several_runs=True, standstill=True)
    at_standstill = True
    stage = 5

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        drift = values["campaign_span_n"] * state.conditions.campaign_time
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + drift)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        pull = signals.drawbar_pull_n + values["campaign_span_n"] * signals.campaign_time
        return replace(signals, drawbar_pull_n=pull)
