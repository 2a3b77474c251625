"""Robust linear fits for the sensor checks: bisquare weights, uncertainty by leaving out stretches of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.timebase import FloatArray

_TUKEY = 4.685
_MAD_TO_SIGMA = 1.4826
_BLOCKS = 12


@dataclass(frozen=True)
class RobustFit:
    """Coefficients of y = A p, shape (k,); their block-jackknife covariance (k, k); robust spread of the residuals."""

    coefficients: FloatArray
    covariance: FloatArray
    spread: float


def robust_linear(
    matrix: FloatArray, y: FloatArray, start: FloatArray | None = None, iterations: int = 12
) -> RobustFit:
    """Fit y = A p with Tukey's bisquare weights.

    The samples are in time order and correlated; the covariance comes from leaving out each of twelve blocks in turn.

    Parameters
    ----------
    matrix : float64 array, shape (n, k)
    y : float64 array, shape (n,)
    start : float64 array, shape (k,), optional
        First coefficients; without them, least absolute deviations by a few reweighted steps.
    """
    weight = np.ones(len(y)) if start is None else _bisquare(y - matrix @ start)
    for step in range(iterations):
        p = _solve(*_normal(matrix, y, weight))
        residual = y - matrix @ p
        if start is None and step < 4:
            weight = 1.0 / np.maximum(np.abs(residual), 1e-3 * _spread(residual) + 1e-12)
        else:
            weight = _bisquare(residual)
    return RobustFit(p, _jackknife(matrix, y, weight), _spread(residual))


def _bisquare(residual: FloatArray) -> FloatArray:
    reach = _TUKEY * max(_spread(residual), 1e-12)
    return np.clip(1.0 - (residual / reach) ** 2, 0.0, None) ** 2


def _spread(residual: FloatArray) -> float:
    return _MAD_TO_SIGMA * float(np.median(np.abs(residual)))


def _normal(matrix: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    weighted = matrix * weight[:, None]
    return weighted.T @ matrix, weighted.T @ y


def _solve(gram: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.pinv(gram, rcond=1e-14, hermitian=True) @ right)


def _jackknife(matrix: FloatArray, y: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the covariance from leave-one-block-out coefficients, the weights kept."""
    blocks = [block for block in np.array_split(np.arange(len(y)), _BLOCKS) if len(block)]
    parts = [_normal(matrix[block], y[block], weight[block]) for block in blocks]
    gram, right = sum(part[0] for part in parts), sum(part[1] for part in parts)
    left_out = np.array([_solve(gram - g, right - r) for g, r in parts])
    deviation = left_out - left_out.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * deviation.T @ deviation)
