"""Robust linear fits for the sensor checks: bisquare weights, uncertainty by leaving out stretches of time."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from daq import FloatArray

_TUKEY = 4.685
_MAD_TO_SIGMA = 1.4826
_BLOCKS = 12
_ABSOLUTE_STEPS = 3


@dataclass(frozen=True)
class RobustFit:
    """A fit of y = A p.

    Attributes
    ----------
    coefficients : float64 array, shape (k,)
    weights : float64 array, shape (n,)
        0 to 1; 0 for outliers.
    spread : float
        Robust standard deviation of the residuals.
    """

    coefficients: FloatArray
    weights: FloatArray
    spread: float


def robust_linear(
    matrix: FloatArray, y: FloatArray, start: FloatArray | None = None, iterations: int = 10
) -> RobustFit:
    """Fit y = A p with Tukey's bisquare weights, starting from `start` or from nearly least absolute deviations.

    `matrix` has shape (n, k), `y` shape (n,), `start` shape (k,).
    """
    unit, norm = _unit_columns(matrix)
    weights = np.ones(len(y)) if start is None else bisquare(y - matrix @ start)
    for step in range(iterations):
        p = _solve(*_normal(unit, y, weights)) / norm
        residual = y - matrix @ p
        if start is None and step < _ABSOLUTE_STEPS:
            weights = 1.0 / np.maximum(np.abs(residual), 1e-3 * robust_spread(residual) + 1e-12)
        else:
            weights = bisquare(residual)
    return RobustFit(p, weights, robust_spread(residual))


def block_covariance(matrix: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the jackknife covariance (k, k) of the coefficients.

    Samples in time order are correlated; what counts is how much the answer changes when a twelfth of the time is left
    out. The weights are kept.
    """
    unit, norm = _unit_columns(matrix)
    blocks = np.array_split(np.arange(len(y)), min(_BLOCKS, len(y)))
    parts = [_normal(unit[block], y[block], weights[block]) for block in blocks]
    gram = np.sum([part[0] for part in parts], axis=0)
    right = np.sum([part[1] for part in parts], axis=0)
    replicates = np.array([_solve(gram - g, right - r) for g, r in parts]) / norm
    deviation = replicates - replicates.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * deviation.T @ deviation)


def robust_spread(residual: FloatArray) -> float:
    """Return the standard deviation that the median absolute residual stands for."""
    size = np.abs(residual)
    middle = (len(size) - 1) // 2, len(size) // 2
    low, high = np.partition(size, middle)[list(middle)]  # np.median takes three times as long for some hundred numbers
    return _MAD_TO_SIGMA * float(0.5 * (low + high))


def roughness(values: FloatArray) -> float:
    """Return the one-sigma of what differs from one value to the next; three values or more."""
    return robust_spread(np.diff(values, 2)) / sqrt(6.0)


def bisquare(residual: FloatArray, least_spread: float = 1e-12) -> FloatArray:
    """Return Tukey's bisquare weights, 0 to 1; `least_spread` is the smallest standard deviation to weigh by."""
    reach = _TUKEY * max(robust_spread(residual), least_spread)
    return np.asarray(np.clip(1.0 - (residual / reach) ** 2, 0.0, None) ** 2)


def _normal(matrix: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    weighted = matrix * weights[:, None]
    return weighted.T @ matrix, weighted.T @ y


def _unit_columns(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    norm = np.linalg.norm(matrix, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    return matrix / norm, norm


def _solve(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Solve the normal equations; what the data do not show (a column without weight) comes out near zero."""
    ridge = 1e-12 * max(float(np.trace(gram)), 1e-300)
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(len(gram)), right))
