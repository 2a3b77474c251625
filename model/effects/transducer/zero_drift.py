"""The transducer's zero of drawbar pull drifts over the campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class ZeroDrift(Effect):
    """Measured Dp = true Dp + d (t/T - 1/2) over the campaign's clock."""

    name = "zero_drift"
    kind = "measurement"
    summary = "The zero of drawbar pull drifts from the first run to the last, as a bridge does that warms up."
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
