"""Soil is stiffer the faster it is loaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil.dual import value_of, where

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.soils import SoilState

REFERENCE_MPS = 2.0
SLOWEST_MPS = 0.2


class RateStiffness(Effect):
    """k (max(V, 0.2 m/s) / 2 m/s)^m: at 2 m/s the laboratory's soil, softer below and stiffer above."""

    name = "rate_stiffness"
    summary = "The soil bears more the faster the wheel drives over it."
    source = "Pope (1971), J. Terramechanics 8; Grahn (1991), J. Terramechanics 28 (pressure by penetration speed)"
    parameters = (
        Parameter("exponent", "1", 0.0, 0.1, 0.0, 1.0, 0.15, "Pope (1971): .05 to .25 clay, about 0 dry sand", side=1),
    )
    needs = Needs(conditions=("ground_speed_mps",))

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil at the present speed."""
        speed = conditions.ground_speed_mps
        speed = where(value_of(speed) < SLOWEST_MPS, SLOWEST_MPS, speed)
        return soil.stiffer(np.exp(values["exponent"] * np.log(speed * (1.0 / REFERENCE_MPS))))
