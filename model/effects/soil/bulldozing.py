"""The wheel pushes a wedge of soil in front of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Reaction, WheelState


class Bulldozing(Effect):
    """Dp -= a b (gamma Z^2 Kp/2 + 2 c sqrt(Kp) Z): passive earth pressure on a wall of height Z.

    sqrt(Kp) = tan(45 deg + phi/2) = tan phi + sqrt(1 + tan^2 phi). A part a of it only: compaction is in Eq. 8 already.
    """

    name = "bulldozing"
    summary = (
        "The wheel pushes soil in front of it: a share of the passive earth pressure on a wall as high as it is sunk."
    )
    source = "Rankine (1857), passive earth pressure; Wong (2008), Theory of Ground Vehicles, on bulldozing"
    shows = ("drawbar_pull",)
    parameters = (
        Parameter("fraction", "1", 0.0, 0.2, 0.0, 3.0, 0.6, "the whole would count compaction twice", side=1),
    )
    needs = Needs(conditions=("unit_weight_n_m3",), channels=("drawbar_pull",), two_loads=True)

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return the forces less what the wedge takes."""
        soil, depth = state.soil, state.sinkage
        root = soil.tan_phi + np.sqrt(1.0 + soil.tan_phi * soil.tan_phi)
        weight = 0.5 * state.conditions.unit_weight_n_m3 * depth * root
        wedge = state.width * depth * root * (weight + 2.0 * soil.cohesion)
        return replace(reaction, drawbar_pull=reaction.drawbar_pull - values["fraction"] * wedge)
