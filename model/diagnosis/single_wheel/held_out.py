"""Which further test on the bench would split the likeliest sets of causes best.

Every design is foretold by both sets, with what each has left unknown; the expected log Bayes factor is the divergence
of the two foretellings from each other, taken as normal, after three repeats at every slip.

What an extension is worth on conditions that neither the choice nor the fit has seen: one group left out at a time.

A group is one condition (one speed) with its repeats, so that nothing is foretold from its own repeats. In every fold
the causes are chosen anew by probability and gate on the rows that are left. The sets that are tried there are the
likeliest by those rows at what all rows estimate, and sets of three grow from pairs of all rows: so far a fold has seen
its own group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from daq import OUTPUTS
from model.diagnosis.core.result import Gain, NextRun, Scores
from model.diagnosis.single_wheel.evidence import Posterior, posterior_of
from model.diagnosis.single_wheel.noise import FORM_SHARE
from model.diagnosis.single_wheel.problem import BenchProblem, Hypothesis
from model.diagnosis.single_wheel.search import Optimum, log_likelihood, search
from model.diagnosis.single_wheel.sets import family_of
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, misfits, threshold
from model.fit.criteria import criteria

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


_LOADS = ((0.5, "half the load"), (2.0, "twice the load"))
_DRAWS = 160
_SETS = 5
_REPEATS = 3
_WORTH = 0.05


@dataclass(frozen=True)
class _Design:
    words: str
    problem: BenchProblem
    channels: tuple[str, ...]


def next_tests(weighing: Weighing, rng: np.random.Generator) -> tuple[NextRun, ...]:
    """Return designs, best first."""
    rivals = _rivals(weighing)
    found = []
    for design in _designs(weighing.problem) if len(rivals) > 1 else []:
        said = [_foretold_of_design(design, weighed, rng) for _, weighed in rivals]
        total, weight, best = 0.0, 0.0, (0.0, ("", ""))
        for i, j in combinations(range(len(rivals)), 2):
            a, b = said[i], said[j]
            if a is None or b is None:
                break
            p = rivals[i][0] * rivals[j][0]
            each = 0.5 * (_divergence(a, b) + _divergence(b, a))
            total, weight = total + p * each, weight + p
            best = max(best, (p * each, _difference(rivals[i][1], rivals[j][1])))
        else:
            if total / weight > _WORTH:
                found.append(NextRun(design.words, best[1], total / weight))
    return tuple(sorted(found, key=lambda run: -run.expected_log_bayes_factor))


def _rivals(weighing: Weighing) -> list[tuple[float, Weighed]]:
    """Return the likeliest sets, of each combination of families the likeliest."""
    found: dict[frozenset[str], tuple[float, Weighed]] = {}
    for p, weighed in zip(weighing.probabilities, weighing.sets, strict=True):
        if weighed.posterior is not None and p > 0:
            found.setdefault(weighed.families, (float(p), weighed))
    return sorted(found.values(), key=lambda pair: -pair[0])[:_SETS]


def _difference(a: Weighed, b: Weighed) -> tuple[str, str]:
    return _name(a, b), _name(b, a)


def _name(weighed: Weighed, other: Weighed) -> str:
    own = [family_of(use) for use in weighed.hypothesis]
    return " and ".join([family for family in own if family not in other.families] or own) or "nothing more"


def _designs(problem: BenchProblem) -> list[_Design]:
    groups = np.unique(problem.group)
    first = np.array([np.flatnonzero(problem.group == g)[0] for g in groups])
    slip, load = (np.array([x[problem.group == g].mean() for g in groups]) for x in (problem.slip, problem.load_n))
    at_centres = replace(problem, slip=slip, load_n=load, bench=problem.bench[first], group=np.arange(len(groups)))
    used = problem.channels
    missing = [channel for channel in OUTPUTS if channel not in used]
    designs = [_Design(f"measure the {OUTPUTS[c].name} too", at_centres, (*used, c)) for c in missing]
    for factor, words in _LOADS:
        designs.append(_Design(words, replace(at_centres, load_n=load * factor), used))
    if missing:
        more = tuple(dict.fromkeys((*used, *missing)))
        for factor, words in _LOADS:
            together = f"{words}, with {' and '.join(OUTPUTS[c].name for c in missing)} measured"
            designs.append(_Design(together, replace(at_centres, load_n=load * factor), more))
    return designs


def _foretold_of_design(
    design: _Design, weighed: Weighed, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """Return mean and covariance of what a set foretells of a design; None where the model has no answer."""
    posterior = weighed.posterior
    assert posterior is not None
    drawn = rng.choice(len(posterior.weights), _DRAWS, p=posterior.weights)
    said, _ = design.problem.evaluate([weighed.hypothesis] * _DRAWS, posterior.standard[drawn])
    values = np.concatenate([said[channel] for channel in design.channels], axis=1)
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
