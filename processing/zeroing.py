"""What the sensors read at standstill: facts for the report and the diagnosis. Nothing is subtracted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from processing.processed_run import Segment, Standstill
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
        means, sigmas = {}, {}
        for role, values in channels.items():
            part = values[start:stop]
            part = part[np.isfinite(part)]
            if len(part) < 2:
                continue
            duration_s = len(part) * float(time_s[1] - time_s[0])
            means[role] = float(part.mean())
            sigmas[role] = float(part.std()) / np.sqrt(max(2.5 * cutoff_hz * duration_s, 1.0))
        found.append(Standstill(float(time_s[start]), float(time_s[stop - 1] - time_s[start]), means, sigmas))
    return tuple(found)
