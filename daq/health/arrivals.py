"""When the frames of one message come: its usual rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

LEARN_NS = 3_000_000_000
"""Arrivals are watched for at least this long before their rate is believed."""
_LEARN_MOST = 8192
_REGULAR = 0.35
_WIDE_GAP = 1.5
_SMALLEST_BLOCK, _LARGEST_BLOCK, _LEAST_BLOCKS = 8, 64, 8
_EVEN = 0.05
_FLOORS, _NO_LOSS = 12, 0.7


@dataclass(frozen=True)
class Usual:
    """What is usual.

    Attributes
    ----------
    period_ns : float
    wide_ns : float
        Intervals beyond are gaps.
    jitter_ns : float
        By how much half of the frames are later than the least late ones, at most.
    """

    period_ns: float
    wide_ns: float
    jitter_ns: float


def learned_after(time_ns: IntArray, least: int) -> int | None:
    """Return after how many frames the rate of a message can be learned, None where it cannot yet.

    Parameters
    ----------
    time_ns : int64 array, shape (n,)
    least : int
        Intervals that it takes at any rate.
    """
    if len(time_ns) > _LEARN_MOST:
        return _LEARN_MOST
    long_enough = (
        np.flatnonzero(time_ns[least:] - time_ns[:1] >= LEARN_NS) if len(time_ns) > least else np.zeros(0, int)
    )
    return least + int(long_enough[0]) + 1 if len(long_enough) else None


def learn(time_ns: IntArray) -> Usual | None:
    """Return the usual rate of a message, None where its frames come when something happens.

    Lost frames make a few intervals long: they are left out. Frames that come in bursts have no usual interval; they
    are regular if blocks of them are.
    """
    gaps = np.maximum(np.diff(time_ns), 0)
    period = float(np.median(gaps))
    if period > 0 and _spread(gaps, period) <= _REGULAR and period > 0.5 * float(gaps.mean()):
        wide = max(_WIDE_GAP * period, 1.25 * float(np.quantile(gaps, 0.9)))
        even = _spread(gaps, period) < _EVEN
        near = np.abs(gaps - period) < (2 * _EVEN if even else 0.5) * period
        period = float(gaps[near].mean())
        counted, jitter_ns = _by_count(time_ns, period)
        return Usual(period if even else counted, wide, jitter_ns)
    size = min(len(gaps) // _LEAST_BLOCKS, _LARGEST_BLOCK)
    if size < _SMALLEST_BLOCK:
        return None
    blocks = np.diff(time_ns[: len(gaps) // size * size + 1 : size]) / size
    period = float(np.median(blocks))
    if period > 0 and _spread(blocks, period) <= _REGULAR / 2:
        wide = max(2 * _WIDE_GAP * period, 1.5 * float(np.quantile(gaps, 0.98)))
        counted, jitter_ns = _by_count(time_ns, period)
        return Usual(counted, wide, jitter_ns)
    return None


def keeps(time_ns: IntArray, usual: Usual) -> bool:
    """Return whether frames come at the usual rate between gaps, however long these are."""
    return _spread(np.maximum(np.diff(time_ns), 0), usual.period_ns) <= _REGULAR


def _by_count(time_ns: IntArray, period: float) -> tuple[float, float]:
    """Return span over count between the least late frames of blocks, and the jitter.

    Blocks between which frames are lost are left out.
    """
    late = time_ns - time_ns[0] - np.arange(len(time_ns)) * period
    size = len(time_ns) // _FLOORS
    if size < _SMALLEST_BLOCK:
        return period, float(np.median(np.abs(np.diff(time_ns) - period)))
    blocks = late[: size * _FLOORS].reshape(_FLOORS, size)
    jitter_ns = float(np.median(np.median(blocks, axis=1) - blocks.min(axis=1)))
    at = np.argmin(blocks, axis=1) + np.arange(_FLOORS) * size
    frames, span = np.diff(at), np.diff(time_ns[at])
    usual = float(np.median(span / frames))
    off = np.abs(span - frames * usual)
    kept = off < max(_NO_LOSS * usual, 4 * float(np.median(off)))
    return (float(span[kept].sum() / frames[kept].sum()) if kept.any() else usual), jitter_ns


def _spread(gaps: NDArray[np.float64] | IntArray, period: float) -> float:
    """Return how far the middle three quarters of the intervals are from the usual one, relative to it."""
    return float(np.quantile(np.abs(gaps - period), 0.75)) / period
