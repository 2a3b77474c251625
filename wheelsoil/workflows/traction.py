"""What a wheel does on this ground: drawbar coefficient, tractive efficiency, drawbar pull at one slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
import scipy

from daq import BoolArray, FloatArray, IntArray
from processing import ProcessedRun

_AT, _WITHIN = 0.2, 0.1
_REACH = 0.2
"""Of slip to either side of 0.2 for a curve: its error, 0.03 to 0.05 at that speed, hardly selects samples then."""
SURE_SIGMAS = 2.0
"""Sigmas of the slip below which the error of the slip makes the efficiency seem higher than any is."""
_LONGEST_STEP_S = 1.0
_FEWEST_PASSES = 3
_WIDTH, _LEAST = 0.05, 20


@dataclass(frozen=True)
class PullAtSlip:
    """Drawbar pull at one slip with its 95 % interval (N), the load (N), how often it was passed, and the speed (m/s).

    The interval is NaN below three passes. Of a measured one the load is the mean there, and the speed NaN.
    """

    slip: float
    pull_n: float
    interval95: tuple[float, float]
    load_n: float
    passes: int
    speed_mps: float = nan


@dataclass(frozen=True)
class Traction:
    """What the used samples of a run, or of several, say of the ground.

    Attributes
    ----------
    drawbar_coefficient, at_slip : float
        The highest Dp/W (median in bins of slip), and the slip there; NaN without drawbar pull or load.
    efficiency, efficiency_at_slip : float
        The highest tractive efficiency Dp v / (T omega) = Dp r (1 - s) / T, and the slip there; NaN without torque. If
        measured, of samples whose slip is more than twice its error.
    model : "", "recommended", "calibrated_soil" or "laboratory_soil"
        What the pull is of: "" is measured, with the loads and speeds as driven; with a soil it is measured, and taken
        to one load and speed by Wong's model with it. The rest is the recommended model's or measured.
    """

    pull: PullAtSlip | None
    drawbar_coefficient: float
    at_slip: float
    efficiency: float
    efficiency_at_slip: float
    model: str = ""


def traction_of(runs: tuple[ProcessedRun, ...]) -> Traction:
    """Return the traction of runs.

    The pull at slip 0.2 is the value there of a cubic through the samples within 0.2 of it; a straight line is low, as
    the curve is bent. Its interval takes each pass through that window for one observation: samples within a pass are
    correlated.

    Source: Wong, Theory of Ground Vehicles, section 2.6, for the efficiency.
    """

    def pooled(name: str) -> FloatArray:
        return np.concatenate([getattr(run, name)[run.used] for run in runs]) if runs else np.zeros(0)

    slip, pull, load = (pooled(name) for name in ("slip", "drawbar_pull_n", "vertical_load_n"))
    radius = np.concatenate([np.full(int(run.used.sum()), run.wheel_radius_m) for run in runs]) if runs else slip
    number = np.repeat(np.arange(len(runs)), [int(run.used.sum()) for run in runs])
    with np.errstate(divide="ignore", invalid="ignore"):
        coefficient = np.where(load > 0, pull / load, np.nan)
        efficiency = pull * radius * (1 - slip) / pooled("driving_torque_nm")
    efficiency[slip <= SURE_SIGMAS * pooled("slip_sigma")] = np.nan
    return Traction(
        pull_at(slip, pull, load, pooled("time_s"), number), *highest(slip, coefficient), *highest(slip, efficiency)
    )


def at_usual_slip(runs: Sequence[ProcessedRun], field: str) -> PullAtSlip | None:
    """Return a channel at slip 0.2 with its 95 % interval, by the estimator of `traction_of`; None where unknown."""
    return pull_at(*_pooled(runs, [np.asarray(getattr(run, field), np.float64) for run in runs]))


def near_usual_slip(slip: FloatArray) -> BoolArray:
    """Return which samples are within 0.1 of slip 0.2, shape (n,)."""
    return np.abs(slip - _AT) <= _WITHIN


def median_of_passes(runs: Sequence[ProcessedRun], values: Sequence[FloatArray]) -> PullAtSlip | None:
    """Return the median over the passes near slip 0.2 of each pass's median, of one array of values a run.

    The interval is by order statistics of the passes; of three to five by Student's t, and NaN below.
    """
    slip, pooled, load, time_s, run = _pooled(runs, values)
    rows = np.flatnonzero(near_usual_slip(slip) & np.isfinite(pooled))
    if len(rows) < _LEAST:
        return None
    which = _passes(time_s[rows], run[rows])
    medians = np.sort([np.median(each) for each in np.split(pooled[rows], np.flatnonzero(np.diff(which)) + 1)])
    middle, ends = float(np.median(medians)), median_interval(medians)
    if len(medians) >= _FEWEST_PASSES and not isfinite(ends[0]):
        half = float(scipy.special.stdtrit(len(medians) - 1, 0.975) * medians.std(ddof=1) / np.sqrt(len(medians)))
        ends = (middle - half, middle + half)
    return PullAtSlip(_AT, middle, ends, _mean(load[rows]), len(medians))


def median_interval(ordered: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of a median by order statistics; NaN below six values, where there is none."""
    from scipy.stats import binom

    rank = int(binom.ppf(0.025, len(ordered), 0.5)) - 1
    if len(ordered) < 6 or rank < 0:
        return float("nan"), float("nan")
    return float(ordered[rank]), float(ordered[-1 - rank])


def _pooled(
    runs: Sequence[ProcessedRun], values: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """Return slip, values, load, time and number of the run of all used samples; values that are none are NaN."""
    used = [run.used for run in runs]
    known = [v[u] if len(v) == len(u) else np.full(int(u.sum()), nan) for v, u in zip(values, used, strict=True)]

    def of(name: str) -> FloatArray:
        return np.concatenate([np.zeros(0), *(getattr(run, name)[run.used] for run in runs)])

    number = np.repeat(np.arange(len(runs)), [int(u.sum()) for u in used])
    return of("slip"), np.concatenate([np.zeros(0), *known]), of("vertical_load_n"), of("time_s"), number


def _passes(time_s: FloatArray, run: IntArray) -> IntArray:
    """Return the number of the pass of each sample near slip 0.2."""
    begins = (np.diff(time_s, prepend=-np.inf) > _LONGEST_STEP_S) | (np.diff(run, prepend=-1) != 0)
    return np.cumsum(begins) - 1


def pull_at(
    slip: FloatArray, pull: FloatArray, load: FloatArray, time_s: FloatArray, run: IntArray
) -> PullAtSlip | None:
    """Return the value at slip 0.2 of a cubic through samples near it, each of shape (n,); see `traction_of`.

    It is linear in `pull`: the values of parts add up to that of their sum. None with fewer than 10 samples within 0.1
    on either side.
    """
    rows = np.flatnonzero((np.abs(slip - _AT) <= _REACH) & np.isfinite(pull))
    sides = slip[rows[near_usual_slip(slip[rows])]] > _AT
    if min(sides.sum(), (~sides).sum()) < _LEAST / 2:
        return None
    which = _passes(time_s[rows], run[rows])
    passes = int(which[-1]) + 1
    design = np.vander(slip[rows] - _AT, 4, increasing=True)
    inverse = np.linalg.pinv(design.T @ design)
    fitted = inverse @ design.T @ pull[rows]
    scores = np.zeros((passes, 4))
    np.add.at(scores, which, design * (pull[rows] - design @ fitted)[:, None])
    ends = (nan, nan)
    if passes >= _FEWEST_PASSES:
        variance = (inverse @ scores.T @ scores @ inverse)[0, 0] * passes / (passes - 1)
        half = float(scipy.special.stdtrit(passes - 1, 0.975) * np.sqrt(variance))
        ends = (float(fitted[0]) - half, float(fitted[0]) + half)
    return PullAtSlip(_AT, float(fitted[0]), ends, _mean(load[rows]), passes)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def highest(slip: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the highest median in bins of positive slip, and the middle of its bin."""
    best = (float("nan"), float("nan"))
    for start in np.arange(0.0, 1.0, _WIDTH):
        there = values[(slip > start) & (slip <= start + _WIDTH) & np.isfinite(values)]
        if len(there) >= _LEAST and not float(np.median(there)) <= best[0]:
            best = (float(np.median(there)), float(start + _WIDTH / 2))
    return best
