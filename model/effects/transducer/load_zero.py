"""The transducer's zero of the load is off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Conditions


class LoadZero(Effect):
    """Measured W = true W + o."""

    name = "load_zero"
    kind = "measurement"
    summary = "Vertical load carries a constant offset."
    source = "MTS Systems (2008), SWIFT 30 manual: zeros of the bridges; usually 0.1 to 0.5 % of the range"
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
    needs = Needs(two_loads=True)
    stage = 4

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the conditions with the true load."""
        return replace(conditions, vertical_load_n=conditions.vertical_load_n - values["offset_n"])

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        return replace(signals, vertical_load_n=signals.vertical_load_n + values["offset_n"])
