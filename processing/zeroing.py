"""What the sensors read at standstill: facts for the report and the diagnosis. Nothing is subtracted."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from processing.processed_run import Segment, Standstill
from processing.robust import robust_spread
from processing.segments import runs_of
from processing.timebase import FloatArray


def standstills(
    time_s: FloatArray, segments: NDArray[np.uint8], channels: Mapping[str, FloatArray], cutoff_hz: float
) -> tuple[Standstill, ...]:
    """Return one `Standstill` per standing period.

    Parameters
    ----------
    time_s : float64 array, shape (n,)
    segments : uint8 array, shape (n,)
        See `Segment`.
    channels : mapping role -> float64 array, shape (n,)
        NaN is left out; a channel without values in a period is not named there.
    cutoff_hz : float
        Of the filter: a second holds about 2.5 times as many independent samples.
    """
    found = []
    for start, stop in runs_of(segments):
        if segments[start] != Segment.STANDSTILL:
            continue
        levels, sigmas = {}, {}
        for role, values in channels.items():
            part = values[start:stop]
            part = part[np.isfinite(part)]
            if len(part) < 2:
                continue
            independent = max(2.5 * cutoff_hz * len(part) * float(time_s[1] - time_s[0]), 1.0)
            middle = float(np.median(part))
            levels[role] = middle
            sigmas[role] = 1.25 * robust_spread(part - middle) / sqrt(independent)
        found.append(Standstill(float(time_s[start]), float(time_s[stop - 1] - time_s[start]), levels, sigmas))
    return tuple(found)
