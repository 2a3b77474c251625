"""The simulation takes its sinkage from a formula, the soil from the balance of its forces."""

from __future__ import annotations

from model.effects.base import Effect, Parameter, Values
from model.wheel_soil.dual import Number


class ClosedFormSinkage(Effect):
    """From Eq. 11 or 12 put straight into Eq. 1 (blend 0) to the load-consistent solution (blend 1).

    Exists only where the simulation under test is the literal one; a balanced one is consistent already.
    """

    name = "closed_form_sinkage"
    summary = (
        "The simulation's sinkage does not carry the measured load: the soil keeps its balance, the formula does not."
    )
    source = "Yang et al. (2016), Eq. 7 against Eq. 10-12: the literal laws carry 1.05 to 1.25 W on clay, 2.4 W on sand"
    parameters = (
        Parameter("blend", "1", 0.0, 0.5, -0.5, 1.5, 0.5, "0 the paper's literal form, 1 the balance of Eq. 7"),
    )
    reading = "literal"

    def load_consistency(self, share: Number, values: Values) -> Number:
        """Return how much of the load-consistent solution counts."""
        return share + values["blend"] * (1.0 - share)
