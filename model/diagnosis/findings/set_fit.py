r"""Final parameters of a set of causes, fitted with the whole model and not its linearisation, and their intervals.

The noise model's own covariance :math:`H^{-1}` is too short: its hyper-parameters are estimated, runs differ by more
than it knows, and other sets of causes are possible. So each variance is put together from

- the model's, and the sandwich over runs :math:`H^{-1} (\sum_r g_r g_r' + I) H^{-1}`, which needs no noise model but
  has only as many degrees of freedom as there are runs. Each stands for as many observations as it has degrees: the
  model's for `TRUST`. The ratio of both to the model's never narrows an interval;
- what the estimate moves when each hyper-parameter moves by its own one-sigma;
- what it moves between the sets of causes that hold it, weighted by their probabilities;
- what the error of form moves it: that is the same in every run, and no number of runs averages it out.

The interval is Student's with the degrees of freedom of the first.

Source: Bell & McCaffrey (2002), Survey Methodology 28:169; Efron & Morris (1973), J. Am. Stat. Assoc. 68:117
(shrinkage); Kass & Steffey (1989), J. Am. Stat. Assoc. 84:717 (hyper-parameters); Hoeting et al. (1999), Stat. Sci.
14:382 (sets of causes).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from daq import BoolArray, FloatArray
from model.cores import in_parallel, one_thread
from model.diagnosis.core.result import ParameterEstimate, SoilEstimate
from model.diagnosis.findings.set_problem import SetProblem, set_problem
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import estimate, posterior, prior_information
from model.diagnosis.time_series.joining import groups_of
from model.diagnosis.time_series.linearised_campaign import STEPS, LinearisedCampaign
from model.diagnosis.time_series.start import CampaignData
from model.effects.catalogue import EFFECTS
from model.fit.gauss_newton import GaussNewtonOptions, GaussNewtonResult, gauss_newton
from model.fit.intervals import Blocks, Sandwich, profile_of_sum, sandwich
from model.wheel_soil.soils import SOIL_PARAMETERS

TRUST = 20.0
"""Degrees of freedom that the noise model's own covariance stands for; see docs/decisions/diagnosis-intervals.md."""
CONFIDENCE = 0.95
_LEAST_SHARE = 0.01
"""Of the most probable set's probability, below which a set is not asked."""
_MOST_SETS = 40

_OPTIONS = GaussNewtonOptions(epsilon=1e-3, cost_tolerance=1e-7, max_iterations=25, noise="unit")
_GLANCE = replace(_OPTIONS, max_iterations=4)
_PROMISING = 20.0
"""Cost above the best, after a few steps from another start, up to which it is followed to its end."""
_SMALL = 0.2
_PARTED = 0.9
"""Size of the correlation of two parameters above which each on its own says little."""
_PRECISION = 0.03


@dataclass(frozen=True)
class Spread:
    """Spread of the p numbers of a fitted set.

    Attributes
    ----------
    covariance : array, shape (p, p)
        Everything together.
    naive : array, shape (p, p)
        The noise model's own.
    robust : array, shape (p, p)
        Of the sandwich over runs.
    degrees : array, shape (p,)
        Of freedom.
    by_noise, by_choice, by_form : array, shape (p,)
        Variances for the hyper-parameters, for the choice of the set, and for the error of form.
    """

    covariance: FloatArray
    naive: FloatArray
    robust: FloatArray
    degrees: FloatArray
    by_noise: FloatArray
    by_choice: FloatArray
    by_form: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma of each, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def correlation(self, i: int, j: int) -> float:
        """Return the correlation of two of them by the noise model alone."""
        return float(self.naive[i, j] / np.sqrt(self.naive[i, i] * self.naive[j, j]))

    def along(self, direction: FloatArray) -> tuple[float, float, float]:
        """Return one-sigma of a combination, the noise model's own, and its degrees of freedom."""
        weight = direction != 0
        variance, naive = (float(direction @ x @ direction) for x in (self.covariance, self.naive))
        return float(np.sqrt(variance)), float(np.sqrt(naive)), float(self.degrees[weight].min())


def spread_of(problem: SetProblem, x: FloatArray, linearised: LinearisedCampaign, keys: tuple[str, ...]) -> Spread:
    """Return the spread of a set that is whitened and fitted at `x`, shape (p,); the keys are of its effects."""
    count = len(x)
    if not count:
        nothing = np.zeros((0, 0))
        return Spread(nothing, nothing, nothing, *(np.zeros(0),) * 4)
    found, combined, degrees = _over_runs(problem, x)
    by_noise = ((problem.score_changes(x) @ found.naive) ** 2).sum(axis=0)
    by_choice, by_form = _by_choice(linearised, keys, count), _by_form(linearised.grams, keys)
    extra = np.sqrt(1.0 + (by_noise + by_choice + by_form) / np.diag(combined))
    return Spread(
        covariance=combined * np.outer(extra, extra),
        naive=found.naive,
        robust=found.covariance,
        degrees=np.full(count, degrees + TRUST),
        by_noise=by_noise,
        by_choice=by_choice,
        by_form=by_form,
    )


def spread_within(
    problem: SetProblem, x: FloatArray, linearised: LinearisedCampaign, keys: tuple[str, ...]
) -> FloatArray:
    """Return the covariance of a fitted set's numbers given that it is the one, shape (p, p).

    Without what the noise's hyper-parameters move, which takes most of the time of `spread_of`, and without what the
    choice of the set moves.
    """
    if not len(x):
        return np.zeros((0, 0))
    _, combined, _ = _over_runs(problem, x)
    extra = np.sqrt(1.0 + _by_form(linearised.grams, keys) / np.diag(combined))
    return np.asarray(combined * np.outer(extra, extra))


def _over_runs(problem: SetProblem, x: FloatArray) -> tuple[Sandwich, FloatArray, float]:
    """Return the sandwich over runs, the covariance that it widens the noise model's to, and degrees of freedom."""
    rows = problem.runs(x)
    everything = np.concatenate(rows)
    run = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
    jacobian, scores = everything[:, 1:], everything[:, 1:] * everything[:, :1]
    blocks = Blocks(run, len(rows), float("nan"), float("nan"))
    found = sandwich(jacobian[:, None], scores, blocks, np.diag(problem.prior))
    degrees = max(min(found.degrees, len(rows) - 1.0), 0.0)
    share = degrees / (degrees + TRUST)
    both = (1.0 - share) * found.naive + share * found.covariance
    widening = np.maximum(np.sqrt(np.diag(both) / np.diag(found.naive)), 1.0)
    return found, found.naive * np.outer(widening, widening), degrees


def interval(value: float, sigma: float, degrees: float) -> tuple[float, float]:
    """Return Student's 95 % interval."""
    reach = float(scipy.special.stdtrit(degrees, 0.5 + 0.5 * CONFIDENCE)) * sigma
    return value - reach, value + reach


def _by_form(grams: Grams, keys: tuple[str, ...]) -> FloatArray:
    """Return what the error of form adds to the variance of soil and coefficients, shape (p,)."""
    at = np.r_[grams.soil_columns, [i for key in keys for i in grams.columns_of(key)]].astype(np.intp)
    prior = np.diag(prior_information(grams, keys))
    known, exact = (np.linalg.inv(prior + x[np.ix_(at, at)]) for x in (grams.net, grams.total))
    return np.asarray(np.maximum(np.diag(known) - np.diag(exact), 0.0))


def _by_choice(linearised: LinearisedCampaign, keys: tuple[str, ...], count: int) -> FloatArray:
    """Return the variance of the set's coefficients between the sets that hold it, shape (p,); 0 for the soil."""
    total = np.zeros(count)
    if not keys:
        return total
    weighed = posterior(linearised.grams, linearised.excluded, linearised.most_causes)
    listed = weighed.hypotheses
    own = [listed.effects.index(key) for key in keys if key in listed.effects]
    holding = np.flatnonzero(listed.has_effect[:, own].all(axis=1))
    order = holding[np.argsort(-weighed.probability[holding])][:_MOST_SETS]
    order = order[weighed.probability[order] > _LEAST_SHARE * weighed.probability[order[0]]]
    alone = estimate(linearised.grams, keys)
    columns = list(alone.columns)
    sizes = np.array([estimate(linearised.grams, listed.keys_of(int(i))).coefficients[columns] for i in order])
    weights = weighed.probability[order] / weighed.probability[order].sum()
    total[count - len(columns) :] = weights @ (sizes - alone.coefficients[columns]) ** 2
    return total


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
    problem : SetProblem
        Whitened at the estimate.
    estimate : array, shape (q + c,)
    at_bound : bool array, shape (q + c,)
    cost : float
        Of whitened residuals and priors.
    """

    keys: tuple[str, ...]
    problem: SetProblem
    estimate: FloatArray
    at_bound: BoolArray
    cost: float

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
def fit_set(
    linearised: LinearisedCampaign, keys: tuple[str, ...], *, starts: Literal["one", "several"] = "several"
) -> SetFit:
    """Fit a set of causes with the whole model.

    Gauss-Newton starts at the linear estimate; where a one-sided cause is small there, at its prior scale too, since it
    may have stuck to its bound; and for a latency at several, since false ones confirm themselves. The cheapest is
    kept, and what whitens renewed there. The set about which was linearised is estimated with the error of form in
    mind; what others leave is no error of form. Without keys it is the soil alone. One start, at the linear estimate,
    does where only a point to linearise about is asked for.
    """
    linear = estimate(linearised.grams, keys)
    problem = set_problem(linearised.campaigns, linearised.grams, keys)
    lower, upper = problem.bounds
    start = np.clip(np.r_[linear.soil, linear.coefficients[list(linear.columns)]], lower, upper)
    if set(keys) != set(linearised.best.keys):
        problem, start = _answered(problem, start)
    if not start.size:
        return SetFit(keys, problem.refrozen(start), start, np.zeros(0, bool), float("nan"))
    others = _others(problem, start) if starts == "several" else ()
    tasks = [(start, _OPTIONS), *((other, _GLANCE) for other in others)]
    found, *glances = in_parallel(lambda task: _solved(problem, *task), tasks, rows=linearised.rows)
    for tried in glances:
        if tried.cost < found.cost + _PROMISING:
            found = min(found, _solved(problem, tried.estimate), key=lambda result: result.cost)
    problem = problem.refrozen(found.estimate)
    last = _solved(problem, found.estimate)
    shown = last.estimate
    if set(keys) == set(linearised.best.keys):
        shown = shifted(problem, shown, _form_shift(linearised.grams, keys))
    return SetFit(
        keys=keys,
        problem=problem,
        estimate=shown,
        at_bound=last.at_bound,
        cost=last.cost,
    )


def _form_shift(grams: Grams, keys: tuple[str, ...]) -> FloatArray:
    """Return by how much an estimate that knows of the error of form differs from one that does not, shape (p,)."""
    own = list(estimate(grams, keys).columns)
    found = [estimate(g, keys) for g in (grams, replace(grams, form=0.0))]
    known, exact = (np.r_[linear.soil, linear.coefficients[own]] for linear in found)
    return np.asarray(known - exact)


def shifted(problem: SetProblem, x: FloatArray, shift: FloatArray) -> FloatArray:
    """Return numbers with as much of a shift, within bounds, as no sample loses its answer."""
    for share in STEPS:
        moved = np.clip(x + share * shift, *problem.bounds)
        if all(np.isfinite(rows).all() for rows in problem.runs(moved)):
            break
    return moved


def fit_sets(
    linearised: LinearisedCampaign, sets: Sequence[tuple[str, ...]], *, starts: Literal["one", "several"]
) -> dict[tuple[str, ...], SetFit]:
    """Fit several sets of causes, each as `fit_set` does, in parallel."""

    def light(keys: tuple[str, ...]) -> SetFit:
        return _of_data(fit_set(linearised, keys, starts=starts), [None] * len(linearised.campaigns))

    found = in_parallel(light, sets, rows=linearised.rows)
    return {keys: _of_data(fit, linearised.campaigns) for keys, fit in zip(sets, found, strict=True)}


def _of_data(fit: SetFit, campaigns: Sequence[CampaignData | None]) -> SetFit:
    """Return a fit whose problem has the campaigns' data, or none: between processes they are not sent."""
    parts = zip(fit.problem.parts, campaigns, strict=True)
    of = tuple(replace(part, data=data) for part, data in parts)  # type: ignore[arg-type]
    return replace(fit, problem=replace(fit.problem, parts=of))


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


def _answered(problem: SetProblem, start: FloatArray) -> tuple[SetProblem, FloatArray]:
    """Return the problem whitened at a start, which lies as far from neutral as no sample loses its answer."""
    for share in STEPS:
        moved = problem.refrozen(share * start)
        lost = (old.frozen.usable & ~new.frozen.usable for old, new in zip(problem.parts, moved.parts, strict=True))
        if not any(map(np.any, lost)):
            break
    return moved, share * start


def _others(problem: SetProblem, start: FloatArray) -> Iterator[FloatArray]:
    """Yield where else to start."""
    lower, upper = problem.bounds
    for i, cause in enumerate(problem.causes, len(problem.soil)):
        starts = (1.0,) if cause.one_sided and start[i] < _SMALL else EFFECTS[cause.key].starts
        for size in starts:
            if abs(size - start[i]) <= _SMALL:
                continue
            moved = start.copy()
            moved[i] = np.clip(size, lower[i], upper[i])
            yield moved


def parameters_of(
    fit: SetFit, linearised: LinearisedCampaign, spread: Spread | None = None
) -> dict[str, tuple[ParameterEstimate, ...]]:
    """Return the parameters of every effect of a set, with 95 % intervals.

    Of Lyasko's law the sum p = m1 + m2 comes first, by profile; m1 and m2 have intervals only where they can be parted.
    A parameter at its bound has an interval from there. `spread` is that of the fit, where it is known already.
    """
    spread = spread or spread_of(fit.problem, fit.estimate, linearised, fit.keys)
    found: dict[str, tuple[ParameterEstimate, ...]] = {}
    offset = len(fit.problem.soil)
    for key in fit.keys:
        own = [offset + i for i, c in enumerate(fit.problem.causes) if c.key == key]
        singly = [_estimate(fit, spread, i) for i in own]
        if EFFECTS[key].total:
            total = _sum(fit, spread, (own[0], own[1]), EFFECTS[key].total)
            correlation = spread.correlation(*own)
            if not abs(correlation) < _PARTED:
                nothing = (float("nan"), float("nan"))
                singly = [ParameterEstimate(p.name, p.unit, p.value, nothing, float("nan")) for p in singly]
            singly = [total, *singly]
        found[key] = tuple(singly)
    return found


def parameters_within(fit: SetFit, covariance: FloatArray) -> dict[str, tuple[ParameterEstimate, ...]]:
    """Return the parameters of every effect of a set given that it is the one; see `spread_within`."""
    offset, sigmas = len(fit.problem.soil), np.sqrt(np.diag(covariance))
    return {
        key: tuple(
            _valued(fit, i, float(sigmas[i]), TRUST) for i, c in enumerate(fit.problem.causes, offset) if c.key == key
        )
        for key in fit.keys
    }


def _estimate(fit: SetFit, spread: Spread, i: int) -> ParameterEstimate:
    return _valued(fit, i, float(spread.sigmas[i]), float(spread.degrees[i]))


def _valued(fit: SetFit, i: int, sigma: float, degrees: float) -> ParameterEstimate:
    """Return a parameter of its coordinate's one-sigma."""
    cause = fit.problem.causes[i - len(fit.problem.soil)]
    value = cause.neutral + float(fit.estimate[i]) * cause.scale
    sigma *= abs(cause.scale)
    low, high = interval(value, sigma, degrees)
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


def soils_of(fit: SetFit, linearised: LinearisedCampaign, spread: Spread | None = None) -> tuple[SoilEstimate, ...]:
    """Return the soil of every campaign, with the set of causes in the model.

    It takes what `parameters_of` does.
    """
    spread = spread or spread_of(fit.problem, fit.estimate, linearised, fit.keys)
    return soils_with(fit, linearised, spread.covariance)


def of_soils(linearised: LinearisedCampaign) -> dict[int, str]:
    """Return the place of a campaign for every soil, with the soil's name: wheels of one vehicle have one."""
    campaigns = [data.campaign for data in linearised.campaigns]
    return {group[0]: campaigns[group[0]].ground for group in groups_of(campaigns)}


def soils_with(fit: SetFit, linearised: LinearisedCampaign, covariance: FloatArray) -> tuple[SoilEstimate, ...]:
    """Return the soil of every campaign, of wheels of one vehicle once; with the covariance of the fit's p numbers."""
    found = []
    for i, name in of_soils(linearised).items():
        part, data = fit.problem.parts[i], linearised.campaigns[i]
        space = part.simulation.space
        u = fit.estimate[part.soil]
        jacobian = space.jacobian(u)
        sigmas = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance[np.ix_(part.soil, part.soil)], jacobian))
        found.append(
            SoilEstimate(
                name,
                space.values(u),
                {name: float(s) for name, s in zip(SOIL_PARAMETERS, sigmas, strict=True)},
                data.campaign.soil_prior.sized(),
            )
        )
    return tuple(found)
