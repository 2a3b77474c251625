"""Predictions of the weighed sets: of held-out conditions, and of further tests that would separate the sets.

**Held-out conditions.** Gain of an extension on one group at a time, which neither the choice nor the fit has used. A
group is one condition (one speed) with its repeats, so that nothing is predicted from its own repeats. In every fold
the causes are chosen anew by probability and gate on the rows that are left. The sets that are tried there are the
most probable ones on those rows at the estimates from all rows, and sets of three grow from pairs of all rows: to this
extent a fold has used its own group.

**Further tests.** Every design is predicted by both sets, with what each has left unknown; the expected log Bayes
factor is the divergence of the two predictions from each other, taken as normal, after three repeats at every slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray, Note
from model.diagnosis.core.bayes_factors import WORTH_SAYING, best_first, expected_nats
from model.diagnosis.core.gain import HeldOutPrediction, gain_of
from model.diagnosis.core.naming import Judgement, is_usual
from model.diagnosis.core.result import Gain, NextRun
from model.diagnosis.single_wheel.evidence import SetPosterior, posterior_of
from model.diagnosis.single_wheel.findings import with_posterior
from model.diagnosis.single_wheel.noise import FORM_SHARE
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.search import Optimum, log_likelihood, search
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, misfits, threshold
from model.notes import StepCode

_MOST = 30
"""Candidates of a fold: the sets that are most probable on the rows that are kept, before they are searched there."""
_GATED = 8
"""Most probable sets of a fold that are put to the gate; the first is taken where none of them passes."""
_LEAST_GROUPS = 3

_LOADS = (0.5, 2.0)
_DRAWS = 160
_SETS = 5
_REPEATS = 3


def predict_held_out(
    problem: BenchProblem, optima: Sequence[Optimum], rng: np.random.Generator
) -> tuple[HeldOutPrediction, ...]:
    """Predict every group from the others under one hypothesis.

    Parameters
    ----------
    optima : sequence of Optimum
        Of the hypothesis, on all rows.
    """
    folds = [_Fold.of(problem, group) for group in np.unique(problem.group)]
    again = _searched(problem, folds, [optima] * len(folds))
    return tuple(_predicted(problem, fold, own, rng) for fold, own in zip(folds, again, strict=True))


def held_out(weighing: Weighing, rng: np.random.Generator) -> Gain | None:
    """Return the held-out gain of the extension; None with fewer than three groups."""
    problem = weighing.problem
    groups = np.unique(problem.group)
    if len(groups) < _LEAST_GROUPS:
        return None
    folds = [_Fold.of(problem, group) for group in groups]
    best = _best_in(weighing, folds, rng)
    null = _searched(problem, folds, [weighing.of_set(()).optima] * len(folds))
    base = [_predicted(problem, fold, again, rng) for fold, again in zip(folds, null, strict=True)]
    extended = [
        _predicted(problem, fold, (optimum,), rng) if optimum.hypothesis else plain
        for fold, optimum, plain in zip(folds, best, base, strict=True)
    ]
    chosen = [tuple(use.key for use in optimum.hypothesis) for optimum in best]
    return gain_of(base, extended, chosen, problem.channels[0])


@dataclass(frozen=True)
class _Fold:
    held_out: BoolArray
    kept: FloatArray

    @staticmethod
    def of(problem: BenchProblem, group: int) -> _Fold:
        own = problem.group == group
        return _Fold(own, np.where(own, 0.0, 1.0))


def _best_in(weighing: Weighing, folds: Sequence[_Fold], rng: np.random.Generator) -> list[Optimum]:
    """Return, for every fold, the best of the set that is chosen on the rows that are kept."""
    problem = weighing.problem
    counted = [_candidates(weighing, fold) for fold in folds]
    found = _searched(problem, folds, [[w.optima[0] for w in own] for own in counted])
    ranked = []
    for own, optima in zip(counted, found, strict=True):
        score = np.array([o.log_evidence + w.log_prior for o, w in zip(optima, own, strict=True)])
        ranked.append([optima[i] for i in np.argsort(-score)])
    best = []
    gated = [optima[:_GATED] for optima in ranked]
    kept = np.repeat([fold.kept for fold in folds], [len(own) for own in gated], axis=0)
    missed = np.split(
        misfits(problem, [o for own in gated for o in own], kept), np.cumsum([len(o) for o in gated])[:-1]
    )
    for fold, optima, left in zip(folds, ranked, missed, strict=True):
        best.append(optima[int(np.argmax(left <= threshold(problem, rng, fold.kept)))])
    return best


def _searched(
    problem: BenchProblem, folds: Sequence[_Fold], optima: Sequence[Sequence[Optimum]]
) -> list[list[Optimum]]:
    """Return where hypotheses fit best on the rows that each fold keeps, from where they do on others."""
    kept = np.repeat([fold.kept for fold in folds], [len(own) for own in optima], axis=0)
    every = [o for own in optima for o in own]
    found = iter(search(problem, [o.hypothesis for o in every], [o.standard for o in every], kept))
    return [[next(found) for _ in own] for own in optima]


def _candidates(weighing: Weighing, fold: _Fold) -> list[Weighed]:
    """Return the sets that are worth a search on the rows that are kept; no cause at all is always one."""
    predicted = {
        c: np.stack([w.optima[0].predicted[c] for w in weighing.sets]) for c in weighing.sets[0].optima[0].predicted
    }
    kept = log_likelihood(weighing.problem, predicted, fold.kept)
    whole = np.array([w.optima[0].log_likelihood for w in weighing.sets])
    possible = np.isfinite(kept) & np.isfinite(whole)
    score = np.full(len(kept), -np.inf)
    score[possible] = np.array([w.score for w in weighing.sets])[possible] + kept[possible] - whole[possible]
    found = [weighing.sets[i] for i in np.argsort(-score)[:_MOST].tolist() if np.isfinite(score[i])]
    return found if any(not w.hypothesis for w in found) else [*found, weighing.of_set(())]


def _predicted(
    problem: BenchProblem, fold: _Fold, optima: Sequence[Optimum], rng: np.random.Generator
) -> HeldOutPrediction:
    """Predict the rows of a fold that were held out from where a hypothesis fits the others best."""
    posterior = posterior_of(problem, optima, rng, fold.kept)
    weights = posterior.weights
    measured = {channel: problem.measured(channel) for channel in posterior.predicted}
    there = [channel for channel, values in measured.items() if np.isfinite(values).any()]
    return HeldOutPrediction(
        log_likelihood=_log_predictive(problem, posterior),
        measured={channel: measured[channel][fold.held_out] for channel in there},
        predicted={channel: weights @ posterior.predicted[channel][:, fold.held_out] for channel in there},
        judged=np.ones(int(fold.held_out.sum()), bool),
        numbers=int(sum(fold.held_out[rows].sum() for rows in problem.rows)),
    )


def _log_predictive(problem: BenchProblem, posterior: SetPosterior) -> float:
    """Return ln p of the rows that were held out, given those that were kept."""
    possible = np.isfinite(posterior.log_likelihood)
    everything = log_likelihood(problem, {c: values[possible] for c, values in posterior.predicted.items()})
    ratio = everything - posterior.log_likelihood[possible]
    top = float(ratio.max())
    with np.errstate(divide="ignore"):  # no weight is left where the rows fit nowhere: -inf
        return top + float(np.log(posterior.weights[possible] @ np.exp(ratio - top)))


@dataclass(frozen=True)
class _Design:
    step: Note
    problem: BenchProblem
    channels: tuple[str, ...]


def next_tests(weighing: Weighing, verdict: Judgement, rng: np.random.Generator) -> tuple[NextRun, ...]:
    """Return designs, best first, by how well they separate what the verdict leaves open."""
    asked = _left_open(verdict)
    barred = verdict.peak_bar
    rivals = _rivals(weighing, asked) if barred is None else _across_the_peak(weighing, barred, rng)
    found = []
    for design in _designs(weighing.problem) if len(rivals) > 1 else []:
        predictions = [_prediction_of_design(design, weighed, rng) for _, weighed in rivals]
        known = [prediction for prediction in predictions if prediction is not None]
        if len(known) < len(predictions):
            continue
        nats = np.array([[_divergence(a, b) for b in known] for a in known])
        expected = expected_nats(nats, [p for p, _ in rivals])
        if expected > WORTH_SAYING:
            found.append(NextRun(design.step, _parted(rivals, nats, asked), expected))
    return tuple(best_first(found))


def _left_open(verdict: Judgement) -> tuple[str, ...]:
    """Return the families that a verdict does not decide; none where it asks for no set."""
    if verdict.verdict != "one_of":
        return ()
    why = verdict.peak_bar
    return tuple(f for f in verdict.families if why is None or f == why.values["family"] or is_usual(f))


def _across_the_peak(weighing: Weighing, why: Note, rng: np.random.Generator) -> list[tuple[float, Weighed]]:
    """Return the most probable set with a name that a usual stress peak bars, and that with a peak in its place."""
    name, p = why.values["family"], why.values["probability"]
    ranked = sorted(weighing.sets, key=lambda w: -w.score)
    alone = next(w for w in ranked if name in w.families and not any(map(is_usual, w.families)))
    ahead = next(w for w in ranked if name not in w.families and any(map(is_usual, w.families)))
    return [(p, with_posterior(weighing, alone, rng)), (1.0 - p, with_posterior(weighing, ahead, rng))]


def _rivals(weighing: Weighing, asked: Sequence[str]) -> list[tuple[float, Weighed]]:
    """Return the most probable sets, one for each combination of the families asked for, or of all.

    A set with none of those asked for is none to separate.
    """
    found: dict[frozenset[str], tuple[float, Weighed]] = {}
    for p, weighed in zip(weighing.probabilities, weighing.sets, strict=True):
        own = weighed.families & frozenset(asked) if asked else weighed.families
        if weighed.posterior is not None and p > 0 and (own or not asked):
            found.setdefault(own, (float(p), weighed))
    return sorted(found.values(), key=lambda pair: -pair[0])[:_SETS]


def _parted(rivals: Sequence[tuple[float, Weighed]], nats: FloatArray, asked: Sequence[str]) -> tuple[str, ...]:
    """Return in what the two sets differ that come apart most, as likely as they are; of the families asked for.

    A single one: whether it acts.
    """
    p = np.array([probability for probability, _ in rivals])
    i, j = divmod(int(np.argmax(np.outer(p, p) * (nats + nats.T))), len(rivals))
    first, second = rivals[i][1].families, rivals[j][1].families
    own = [[family for family in asked or sorted(a) if family in a - b] for a, b in ((first, second), (second, first))]
    return tuple(" + ".join(families) for families in own if families)


def _designs(problem: BenchProblem) -> list[_Design]:
    groups = np.unique(problem.group)
    first = np.array([np.flatnonzero(problem.group == g)[0] for g in groups])
    slip, load = (np.array([x[problem.group == g].mean() for g in groups]) for x in (problem.slip, problem.load_n))
    at_centres = replace(problem, slip=slip, load_n=load, table=problem.table[first], group=np.arange(len(groups)))
    used = problem.channels
    missing = [channel for channel in OUTPUTS if channel not in used]
    designs = [_Design(_step(1.0, c), at_centres, (*used, c)) for c in missing]
    return designs + [
        _Design(_step(factor, *more), replace(at_centres, load_n=load * factor), (*used, *more))
        for more in dict.fromkeys(((), tuple(missing)))
        for factor in _LOADS
    ]


def _step(load_factor: float, *channels: str) -> Note:
    return Note(StepCode.TABLE, values={"load_factor": load_factor, "channels": channels})


def _prediction_of_design(
    design: _Design, weighed: Weighed, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """Return mean and covariance of what a set predicts for a design; None where the model has no answer."""
    posterior = weighed.posterior
    assert posterior is not None
    drawn = rng.choice(len(posterior.weights), _DRAWS, p=posterior.weights)
    predicted, _ = design.problem.evaluate([weighed.hypothesis] * _DRAWS, posterior.standard[drawn])
    values = np.concatenate([predicted[channel] for channel in design.channels], axis=1)
    possible = np.isfinite(values).all(axis=1)
    if possible.mean() < 0.9:
        return None
    noise = np.concatenate([_variance(design, channel) for channel in design.channels])
    return values[possible].mean(axis=0), np.atleast_2d(np.cov(values[possible].T)) + np.diag(noise)


def _variance(design: _Design, channel: str) -> FloatArray:
    problem = design.problem
    known = {noise.channel: noise for noise in problem.noises}
    if channel in known:
        form, scatter = known[channel].form_scale, float(np.median(known[channel].scatter))
    else:
        form = scatter = FORM_SHARE * problem.size_of(channel)
    return np.full(len(problem.slip), form**2 + scatter**2 / _REPEATS)


def _divergence(a: tuple[FloatArray, FloatArray], b: tuple[FloatArray, FloatArray]) -> float:
    """Return the expected log Bayes factor for a over b if a is true."""
    gap = a[0] - b[0]
    inverse = np.linalg.inv(b[1])
    determinants = float(np.linalg.slogdet(b[1])[1] - np.linalg.slogdet(a[1])[1])
    return 0.5 * (float(np.trace(inverse @ a[1])) - len(gap) + float(gap @ inverse @ gap) + determinants)
