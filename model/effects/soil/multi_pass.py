"""Soil gets stiffer (or softer) from pass to pass in one track."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.soils import SoilState


class MultiPass(Effect):
    """k (1 + a (pass - 1))."""

    name = "multi_pass"
    summary = "Every pass changes the soil of the track: it is compacted (a > 0) or loosened (a < 0)."
    source = "Holm (1969), J. Terramechanics 6:47-71 (multi-pass behaviour of a pneumatic tire)"
    parameters = (
        Parameter("per_pass", "1", 0.0, 0.1, -0.3, 3.0, 0.15, "Holm (1969): most of the change in the first passes"),
    )
    needs = Needs(conditions=("pass_number",), several_passes=True)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil of the present pass."""
        return soil.stiffer(1.0 + values["per_pass"] * (conditions.pass_number - 1.0))
