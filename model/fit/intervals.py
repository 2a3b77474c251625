r"""Intervals of estimates: the block sandwich of correlated samples, and the profile of a confounded sum.

**Correlated samples.** Least squares with weights gives :math:`\hat\beta - \beta \approx H^{-1} \sum_i g_i` with
:math:`g_i = w_i J_i' e_i`. The :math:`g_i` of neighbouring samples are correlated - the filter, coloured transducer
noise and the speed error, which enters every channel through the slip, all see to that. They are summed over blocks
several correlation times long; block sums are as good as independent, so that
:math:`\mathrm{cov} = H^{-1} \left(\sum_b G_b G_b'\right) H^{-1}` (`sandwich`: with its corrections for few blocks).
No parametric model of the noise is needed; that the slip is measured is in it because its error is in the residual.

**Confounded sum.** Two parameters that are not separable have a well-determined sum, of which the profile gives the
interval. Along the valley in which the data leave two parameters, the sum is far from linear in them, and an interval
from the curvature at the minimum misses. The profile asks instead: how far can the sum be moved, everything else
refitted, before the cost rises by what chance allows? With correlated samples that is Wilks' threshold :math:`t^2`
times the sandwich over the naive variance of the sum.

Source: Cameron & Miller (2015), J. Human Resources 50:317 (cluster-robust inference); Carlstein (1986), Ann. Stat. 14;
Venzon & Moolgavkar (1988), Appl. Stat. 37:87 (profile); Rotnitzky & Jewell (1990), Biometrika 77:485.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from daq import FloatArray, IndexArray
from model.cores import in_parallel
from model.fit.gauss_newton import GaussNewtonOptions, gauss_newton

_OPTIONS = GaussNewtonOptions(epsilon=1e-4, cost_tolerance=1e-6, max_iterations=30)

_HOLLOW = 1e3
"""Condition above which a block holds all that is known of a direction: nothing is left to correct it by."""
MIN_BLOCKS = 12
"""As many blocks as the shortest usable record gives, so that t does not explode."""
_LONGEST_S = 8.0
_SHORTEST_S = 0.5
_CORRELATION_TIMES = 6.0


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

    `x` is the minimum, `pair` is (i, j), `allowed` is in units of the whitened cost. `span` is about how far from the
    minimum to expect the ends (default: a quarter of the sum), `precision` that of their distance from the minimum,
    relative. Where the parameters' bounds stop the search first, the end is the bound.
    """
    i, j = pair
    lower, upper = (np.array([getattr(f, side) for f in problem.free]) for side in ("lower", "upper"))
    centre = float(x[i] + x[j])
    least = _cost(problem, x)

    def excess(total: float) -> float:
        cost = _refitted(problem, x, pair, total, lower, upper)
        return float(np.sqrt(max(cost - least, 0.0))) if np.isfinite(cost) else np.inf  # a wheel sunk to its axle

    reach = max(0.25 * abs(centre), 0.05) if span is None else span
    edges = {-1.0: float(lower[i] + lower[j]), 1.0: float(upper[i] + upper[j])}
    target = float(np.sqrt(allowed))

    def edge(side: float) -> float:
        return _edge(excess, centre, side * reach, edges[side], target, precision)

    low, high = in_parallel(edge, edges, rows=len(problem.residual_and_jacobian(x)[0]))
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
    return gauss_newton(reduced, start, lower=low[others], upper=high[others], options=_OPTIONS).cost


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


@dataclass(frozen=True)
class Blocks:
    """Samples grouped into blocks that are as good as independent.

    Attributes
    ----------
    label : int array, shape (n,)
        Block of each sample, 0 to count - 1.
    length_s : float
        Of a block; NaN for independent rows.
    correlation_time_s : float
        Integral of the residual's autocorrelation, both sides; NaN for independent rows.
    """

    label: IndexArray
    count: int
    length_s: float
    correlation_time_s: float


def correlation_time(residual: FloatArray, time_s: FloatArray, run: IndexArray) -> float:
    """Return the integrated autocorrelation time of a residual in seconds.

    Pairs of samples are taken within runs by their time difference, so that gaps (braking in between) do no harm.
    The sum stops at the first lag where the autocorrelation falls below 0.05.
    """
    step = _spacing(time_s, run)
    centred = residual - np.mean(residual)
    power = float(np.mean(centred**2))
    if not power > 0 or not np.isfinite(step):
        return 0.0
    grids = [_on_grid(centred[run == r], time_s[run == r], step) for r in np.unique(run)]
    total, lag = 1.0, 1
    while lag * step < _LONGEST_S:
        products = np.concatenate([g[:-lag] * g[lag:] for g in grids])
        products = products[np.isfinite(products)]
        rho = float(np.mean(products)) / power if len(products) > 10 else 0.0
        if rho < 0.05:
            break
        total += 2.0 * rho
        lag += 1
    return total * step


def _on_grid(values: FloatArray, time_s: FloatArray, step: float) -> FloatArray:
    """Return the values on a regular grid, NaN where there is no sample."""
    index = np.round((time_s - time_s[0]) / step).astype(np.intp)
    grid = np.full(int(index[-1]) + 1, np.nan)
    grid[index] = values
    return grid


def _spacing(time_s: FloatArray, run: IndexArray) -> float:
    step = np.diff(time_s)[np.diff(run) == 0]
    step = step[step > 0]
    return float(np.median(step)) if len(step) else float("nan")


def blocks_of(
    residual: FloatArray, time_s: FloatArray, run: IndexArray, independent: bool, drive: IndexArray | None = None
) -> Blocks:
    """Group samples: rows of a table singly, a time series in blocks of six correlation times.

    Wheels that were driven together share their blocks: an error of the ground speed is in the slip of all. By default
    every run is a drive of its own.
    """
    if independent:
        return Blocks(np.arange(len(residual)), len(residual), float("nan"), float("nan"))
    tau, step = correlation_time(residual, time_s, run), _spacing(time_s, run)
    drive = run if drive is None else drive
    at = _driven_steps(time_s, run, drive)
    span = len(np.unique([drive, at], axis=1).T) * step
    longest = max(span / MIN_BLOCKS, _SHORTEST_S) if np.isfinite(span) else _SHORTEST_S
    length = float(np.clip(_CORRELATION_TIMES * tau, _SHORTEST_S, min(longest, _LONGEST_S)))
    key = np.stack([drive, np.floor(at * step / length).astype(np.intp)], axis=1)
    label = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    return Blocks(label, int(label.max()) + 1 if len(label) else 0, length, tau)


def _driven_steps(time_s: FloatArray, run: IndexArray, drive: IndexArray) -> IndexArray:
    """Return how many samples of its drive's longest run are before each, so that blocks hold about equally many."""
    counted = np.zeros(len(time_s), np.intp)
    for d in np.unique(drive):
        rows = drive == d
        longest = run == np.bincount(run[rows]).argmax()
        counted[rows] = np.searchsorted(time_s[longest], time_s[rows])
    return counted


@dataclass(frozen=True)
class Sandwich:
    """How far an estimate of p parameters may be off.

    Attributes
    ----------
    covariance : array, shape (p, p)
    naive : array, shape (p, p)
        H^-1: what the covariance would be if whitened samples were independent.
    degrees : of freedom, for Student's t
    """

    covariance: FloatArray
    naive: FloatArray
    degrees: float


def sandwich(jacobian: FloatArray, scores: FloatArray, blocks: Blocks, prior: FloatArray | None = None) -> Sandwich:
    """Return the block-sandwich covariance with the jackknife's correction for leverage.

    A block that holds much of the information pulls the fit towards itself, so that its residual is too small: its
    summed score is multiplied by (I - H_b H^-1)^-1. Few blocks with much of the information leave few degrees of
    freedom, 1/sum(h_b^2) - 1 with h_b the block's share of the information. `jacobian`, shape (n, c, p), has the
    whitened sensitivities of each sample's c channels, `scores`, shape (n, p), are w_i J_i' e_i. `prior`, shape (p, p),
    is the information of a prior: part of H, and of what varies.

    Source: Bell & McCaffrey (2002), Survey Methodology 28:169 (leverage, degrees of freedom).
    """
    p = scores.shape[1]
    known = np.zeros((p, p)) if prior is None else prior
    rows = jacobian.reshape(-1, p)
    bread = rows.T @ rows + known
    size = np.sqrt(np.diag(bread))
    size[size == 0] = 1.0  # parameters differ by powers of ten in size: everything below is in units of their own sigma
    unit = np.outer(size, size)
    jacobian, scores = jacobian / size, scores / size
    inverse = _inverse(bread / unit)
    meat = known / unit
    shares = []
    for block in np.split(np.argsort(blocks.label, kind="stable"), np.cumsum(np.bincount(blocks.label))[:-1]):
        part = jacobian[block].reshape(-1, p)
        information = part.T @ part @ inverse
        score = scores[block].sum(axis=0)
        keep = np.eye(p) - information
        if np.linalg.cond(keep) < _HOLLOW:
            score = np.linalg.solve(keep, score)
        meat = meat + np.outer(score, score)
        shares.append(float(np.trace(information)) / p)
    held = float(np.sum(np.square(shares)))
    degrees = max(1.0 / held - 1.0, 1.0) if held > 0 else 1.0
    return Sandwich(inverse @ meat @ inverse / unit, inverse / unit, degrees)


def _inverse(matrix: FloatArray) -> FloatArray:
    """Invert an information matrix; a direction without information gets a huge variance, never none."""
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, np.finfo(float).eps * max(float(values[-1]), 1e-300))
    return np.asarray((vectors / values) @ vectors.T)
