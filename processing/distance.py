"""Distance along the track from ground speed."""

from __future__ import annotations

import numpy as np

from processing.timebase import FloatArray


def distance_of(time_s: FloatArray, ground_speed_mps: FloatArray) -> tuple[FloatArray, float]:
    """Integrate ground speed by the trapezium rule.

    Inside a gap the distance is NaN. Behind it the distance goes on as if the mean of the speeds at its ends had held:
    that is an offset of what follows, not a sample, and the second value says how much of it there is.

    Parameters
    ----------
    time_s, ground_speed_mps : float64 arrays, shape (n,)

    Returns
    -------
    distance_m : float64 array, shape (n,)
        0 at the first known speed.
    bridged_m : float
    """
    known = np.flatnonzero(np.isfinite(ground_speed_mps))
    distance = np.full(len(time_s), np.nan)
    if not len(known):
        return distance, 0.0
    speed = ground_speed_mps[known]
    parts = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s[known])
    distance[known] = np.concatenate([[0.0], np.cumsum(parts)])
    return distance, float(np.abs(parts[np.diff(known) > 1]).sum())
