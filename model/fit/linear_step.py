"""The linearised least-squares problem of a Gauss-Newton iteration: checks, evaluation, and damped and bounded steps.

In the scaled step ``y = D s`` and with ``[J D^-1 | r] = Q [R | q]`` the problem ``min |r + J s|^2 + mu |D s|^2`` is

    min |q + R y|^2 + mu |y|^2,

of the size of the parameters, however many rows the residual has. With ``R = U S V'`` its solution for any mu is
``y = -V S (S^2 + mu)^-1 U' q``. Where that leaves the box, the problem with the box is solved by active sets.

Source: More (1978), Lecture Notes in Math. 630; Stark & Parker (1995), Computational Statistics 10, 129-141.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from daq import BoolArray, ConfigError, Fault, FloatArray

_RANK_TOLERANCE = 1e-14
_RADIUS_MET = 0.1  # relative accuracy to which a damped step meets the radius
_PULL_TOLERANCE = 1e-14  # cosine between a column and the residual below which a bound is not left
_ROUNDS = 3  # releases from bounds a parameter

ResidualAndJacobian = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class LinearProblem:
    """``min |q + R y|`` within a box.

    Attributes
    ----------
    triangle : shape (k, p)
        R; k = min(m, p + 1).
    target : shape (k,)
        q.
    unit : shape (p,)
        D, the unit of each step: ``s = y / unit``.
    lower, upper : shape (p,)
        Box of y; contains 0.
    """

    triangle: FloatArray
    target: FloatArray
    unit: FloatArray
    lower: FloatArray
    upper: FloatArray

    @staticmethod
    def of(
        residual: FloatArray, jacobian: FloatArray, *, unit: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> LinearProblem:
        """Return the problem in the scaled step; `lower` and `upper` bound the step s itself."""
        reduced: FloatArray = np.asarray(np.linalg.qr(np.column_stack([jacobian / unit, residual]), mode="r"))
        return LinearProblem(reduced[:, :-1], reduced[:, -1], unit, lower * unit, upper * unit)

    def predicted_gain(self, step: FloatArray) -> float:
        """Return by how much the sum of squares falls for a step y, were the residual linear."""
        change = self.triangle @ step
        return float(-(2 * self.target + change) @ change)

    @cached_property
    def newton_step(self) -> FloatArray:
        """The undamped step within the box, shape (p,); of least length where the data leave it open."""
        length = np.linalg.norm(self.triangle, axis=0)
        length[length == 0] = 1.0
        free, *_ = np.linalg.lstsq(self.triangle / length, -self.target, rcond=_RANK_TOLERANCE)
        return self._boxed(free / length, 0.0)

    def step_within(self, radius: float) -> tuple[FloatArray, float]:
        """Return the step that is at most `radius` long (to a tenth), and the damping mu that makes it so."""
        if np.linalg.norm(self.newton_step) <= (1 + _RADIUS_MET) * radius:
            return self.newton_step, 0.0
        mu = self._damping(radius)
        left, singular, right = self._svd
        return self._boxed(-right.T @ (singular * (left.T @ self.target) / (singular**2 + mu)), mu), mu

    @cached_property
    def _svd(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        left, singular, right = np.linalg.svd(self.triangle, full_matrices=False)
        return left, singular, right

    def _damping(self, radius: float) -> float:
        """Return mu by bisection of its logarithm: the length of the step falls with mu, and is below gradient / mu."""
        left, singular, _ = self._svd
        gradient = singular * (left.T @ self.target)
        high = float(np.linalg.norm(gradient)) / radius
        low, mu = 1e-30 * high, high
        for _ in range(100):
            mu = float(np.sqrt(low * high))
            length = float(np.linalg.norm(gradient / (singular**2 + mu)))
            if abs(length - radius) <= _RADIUS_MET * radius:
                break
            low, high = (mu, high) if length > radius else (low, mu)
        return mu

    def _boxed(self, step: FloatArray, mu: float) -> FloatArray:
        """Return `step`, or where it leaves the box the solution of the problem with mu within the box."""
        if np.all((step >= self.lower) & (step <= self.upper)):
            return step
        count = step.size
        matrix = np.vstack([self.triangle, np.sqrt(mu) * np.eye(count)])
        target = np.concatenate([-self.target, np.zeros(count)])
        return bounded_least_squares(matrix, target, self.lower, self.upper, step)


def bounded_least_squares(
    matrix: FloatArray, target: FloatArray, lower: FloatArray, upper: FloatArray, start: FloatArray
) -> FloatArray:
    """Return y that minimises ``|matrix y - target|`` with ``lower <= y <= upper``, by active sets.

    For the small dense problems of one step; scipy's ``lsq_linear`` does the same, but takes longer to import than most
    fits take, and stops at an absolute tolerance. The matrix has the shape (k, p); the start need not lie in the box.

    Source: Stark & Parker (1995), Computational Statistics 10, 129-141.
    """
    y = np.clip(start, lower, upper)
    held = (y == lower) | (y == upper)
    length = np.linalg.norm(matrix, axis=0)
    for _ in range(_ROUNDS * y.size):
        y, held = _free_minimum(matrix, target, lower, upper, y, held)
        residual = matrix @ y - target
        pull = -(matrix.T @ residual)
        inward = np.where(y == lower, pull, -pull) * held
        inward[lower == upper] = 0.0
        strength = inward / np.maximum(length * np.linalg.norm(residual), np.finfo(float).tiny)
        if strength.max() <= _PULL_TOLERANCE:
            break
        held[np.argmax(strength)] = False
    return y


def _free_minimum(
    matrix: FloatArray,
    target: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    y: FloatArray,
    held: BoolArray,
) -> tuple[FloatArray, BoolArray]:
    """Move the parameters that are not held to their minimum; one that meets a bound on the way is held there."""
    y, held = y.copy(), held.copy()
    while not held.all():
        free = np.flatnonzero(~held)
        goal, *_ = np.linalg.lstsq(matrix[:, free], target - matrix[:, held] @ y[held], rcond=_RANK_TOLERANCE)
        bound = np.where(goal < y[free], lower[free], upper[free])
        beyond = (goal < lower[free]) | (goal > upper[free])
        if not beyond.any():
            y[free] = goal
            break
        share = np.full(free.size, np.inf)
        share[beyond] = (bound - y[free])[beyond] / (goal - y[free])[beyond]
        first = int(np.argmin(share))
        y[free] += share[first] * (goal - y[free])
        y[free] = np.clip(y[free], lower[free], upper[free])
        y[free[first]] = bound[first]
        held[free[first]] = True
    return y, held


@dataclass(frozen=True)
class Point:
    """An estimate x, shape (p,), with the residual, shape (m,), and its jacobian, shape (m, p), there."""

    x: FloatArray
    residual: FloatArray
    jacobian: FloatArray

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        with np.errstate(over="ignore", invalid="ignore"):
            return float(self.residual @ self.residual)

    @property
    def finite(self) -> bool:
        """Whether the cost and every sensitivity are finite numbers, and their squares too."""
        with np.errstate(over="ignore", invalid="ignore"):
            return bool(np.isfinite(self.cost) and np.isfinite(np.sum(self.jacobian**2)))


@dataclass(frozen=True)
class BoundedProblem:
    """A residual with a start in a box.

    Attributes
    ----------
    function : ``x -> (residual, jacobian)``
    start, lower, upper : shape (p,)
        Infinite where there is no bound.
    scale : shape (p,)
        Typical sizes; 0 where none was given.
    names : p names
    """

    function: ResidualAndJacobian
    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    scale: FloatArray
    names: tuple[str, ...]

    @property
    def free(self) -> BoolArray:
        """Parameters that may move."""
        return np.asarray(self.lower < self.upper)

    @staticmethod
    def checked(
        function: ResidualAndJacobian,
        start: ArrayLike,
        lower: ArrayLike | None,
        upper: ArrayLike | None,
        scale: ArrayLike | None,
        names: Sequence[str] | None,
    ) -> BoundedProblem:
        """Return the problem, or raise ConfigError with all that is wrong with it."""
        x = np.array(start, float)
        if x.ndim != 1 or x.size == 0:
            raise ConfigError.of("the start must be a list of at least one number", found=f"shape {x.shape}")
        low, high, size = (
            _filled(value, default, x.size, what)
            for value, default, what in ((lower, -np.inf, "lower"), (upper, np.inf, "upper"), (scale, 0.0, "scale"))
        )
        labels = tuple(names) if names else tuple(f"x{i}" for i in range(1, x.size + 1))
        problem = BoundedProblem(function, x, low, high, size, labels)
        ConfigError.stop_if_any(problem._faults(scale is not None))
        return problem

    def _faults(self, scaled: bool) -> Iterator[Fault]:
        if len(self.names) != self.start.size:
            yield Fault(f"{self.start.size} parameters but {len(self.names)} names", found=", ".join(self.names))
            return
        for name, x, low, high, size in zip(self.names, self.start, self.lower, self.upper, self.scale, strict=True):
            if not np.isfinite(x):
                yield Fault(f"the start of {name} is not a finite number", found=str(x))
            elif not low <= high:
                yield Fault(f"the bounds of {name} are the wrong way round", found=f"[{low}, {high}]")
            elif not low <= x <= high:
                yield Fault(f"the start of {name} is outside its bounds", found=str(x), expected=f"[{low}, {high}]")
            if scaled and not 0 < size < np.inf:
                yield Fault(f"the scale of {name} must be positive", found=str(size))

    def linearised(self, point: Point, unit: FloatArray) -> LinearProblem:
        """Return the linear problem of the free parameters at a point, in steps scaled by `unit`, shape (p,)."""
        return LinearProblem.of(
            point.residual,
            point.jacobian[:, self.free],
            unit=unit[self.free],
            lower=(self.lower - point.x)[self.free],
            upper=(self.upper - point.x)[self.free],
        )

    def moved(self, x: FloatArray, step: FloatArray) -> FloatArray:
        """Return x with a step of the free parameters added; a step to a bound (but for rounding) ends on it."""
        moved = x.copy()
        moved[self.free] += step
        near = 4 * np.finfo(float).eps * np.maximum(np.abs(x), np.abs(moved))
        moved = np.where(moved <= self.lower + near, self.lower, moved)
        return np.where(moved >= self.upper - near, self.upper, moved)

    def evaluate(self, x: FloatArray) -> Point:
        """Return the point at x; raise ValueError where the function returns arrays of the wrong shape."""
        with np.errstate(all="ignore"):  # a trial step may go too far; what is not finite is rejected
            residual, jacobian = self.function(x)
        residual, jacobian = np.asarray(residual, float), np.asarray(jacobian, float)
        if residual.ndim != 1 or residual.size == 0 or jacobian.shape != (residual.size, x.size):
            raise ValueError(
                f"residual {residual.shape} and jacobian {jacobian.shape} must be (m,) and (m, {x.size}), m > 0"
            )
        return Point(x, residual, jacobian)


def _filled(value: ArrayLike | None, default: float, count: int, what: str) -> FloatArray:
    filled = np.full(count, default) if value is None else np.array(value, float)
    if filled.shape != (count,):
        raise ConfigError.of(
            f"{what} must have one number a parameter", found=f"shape {filled.shape}", expected=f"({count},)"
        )
    return filled
