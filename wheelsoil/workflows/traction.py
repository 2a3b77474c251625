"""What a wheel does on this ground: drawbar coefficient, tractive efficiency, drawbar pull at one slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from daq import FloatArray, IntArray
from processing import ProcessedRun

_AT, _WITHIN = 0.2, 0.1
_LONGEST_STEP_S = 1.0
_FEWEST_PASSES = 3
_WIDTH, _LEAST = 0.05, 20


@dataclass(frozen=True)
class PullAtSlip:
    """Drawbar pull at one slip with its 95 % interval (N), the mean load there (N), and how often it was passed.

    The interval is NaN below three passes.
    """

    slip: float
    pull_n: float
    interval95: tuple[float, float]
    load_n: float
    passes: int


@dataclass(frozen=True)
class Traction:
    """What the used samples of a run, or of several, say of the ground.

    Attributes
    ----------
    drawbar_coefficient, at_slip : float
        The highest Dp/W (median in bins of slip), and the slip there; NaN without drawbar pull or load.
    efficiency, efficiency_at_slip : float
        The highest tractive efficiency Dp v / (T omega) = Dp r (1 - s) / T, and the slip there; NaN without torque.
    """

    pull: PullAtSlip | None
    drawbar_coefficient: float
    at_slip: float
    efficiency: float
    efficiency_at_slip: float


def traction_of(runs: tuple[ProcessedRun, ...]) -> Traction:
    """Return the traction of runs.

    The pull at slip 0.2 is the value there of a straight line through the samples within 0.1 of it. Its interval takes
    each pass through that window for one observation: samples within a pass are correlated.

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
    return Traction(
        _pull_at(slip, pull, load, pooled("time_s"), number), *_highest(slip, coefficient), *_highest(slip, efficiency)
    )


def value_at_slip(runs: tuple[ProcessedRun, ...], field: str) -> tuple[float, tuple[float, float]]:
    """Return a channel at slip 0.2 with its 95 % interval, by the estimator of `traction_of`; NaN where unknown."""
    used = [run.used for run in runs]
    pieces = [np.asarray(getattr(run, field), np.float64) for run in runs]
    known = [p[u] if len(p) == len(u) else np.full(int(u.sum()), np.nan) for p, u in zip(pieces, used, strict=True)]

    def pooled(name: str) -> FloatArray:
        return np.concatenate([np.zeros(0), *(getattr(run, name)[run.used] for run in runs)])

    number = np.repeat(np.arange(len(runs)), [int(u.sum()) for u in used])
    values = np.concatenate([np.zeros(0), *known])
    found = _pull_at(pooled("slip"), values, pooled("vertical_load_n"), pooled("time_s"), number)
    return (found.pull_n, found.interval95) if found else (float("nan"), (float("nan"), float("nan")))


def _pull_at(
    slip: FloatArray, pull: FloatArray, load: FloatArray, time_s: FloatArray, run: IntArray
) -> PullAtSlip | None:
    rows = np.flatnonzero((np.abs(slip - _AT) <= _WITHIN) & np.isfinite(pull))
    if len(rows) < _LEAST:
        return None
    begins = (np.diff(time_s[rows], prepend=-np.inf) > _LONGEST_STEP_S) | (np.diff(run[rows], prepend=-1) != 0)
    which = np.cumsum(begins) - 1
    passes = int(which[-1]) + 1
    design = np.stack([np.ones(len(rows)), slip[rows] - _AT], axis=1)
    inverse = np.linalg.pinv(design.T @ design)
    fitted = inverse @ design.T @ pull[rows]
    scores = np.zeros((passes, 2))
    np.add.at(scores, which, design * (pull[rows] - design @ fitted)[:, None])
    ends = (float("nan"), float("nan"))
    if passes >= _FEWEST_PASSES:
        variance = (inverse @ scores.T @ scores @ inverse)[0, 0] * passes / (passes - 1)
        half = float(stdtrit(passes - 1, 0.975) * np.sqrt(variance))
        ends = (float(fitted[0]) - half, float(fitted[0]) + half)
    return PullAtSlip(_AT, float(fitted[0]), ends, _mean(load[rows]), passes)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _highest(slip: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the highest median in bins of positive slip, and the middle of its bin."""
    best = (float("nan"), float("nan"))
    for start in np.arange(0.0, 1.0, _WIDTH):
        there = values[(slip > start) & (slip <= start + _WIDTH) & np.isfinite(values)]
        if len(there) >= _LEAST and not float(np.median(there)) <= best[0]:
            best = (float(np.median(there)), float(start + _WIDTH / 2))
    return best
