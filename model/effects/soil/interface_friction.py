"""The wheel's surface is smoother than the soil."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.soils import SoilState


class InterfaceFriction(Effect):
    """tan delta = mu tan phi in Eq. 4; mu < 1, so ln mu < 0. Soil that is pushed or carried keeps its tan phi."""

    name = "interface_friction"
    summary = "Soil slides on the wheel before it shears in itself: friction at the rim is below that of the soil."
    source = "Potyondy (1961), Geotechnique 11:339-353 (friction between soils and construction materials)"
    parameters = (Parameter("ln_mu", "1", 0.0, -0.3, -2.0, 0.0, 0.4, "Potyondy (1961): delta/phi .54 to .98", side=-1),)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil with the friction of its interface."""
        return replace(soil, interface=soil.interface * np.exp(values["ln_mu"]))
