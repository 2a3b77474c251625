"""The soil's stiffness changes along the track."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.wheel_soil.conditions import Conditions
    from model.wheel_soil.soils import SoilState


class TrackDrift(Effect):
    """k exp(a x), x from -1 to 1 along the campaign's line, -1 where "out" starts."""

    name = "track_drift"
    summary = "The soil gets stiffer or softer along the track, from moisture or compaction; it follows the place."
    source = "first term of a soil that varies along a line; Wong (2008), Theory of Ground Vehicles, on its variability"
    parameters = (
        Parameter("log_stiffness_half_span", "1", 0.0, 0.1, -2.0, 2.0, 0.2, "20 to 50 % over a field, both ends"),
    )
    needs = Needs(conditions=("line_position",), both_directions=True)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil of the present place."""
        return soil.stiffer(np.exp(values["log_stiffness_half_span"] * conditions.line_position))
