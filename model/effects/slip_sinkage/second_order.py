"""Slip sinkage of a law that nobody has named yet: to second order in slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import Number

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions


class SecondOrder(Effect):
    """Z = Z0 + H s + Q s (1 - s) for s > 0; Q > 0 grows early and then less, Q < 0 late."""

    name = "slip_sinkage"
    form = "second_order"
    summary = "The wheel digs in with slip by H metres at full slip; whether early (Q > 0) or late is left open."
    source = "any law to second order in slip; the published ones of 1969 to 2010 are near it or in it"
    parameters = (
        Parameter("H_m", "m", 0.0, 0.02, 0.0, 0.5, 0.05, "Yang Tab. 3: .02 clay, .08 sand", side=1),
        Parameter("Q_m", "m", 0.0, 0.01, -0.5, 0.5, 0.05, "as H_m: the law may bend as much as it rises"),
    )
    needs = Needs(largest_slip=0.15)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return the sinkage of a driven wheel."""
        s = conditions.driving_slip
        return static_sinkage + values["H_m"] * s + values["Q_m"] * s * (1.0 - s)
