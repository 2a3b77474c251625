"""Many tests, one terrain: parameters common to all tests, with intervals that allow for the scatter between tests.

A laboratory's plates differ from test to test by far more than the points of one curve scatter about it (soil is
prepared anew each time): on a real sand by 6 % in pressure and 0.08 in n, against 1 % and 0.03 from the points. A fit
of all points at once would take the points of one test for independent evidence and give intervals several times too
short. Here every test i counts once, by the pair of numbers y_i that its own fit gives, with

    y_i = f(x; test i) + u_i + e_i,   cov(u_i) = Omega (between tests),   cov(e_i) = S_i (points of test i).     (1)

x is found by Gauss-Newton with the weights 1/diag(Omega + S_i), Omega from the residuals by moments (divided by the
tests less the parameters that each of the two numbers has), the two in turn until they settle. The covariance of x is
the sandwich of the full Omega + S_i, so that the correlation of the two numbers is in it, and intervals use Student's
t. Where there are no repeats (as many tests as parameters) Omega cannot be seen: a typical laboratory scatter is then
*assumed*, and said to be.

Source: Davidian & Giltinan (1995), Nonlinear Models for Repeated Measurement Data, chapter 5 (two-stage estimation).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from daq import DataError, FloatArray, Note
from model.bevameter.window import FitFault
from model.fit.gauss_newton import GaussNewtonOptions, GaussNewtonResult, gauss_newton
from model.notes import BevameterCode

Common = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""x, shape (p,) -> what it gives for each test, shape (tests, 2), and its sensitivities, shape (tests, 2, p)."""

POSITIVE = ("stiffness", "sinkage_exponent", "tan_phi", "strength_pa", "shear_modulus_m")
"""Parameters that are above 0 in every soil: log-normal, so that their intervals stay there. Cohesion may be 0, and k_c
and k_phi trade off against each other across 0: those are normal."""
_ROUNDS = 20
_SETTLED = 1e-6
_LARGEST_LOG = 50.0  # of an interval's half: any number, and no overflow
_WIDE = 1.5  # Student's t over the normal quantile from which on there is a warning


@dataclass(frozen=True)
class JointFit:
    """Parameters common to several tests.

    Attributes
    ----------
    names : p names
        With the unit in the name; SI.
    values : shape (p,)
    covariance : shape (p, p)
    freedom : shape (p,)
        Degrees of freedom of Student's t; infinite where the scatter is assumed.
    scatter : shape (2, 2)
        Omega of (1), between tests.
    scatter_source : "repeats" or "assumed"
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    freedom: FloatArray
    scatter: FloatArray
    scatter_source: Literal["repeats", "assumed"]
    tests: int
    warnings: tuple[Note, ...] = ()

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def __contains__(self, name: str) -> bool:
        return name in self.names

    @property
    def sigma(self) -> FloatArray:
        """One-sigma of each parameter, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval95(self) -> FloatArray:
        """95 % intervals by Student's t, shape (p, 2): of the logarithm for a parameter of `POSITIVE`."""
        half = self.sigma * _quantile(self.freedom)
        plain = np.column_stack([self.values - half, self.values + half])
        positive = np.array([name in POSITIVE for name in self.names]) & (self.values > 0)
        size = np.where(positive, self.values, 1.0)
        ratio = np.exp(np.minimum(half / size, _LARGEST_LOG))
        return np.where(positive[:, None], np.column_stack([size / ratio, size * ratio]), plain)

    @property
    def normal_covariance(self) -> FloatArray:
        """Covariance of the normal distribution with the same 95 % intervals, shape (p, p)."""
        widening = _quantile(self.freedom) / _quantile(np.array([np.inf]))
        return self.covariance * np.outer(widening, widening)


def fit_jointly(
    estimates: Sequence[tuple[FloatArray, FloatArray]],
    common: Common,
    start: ArrayLike,
    *,
    names: Sequence[str],
    parameters: tuple[int, int],
    assumed_scatter: tuple[float, float],
) -> tuple[JointFit, GaussNewtonResult]:
    """Fit common parameters to the pairs of numbers of several tests, y_i of shape (2,) and S_i of shape (2, 2) in (1).

    `parameters` is how many of the p named ones determine the first number of a test, and how many the second.
    `assumed_scatter` is the one-sigma of the two numbers between tests, used where there are no repeats. `DataError`
    where the fit does not converge.

    Source: Davidian & Giltinan (1995), section 5.3.
    """
    measured = np.array([value for value, _ in estimates])
    points = np.array([spread for _, spread in estimates])
    free = np.array([len(estimates) - count for count in parameters], float)
    repeats = bool(free.min() >= 1)
    assumed = np.diag(np.square(assumed_scatter))
    omega = assumed
    for _ in range(_ROUNDS if repeats else 1):
        result = _weighted(measured, common, start, omega, points, names)
        if repeats:
            before, omega = omega, _between(measured - common(result.estimate)[0], free, points)
            if np.allclose(before, omega, rtol=_SETTLED, atol=1e-30):
                break
    joint = JointFit(
        names=tuple(names),
        values=result.estimate,
        covariance=_sandwich(common(result.estimate)[1], omega, points),
        freedom=np.full(len(names), free.min() if repeats else np.inf),
        scatter=omega,
        scatter_source="repeats" if repeats else "assumed",
        tests=len(estimates),
        warnings=_few_repeats(len(estimates), float(free.min()), assumed_scatter),
    )
    return joint, result


def _weighted(
    measured: FloatArray, common: Common, start: ArrayLike, omega: FloatArray, points: FloatArray, names: Sequence[str]
) -> GaussNewtonResult:
    sigma = _sigmas(omega, points)

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        given, slopes = common(x)
        return ((given - measured) / sigma).ravel(), (slopes / sigma[:, :, None]).reshape(measured.size, -1)

    result = gauss_newton(residual, start, names=names, options=GaussNewtonOptions(noise="unit"))
    if not result.converged:
        raise DataError(
            FitFault(
                "the tests cannot be brought under one set of parameters",
                found=f"stopped: {result.stop_reason}",
                next_step="look at the fits of the single tests; exclude what is not this terrain",
                notes=result.warnings,
            )
        )
    return result


def _sigmas(omega: FloatArray, points: FloatArray) -> FloatArray:
    """Return the weights' one-sigma, shape (tests, 2); never quite 0, so that exact curves can be fitted."""
    variance = np.diag(omega) + np.diagonal(points, axis1=1, axis2=2)
    return np.sqrt(np.maximum(variance, 1e-12 * max(float(variance.max()), 1e-12)))


def _between(residual: FloatArray, free: FloatArray, points: FloatArray) -> FloatArray:
    """Return Omega by moments, with no negative eigenvalue."""
    total = residual.T @ residual / np.sqrt(np.outer(free, free))
    values, vectors = np.linalg.eigh(total - points.mean(axis=0))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _sandwich(slopes: FloatArray, omega: FloatArray, points: FloatArray) -> FloatArray:
    """Return the covariance of x, shape (p, p), for slopes of shape (tests, 2, p)."""
    weights = _sigmas(omega, points) ** -2
    bread = np.linalg.inv(np.einsum("tip,ti,tiq->pq", slopes, weights, slopes))
    weighted = weights[:, :, None] * slopes
    meat = np.einsum("tip,tij,tjq->pq", weighted, omega + points, weighted)
    return np.asarray(bread @ meat @ bread)


def _quantile(freedom: FloatArray) -> FloatArray:
    return np.asarray(scipy.special.stdtrit(np.where(np.isinf(freedom), 1e12, freedom), 0.975))


def _few_repeats(tests: int, free: float, assumed: tuple[float, float]) -> tuple[Note, ...]:
    if free < 1:
        return (Note(BevameterCode.NO_REPEATS, values={"tests": tests, "scatter": assumed}),)
    widening = float(_quantile(np.array([free]))[0] / 1.96)
    if widening < _WIDE:
        return ()
    return (Note(BevameterCode.FEW_REPEATS, values={"tests": tests, "freedom": free, "widening": widening}),)
