"""The tyre is not rigid: its contact is that of a larger wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.conditions import REFERENCE_INFLATION_KPA
from model.wheel_soil.dual import Number

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions

REFERENCE_LOAD_N = 10e3


class TyreFlattening(Effect):
    """The contact has the radius r (1 + a W/10 kN 340 kPa/p): of the whole contact, not of the slip."""

    name = "tyre_flattening"
    summary = (
        "The tyre flattens under load: its contact is longer and flatter than a rigid wheel's, more at low pressure."
    )
    source = "larger substitute circle, as in Harnisch et al. (2005), Vehicle System Dynamics 43, suppl. 1"
    parameters = (Parameter("radius_gain", "1", 0.0, 0.1, 0.0, 2.0, 0.15, "10 to 20 % at 340 kPa and 10 kN", side=1),)
    needs = Needs(conditions=("inflation_kpa",), pressures=True)

    def contact_radius(self, radius: Number, conditions: Conditions, values: Values) -> Number:
        """Return the radius of the substitute circle."""
        load = conditions.vertical_load_n * (1.0 / REFERENCE_LOAD_N)
        return radius * (1.0 + values["radius_gain"] * load * REFERENCE_INFLATION_KPA / conditions.inflation_kpa)
