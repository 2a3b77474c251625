"""Gauss-Newton for nonlinear least squares: damped, bounded, with a stated reason for every stop. No physics in it.

The algorithm is that of the paper's Fig. 2: with the residual ``r(x)`` (m entries) and its sensitivity matrix
``J_k = dr/dx`` at the estimate ``x_k``, the sum of squares is replaced by that of the linearised residual,

    |r(x_k + s)|^2 ~ |r + J_k s|^2,                                                                     (1)

whose minimum is the Gauss-Newton step ``s = -J_k^+ r``; the iteration ends when the step falls below epsilon.

**Damping.** Far from the solution (1) holds in a neighbourhood only. The step solves

    min |r + J_k s|^2 + mu |D s|^2,   D = diag(largest column norms of J seen so far),                  (2)

with the smallest mu >= 0 that keeps |D s| within a radius (Levenberg 1944, Marquardt 1963, More 1978). The radius
grows where the cost falls as (1) predicts and shrinks where it does not. The first step is tried undamped, and kept if
(1) predicts its gain within a quarter: a linear problem is solved in one step. D makes the iteration independent of
the units of the parameters.

**Numerics.** One Householder triangularisation of ``[J D^-1 | r]`` a linearisation, then small algebra on the p x p
triangle: its singular values give (2) for every mu. The gain is summed as ``(r - r_new)'(r + r_new)``, which keeps the
digits that the difference of two sums of squares loses.

**Bounds.** (2) is solved within ``lower <= x_k + s <= upper`` by an active-set method (bounded-variable least squares,
Stark & Parker 1995), so that every estimate is feasible and a bound is left again as soon as the data pull away.

**Stop.** Tests use the undamped, bounded step: a short damped step is no sign of a minimum. It has converged when every
component is below ``epsilon`` of the parameter (`StopReason.CONVERGED_STEP`), or when the gain (1) predicts for it is
below ``cost_tolerance`` of the cost or too small to be seen in it (`StopReason.CONVERGED_COST`; the square root of that
ratio is in proportion to Bates and Watts' relative offset, the distance to the minimum in standard deviations). Where
the gain can no longer be seen, steps are kept as long as they halve the predicted gain that is left.

Prior knowledge ``x_i ~ (mean, sigma)`` enters as an extra row ``(x_i - mean) / sigma`` of the residual.

Source: Yang et al. (2016), 1.2 and Fig. 2; More (1978), The Levenberg-Marquardt algorithm, Lecture Notes in Math. 630
(of the radius section 4 and 7); Stark & Parker (1995), Computational Statistics 10; Bates & Watts (1981),
Technometrics 23.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from daq import BoolArray, ConfigError, Fault, FloatArray, Note
from model.fit.covariance import Covariance, covariance
from model.fit.linear_step import BoundedProblem, LinearProblem, Point, ResidualAndJacobian
from model.notes import FitCode

_KEPT_GAIN = 1e-4  # share of the predicted gain that a step must bring to be kept

_UNSEEN = 1e-12  # share of the cost below which a predicted gain drowns in rounding


class TrustRadius:
    """The radius within which the linearised residual is believed, and the unit D it is measured in.

    That of the first damped step is the length of the scaled start. `tried` counts the steps.
    """

    def __init__(self, problem: BoundedProblem) -> None:
        self._size = np.maximum(np.abs(problem.start), problem.scale) * problem.free
        self._norms = np.zeros(problem.start.size)
        self.tried = 0
        self.radius = np.inf

    def norms_seen(self, jacobian: FloatArray) -> FloatArray:
        """Return D: the largest column norms so far; 1 for a column that was always zero."""
        self._norms = np.maximum(self._norms, np.linalg.norm(jacobian, axis=0))
        return np.where(self._norms > 0, self._norms, 1.0)

    def keeps(self, ratio: float, length: float) -> bool:
        """Set the radius by the ratio of seen to predicted gain of a step; return whether the step is kept."""
        self.tried += 1
        if self.tried == 1:
            first = float(np.linalg.norm(self._norms * self._size)) or np.inf
            if abs(ratio - 1) <= 0.25:
                self.radius = max(first, length)
                return True
            self.radius = min(first, length / 2)
            return False
        if ratio < 0.25:
            self.radius = min(self.radius, length) * (0.25 if ratio > -1e3 else 0.1)
        elif ratio > 0.75:
            self.radius = max(self.radius, 2 * length)
        return ratio > _KEPT_GAIN


class StopReason(StrEnum):
    """Why an iteration ended."""

    CONVERGED_STEP = "converged_step"
    CONVERGED_COST = "converged_cost"
    AT_BOUNDS = "at_bounds"
    SINGULAR = "singular"
    NO_PROGRESS = "no_progress"
    MAX_ITERATIONS = "max_iterations"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True)
class GaussNewtonOptions:
    """How far and how boldly to go.

    Attributes
    ----------
    epsilon : step, relative to the parameter, below which the iteration has converged
    cost_tolerance : predicted gain, relative to the cost, below which it has converged
    max_iterations : of evaluations after the first, rejected steps included
    noise : "estimated" or "unit"
        Variance of an entry of the residual: cost / (m - rank), or 1 where residuals are divided by their sigma.
    """

    epsilon: float = 1e-9
    cost_tolerance: float = 1e-16
    max_iterations: int = 1000
    noise: Literal["estimated", "unit"] = "estimated"


@dataclass(frozen=True)
class GaussNewtonResult:
    """Where the iteration ended and why.

    Attributes
    ----------
    estimate : shape (p,)
    covariance, correlation : shape (p, p)
        Infinite or NaN where the data do not determine a parameter, NaN at a bound; see `model.fit.covariance`.
    residual : shape (m,)
    jacobian : shape (m, p)
    cost : sum of squared residuals
    iterations : evaluations after the first
    stop_reason : StopReason
        ``at_bounds`` is converged too, but at least one parameter is held by its bound; ``singular`` is converged in
        what the data determine, which is not every parameter.
    at_bound : bool, shape (p,)
        Parameters that ended on a bound (a parameter with equal bounds included).
    warnings : tuple of Note
        What cannot be separated, and what else a reader must know.
    """

    estimate: FloatArray
    covariance: FloatArray
    correlation: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    cost: float
    iterations: int
    stop_reason: StopReason
    at_bound: BoolArray
    warnings: tuple[Note, ...]

    @property
    def converged(self) -> bool:
        """Whether a minimum (perhaps on a bound) was reached."""
        return self.stop_reason in (StopReason.CONVERGED_STEP, StopReason.CONVERGED_COST, StopReason.AT_BOUNDS)


def gauss_newton(
    residual_and_jacobian: ResidualAndJacobian,
    start: ArrayLike,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    options: GaussNewtonOptions | None = None,
) -> GaussNewtonResult:
    """Minimise the sum of squares of a residual.

    `residual_and_jacobian` takes x, shape (p,), and returns r, shape (m,), and J = dr/dx, shape (m, p); where either is
    not finite the step is rejected. The start is within the bounds and may lie on them; equal bounds hold a parameter
    fixed. `scale` has typical sizes, positive: what ``epsilon`` is relative to where a parameter is near 0, and what
    the first radius is measured in where the start is 0. The names are for messages.

    `ConfigError` lists every start, bound, scale or option that cannot be; `ValueError` for arrays of the wrong shape.

    Source: Yang et al. (2016), Fig. 2.
    """
    options = options or GaussNewtonOptions()
    _check_options(options)
    problem = BoundedProblem.checked(residual_and_jacobian, start, lower, upper, scale, names)
    point = problem.evaluate(problem.start)
    if not point.finite:
        return _result(problem, point, StopReason.NOT_FINITE, 0, options)
    trust = TrustRadius(problem)
    rounding = point.residual.size * np.finfo(float).eps ** 2 * point.cost
    reason = None
    while reason is None:
        linear = problem.linearised(point, trust.norms_seen(point.jacobian))
        reason = _converged(problem, point, linear, options, rounding)
        if reason is None:
            point, reason = _search(problem, point, linear, trust, options)
    return _result(problem, point, reason, trust.tried, options)


def _converged(
    problem: BoundedProblem, point: Point, linear: LinearProblem, options: GaussNewtonOptions, rounding: float
) -> StopReason | None:
    newton = linear.newton_step
    if linear.predicted_gain(newton) <= max(options.cost_tolerance * point.cost, rounding):
        return StopReason.CONVERGED_COST
    size = np.maximum(np.abs(point.x), problem.scale)[problem.free]
    if np.all(np.abs(newton / linear.unit) <= options.epsilon * size):
        return StopReason.CONVERGED_STEP
    return None


def _search(
    problem: BoundedProblem,
    point: Point,
    linear: LinearProblem,
    trust: TrustRadius,
    options: GaussNewtonOptions,
) -> tuple[Point, StopReason | None]:
    """Try steps with a shrinking radius until one lowers the cost; return the new point, or why there is none."""
    left = linear.predicted_gain(linear.newton_step)
    unseen = left <= _UNSEEN * point.cost
    while trust.tried < options.max_iterations:
        step, _ = linear.step_within(trust.radius)
        trial = problem.evaluate(problem.moved(point.x, step / linear.unit))
        predicted = linear.predicted_gain(step)
        ratio = _seen_gain(point, trial) / predicted if predicted > 0 else -np.inf
        kept = trust.keeps(ratio, float(np.linalg.norm(step)))
        if unseen and not kept and trial.finite:
            onward = problem.linearised(trial, trust.norms_seen(trial.jacobian))
            kept = onward.predicted_gain(onward.newton_step) < left / 2
        if kept:
            return trial, None
        if unseen:
            return point, StopReason.CONVERGED_COST
        if predicted <= np.finfo(float).eps * point.cost:
            return point, StopReason.NO_PROGRESS
    return point, StopReason.MAX_ITERATIONS


def _seen_gain(point: Point, trial: Point) -> float:
    if not trial.finite:
        return -np.inf
    return float((point.residual - trial.residual) @ (point.residual + trial.residual))


def _result(
    problem: BoundedProblem,
    point: Point,
    reason: StopReason,
    iterations: int,
    options: GaussNewtonOptions,
) -> GaussNewtonResult:
    at_bound = (point.x <= problem.lower) | (point.x >= problem.upper)
    held = at_bound & problem.free
    spread, warnings = _spread(problem, point, at_bound, options)
    if reason in (StopReason.CONVERGED_STEP, StopReason.CONVERGED_COST):
        if spread.rank < np.count_nonzero(~at_bound):
            reason = StopReason.SINGULAR
        elif held.any():
            reason = StopReason.AT_BOUNDS
    ended = [(problem.names[i], float(point.x[i])) for i in np.flatnonzero(held)]
    warnings += [Note(FitCode.AT_BOUND, values={"names": (name,), "value": value}) for name, value in ended]
    return GaussNewtonResult(
        estimate=point.x,
        covariance=spread.matrix,
        correlation=spread.correlation,
        residual=point.residual,
        jacobian=point.jacobian,
        cost=point.cost,
        iterations=iterations,
        stop_reason=reason,
        at_bound=at_bound,
        warnings=tuple(warnings),
    )


def _spread(
    problem: BoundedProblem, point: Point, at_bound: BoolArray, options: GaussNewtonOptions
) -> tuple[Covariance, list[Note]]:
    count = point.x.size
    if not point.finite:
        nothing = np.full((count, count), np.nan)
        return Covariance(nothing, nothing, np.nan, 0), [Note(FitCode.NOT_FINITE)]
    warnings = []
    variance = 1.0
    if options.noise == "estimated":
        freedom = point.residual.size - covariance(point.jacobian, held=at_bound).rank
        variance = point.cost / freedom if freedom > 0 else np.nan
        if freedom <= 0:
            values = {"residuals": point.residual.size, "parameters": count}
            warnings.append(Note(FitCode.NOISE_UNKNOWN, values=values))
    spread = covariance(point.jacobian, variance, names=problem.names, held=at_bound)
    return spread, [*spread.warnings, *warnings]


def _check_options(options: GaussNewtonOptions) -> None:
    positive = {"epsilon": options.epsilon, "max_iterations": options.max_iterations}
    faults = [Fault(f"{name} must be positive", found=str(value)) for name, value in positive.items() if not value > 0]
    if not options.cost_tolerance >= 0:
        faults.append(Fault("cost_tolerance must not be negative", found=str(options.cost_tolerance)))
    ConfigError.stop_if_any(faults)
