"""Slip sinkage after Ding: the sinkage exponent grows with slip (Eq. 13)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.soils import SoilState


class Ding(Effect):
    """N = n + n1 s for s > 0, in the stress law and in whatever gives the static sinkage.

    k keeps its number: for Z < 1 m a larger exponent is a softer soil (the unit Pa/m^N holds for Z in metres).
    """

    name = "slip_sinkage"
    form = "ding"
    own_symbols = True
    summary = "The wheel digs in with slip because the sheared soil gets softer: the sinkage exponent grows with slip."
    source = "Ding et al. (2010), J. Cent. South Univ. Technol. 17:129-135; Yang et al. (2016), Eq. 13"
    parameters = (Parameter("n1", "1", 0.0, 0.3, 0.0, 2.0, 0.3, "Yang Tab. 3: .35 clay, .53 sand", side=1),)
    needs = Needs(largest_slip=0.15)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil with N of Eq. 13."""
        return replace(soil, exponent=soil.exponent + values["n1"] * conditions.driving_slip)
