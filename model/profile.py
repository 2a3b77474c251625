r"""Profile interval of a sum of two parameters that cannot be told apart.

Along the valley in which the data leave two parameters, the sum is far from linear in them, and an interval from
the curvature at the minimum misses. The profile asks instead: how far can the sum be moved, everything else
refitted, before the cost rises by what chance allows? With correlated samples that is Wilks' threshold :math:`t^2`
times the sandwich over the naive variance of the sum.

Source: Venzon & Moolgavkar (1988), Appl. Stat. 37:87; Rotnitzky & Jewell (1990), Biometrika 77:485.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from model.gauss_newton import GaussNewtonOptions, gauss_newton

FloatArray = NDArray[np.float64]
_OPTIONS = GaussNewtonOptions(epsilon=1e-4, cost_tolerance=1e-6, max_iterations=30)


class Bounded(Protocol):
    """A parameter with its bounds."""

    @property
    def lower(self) -> float:
        """Least value."""

    @property
    def upper(self) -> float:
        """Largest value."""


class Problem(Protocol):
    """A least-squares problem with bounds on each of its p parameters."""

    @property
    def free(self) -> Sequence[Bounded]:
        """The parameters."""

    def residual_and_jacobian(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residual (m,) and its derivatives (m, p)."""


def profile_of_sum(
    problem: Problem,
    x: FloatArray,
    pair: tuple[int, int],
    allowed: float,
    *,
    span: float | None = None,
    precision: float = 2e-3,
) -> tuple[float, float]:
    """Return the interval of x[i] + x[j] within which the refitted cost rises by at most `allowed`.

    Parameters
    ----------
    problem : Problem
    x : array, shape (p,)
        The minimum.
    pair : (i, j)
    allowed : float
        In units of the whitened cost.
    span : float, optional
        About how far from the minimum to expect the ends; the default is a quarter of the sum.
    precision : float
        Of the distance of an end from the minimum, relative.

    Returns
    -------
    (low, high)
        Where the parameters' bounds stop the search first, the bound.
    """
    i, j = pair
    lower, upper = (np.array([getattr(f, side) for f in problem.free]) for side in ("lower", "upper"))
    centre = float(x[i] + x[j])
    least = _cost(problem, x)

    def excess(total: float) -> float:
        cost = _refitted(problem, x, pair, total, lower, upper)
        return float(np.sqrt(max(cost - least, 0.0))) if np.isfinite(cost) else np.inf  # a wheel sunk to its axle

    reach = max(0.25 * abs(centre), 0.05) if span is None else span
    edges = (float(lower[i] + lower[j]), float(upper[i] + upper[j]))
    target = float(np.sqrt(allowed))
    low, high = (
        _edge(excess, centre, side * reach, edge, target, precision)
        for side, edge in zip((-1.0, 1.0), edges, strict=True)
    )
    return low, high


def _cost(problem: Problem, x: FloatArray) -> float:
    residual, _ = problem.residual_and_jacobian(x)
    return float(residual @ residual)


def _refitted(
    problem: Problem, x: FloatArray, pair: tuple[int, int], total: float, lower: FloatArray, upper: FloatArray
) -> float:
    """Return the least cost with x[i] = total - x[j]."""
    i, j = pair
    others = [k for k in range(len(x)) if k != i]

    def full(y: FloatArray) -> FloatArray:
        z = x.copy()
        z[others] = y
        z[i] = total - z[j]
        return z

    def reduced(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = problem.residual_and_jacobian(full(y))
        jacobian = jacobian.copy()
        jacobian[:, j] -= jacobian[:, i]
        return residual, jacobian[:, others]

    low, high = lower.copy(), upper.copy()
    low[j], high[j] = max(lower[j], total - upper[i]), min(upper[j], total - lower[i])
    start = np.clip(x, low, high)[others]
    result = gauss_newton(reduced, start, lower=low[others], upper=high[others], options=_OPTIONS)
    return result.cost


def _edge(
    excess: Callable[[float], float], centre: float, span: float, limit: float, target: float, precision: float
) -> float:
    """Return where `excess` reaches `target`, walking from `centre` in the direction of `span`, at most to `limit`."""
    inside, outside = centre, centre + span
    at_inside, at_outside = 0.0, excess(_within(outside, span, limit))
    while at_outside < target:
        outside = _within(outside, span, limit)
        if outside == limit:
            return limit
        inside, at_inside = outside, at_outside
        outside += span
        span *= 2.0
        at_outside = excess(_within(outside, span, limit))
    outside = _within(outside, span, limit)
    for _ in range(12):
        if abs(outside - inside) < precision * max(abs(outside - centre), 1e-6):
            break
        share = np.clip((target - at_inside) / max(at_outside - at_inside, 1e-300), 0.1, 0.9)
        middle = inside + float(share) * (outside - inside)
        value = excess(middle)
        if value < target:
            inside, at_inside = middle, value
        else:
            outside, at_outside = middle, value
    return 0.5 * (inside + outside)


def _within(value: float, direction: float, limit: float) -> float:
    return max(value, limit) if direction < 0 else min(value, limit)
