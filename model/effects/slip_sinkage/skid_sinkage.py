"""Skid sinkage: a braked wheel ploughs itself in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import Number

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions


class SkidSinkage(Effect):
    """Z = Z0 + H2 s_b^2 for s_b < 0; the laws of slip sinkage do not hold there."""

    name = "skid_sinkage"
    summary = "A braked wheel digs itself in, slowly at first and by H2 metres when it is locked."
    source = "found on the public single-wheel tests of Pavlov & Johnson (2019): left-out rms 1 mm, linear 8 mm"
    parameters = (
        Parameter(
            "H2_m",
            "m",
            0.0,
            0.1,
            0.0,
            1.0,
            0.6,
            "Pavlov & Johnson (2019): 35 mm, wheel of 58 mm",
            side=1,
            in_radii=True,
        ),
    )
    needs = Needs(braking=True)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return the sinkage of a braked wheel."""
        slip = conditions.braking_slip
        return static_sinkage + values["H2_m"] * slip * slip
