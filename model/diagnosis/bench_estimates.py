"""Values of causes and of the soil, as the posterior of all sets that hold them gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_columns import CauseUse
from model.diagnosis.bench_evidence import posterior_of
from model.diagnosis.bench_sets import family_of
from model.diagnosis.bench_weigh import Weighed, Weighing
from model.diagnosis.result import Cause, ParameterEstimate, SoilEstimate
from model.effects import EFFECTS

FloatArray = NDArray[np.float64]

_COUNTED = 3.0
"""Nats below the likeliest set that holds a cause within which another one counts for its parameters."""
_MOST = 12
_SUMS = {"lyasko": (("m1", "m2"), "p")}
"""Parameters of which only the sum is well determined, and what it is called."""


@dataclass(frozen=True)
class Draws:
    """Weighted values of one quantity, shape (m,) each."""

    values: FloatArray
    weights: FloatArray

    def estimate(self, name: str, unit: str) -> ParameterEstimate:
        """Return the mean with the 95 % interval between quantiles."""
        mean = float(self.weights @ self.values)
        sigma = float(np.sqrt(self.weights @ (self.values - mean) ** 2))
        order = np.argsort(self.values)
        steps = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        low, high = np.interp([0.025, 0.975], steps, self.values[order])
        return ParameterEstimate(name, unit, mean, (float(low), float(high)), sigma)


def cause_of(weighing: Weighing, family: str, probability: float, rng: np.random.Generator) -> Cause:
    """Return a family's likeliest form with its parameters, over all sets that hold it."""
    shares: dict[CauseUse, float] = {}
    for p, weighed in zip(weighing.probabilities, weighing.sets, strict=True):
        for use in weighed.hypothesis:
            if family_of(use) == family:
                shares[use] = shares.get(use, 0.0) + float(p)
    use = max(shares, key=lambda u: shares[u])
    effect = EFFECTS[use.key]
    total = sum(shares.values())
    return Cause(
        name=family,
        form=effect.form,
        kind=effect.kind,
        key=use.key,
        probability=probability,
        form_probability=shares[use] / total if total > 0 else 1.0 / len(shares),
        parameters=estimates_of(weighing, use, rng),
    )


def estimates_of(weighing: Weighing, use: CauseUse, rng: np.random.Generator) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of a cause, over all sets that hold it."""
    effect = EFFECTS[use.key]
    draws = parameter_draws(weighing, use, rng)
    found = [draws[p.name].estimate(p.name, p.unit) for p in effect.parameters]
    if use.key in _SUMS:
        names, total_name = _SUMS[use.key]
        total = Draws(np.sum([draws[name].values for name in names], axis=0), draws[names[0]].weights)
        found.insert(0, total.estimate(total_name, effect.parameters[0].unit))
    return tuple(found)


def parameter_draws(weighing: Weighing, use: CauseUse, rng: np.random.Generator) -> dict[str, Draws]:
    """Return weighted values of every parameter of a cause, over the likeliest sets that hold it."""
    gated = [w for w in weighing.sets if use in w.hypothesis and weighing.adequate(w)]
    ranked = sorted(gated or [w for w in weighing.sets if use in w.hypothesis], key=lambda w: -w.score)
    counted = [w for w in ranked if w.posterior or w.score > ranked[0].score - _COUNTED][:_MOST]
    holding = [(float(np.exp(w.score - ranked[0].score)), with_posterior(weighing, w, rng)) for w in counted]
    problem = weighing.problem
    values: dict[str, list[FloatArray]] = {}
    weights = []
    for p, weighed in holding:
        assert weighed.posterior is not None
        standard = weighed.posterior.standard[:, problem.positions(weighed.hypothesis)[use]]
        for column, coordinate in zip(standard.T, problem.coordinates(use), strict=True):
            values.setdefault(coordinate.name, []).append(coordinate.values(column)[0])
        weights.append(p * weighed.posterior.weights)
    share = np.concatenate(weights)
    return {name: Draws(np.concatenate(parts), share / share.sum()) for name, parts in values.items()}


def with_posterior(weighing: Weighing, weighed: Weighed, rng: np.random.Generator) -> Weighed:
    """Return a set with its posterior, computed where the evidence did not need it."""
    if weighed.posterior is not None:
        return weighed
    return replace(weighed, posterior=posterior_of(weighing.problem, weighed.optima, rng))


def soils_of(weighing: Weighing, weighed: Weighed) -> tuple[SoilEstimate, ...]:
    """Return the soils that a set of causes leaves; the set has a posterior."""
    problem, posterior = weighing.problem, weighed.posterior
    assert posterior is not None
    found = []
    for i, soil in enumerate(problem.soils):
        bench = problem.benches[problem.soil_of.index(i)]
        start, stop = problem.soil_offsets[i : i + 2]
        values, _ = soil.values(posterior.standard[:, start:stop])
        natural = soil.soil_parameters(values, bench.wheel.width_m)
        draws = {name: Draws(column, posterior.weights).estimate(name, "") for name, column in natural.items()}
        names = [b.name for b, of in zip(problem.benches, problem.soil_of, strict=True) if of == i]
        found.append(
            SoilEstimate(
                " and ".join(names), {n: d.value for n, d in draws.items()}, {n: d.sigma for n, d in draws.items()}
            )
        )
    return tuple(found)


def short_set(weighing: Weighing, families: Sequence[str], level: float = 0.95) -> list[str]:
    """Return the fewest families, likeliest first, one of which is among the causes with a probability of `level`.

    What has no cause at all does not count.
    """
    holds = np.array([[family in w.families for family in families] for w in weighing.sets], bool)
    some = np.array([bool(w.hypothesis) for w in weighing.sets])
    p = np.where(some, weighing.probabilities, 0.0)
    left, chosen = p.copy(), list[int]()
    while p.sum() > 0 and left.sum() > (1.0 - level) * p.sum() and len(chosen) < len(families):
        chosen.append(int(np.argmax(left @ holds)))
        left = np.where(holds[:, chosen[-1]], 0.0, left)
    return [families[i] for i in chosen]
