"""Slip ratio of Eq. 6 and its braking counterpart, with propagated uncertainty; standstill, drive, coast and brake."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq import BoolArray, FloatArray, IntArray
from processing.processed_run import Segment

_ROWS_AT_ONCE = 1 << 16
"""Rows at once: a long run's temporaries stay small."""
_LEAST_SLIP_MPS = 0.5
_FAST_MPS = 2.0
"""A vehicle that gets no faster has thresholds in proportion."""
_MOVING_SHARE = 0.1
_STALLED_SHARE, _WORKING_SHARE = 0.25, 0.1
_REST_MPS = 0.15
_MOVING_MPS = 0.3
_REST_SECONDS = 0.5
_SHORTEST_SECONDS = 0.3
_LOW_TRACTION = 0.03
_DRIVE_MPS2, _BRAKE_MPS2 = 0.2, 0.5
_DRIVEN_SLIP = 0.05


def pace_of(rim_speed_mps: FloatArray, ground_speed_mps: FloatArray) -> float:
    """Return the share of the usual thresholds of speed that suits a run: 1 for one that reaches 2 m/s, less below.

    Reached is what 5 % of its moving samples exceed, by rim or ground. The arrays have shape (n,).
    """
    larger = np.fmax(np.abs(rim_speed_mps), np.abs(ground_speed_mps))
    larger = larger[np.isfinite(larger)]
    if not len(larger):
        return 1.0
    moving = larger[larger > _MOVING_SHARE * float(np.quantile(larger, 0.999))]
    reached = float(np.quantile(moving, 0.95)) if len(moving) else 0.0
    return min(1.0, reached / _FAST_MPS) or 1.0


def least_slip_speed(pace: float) -> float:
    """Return the larger speed below which no slip is formed, m/s."""
    return _LEAST_SLIP_MPS * pace


def slip_of(rim_speed_mps: FloatArray, ground_speed_mps: FloatArray, min_speed_mps: float) -> FloatArray:
    """Return the slip: (r omega - V)/(r omega) driving (Eq. 6), (r omega - V)/V braking.

    Both are (r omega - V) over the larger speed, so that exchanging the speeds changes the sign only. The arrays have
    shape (n,); NaN where the larger speed is below `min_speed_mps`.
    """
    larger = np.maximum(rim_speed_mps, ground_speed_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        slip = (rim_speed_mps - ground_speed_mps) / larger
    return np.where(larger >= min_speed_mps, slip, np.nan)


def slip_sigma(
    rim_speed_mps: FloatArray,
    ground_speed_mps: FloatArray,
    rim_sigma_mps: FloatArray,
    ground_sigma_mps: FloatArray,
    min_speed_mps: float,
) -> FloatArray:
    """Return the one-sigma of the slip to first order: 1 - |s| = smaller/larger, the two speeds being independent.

    All arrays have shape (n,); NaN where the larger speed is below `min_speed_mps`.
    """
    sigma = np.empty(len(rim_speed_mps))
    for start in range(0, len(sigma), _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        speeds = np.stack([rim_speed_mps[rows], ground_speed_mps[rows]])
        sigmas = np.stack([rim_sigma_mps[rows], ground_sigma_mps[rows]])
        sigma[rows] = _sigma(speeds, sigmas, min_speed_mps)
    return sigma


def _sigma(speeds: FloatArray, sigmas: FloatArray, min_speed_mps: float) -> FloatArray:
    """Return `slip_sigma` of a block; rim and ground are the rows."""
    driving = speeds[0] >= speeds[1]
    (larger, smaller), (sigma_larger, sigma_smaller) = (np.where(driving, x, x[::-1]) for x in (speeds, sigmas))
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.hypot(sigma_smaller, smaller / larger * sigma_larger) / larger
    return np.where(larger >= min_speed_mps, sigma, np.nan)


def segment(
    rim_speed_mps: FloatArray,
    ground_speed_mps: FloatArray,
    acceleration_mps2: FloatArray,
    slip: FloatArray,
    torque_over_radius_n: FloatArray,
    load_n: FloatArray,
    rate_hz: float,
    pace: float = 1.0,
) -> NDArray[np.uint8]:
    """Return the `Segment` of each sample; all arrays of shape (n,), all NaN where not measured.

    Standstill: both speeds below 0.15 m/s for at least 0.5 s, left at 0.3 m/s. Drive and brake by the torque where it
    is measured (|T|/r above 3 % of the load, or of the largest |T|/r without load; left at half of it), else by slip
    (5 %) and acceleration (0.2 and -0.5 m/s2); coast is in between. Pieces under 0.3 s join what was before. Unknown
    where a speed is missing; lost frames of less than 0.5 s do not end a standstill. `pace` scales the speeds.
    """
    known = np.isfinite(rim_speed_mps) & np.isfinite(ground_speed_mps)
    fastest = np.fmax(np.abs(rim_speed_mps), np.abs(ground_speed_mps))
    lost = _at_least(~known, _REST_SECONDS * rate_hz)
    resting = _hold(known & (fastest < _REST_MPS * pace), fastest > _MOVING_MPS * pace, lost)
    resting &= _at_least(resting, _REST_SECONDS * rate_hz)
    driven = _driven(acceleration_mps2, slip, torque_over_radius_n, load_n, known)
    kind = np.where(driven > 0, Segment.DRIVE, np.where(driven < 0, Segment.BRAKE, Segment.COAST))
    kind = np.where(resting, Segment.STANDSTILL, kind)
    kind = np.where(known | resting, kind, Segment.UNKNOWN).astype(np.uint8)
    return _without_short(kind, _SHORTEST_SECONDS * rate_hz)


def stalled(segments: NDArray[np.uint8], torque_nm: FloatArray) -> BoolArray:
    """Return where a wheel stands under a torque that works at it: no standstill that shows zeros or noise.

    Its median torque is above a quarter of what 5 % of the run's samples exceed, and varies by more than a tenth of
    that: held brakes keep it constant. Arrays of shape (n,).
    """
    out = np.zeros(len(segments), np.bool_)
    known = np.abs(torque_nm[np.isfinite(torque_nm)])
    large = float(np.quantile(known, 0.95)) if len(known) else 0.0
    for start, stop in runs_of(segments) if large > 0 else ():
        part = torque_nm[start:stop]
        part = part[np.isfinite(part)]
        if segments[start] == Segment.STANDSTILL and len(part):
            low, middle, high = np.quantile(part, (0.05, 0.5, 0.95))
            out[start:stop] = abs(middle) > _STALLED_SHARE * large and high - low > _WORKING_SHARE * large
    return out


def runs_of(labels: NDArray[np.uint8] | BoolArray) -> IntArray:
    """Return (start, stop) of every run of equal labels, shape (k, 2)."""
    if not len(labels):
        return np.zeros((0, 2), np.int64)
    bounds = np.concatenate([[0], np.flatnonzero(labels[1:] != labels[:-1]) + 1, [len(labels)]])
    return np.column_stack([bounds[:-1], bounds[1:]])


def _driven(
    acceleration: FloatArray, slip: FloatArray, force: FloatArray, load: FloatArray, known: BoolArray
) -> NDArray[np.int8]:
    """Return 1 driving, -1 braking, 0 neither."""
    size = np.abs(force[known & np.isfinite(force)])
    if len(size):
        scale = load[known & (load > 0)]
        threshold = _LOW_TRACTION * float(np.median(scale) if len(scale) else size.max())
        up, down = _both_ways(force, threshold, threshold, ~known)
    else:
        by_slip = _both_ways(slip, _DRIVEN_SLIP, _DRIVEN_SLIP, ~known)
        by_speed = _both_ways(acceleration, _DRIVE_MPS2, _BRAKE_MPS2, ~known)
        up, down = by_slip[0] | by_speed[0], by_slip[1] | by_speed[1]
        up, down = up & ~by_slip[1], down & ~by_slip[0]
    return up.astype(np.int8) - down.astype(np.int8)


def _both_ways(signal: FloatArray, above: float, below: float, cut: BoolArray) -> tuple[BoolArray, BoolArray]:
    cut = cut | ~np.isfinite(signal)
    up = _hold(signal > above, signal < above / 2, cut)
    return up, _hold(signal < -below, signal > -below / 2, cut)


def _hold(enter: BoolArray, leave: BoolArray, cut: BoolArray) -> BoolArray:
    """Return a state with hysteresis: on at `enter`, off at `leave` or `cut`, else as before (off at the start)."""
    off = leave | cut
    decided = np.where(enter | off, np.arange(len(enter)), -1)
    last = np.maximum.accumulate(decided) if len(decided) else decided
    return np.asarray((last >= 0) & (enter & ~off)[np.maximum(last, 0)])


def _at_least(state: BoolArray, samples: float) -> BoolArray:
    """Return where a run of True is at least so long."""
    long = np.zeros(len(state), np.bool_)
    for start, stop in runs_of(state):
        long[start:stop] = state[start] and stop - start >= samples
    return long


def _without_short(kind: NDArray[np.uint8], samples: float) -> NDArray[np.uint8]:
    """Let pieces that are too short join the piece before; standstill and unknown stay as they are."""
    kind = kind.copy()
    fixed = (Segment.STANDSTILL, Segment.UNKNOWN)
    for start, stop in runs_of(kind):
        before = kind[start - 1] if start else Segment.UNKNOWN
        if stop - start < samples and kind[start] not in fixed and before not in fixed:
            kind[start:stop] = before
    return kind
