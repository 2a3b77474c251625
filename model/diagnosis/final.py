"""Final parameters of a set of causes: the whole model again, not its linearisation, and intervals that are honest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import estimate
from model.diagnosis.grams import Grams
from model.diagnosis.look import Look
from model.diagnosis.result import ParameterEstimate, SoilEstimate
from model.diagnosis.set_problem import SetProblem, set_problem
from model.diagnosis.spread import Spread, interval, spread_of
from model.gauss_newton import GaussNewtonOptions, GaussNewtonResult, gauss_newton
from model.one_thread import one_thread
from model.profile import profile_of_sum
from model.soils import SOIL_PARAMETERS

FloatArray = NDArray[np.float64]

_OPTIONS = GaussNewtonOptions(epsilon=1e-3, cost_tolerance=1e-7, max_iterations=25, noise="unit")
_GLANCE = replace(_OPTIONS, max_iterations=4)
_PROMISING = 20.0
"""Cost above the best, after a few steps from another start, up to which it is followed to its end."""
_SMALL = 0.2
_LATENCY_STARTS = (-1.0, -0.4, 0.4, 1.0)
_SUMS = {"lyasko": (("m1", "m2"), "p")}
"""Effects of whose two parameters the sum is what the data tell."""
_PARTED = 0.9
"""Size of the correlation of two parameters above which each on its own says little."""
_PRECISION = 0.03


@dataclass(frozen=True)
class Bounds:
    """Of one parameter of a problem."""

    lower: float
    upper: float


@dataclass(frozen=True)
class SetFit:
    """A set of causes fitted to everything; x holds the soils' coordinates and then the causes' coefficients.

    Attributes
    ----------
    keys : tuple of str
    problem : SetProblem
        Whitened at the estimate.
    estimate : array, shape (q + c,)
    at_bound : bool array, shape (q + c,)
    cost : float
        Of whitened residuals and priors.
    stop_reason : str
    evaluations : int
    """

    keys: tuple[str, ...]
    problem: SetProblem
    estimate: FloatArray
    at_bound: NDArray[np.bool_]
    cost: float
    stop_reason: str
    evaluations: int

    @property
    def soil(self) -> FloatArray:
        """Coordinates of the soils, shape (q,)."""
        return self.estimate[: len(self.problem.soil)]

    @property
    def sizes(self) -> dict[str, FloatArray]:
        """Coefficients of each effect, in units of the prior scale."""
        x = self.estimate[len(self.problem.soil) :]
        keys = [c.key for c in self.problem.causes]
        return {key: x[[i for i, k in enumerate(keys) if k == key]] for key in self.keys}

    @property
    def free(self) -> tuple[Bounds, ...]:
        """Bounds of x."""
        lower, upper = self.problem.bounds
        return tuple(Bounds(float(a), float(b)) for a, b in zip(lower, upper, strict=True))

    def residual_and_jacobian(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `SetProblem.residual_and_jacobian`."""
        return self.problem.residual_and_jacobian(x)

    def grams(self) -> Grams:
        """Return the Gram matrices about the estimate; their causes are the set's only."""
        return self.problem.grams()


@one_thread
def fit_set(look: Look, keys: tuple[str, ...], *, starts: Literal["one", "several"] = "several") -> SetFit:
    """Fit a set of causes with the whole model.

    Gauss-Newton starts at the linear estimate; where a one-sided cause is small there, at its prior scale too, since
    it may have stuck to its bound; and for a latency at several, since false ones confirm themselves. The cheapest is
    kept, and what whitens renewed there.

    Parameters
    ----------
    look : Look
    keys : tuple of str
        Effects of the set; empty: the soil alone.
    starts : "one" or "several"
        "one": at the linear estimate only, where a point to linearise about is all that is asked for.
    """
    linear = estimate(look.grams, keys)
    problem = set_problem(look.views, look.grams, keys)
    lower, upper = problem.bounds
    start = np.clip(np.r_[linear.soil, linear.coefficients[list(linear.columns)]], lower, upper)
    if set(keys) != set(look.best.keys):
        problem = problem.refrozen(start)
    if not start.size:
        return SetFit(keys, problem.refrozen(start), start, np.zeros(0, bool), float("nan"), "nothing to fit", 0)
    tried = [_solved(problem, start)]
    found = tried[0]
    for other in _others(problem, start) if starts == "several" else ():
        tried.append(_solved(problem, other, _GLANCE))
        if tried[-1].cost < found.cost + _PROMISING:
            tried.append(_solved(problem, tried[-1].estimate))
            found = min(found, tried[-1], key=lambda result: result.cost)
    problem = problem.refrozen(found.estimate)
    last = _solved(problem, found.estimate)
    return SetFit(
        keys=keys,
        problem=problem,
        estimate=last.estimate,
        at_bound=last.at_bound,
        cost=last.cost,
        stop_reason=str(last.stop_reason),
        evaluations=sum(result.iterations + 1 for result in [*tried, last]),
    )


def _solved(problem: SetProblem, start: FloatArray, options: GaussNewtonOptions = _OPTIONS) -> GaussNewtonResult:
    lower, upper = problem.bounds
    return gauss_newton(
        problem.residual_and_jacobian,
        start,
        lower=lower,
        upper=upper,
        scale=np.ones(len(start)),
        options=options,
    )


def _others(problem: SetProblem, start: FloatArray) -> Iterator[FloatArray]:
    """Yield where else to start."""
    lower, upper = problem.bounds
    for i, cause in enumerate(problem.causes, len(problem.soil)):
        if cause.family == "speed_latency":
            others = [size for size in _LATENCY_STARTS if abs(size - start[i]) > _SMALL]
        else:
            others = [1.0] if cause.one_sided and start[i] < _SMALL else []
        for size in others:
            moved = start.copy()
            moved[i] = np.clip(size, lower[i], upper[i])
            yield moved


def parameters_of(fit: SetFit, look: Look, spread: Spread | None = None) -> dict[str, tuple[ParameterEstimate, ...]]:
    """Return the parameters of every effect of a set, with 95 % intervals.

    Of Lyasko's law the sum p = m1 + m2 comes first, by profile; m1 and m2 have intervals only where they can be
    parted. A parameter at its bound has an interval from there.

    Parameters
    ----------
    fit : SetFit
    look : Look
    spread : Spread, optional
        Of the fit, where it is known already.
    """
    spread = spread or spread_of(fit.problem, fit.estimate, look, fit.keys)
    found: dict[str, tuple[ParameterEstimate, ...]] = {}
    offset = len(fit.problem.soil)
    for key in fit.keys:
        own = [offset + i for i, c in enumerate(fit.problem.causes) if c.key == key]
        singly = [_estimate(fit, spread, i) for i in own]
        if key in _SUMS and len(own) == 2:
            total = _sum(fit, spread, (own[0], own[1]), _SUMS[key][1])
            correlation = spread.correlation(*own)
            if not abs(correlation) < _PARTED:
                nothing = (float("nan"), float("nan"))
                singly = [ParameterEstimate(p.name, p.unit, p.value, nothing, float("nan")) for p in singly]
            singly = [total, *singly]
        found[key] = tuple(singly)
    return found


def _estimate(fit: SetFit, spread: Spread, i: int) -> ParameterEstimate:
    cause = fit.problem.causes[i - len(fit.problem.soil)]
    size = abs(cause.scale)
    value = cause.neutral + float(fit.estimate[i]) * cause.scale
    sigma = size * float(spread.sigmas[i])
    low, high = interval(value, sigma, float(spread.degrees[i]))
    return ParameterEstimate(cause.parameter, cause.unit, value, (max(low, cause.lower), min(high, cause.upper)), sigma)


def _sum(fit: SetFit, spread: Spread, pair: tuple[int, int], name: str) -> ParameterEstimate:
    """Return the sum of two parameters of one scale, by profile."""
    i, j = pair
    cause = fit.problem.causes[i - len(fit.problem.soil)]
    direction = np.zeros(len(fit.estimate))
    direction[[i, j]] = 1.0
    sigma, naive, degrees = spread.along(direction)
    centre = float(fit.estimate[i] + fit.estimate[j])
    low, high = interval(0.0, sigma, degrees)
    allowed = (high / naive) ** 2 if naive > 0 else 0.0
    low, high = profile_of_sum(fit, fit.estimate, pair, allowed, span=high, precision=_PRECISION)
    scale = abs(cause.scale)
    return ParameterEstimate(name, cause.unit, centre * scale, (low * scale, high * scale), sigma * scale)


def soils_of(fit: SetFit, look: Look, spread: Spread | None = None) -> tuple[SoilEstimate, ...]:
    """Return the soil of every campaign, with the set of causes in the model.

    Parameters
    ----------
    fit, look, spread
        As for `parameters_of`.
    """
    spread = spread or spread_of(fit.problem, fit.estimate, look, fit.keys)
    found = []
    for part, view in zip(fit.problem.parts, look.views, strict=True):
        space = part.simulation.space
        u = fit.estimate[part.soil]
        jacobian = space.jacobian(u)
        sigmas = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, spread.covariance[part.soil, part.soil], jacobian))
        found.append(
            SoilEstimate(
                view.campaign.name,
                space.values(u),
                {name: float(s) for name, s in zip(SOIL_PARAMETERS, sigmas, strict=True)},
            )
        )
    return tuple(found)
