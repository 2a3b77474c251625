"""The normal stress peaks in front of the bottom of the wheel."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Parameter, Values
from model.wheel_soil.dual import value_of, where

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.contact import Patch

FOREMOST = 0.95
"""Of theta_1: the peak stays behind the entry."""


class StressPeakShift(Effect):
    """theta_m = (c1 + c2 max(s, 0)) theta_1; behind it the stress falls as it rose in front (Wong & Reece).

    sigma(theta) = k r^n [cos(theta_1 - (theta - theta_2)/(theta_m - theta_2) (theta_1 - theta_m)) - cos theta_1]^n.
    """

    name = "stress_peak_shift"
    summary = "The pressure under the wheel peaks ahead of its lowest point, and farther ahead the more it slips."
    source = "Wong & Reece (1967), J. Terramechanics 4(1):81-98"
    parameters = (
        Parameter("c1", "1", 0.0, 0.2, 0.0, 0.9, 0.3, "Wong & Reece (1967): .18 loose, .43 compact sand", side=1),
        Parameter("c2", "1", 0.0, 0.2, 0.0, 0.9, 0.3, "Wong & Reece (1967): .32", side=1),
    )

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with its peak."""
        share = values["c1"] + values["c2"] * conditions.driving_slip
        share = where(value_of(share) < FOREMOST, share, FOREMOST)
        return replace(patch, peak_angle=share * patch.entry_angle)
