"""The line is not level."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Reaction, WheelState


class Slope(Effect):
    """Dp -= direction W sin a; uphill on "out" is positive, and on "back" it is downhill."""

    name = "slope"
    summary = "The track is not level: part of the wheel's load pulls it back uphill and forward downhill."
    source = "statics; Wong (2008), Theory of Ground Vehicles, grade resistance"
    shows = ("drawbar_pull",)
    parameters = (Parameter("angle_rad", "rad", 0.0, 0.02, -0.3, 0.3, 0.03, "a field that looks level: 1 to 2 deg"),)
    needs = Needs(conditions=("direction",), channels=("drawbar_pull",), both_directions=True, standstill=True)
    at_standstill = True

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces with the load's share along the slope."""
        share = state.conditions.direction * np.sin(values["angle_rad"])
        pull = reaction.drawbar_pull - state.conditions.vertical_load_n * share
        return replace(reaction, drawbar_pull=pull)
