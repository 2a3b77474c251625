"""Gain of an extension on held-out conditions, which neither the choice nor the fit has used: one group at a time.

A group is one condition (one speed) with its repeats, so that nothing is predicted from its own repeats. In every fold
the causes are chosen anew by probability and gate on the rows that are left. The sets that are tried there are the
most probable ones on those rows at the estimates from all rows, and sets of three grow from pairs of all rows: to this
extent a fold has used its own group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq import BoolArray, FloatArray
from model.diagnosis.core.gain import HeldOutPrediction, gain_of
from model.diagnosis.core.result import Gain
from model.diagnosis.single_wheel.evidence import SetPosterior, posterior_of
from model.diagnosis.single_wheel.problem import BenchProblem
from model.diagnosis.single_wheel.search import Optimum, log_likelihood, search
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, misfits, threshold

_MOST = 30
"""Candidates of a fold: the sets that are most probable on the rows that are kept, before they are searched there."""
_GATED = 8
"""Most probable sets of a fold that are put to the gate; the first is taken where none of them passes."""
_LEAST_GROUPS = 3


def predict_held_out(
    problem: BenchProblem, optima: Sequence[Optimum], rng: np.random.Generator
) -> tuple[HeldOutPrediction, ...]:
    """Predict every group from the others under one hypothesis.

    Parameters
    ----------
    optima : sequence of Optimum
        Of the hypothesis, on all rows.
    """
    return tuple(_predicted(problem, _Fold.of(problem, group), optima, rng) for group in np.unique(problem.group))


def held_out(weighing: Weighing, rng: np.random.Generator) -> Gain | None:
    """Return the held-out gain of the extension; None with fewer than three groups."""
    problem = weighing.problem
    groups = np.unique(problem.group)
    if len(groups) < _LEAST_GROUPS:
        return None
    base, extended, chosen = [], [], []
    for group in groups:
        fold = _Fold.of(problem, group)
        best = _best_in(weighing, fold, rng)
        base.append(_predicted(problem, fold, weighing.of_set(()).optima, rng))
        extended.append(_predicted(problem, fold, best, rng) if best[0].hypothesis else base[-1])
        chosen.append(tuple(use.key for use in best[0].hypothesis))
    return gain_of(base, extended, chosen, problem.channels[0], rng)


@dataclass(frozen=True)
class _Fold:
    left_out: BoolArray
    kept: FloatArray

    @staticmethod
    def of(problem: BenchProblem, group: int) -> _Fold:
        left_out = problem.group == group
        return _Fold(left_out, np.where(left_out, 0.0, 1.0))


def _best_in(weighing: Weighing, fold: _Fold, rng: np.random.Generator) -> tuple[Optimum, ...]:
    """Return the optima of the set that is chosen on the rows that are kept."""
    counted = _candidates(weighing, fold)
    problem = weighing.problem
    found = search(problem, [w.hypothesis for w in counted], [w.optima[0].standard for w in counted], fold.kept)
    score = np.array([o.log_evidence + w.log_prior for o, w in zip(found, counted, strict=True)])
    ranked = [found[i] for i in np.argsort(-score)]
    adequate = misfits(problem, ranked[:_GATED], fold.kept) <= threshold(problem, rng, fold.kept)
    return (ranked[int(np.argmax(adequate))],)


def _candidates(weighing: Weighing, fold: _Fold) -> list[Weighed]:
    """Return the sets that are worth a search on the rows that are kept; no cause at all is always one."""
    said = {c: np.stack([w.optima[0].said[c] for w in weighing.sets]) for c in weighing.sets[0].optima[0].said}
    kept = log_likelihood(weighing.problem, said, fold.kept)
    whole = np.array([w.optima[0].log_likelihood for w in weighing.sets])
    possible = np.isfinite(kept) & np.isfinite(whole)
    score = np.full(len(kept), -np.inf)
    score[possible] = np.array([w.score for w in weighing.sets])[possible] + kept[possible] - whole[possible]
    found = [weighing.sets[i] for i in np.argsort(-score)[:_MOST].tolist() if np.isfinite(score[i])]
    return found if any(not w.hypothesis for w in found) else [*found, weighing.of_set(())]


def _predicted(
    problem: BenchProblem, fold: _Fold, optima: Sequence[Optimum], rng: np.random.Generator
) -> HeldOutPrediction:
    hypothesis = optima[0].hypothesis
    again = search(problem, [hypothesis] * len(optima), [o.standard for o in optima], fold.kept)
    posterior = posterior_of(problem, again, rng, fold.kept)
    weights = posterior.weights
    measured = {channel: problem.measured(channel) for channel in posterior.said}
    there = [channel for channel, values in measured.items() if np.isfinite(values).any()]
    return HeldOutPrediction(
        log_likelihood=_log_predictive(problem, posterior),
        measured={channel: measured[channel][fold.left_out] for channel in there},
        predicted={channel: weights @ posterior.said[channel][:, fold.left_out] for channel in there},
        judged=np.ones(int(fold.left_out.sum()), bool),
        numbers=int(sum(fold.left_out[rows].sum() for rows in problem.rows)),
    )


def _log_predictive(problem: BenchProblem, posterior: SetPosterior) -> float:
    """Return ln p of the rows that were left out, given those that were kept."""
    possible = np.isfinite(posterior.log_likelihood)
    everything = log_likelihood(problem, {c: values[possible] for c, values in posterior.said.items()})
    ratio = everything - posterior.log_likelihood[possible]
    top = float(ratio.max())
    return top + float(np.log(posterior.weights[possible] @ np.exp(ratio - top)))
