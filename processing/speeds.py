"""Ground speed held against wheel speed: residual latency and scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from processing.latency import residual_latency
from processing.rolling_radius import hardly_slipping, speed_scale
from processing.timebase import FloatArray

_ROWS = 10_000


@dataclass(frozen=True)
class SpeedComparison:
    """Delay of ground speed (positive: late) in s, ground speed over rim speed, and their sigmas; NaN where unknown."""

    latency_s: float = nan
    latency_sigma_s: float = nan
    scale: float = nan
    scale_sigma: float = nan


def compare_speeds(
    ground_speed_mps: FloatArray,
    rim_speed_mps: FloatArray,
    torque_nm: FloatArray,
    load_n: FloatArray,
    radius_m: float,
    rate_hz: float,
) -> SpeedComparison:
    """Estimate latency and scale on samples that hardly slip.

    Parameters
    ----------
    ground_speed_mps, rim_speed_mps, torque_nm, load_n : float64 arrays, shape (n,)
        On the time base; NaN where not to be used or not measured.
    radius_m, rate_hz : float
    """
    chosen = hardly_slipping(rim_speed_mps, torque_nm, load_n, radius_m)
    delay = residual_latency(ground_speed_mps, rim_speed_mps, torque_nm, chosen, rate_hz)
    lag = (delay.latency_s if isfinite(delay.latency_s) else 0.0) * rate_hz
    rows = np.flatnonzero(chosen)
    rows = rows[:: max(1, -(-len(rows) // _ROWS))]
    ahead = np.clip(np.floor(rows + lag).astype(np.int64), 0, max(len(ground_speed_mps) - 2, 0))
    share = rows + lag - ahead
    ground = (1 - share) * ground_speed_mps[ahead] + share * ground_speed_mps[ahead + 1]
    ground[(share < 0) | (share > 1)] = nan
    scale, sigma = speed_scale(ground, rim_speed_mps[rows], torque_nm[rows], np.ones(len(rows), np.bool_))
    return SpeedComparison(delay.latency_s, delay.sigma_s, scale, sigma)
