"""The transducer shows the load too large or too small by a share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Conditions


class LoadGain(Effect):
    """Measured W = (1 + e) true W."""

    name = "load_gain"
    kind = "measurement"
    summary = "Vertical load is scaled by a wrong gain of the transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: gains of the bridges; data sheets usually state 0.5 to 2 %"
    shows = ("vertical_load",)
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
    needs = Needs(two_loads=True)
    stage = 3

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n / (1.0 + values["relative"]))

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, vertical_load_n=signals.vertical_load_n * (1.0 + values["relative"]))
