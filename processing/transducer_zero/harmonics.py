r"""Offset, once and twice per revolution of one signal, with sigmas that hold for noise correlated in time.

A robust fit (bisquare: spikes do not count) gives the coefficients. Their covariance is the jackknife over blocks of
time of a second or more, which are nearly independent however the samples within them depend on each other; blocks
twice as long show what is left of that, and the larger sigma holds. From n blocks a sigma is itself uncertain, so that
it is widened by Student's quantile for n - 1 degrees of freedom. Between 64 and 82 % of the errors of noise correlated
over 0.02 to 0.2 s lie within +-1 sigma, of spins from 2 to 40 s.

What rounding to the DBC's resolution q hides is added: q/sqrt(12) for a signal that does not move,
exp(-2 pi^2 s^2/q^2) of it where noise of standard deviation s shakes it through the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np

from processing.robust import robust_linear, robust_spread
from processing.timebase import FloatArray

_BLOCK_S = 1.0
_FEWEST_BLOCKS, _MOST_BLOCKS = 4, 16
_TUKEY = 4.685
_REFINEMENTS = 4


@dataclass(frozen=True)
class Harmonics:
    """A fit of y = a + b cos psi + c sin psi + d cos 2 psi + e sin 2 psi.

    Attributes
    ----------
    coefficients, sigmas : float64 arrays, shape (5,), or (1,) without an angle
    spread : float
        Robust standard deviation of the residuals.
    outliers : int
        Samples that do not count at all.
    """

    coefficients: FloatArray
    sigmas: FloatArray
    spread: float
    outliers: int


def fit_harmonics(time_s: FloatArray, y: FloatArray, angle_rad: FloatArray | None, resolution: float) -> Harmonics:
    """Fit one signal.

    Parameters
    ----------
    time_s, y : float64 arrays, shape (n,)
        In order of time, finite.
    angle_rad : float64 array, shape (n,), or None
        psi; None: the offset alone.
    resolution : float
        Step of the signal in its unit.
    """
    matrix = _design(len(y), angle_rad)
    p = robust_linear(matrix, y).coefficients
    for _ in range(_REFINEMENTS):  # a signal that hardly moves has no spread to weigh by: half a step is the least
        weights = _bisquare(y - matrix @ p, max(resolution / 2, 1e-12))
        p = _solve(matrix, y, weights)
    residual = y - matrix @ p
    spread = robust_spread(residual)
    seen = _sigmas(time_s, matrix, y, weights)
    hidden = resolution / sqrt(12) * exp(-2 * (pi * spread / resolution) ** 2) if resolution > 0 else 0.0
    return Harmonics(p, np.hypot(seen, hidden), spread, int(np.sum(weights == 0)))


def _design(count: int, angle_rad: FloatArray | None) -> FloatArray:
    if angle_rad is None:
        return np.ones((count, 1))
    one = np.ones(count)
    return np.column_stack([one, np.cos(angle_rad), np.sin(angle_rad), np.cos(2 * angle_rad), np.sin(2 * angle_rad)])


def _bisquare(residual: FloatArray, least_spread: float) -> FloatArray:
    reach = _TUKEY * max(robust_spread(residual), least_spread)
    return np.asarray(np.clip(1.0 - (residual / reach) ** 2, 0.0, None) ** 2)


def _solve(matrix: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq((matrix * weights[:, None]).T @ matrix, matrix.T @ (weights * y), rcond=None)[0])


def _sigmas(time_s: FloatArray, matrix: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the one-sigma of each coefficient, the weights kept: the larger of two block lengths'."""
    span_s = float(time_s[-1] - time_s[0])
    most = int(np.clip(span_s / _BLOCK_S, _FEWEST_BLOCKS, _MOST_BLOCKS))
    place = (time_s - time_s[0]) / max(span_s, 1e-9)
    weighted = matrix * weights[:, None]
    return np.maximum(*(_jackknife(place, weighted, matrix, y, count) for count in (most, max(most // 2, 3))))


def _jackknife(place: FloatArray, weighted: FloatArray, matrix: FloatArray, y: FloatArray, count: int) -> FloatArray:
    """Return what the coefficients change when one of `count` blocks is left out, as one-sigma; `place` is 0 to 1."""
    block = np.minimum((place * count).astype(np.int64), count - 1)
    grams = np.array([weighted[block == k].T @ matrix[block == k] for k in range(count)])
    rights = np.array([weighted[block == k].T @ y[block == k] for k in range(count)])
    gram, right = grams.sum(axis=0), rights.sum(axis=0)
    without = np.array(
        [np.linalg.lstsq(gram - g, right - r, rcond=None)[0] for g, r in zip(grams, rights, strict=True)]
    )
    variance = (count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    return np.asarray(_student(count - 1) * np.sqrt(variance))


def _student(freedom: int) -> float:
    """Return the quantile of Student's t that one sigma of a normal distribution has (Cornish and Fisher's series)."""
    return 1 + 1 / (2 * freedom) + 1 / (4 * freedom**2)
