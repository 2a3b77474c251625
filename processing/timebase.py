"""Time stamps: order, gap-free stretches, joins with a tolerance, and the one time base of a run."""

from __future__ import annotations

import numpy as np

from daq import DataError, FloatArray, IndexArray, IntArray, moment

LATE_NS = 100_000_000
"""A stamp this much behind its predecessor is a step of the clock or a rogue, not a frame that queued."""
_MAX_STEPS = 100
_MAX_SAMPLES = 40_000_000


def seconds_since(time_ns: IntArray, origin_ns: int) -> FloatArray:
    """Return the seconds from `origin_ns` to each stamp."""
    return np.asarray((time_ns - origin_ns) * 1e-9, np.float64)


def in_order(time_ns: IntArray) -> IntArray:
    """Return the indices of the samples to keep, in time order.

    Frames that queued (at most `LATE_NS` late) are put in their place. Where stamps run back further, the smaller
    group is left out: a single rogue stamp, ahead or behind, or what came after a backward step of the clock.
    """
    if not np.any(np.diff(time_ns) < 0):
        return np.arange(len(time_ns))
    keep = np.arange(len(time_ns))
    for _ in range(_MAX_STEPS):
        stamps = time_ns[keep]
        peak = np.maximum.accumulate(stamps)
        behind = np.flatnonzero(stamps < peak - LATE_NS)
        if not len(behind):
            break
        first = behind[0]
        behind = behind[peak[behind] == peak[first]]
        ahead = np.flatnonzero(stamps[:first] > stamps[first] + LATE_NS)
        keep = np.delete(keep, ahead if len(ahead) < len(behind) else behind)
    else:
        stamps = time_ns[keep]
        keep = keep[stamps >= np.maximum.accumulate(stamps) - LATE_NS]
    return keep[np.argsort(time_ns[keep], kind="stable")]


def merge_equal_stamps(time_ns: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Replace samples that carry the same stamp by their mean; stamps must not decrease."""
    first = np.flatnonzero(np.diff(time_ns, prepend=np.iinfo(np.int64).min) != 0)
    if len(first) == len(time_ns):
        return time_ns, values
    count = np.diff(first, append=len(time_ns))
    return time_ns[first], np.add.reduceat(values, first) / count


def stretches(time_s: FloatArray, max_gap_s: float, least: int = 1) -> IntArray:
    """Return the gap-free stretches as (start, stop) index pairs, shape (k, 2).

    Stamps must not decrease; an interval longer than `max_gap_s` ends a stretch, and one of fewer than `least` samples
    is left out.
    """
    if not len(time_s):
        return np.zeros((0, 2), np.int64)
    breaks = np.flatnonzero(np.diff(time_s) > max_gap_s) + 1
    bounds = np.concatenate([[0], breaks, [len(time_s)]])
    pairs = np.column_stack([bounds[:-1], bounds[1:]])
    return np.asarray(pairs[pairs[:, 1] - pairs[:, 0] >= least])


def stretch_of(at_s: FloatArray, time_s: FloatArray, pairs: IntArray) -> IntArray:
    """Return the stretch each instant lies in (first to last sample included), -1 in a gap; shape of `at_s`."""
    if not len(pairs):
        return np.full(len(at_s), -1, np.int64)
    first, last = time_s[pairs[:, 0]], time_s[pairs[:, 1] - 1]
    which = np.searchsorted(first, at_s, side="right") - 1
    inside = (which >= 0) & (at_s <= last[np.maximum(which, 0)])
    return np.where(inside, which, -1)


def nearest(at: FloatArray | IntArray, stamps: FloatArray | IntArray) -> IndexArray:
    """Return the index of the stamp that is nearest to each instant, the later of two; there must be a stamp."""
    after = np.clip(np.searchsorted(stamps, at), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(at - stamps[before] < stamps[after] - at, before, after)


def as_of(at_ns: IntArray, source_ns: IntArray, tolerance_ns: int) -> IntArray:
    """Return the index of the latest source stamp at or before each instant, -1 where that is too old."""
    index = np.searchsorted(source_ns, at_ns, side="right") - 1
    if not len(source_ns):
        return index
    stale = (index < 0) | (at_ns - source_ns[np.maximum(index, 0)] > tolerance_ns)
    return np.where(stale, -1, index)


def interpolate(at_s: FloatArray, time_s: FloatArray, values: FloatArray, max_gap_s: float) -> FloatArray:
    """Interpolate linearly inside gap-free stretches; NaN in gaps and outside. Stamps must not decrease."""
    which = stretch_of(at_s, time_s, stretches(time_s, max_gap_s))
    if not len(time_s):
        return np.full(len(at_s), np.nan)
    return np.where(which >= 0, np.interp(at_s, time_s, values), np.nan)


def make_time_base(spans_ns: dict[str, tuple[int, int]], rate_hz: float) -> tuple[int, FloatArray]:
    """Lay one time base over everything that was received: UTC of the first sample in ns, and the times, shape (n,).

    `spans_ns` has the first and last stamp of each role that a sample needs, latency removed. The first sample is at a
    multiple of the sampling interval. `DataError` where there is no common time, less than two samples, or far too many
    (a clock that is wrong by years).
    """
    first_ns = min(first for first, _ in spans_ns.values())
    last_ns = max(last for _, last in spans_ns.values())
    shown = "; ".join(f"{role} {moment(a)} to {moment(b)}" for role, (a, b) in spans_ns.items())
    if max(first for first, _ in spans_ns.values()) > min(last for _, last in spans_ns.values()):
        raise DataError.of(
            "the channels are never there at the same time",
            found=shown,
            next_step="check that they come from one recording and one clock",
        )
    step_ns = round(1e9 / rate_hz)
    start_ns = -(-first_ns // step_ns) * step_ns
    count = int((last_ns - start_ns) * rate_hz / 1e9) + 1
    if last_ns < start_ns or count < 2:
        raise DataError.of(
            "the run is too short for one slip value", "", shown, "a second or more", "drive it again, longer"
        )
    if count > _MAX_SAMPLES:
        raise DataError.of(
            f"the run would span {(last_ns - first_ns) / 3.6e12:.4g} hours",
            found=shown,
            expected=f"at most {_MAX_SAMPLES / rate_hz / 3600:.0f} hours at {rate_hz:g} Hz",
            next_step="check the clock of the channel that starts or ends apart, or cut the recording",
        )
    return start_ns, np.arange(count) / rate_hz
