"""What makes the soil stiffer or softer: speed, passes and the place on the track."""

from __future__ import annotations

import numpy as np

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil import Conditions, SoilState, value_of, where

SLOWEST_MPS = 0.2


class RateStiffness(Effect):
    """k (max(V, 0.2 m/s) / V0)^m: at V0 the laboratory's soil, softer below and stiffer above.

    V0 is 2 m/s, or, where terrain.toml states `plate_speed_mps`, the speed at which the wheel presses the soil as fast
    as the plate did (`SoilState.reference_speed`).
    """

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
        return soil.stiffer(np.exp(values["exponent"] * np.log(speed * (1.0 / soil.reference_speed))))


class MultiPass(Effect):
    """k (1 + a)^(log2 pass): 1 + a times as stiff whenever the number of passes doubles; positive for every a > -1."""

    name = "multi_pass"
    summary = (
        "Passes compact the soil of the track (below 0: loosen it): stiffer by this share with each doubling of them."
    )
    source = "Holm (1969), J. Terramechanics 6:47-71 (multi-pass behaviour of a pneumatic tire)"
    parameters = (
        Parameter("per_pass", "1", 0.0, 0.1, -0.3, 3.0, 0.15, "Holm (1969): most of the change in the first passes"),
    )
    needs = Needs(conditions=("pass_number",), several_passes=True)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil of the present pass."""
        return soil.stiffer(np.exp(np.log(1.0 + values["per_pass"]) * np.log2(value_of(conditions.pass_number))))


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
