"""Slip sinkage after Vasil'ev: linear in slip (Eq. 11)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import Number

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions


class Vasilev(Effect):
    """Z = Z0 + H s for s > 0."""

    name = "slip_sinkage"
    form = "vasilev"
    own_symbols = True
    summary = "The wheel digs in with slip: sinkage grows by H metres from no slip to full slip, whatever the load."
    source = "Vasil'ev, Dokycheva, Utkin-Lubovtsov (1969); Yang et al. (2016), Eq. 11"
    parameters = (Parameter("H_m", "m", 0.0, 0.02, 0.0, 0.5, 0.05, "Yang Tab. 3: .02 clay, .08 sand", side=1),)
    needs = Needs(largest_slip=0.15)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Eq. 11."""
        return static_sinkage + values["H_m"] * conditions.driving_slip
