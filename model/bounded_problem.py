"""A bounded least-squares problem as it was handed in: checked at the door, evaluated, linearised."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import ConfigError, Fault
from model.linear_step import LinearProblem

FloatArray = NDArray[np.float64]
ResidualAndJacobian = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


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
    function : callable
        ``x -> (residual, jacobian)``.
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
    def free(self) -> NDArray[np.bool_]:
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
            raise ConfigError(Fault("the start must be a list of at least one number", found=f"shape {x.shape}"))
        low, high, size = (
            _filled(value, default, x.size, what)
            for value, default, what in ((lower, -np.inf, "lower"), (upper, np.inf, "upper"), (scale, 0.0, "scale"))
        )
        labels = tuple(names) if names else tuple(f"x{i}" for i in range(1, x.size + 1))
        problem = BoundedProblem(function, x, low, high, size, labels)
        faults = problem._faults(scale is not None)
        if faults:
            raise ConfigError(*faults)
        return problem

    def _faults(self, scaled: bool) -> list[Fault]:
        if len(self.names) != self.start.size:
            return [Fault(f"{self.start.size} parameters but {len(self.names)} names", found=", ".join(self.names))]
        faults = []
        for name, x, low, high, size in zip(self.names, self.start, self.lower, self.upper, self.scale, strict=True):
            if not np.isfinite(x):
                faults.append(Fault(f"the start of {name} is not a finite number", found=str(x)))
            elif not low <= high:
                faults.append(Fault(f"the bounds of {name} are the wrong way round", found=f"[{low}, {high}]"))
            elif not low <= x <= high:
                faults.append(
                    Fault(f"the start of {name} is outside its bounds", found=str(x), expected=f"[{low}, {high}]")
                )
            if scaled and not 0 < size < np.inf:
                faults.append(Fault(f"the scale of {name} must be positive", found=str(size)))
        return faults

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
        raise ConfigError(
            Fault(f"{what} must have one number a parameter", found=f"shape {filled.shape}", expected=f"({count},)")
        )
    return filled
