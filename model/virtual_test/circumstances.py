"""What a virtual run happens under, besides slip and load: everything that an effect may ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.config import RunInfo
from model.conditions import Conditions
from model.virtual_test.motion import Motion
from model.wheel_soil import WheelSoilModel

FloatArray = NDArray[np.float64]

_USUAL_SPEED_MPS = 1.25
"""Mean ground speed of a run, about."""


@dataclass(frozen=True)
class Circumstances:
    """A run's place in its campaign.

    Attributes
    ----------
    info : RunInfo
    inflation_kpa : float
        Of the tyre, whether or not the run's owner states it.
    elapsed_s, campaign_s : float
        From the start of the campaign to the start of the run, and to the end of the campaign.
    line_m : (low, high)
        Where the campaign's line starts and ends, from where "out" starts.
    """

    info: RunInfo
    inflation_kpa: float
    elapsed_s: float
    campaign_s: float
    line_m: tuple[float, float]

    @property
    def direction(self) -> float:
        """1 "out", -1 "back"."""
        return -1.0 if self.info.direction == "back" else 1.0

    def campaign_time(self, time_s: FloatArray) -> FloatArray:
        """Return the campaign's clock, from -1/2 to 1/2, at times since the start of the run."""
        return (self.elapsed_s + time_s) / self.campaign_s - 0.5

    def line_position(self, track_position_m: FloatArray) -> FloatArray:
        """Return the place on the campaign's line, from -1 to 1."""
        low, high = self.line_m
        return 2.0 * (track_position_m - low) / (high - low) - 1.0

    def conditions(
        self, model: WheelSoilModel, motion: Motion, vertical_load_n: FloatArray, track_position_m: FloatArray
    ) -> Conditions:
        """Return what the wheel is put through, in full."""
        step_s = float(motion.time_s[1] - motion.time_s[0])
        return Conditions(
            slip=motion.slip,
            vertical_load_n=vertical_load_n,
            ground_speed_mps=motion.ground_speed_mps,
            wheel_speed_radps=motion.wheel_speed_radps,
            ground_acceleration_mps2=motion.ground_acceleration_mps2,
            ground_jerk_mps3=np.gradient(motion.ground_acceleration_mps2, step_s),
            wheel_acceleration_radps2=motion.wheel_acceleration_radps2,
            line_position=self.line_position(track_position_m),
            campaign_time=self.campaign_time(motion.time_s),
            direction=self.direction,
            pass_number=float(self.info.pass_number),
            inflation_kpa=self.inflation_kpa,
            unit_weight_n_m3=model.soil.unit_weight_n_m3,
        )

    def usual_conditions(self, model: WheelSoilModel, slip: FloatArray, vertical_load_n: float) -> Conditions:
        """Return an even drive at the usual speed in the middle of the line, for slips below 0."""
        return Conditions(
            slip=slip,
            vertical_load_n=np.full(len(slip), vertical_load_n),
            ground_speed_mps=_USUAL_SPEED_MPS,
            wheel_speed_radps=_USUAL_SPEED_MPS * (1.0 + slip) / model.wheel.radius_m,
            ground_acceleration_mps2=0.0,
            ground_jerk_mps3=0.0,
            wheel_acceleration_radps2=0.0,
            line_position=0.0,
            campaign_time=0.0,
            direction=self.direction,
            pass_number=float(self.info.pass_number),
            inflation_kpa=self.inflation_kpa,
            unit_weight_n_m3=model.soil.unit_weight_n_m3,
        )


def campaign_line_m(track_length_m: float, duration_s: float) -> tuple[float, float]:
    """Return the line that runs of a duration cover: "out" drives it from 0, "back" from the track's end."""
    driven = _USUAL_SPEED_MPS * duration_s
    return min(0.0, track_length_m - driven), max(track_length_m, driven)
