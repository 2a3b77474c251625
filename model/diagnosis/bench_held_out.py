"""What an extension is worth on conditions that neither the choice nor the fit has seen: one group left out at a time.

A group is one condition (one speed) with its repeats, so that nothing is foretold from its own repeats. In every fold
the causes are chosen anew by probability and gate on the rows that are left. The sets that are tried there are the
likeliest by those rows at what all rows estimate, and sets of three grow from pairs of all rows: so far a fold has seen
its own group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.criteria import criteria
from model.diagnosis.bench_adequacy import misfits, threshold
from model.diagnosis.bench_columns import Hypothesis
from model.diagnosis.bench_evidence import Posterior, posterior_of
from model.diagnosis.bench_problem import BenchProblem
from model.diagnosis.bench_search import Optimum, log_likelihood, search
from model.diagnosis.bench_weigh import Weighed, Weighing
from model.diagnosis.result import Gain, Scores

FloatArray = NDArray[np.float64]

_MOST = 30
"""Candidates of a fold: the sets that are likeliest on the rows that are kept, before they are searched there."""
_GATED = 8
"""Likeliest sets of a fold that are put to the gate; the likeliest is taken where none of them passes."""
_RESAMPLES = 2000
_LEAST_GROUPS = 3


@dataclass(frozen=True)
class Foretold:
    """What hypotheses say of groups that were left out.

    Attributes
    ----------
    said : mapping channel -> array, shape (n,)
        Every row from the fold in which it was left out; NaN where it never was.
    log_likelihood : array, shape (groups,)
        ln p of each left-out group, given the others.
    chosen : tuple of Hypothesis
        Of each fold.
    groups : int array, shape (groups,)
    """

    said: dict[str, FloatArray]
    log_likelihood: FloatArray
    chosen: tuple[Hypothesis, ...]
    groups: NDArray[np.intp]

    def error(self, problem: BenchProblem, channel: str) -> FloatArray:
        """Return measured minus foretold, shape (n,); NaN where not measured."""
        return np.asarray(problem.measured(channel) - self.said[channel])

    def rms(self, problem: BenchProblem, channel: str) -> float:
        """Return the root mean square error of a channel."""
        return float(np.sqrt(np.nanmean(self.error(problem, channel) ** 2)))


def foretell(problem: BenchProblem, optima: Sequence[Optimum], rng: np.random.Generator) -> Foretold:
    """Foretell every group from the others under one hypothesis.

    Parameters
    ----------
    problem : BenchProblem
    optima : sequence of Optimum
        Of the hypothesis, on all rows.
    rng : Generator
    """
    groups = np.unique(problem.group)
    folds = [_Fold.of(problem, group) for group in groups]
    return _joined(problem, groups, [_foretold(problem, fold, optima, rng) for fold in folds], [optima[0].hypothesis])


def gain_of(weighing: Weighing, rng: np.random.Generator) -> Gain | None:
    """Return the held-out gain of the extension; None with fewer than three groups."""
    problem = weighing.problem
    groups = np.unique(problem.group)
    if len(groups) < _LEAST_GROUPS:
        return None
    base, extended, chosen = [], [], []
    for group in groups:
        fold = _Fold.of(problem, group)
        best = _best_in(weighing, fold, rng)
        base.append(_foretold(problem, fold, weighing.of_set(()).optima, rng))
        extended.append(_foretold(problem, fold, best, rng) if best[0].hypothesis else base[-1])
        chosen.append(best[0].hypothesis)
    return _gain(problem, _joined(problem, groups, base, [()]), _joined(problem, groups, extended, chosen), rng)


@dataclass(frozen=True)
class _Fold:
    left_out: NDArray[np.bool_]
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


def _foretold(
    problem: BenchProblem, fold: _Fold, optima: Sequence[Optimum], rng: np.random.Generator
) -> tuple[dict[str, FloatArray], float, NDArray[np.bool_]]:
    hypothesis = optima[0].hypothesis
    again = search(problem, [hypothesis] * len(optima), [o.standard for o in optima], fold.kept)
    posterior = posterior_of(problem, again, rng, fold.kept)
    weights = posterior.weights
    said = {channel: weights @ values[:, fold.left_out] for channel, values in posterior.said.items()}
    return said, _log_predictive(problem, posterior), fold.left_out


def _log_predictive(problem: BenchProblem, posterior: Posterior) -> float:
    """Return ln p of the rows that were left out, given those that were kept."""
    possible = np.isfinite(posterior.log_likelihood)
    everything = log_likelihood(problem, {c: values[possible] for c, values in posterior.said.items()})
    ratio = everything - posterior.log_likelihood[possible]
    top = float(ratio.max())
    return top + float(np.log(posterior.weights[possible] @ np.exp(ratio - top)))


def _joined(
    problem: BenchProblem,
    groups: NDArray[np.intp],
    parts: Sequence[tuple[dict[str, FloatArray], float, NDArray[np.bool_]]],
    chosen: Sequence[Hypothesis],
) -> Foretold:
    said = {channel: np.full(len(problem.slip), np.nan) for channel in parts[0][0]}
    for values, _, rows in parts:
        for channel, foretold in values.items():
            said[channel][rows] = foretold
    return Foretold(said, np.array([likelihood for _, likelihood, _ in parts]), tuple(chosen), groups)


def _gain(problem: BenchProblem, base: Foretold, extended: Foretold, rng: np.random.Generator) -> Gain:
    first = problem.channels[0]
    reduction = _reduction(base.error(problem, first), extended.error(problem, first))
    member = [problem.group == group for group in base.groups]
    resampled = []
    for _ in range(_RESAMPLES):
        drawn = rng.integers(0, len(member), len(member))
        rows = np.concatenate([np.flatnonzero(member[i]) for i in drawn])
        resampled.append(_reduction(base.error(problem, first)[rows], extended.error(problem, first)[rows]))
    low, high = np.quantile(resampled, [0.025, 0.975])
    return Gain(
        base=_scores(problem, base),
        extended=_scores(problem, extended),
        reduction_percent=reduction,
        interval95=(float(low), float(high)),
        log_likelihood_gain=float((extended.log_likelihood - base.log_likelihood).sum()),
        chosen=tuple(tuple(use.key for use in hypothesis) for hypothesis in extended.chosen),
        channel=first,
    )


def _reduction(base: FloatArray, extended: FloatArray) -> float:
    before, after = (float(np.sqrt(np.nanmean(error**2))) for error in (base, extended))
    return 100.0 * (1.0 - after / before)


def _scores(problem: BenchProblem, foretold: Foretold) -> dict[str, Scores]:
    """Return the criteria of every channel that was measured, used or not."""
    found = {}
    for channel, said in foretold.said.items():
        measured = problem.measured(channel)
        if not np.isfinite(measured).any():
            continue
        seen = criteria(measured, said, problem.slip, -1.0)
        found[channel] = Scores(seen.R0_N, seen.M0_percent, seen.R2, float(foretold.log_likelihood.mean()))
    return found
