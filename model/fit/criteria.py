"""How well a model predicts: the paper's M0, R0 and R2 above a slip threshold.

What each one sees, and what it does not:

- **M0**, the maximum error rate, is not defined in the paper, which judges curves against slip (its Fig. 4 and 5). Here
  it is the largest ``|y_p - y_a| / |y_a|``, in percent, of the curves of means in bins of slip (`BIN_WIDTH`); each row
  of a single-wheel test is a bin. A bin with too few samples (`LEAST_SHARE`), or whose measured mean is near zero
  beside the others (`LEAST_MEAN`), does not count: the error of such a mean is as large as the mean.
  ``M0_sample_percent`` is that of single samples; it has no limit where the measured value passes through zero.
- **R0** is the root mean square error in the unit of the channel. Beside the mean load (`Criteria.R0_per_load`) it can
  be compared between wheels.
- **R2** is the squared correlation. An offset, a gain and even a wrong sign leave it as it is: it says that prediction
  and measurement move together, not that they agree. Never judge a model by R2 alone.

Source: Yang et al. (2016), section 1.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from daq import FloatArray, IndexArray, Note
from model.notes import FitCode

BIN_WIDTH = 0.05
"""Of slip; bins begin at multiples of it, as in the figures of a report."""
LEAST_SHARE = 0.01
"""Of the samples that count: a bin with fewer has no part in M0."""
LEAST_MEAN = 0.1
"""Of the largest measured mean of a bin: a bin whose own is smaller has no part in M0."""


@dataclass(frozen=True)
class Criteria:
    """The paper's criteria over the samples at or above the slip threshold.

    Attributes
    ----------
    M0_percent : largest relative error of the means in bins of slip
    R0_N : root mean square error, in the unit of the channel (N; for torque N m)
    R2 : squared correlation, 0 to 1; blind to offset, gain and sign
    samples : number of samples that count
    threshold : slip at or above which a sample counts
    M0_sample_percent : largest relative error of a sample; infinite where a measured value is exactly zero
    R0_per_load : float
        R0 over the mean vertical load, a torque's over that of load times radius; NaN where no load was given.
    reason : Note, optional
        Why a criterion is NaN.
    """

    M0_percent: float
    R0_N: float
    R2: float
    samples: int
    threshold: float
    M0_sample_percent: float = float("nan")
    R0_per_load: float = float("nan")
    reason: Note | None = None


def criteria(
    actual: ArrayLike,
    predicted: ArrayLike,
    slip: ArrayLike,
    threshold: float,
    *,
    vertical_load_n: ArrayLike | None = None,
    rows: bool = False,
) -> Criteria:
    """Compare a prediction with what was measured; a sample where one of both or the slip is NaN does not count.

    A sample counts at or above the slip `threshold`; the paper's is 0.2 on clay and 0.1 on sandy soil. The vertical
    load is for R0 over the mean load; for a torque it is load times radius, N m, so that the share is a number. With
    `rows` samples are rows of a single-wheel test, each a bin of M0; else samples of runs, in any order. Criteria are
    NaN, with a reason, where nothing is left to compare; `ValueError` for arrays of different lengths.

    Source: Yang et al. (2016), section 1.3 and Fig. 4 and 5; bins and limits of M0 are ours.
    """
    ya, yp, s = (np.asarray(values, float).ravel() for values in (actual, predicted, slip))
    if not ya.size == yp.size == s.size:
        raise ValueError(f"actual ({ya.size}), predicted ({yp.size}) and slip ({s.size}) must have the same length")
    known = np.isfinite(ya) & np.isfinite(yp) & np.isfinite(s)
    counted = known & (s >= threshold)
    if not counted.any():
        return Criteria(np.nan, np.nan, np.nan, 0, threshold, reason=_why_none(s[known], threshold))
    error = (yp - ya)[counted]
    r0 = float(np.sqrt(np.mean(error**2)))
    r2, reason = _squared_correlation(ya[counted], yp[counted])
    return Criteria(
        M0_percent=_largest_rate(*_curves(ya[counted], error, np.arange(len(error)) if rows else _bins(s[counted]))),
        R0_N=r0,
        R2=r2,
        samples=int(counted.sum()),
        threshold=threshold,
        M0_sample_percent=_largest_rate(ya[counted], error),
        R0_per_load=np.nan if vertical_load_n is None else _per_load(r0, np.asarray(vertical_load_n, float)[counted]),
        reason=reason,
    )


def _bins(slip: FloatArray) -> IndexArray:
    return np.floor(slip / BIN_WIDTH + 1e-9).astype(np.intp)


def _curves(ya: FloatArray, error: FloatArray, label: IndexArray) -> tuple[FloatArray, FloatArray]:
    """Return means of the measured values and of the errors in the bins that count; shape (bins,)."""
    _, which, count = np.unique(label, return_inverse=True, return_counts=True)
    mean, miss = (np.bincount(which, weights=values) / count for values in (ya, error))
    full = count >= min(LEAST_SHARE * len(ya), count.max())
    counts = full & (np.abs(mean) >= LEAST_MEAN * np.abs(mean[full]).max())
    return mean[counts], miss[counts]


def _largest_rate(ya: FloatArray, error: FloatArray) -> float:
    """Return the largest relative error, percent; 0 where a measured zero is predicted."""
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(error == 0, 0.0, np.abs(error) / np.abs(ya))
    return float(np.max(rate)) * 100.0


def _squared_correlation(ya: FloatArray, yp: FloatArray) -> tuple[float, Note | None]:
    if ya.size < 2:
        return np.nan, Note(FitCode.ONE_SAMPLE)
    a, p = ya - ya.mean(), yp - yp.mean()
    spread_a, spread_p = float(np.linalg.norm(a)), float(np.linalg.norm(p))
    rounding = 8 * np.finfo(float).eps * np.sqrt(ya.size)
    if spread_a <= rounding * np.max(np.abs(ya)):
        return np.nan, Note(FitCode.MEASURED_CONSTANT)
    if spread_p <= rounding * np.max(np.abs(yp)):
        return np.nan, Note(FitCode.PREDICTED_CONSTANT)
    return float(min(((a / spread_a) @ (p / spread_p)) ** 2, 1.0)), None


def _per_load(r0: float, load: FloatArray) -> float:
    load = load[np.isfinite(load)]
    mean = float(np.mean(load)) if load.size else 0.0
    return r0 / mean if mean > 0 else np.nan


def _why_none(slip: FloatArray, threshold: float) -> Note:
    if not slip.size:
        return Note(FitCode.NO_SAMPLE)
    return Note(FitCode.NO_SLIP, values={"threshold": threshold, "largest": float(np.max(slip))})
