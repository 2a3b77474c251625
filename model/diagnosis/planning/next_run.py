r"""Which manoeuvre would split a set of causes best, and the noise that an explanation is judged by.

**Candidates.** Every manoeuvre of `model.diagnosis.planning.manoeuvres` is linearised and whitened as if it had been
driven, with the noise model of the campaign. Others need no soil (`model.diagnosis.planning.static_tests`).

**Plausible noise.** Slip is measured, and an error of the ground speed shows in all channels at once. So does much
else: a slip that lags behind, a soil that answers late. A noise model that may choose its speed error and its delays
freely explains them all; one that may choose the soil's scatter freely takes a soft patch for it. Whether an
explanation is adequate is therefore judged with a speed error no larger than the sensor is stated to have, with a
margin, or than a usual receiver has, with delays no longer than what is thought of toothed rings, and with a soil as
even as is thought of one terrain.

**What further data do.** Let member i of the set be the cause at its estimated size. Data with cross products G then
favour it over member j, at whatever size j imitates it best, by an expected

.. math:: \tfrac12\, d^2_{i|j}(G) = \tfrac12\, z_i^2 (1 - \cos^2_{ij})

nats (`model.diagnosis.findings.isolability`: z is d, the cosine is that of the signatures once the soil is projected
out). What one more run adds is the difference of that with and without it. Against the whole rest of the set, with
weights :math:`w_j`, i gains :math:`-\ln \sum_j w_j \exp(-\Delta_{ij})`: a run that separates i from all others
but one confounded cause is worth little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from daq import FloatArray, Note
from model.cores import in_parallel
from model.diagnosis.core.bayes_factors import WORTH_SAYING, best_first, comes_apart, expected_nats
from model.diagnosis.core.result import NextRun
from model.diagnosis.findings.isolability import Projected, least_left, own_columns
from model.diagnosis.findings.isolability import projected_without_soil as without_soil
from model.diagnosis.planning.manoeuvres import Manoeuvre, manoeuvres, typical_run
from model.diagnosis.planning.naming_chance import Outlook
from model.diagnosis.planning.static_tests import Products, static_tests
from model.diagnosis.time_series.columns import Grams, cause_columns, columns_of
from model.diagnosis.time_series.joining import turn_of
from model.diagnosis.time_series.linearise import Point, Simulation, linearise
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import hyper_priors
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.start import CampaignData
from model.diagnosis.time_series.whitening import run_grams
from model.notes import LackCode, StepCode

MOST = 5
COST_RUNS = {
    StepCode.RUT: 1.5,
    StepCode.SLOWER_RAMPS: 2.0,
    StepCode.LIFTED_ZERO: 0.5,
    StepCode.KNOWN_PULL: 2.0,
    StepCode.KNOWN_TORQUE: 2.0,
    StepCode.HARD_GROUND: 2.0,
}
"""Time that a step takes, in runs like the others, where it is not one; an estimate of ours: a wheel is lifted while a
run is prepared, a winch or a lever is rigged in the time of two runs, hard ground is some way off, and reading a rut
takes half a run beside the run that makes it."""
# The step where the runs contradict a static test; what that will read is not foreseen.
REPEAT = NextRun(Note(StepCode.REPEAT_STATIC), (), np.nan, 2.0, naming_barred=LackCode.AGAINST_STATIC)
_BETTER = 1.05
"""Times what one more run like the others would give: less is no reason to drive another way."""


@dataclass(frozen=True)
class Member:
    """A cause of the set.

    Attributes
    ----------
    size : array, shape (parameters,)
        Coefficients, in units of the prior scale.
    probability : float
        Weight; need not sum to 1.
    """

    key: str
    size: FloatArray
    probability: float = 1.0


@dataclass(frozen=True)
class Split:
    """What more data would do.

    Attributes
    ----------
    nats : array, shape (members, members)
        What they add to the expected log Bayes factor of the row's member, if it is the cause, over the column's.
    expected_log_bayes_factor : float
        Of the true member over the rest, averaged over which is true; nats.
    parted : tuple of str
        Keys of the members that come apart from at least one other.
    """

    nats: FloatArray
    expected_log_bayes_factor: float
    parted: tuple[str, ...]


def split(grams: Grams, added: FloatArray, members: tuple[Member, ...]) -> Split:
    """Say what more data would do to a set of causes.

    The sum over runs in `grams` is what is known now; `added`, shape (m, m), has the cross products of the data to be
    added.
    """
    total = grams.total
    before = _pairwise(grams, without_soil(grams, total), members)
    nats = np.maximum(_pairwise(grams, without_soil(grams, total + added), members) - before, 0.0)
    parted = tuple(member.key for member, apart in zip(members, comes_apart(nats), strict=True) if apart)
    return Split(nats, expected_nats(nats, [member.probability for member in members]), parted)


def _pairwise(grams: Grams, projected: Projected, members: tuple[Member, ...]) -> FloatArray:
    """Return half of d^2 of each member that each other leaves, shape (members, members); 0 on the diagonal."""
    found = np.zeros((len(members), len(members)))
    for i, member in enumerate(members):
        for j, other in enumerate(members):
            if i != j:
                columns = own_columns(grams, other.key)
                sided = np.array([grams.causes[c].one_sided for c in columns])
                left = least_left(projected.information, own_columns(grams, member.key), member.size, columns, sided)
                found[i, j] = 0.5 * left**2
    return found


def members_of(sizes: Mapping[str, FloatArray], probabilities: Mapping[str, float]) -> tuple[Member, ...]:
    """Return the members of a set by their keys; one without a probability counts as any other."""
    return tuple(Member(key, np.asarray(size, float), probabilities.get(key, 1.0)) for key, size in sizes.items())


def next_runs(
    linearised: LinearisedCampaign, members: tuple[Member, ...], most: int = MOST, ahead: Outlook | None = None
) -> tuple[NextRun, ...]:
    """Rank up to `most` manoeuvres by what one more run of them does to a set of causes, best first.

    The members are the causes that were not separable, at their estimated sizes; with one there is no run to rank. What
    does no better than one more run like the others is left out. What a run separates are families. `ahead` is what may
    be true, where a name is what is missing.
    """
    known = {c.key: c.family for c in linearised.grams.causes}
    own = tuple(member for member in members if member.key in known)
    if len(own) < 2:
        return ()
    likely = [cause.key for cause in ahead.grams.causes] if ahead else []
    keys = tuple(dict.fromkeys((*(member.key for member in own), *linearised.best.keys, *likely)))
    candidates = list(_candidates(linearised, keys))
    several = len(linearised.campaigns) > 1
    matrices = in_parallel(lambda c: c.products(), candidates, rows=linearised.rows)
    ranked = []
    for candidate, matrix in zip(candidates, matrices, strict=True):
        added = embedded(linearised, candidate.campaign, candidate.simulation, matrix)
        result = split(linearised.grams, added, own)
        families = tuple(dict.fromkeys(known[key] for key in result.parted))
        name = linearised.campaigns[candidate.campaign].campaign.name if several else ""
        code = StepCode(candidate.step.code)
        cost, chance = COST_RUNS.get(code, 1.0), ahead.chance(code, added) if ahead else None
        ranked.append(
            NextRun(
                candidate.step,
                families,
                result.expected_log_bayes_factor,
                cost,
                name,
                chance,
                ahead.not_foreseen if ahead else "",
            )
        )
    again = [REPEAT] if ahead is not None and ahead.not_foreseen == LackCode.AGAINST_STATIC else []
    plain = [run.expected_log_bayes_factor for run in ranked if run.step.code == StepCode.LIKE_OTHERS]
    least = max(_BETTER * max(plain, default=0.0), WORTH_SAYING)
    worth = [
        run
        for run in best_first(ranked)
        if run.expected_log_bayes_factor > least or run.decides or run.step.code == StepCode.LIKE_OTHERS
    ]
    return tuple([*again, *worth][:most])


@dataclass(frozen=True)
class _Candidate:
    """What could be done, the number of its campaign, and what computes the cross products that it gives."""

    step: Note
    campaign: int
    simulation: Simulation
    products: Callable[[], FloatArray]


def _candidates(linearised: LinearisedCampaign, keys: tuple[str, ...]) -> Iterator[_Candidate]:
    for index, data in enumerate(linearised.campaigns):
        if not len(data.samples):
            continue
        effects = tuple(e for e in data.simulation.effects if e.key() in keys)
        simulation = replace(data.simulation, effects=effects)
        for manoeuvre in manoeuvres(data.samples, [run.run.added_load_kg for run in data.campaign.runs]):
            products = partial(run_matrix, data, simulation, manoeuvre)
            yield _Candidate(manoeuvre.step, index, simulation, products)
        typical = typical_run(data.samples)
        for step, of_causes in static_tests(typical, data.samples.rests):
            products = partial(_without_soil, of_causes, data, simulation, typical)
            yield _Candidate(step, index, simulation, products)


def _without_soil(of_causes: Products, data: CampaignData, simulation: Simulation, typical: Samples) -> FloatArray:
    """Return the cross products of what shows nothing of the soil."""
    return np.pad(of_causes(data, simulation, typical), (1 + len(simulation.space), 0))


def run_matrix(data: CampaignData, simulation: Simulation, manoeuvre: Manoeuvre) -> FloatArray:
    """Return the cross products of a run that was not driven: residual (void), soil, causes.

    `data` is of the campaign it would belong to; the simulation is that one's, perhaps with fewer effects.
    """
    samples = manoeuvre.samples
    linear = linearise(simulation, samples, _point(data, simulation, samples))
    variance = np.full(len(samples), float(np.median(data.speed_variance)))
    columns = columns_of(simulation, samples, linear, variance)
    values = {name: prior.centre for name, prior in hyper_priors(samples).items()} | data.noise.values
    keep = 1 + len(columns.soil) + len(columns.causes)
    return run_grams(samples, linear, columns, values, variance).matrices[0, :keep, :keep]


def _point(data: CampaignData, simulation: Simulation, samples: Samples) -> Point:
    known = {key for _, _, key in simulation.parameters}
    causes = {key: value for key, value in data.linear.point.causes.items() if key in known}
    return Point(data.linear.point.soil, causes, np.zeros(len(samples)))


def embedded(linearised: LinearisedCampaign, index: int, simulation: Simulation, matrix: FloatArray) -> FloatArray:
    """Return cross products of one campaign in the layout of all campaigns' Grams, shape (m, m); the rest is zero.

    `index` is that of the campaign. The causes in `matrix`, shape (1 + q + k, 1 + q + k), are the effects of the
    simulation.
    """
    grams: Grams = linearised.grams
    own, width = cause_columns(simulation, {}), grams.matrices.shape[1]
    turn = turn_of(own, linearised.soil_of(index), grams.causes, len(grams.soil), width)
    turn[0] = 0.0
    return np.asarray(turn.T @ matrix @ turn)
