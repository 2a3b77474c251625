"""Ground speed held against wheel speed: residual latency and scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from processing.latency import SpeedSignals, residual_latency
from processing.rolling_radius import rolls_freely, speed_scale
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
    drawbar_pull_n: FloatArray,
    radius_m: float,
    rate_hz: float,
) -> SpeedComparison:
    """Estimate the residual latency on low slip, and the scale where the wheel rolls freely.

    Parameters
    ----------
    ground_speed_mps, rim_speed_mps, torque_nm, load_n, drawbar_pull_n : float64 arrays, shape (n,)
        On the time base; NaN where not to be used or not measured. Where torque is not, slip goes by drawbar pull.
    radius_m, rate_hz : float
    """
    measured = np.isfinite(torque_nm).any()
    traction = torque_nm / radius_m if measured else drawbar_pull_n
    if np.isfinite(load_n).any():
        traction = np.where(load_n > 0, traction / np.where(load_n > 0, load_n, 1.0), nan)
    latency, sigma = residual_latency(SpeedSignals(ground_speed_mps, rim_speed_mps, traction, rate_hz))
    free = np.flatnonzero(rolls_freely(rim_speed_mps, torque_nm, load_n, drawbar_pull_n, radius_m))
    free = free[:: max(1, -(-len(free) // _ROWS))]
    ground = _later(ground_speed_mps, free, (latency if isfinite(latency) else 0.0) * rate_hz)
    return SpeedComparison(latency, sigma, *speed_scale(ground, rim_speed_mps[free]))


def _later(values: FloatArray, rows: np.ndarray[tuple[int], np.dtype[np.int64]], lag: float) -> FloatArray:
    """Return the values `lag` samples after the rows, interpolated; NaN beyond the ends."""
    low = np.floor(rows + lag).astype(np.int64)
    share = rows + lag - low
    inside = (low >= 0) & (low + 1 < len(values))
    low = np.where(inside, low, 0)
    out = (1 - share) * values[low] + share * values[np.minimum(low + 1, len(values) - 1)]
    return np.where(inside, out, nan)
