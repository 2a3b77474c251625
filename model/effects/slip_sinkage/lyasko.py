"""Slip sinkage after Lyasko: convex in slip, in proportion to the static sinkage (Eq. 12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import Number

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions


class Lyasko(Effect):
    """Z = Z0 (1 + m1 s)/(1 - m2 s) for s > 0; a pole at s = 1/m2, so m2 < 1."""

    name = "slip_sinkage"
    form = "lyasko"
    own_symbols = True
    summary = "The wheel digs in with slip, in proportion to its static sinkage and faster at high slip."
    source = "Lyasko (2010), J. Terramechanics 47:21-31; Yang et al. (2016), Eq. 12"
    parameters = (
        Parameter(
            "m1", "1", 0.0, 0.1, -1.0, 20.0, 0.35, "Yang Tab. 3: .1 clay, .6 sand; only m1 + m2 is well known", side=1
        ),
        Parameter("m2", "1", 0.0, 0.05, -1.0, 0.95, 0.35, "Yang Tab. 3: .05 clay, .03 sand", side=1),
    )
    total = "p"
    needs = Needs(largest_slip=0.15)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Eq. 12."""
        s = conditions.driving_slip
        return static_sinkage * (1.0 + values["m1"] * s) / (1.0 - values["m2"] * s)
