"""Sheared soil loses strength."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.contact import Patch


class ShearSoftening(Effect):
    """tau (1 - q (1 - exp(-|j| / 0.15 m))) in place of tau of Eq. 4; at q = 0 Janosi & Hanamoto's curve."""

    name = "shear_softening"
    summary = "Shear stress falls again with displacement once its peak is passed: the residual strength is lower."
    source = "after Oida (1979) and Wong (2008), whose humped curves do not contain Eq. 4 as a limit; this form does"
    parameters = (
        Parameter("fraction", "1", 0.0, 0.2, 0.0, 0.95, 0.3, "Oida (1979): residual .4 to .9 of the peak", side=1),
    )

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with softening soil."""
        return replace(patch, softening=patch.softening + values["fraction"])
