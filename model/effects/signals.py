"""What the sensors of a virtual test get to see, for measurement effects to change."""

from __future__ import annotations

from dataclasses import dataclass

from daq import FloatArray


@dataclass(frozen=True)
class Signals:
    """Histories of one run on one regular time base, shape (n,) each; SI.

    Attributes
    ----------
    time_s : since the start of the run
    drawbar_pull_n, driving_torque_nm, vertical_load_n : at the transducer
    ground_speed_mps : for the ground-speed sensor only
    wheel_speed_radps : for the wheel-speed sensor only
    campaign_time : float array, from -1/2 to 1/2 over the campaign's clock
    direction : 1 "out", -1 "back"
    """

    time_s: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    vertical_load_n: FloatArray
    ground_speed_mps: FloatArray
    wheel_speed_radps: FloatArray
    campaign_time: FloatArray
    direction: float
