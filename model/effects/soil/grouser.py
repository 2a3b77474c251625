"""Lugs shear the soil outside the rim."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.contact import Patch


class Grouser(Effect):
    """Soil shears at r + h and torque acts there: j = (r + h)(theta_1 - theta) - (V/omega)(sin theta_1 - sin theta)."""

    name = "grouser"
    summary = "Lugs hold the soil between them: it shears on a circle larger than the wheel, with a longer arm."
    source = "Wong (2008), Theory of Ground Vehicles; Ding et al. (2011), J. Terramechanics 48:27-45"
    parameters = (
        Parameter("height_m", "m", 0.0, 0.01, 0.0, 0.2, 0.02, "lugs of 5 to 20 mm; about half of them counts", side=1),
    )
    needs = Needs(lugs=True)

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch with lugs."""
        return replace(patch, lug_height=patch.lug_height + values["height_m"])
