r"""Probabilities of every set of causes of a single-wheel test, among those that are adequate.

A probability compares explanations with each other; the best of bad ones gets a high one too. So a gate stands before
all probabilities. Each set is first compared with what a right model leaves: with the scatter of repeats and the error
of form that a right model may have (`model.diagnosis.single_wheel.noise.FORM_PER_SCATTER`), both fixed, the least

.. math:: Q = \sum_{channels, groups} \frac{\bar e^2}{\sigma^2/m + a^2} + |v|^2

over the coordinates v (soil and causes, with a standard normal prior) is chi-squared with as many degrees of freedom as
there are group means, if the hypothesis is true. The threshold is the 99 % point of simulated Q, in which the scatter
is estimated from as few repeats as in the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from daq import DataError, FloatArray
from model.diagnosis.core.hypotheses import Posterior, listed_sets, probabilities, with_triples
from model.diagnosis.single_wheel.evidence import SetPosterior, posterior_of
from model.diagnosis.single_wheel.noise import ChannelNoise, scatter_of_repeats
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse, Hypothesis
from model.diagnosis.single_wheel.search import Optima, Optimum, search
from model.diagnosis.single_wheel.sets import family_of, listed_uses, sets_of
from model.effects.catalogue import EFFECTS

_LEVEL = 0.99
_SIMULATIONS = 20_000

_PROMISING = 7.0
"""Nats below the best within which a pair gets a third cause."""
_MOST_PAIRS = 6
_GATED = 10.0
"""Nats below the best within which a set is put to the gate; the others do not count anyway."""
_COUNTED = 14.0
"""Nats below the best within which a set may count with half or twice the error of form."""
_CORRECTED = 4.5
"""Nats below the best within which an evidence is corrected by importance sampling."""
_MOST_CORRECTED = 16


def misfits(problem: BenchProblem, optima: Sequence[Optimum], rows: FloatArray | None = None) -> FloatArray:
    """Return Q of hypotheses, each searched for from where it fits best otherwise.

    `rows`, shape (n,) or (B, n), is 1 for those that count and 0 for those that are excluded; the same for all B
    hypotheses, or each its own.
    """
    fixed = with_usual_form(problem)
    found = search(fixed, [o.hypothesis for o in optima], [o.standard for o in optima], rows)
    counted = [rows if rows is None or rows.ndim == 1 else rows[i] for i in range(len(found))]
    return np.array([_misfit(fixed, optimum, own) for optimum, own in zip(found, counted, strict=True)])


def with_usual_form(problem: BenchProblem) -> BenchProblem:
    """Return the problem with fixed noise: the scatter of repeats, and the error of form of a right model."""
    return replace(problem, noises=tuple(_fixed(noise) for noise in problem.noises))


def threshold(problem: BenchProblem, rng: np.random.Generator, rows: FloatArray | None = None) -> float:
    """Return the Q above which a hypothesis is not right enough."""
    total: FloatArray = np.zeros(_SIMULATIONS)
    for noise, chosen in zip(problem.noises, problem.rows, strict=True):
        counted = np.ones(len(chosen)) if rows is None else rows[chosen]
        size = noise.members.T @ counted
        size = size[size > 0]
        variance, freedom = _scatter(noise) ** 2, int((size - 1).sum())
        estimated = variance * (
            rng.chisquare(freedom, _SIMULATIONS) / freedom if freedom and len(noise.scatter) > 1 else 1.0
        )
        true = variance / size + noise.form_scale**2
        assumed = np.reshape(estimated, (-1, 1)) / size + noise.form_scale**2
        total += (rng.standard_normal((_SIMULATIONS, len(size))) ** 2 * true / assumed).sum(axis=1)
    return float(np.quantile(total, _LEVEL))


def _scatter(noise: ChannelNoise) -> float:
    return float(noise.scatter[0]) if noise.scatter_is_known else scatter_of_repeats(noise.measured, noise.groups)


def _fixed(noise: ChannelNoise) -> ChannelNoise:
    scatter = max(_scatter(noise), 1e-3 * noise.form_scale)
    return replace(noise, scatter=np.array([scatter]), form=np.array([noise.form_scale]), log_weight=np.zeros(1))


def _misfit(fixed: BenchProblem, optimum: Optimum, rows: FloatArray | None) -> float:
    if not np.isfinite(optimum.log_likelihood):
        return np.inf
    total = float(optimum.standard @ optimum.standard)
    for noise, chosen in zip(fixed.noises, fixed.rows, strict=True):
        counted = np.ones(len(chosen)) if rows is None else rows[chosen]
        error = (noise.measured - optimum.predicted[noise.channel][chosen]) * counted
        size = noise.members.T @ counted
        there = size > 0
        mean = (noise.members.T @ error)[there] / size[there]
        total += float((mean**2 / (noise.scatter[0] ** 2 / size[there] + noise.form[0] ** 2)).sum())
    return total


@dataclass(frozen=True)
class Weighed:
    """One set of causes.

    Attributes
    ----------
    log_prior, log_evidence : float
        The evidence is corrected where there is a posterior, else Laplace's shifted by what the corrections show.
    optima : tuple of Optimum
        From several starts, best first.
    misfit : float
        See `misfits`.
    posterior : SetPosterior or None
        Of its coordinates.
    """

    hypothesis: Hypothesis
    log_prior: float
    log_evidence: float
    optima: tuple[Optimum, ...]
    misfit: float
    posterior: SetPosterior | None = None

    @property
    def score(self) -> float:
        """Ln (prior times evidence)."""
        return self.log_prior + self.log_evidence

    @property
    def families(self) -> frozenset[str]:
        """Families in the set."""
        return frozenset(family_of(use) for use in self.hypothesis)


@dataclass(frozen=True)
class Weighing:
    """All sets.

    Attributes
    ----------
    sets : tuple of Weighed
        Most probable families first among the adequate ones, of each the most probable form first; then the others.
    threshold : float
        Misfit above which a set is not right enough.
    """

    problem: BenchProblem
    sets: tuple[Weighed, ...]
    threshold: float

    def adequate(self, weighed: Weighed) -> bool:
        """Whether a set is right enough to be weighed."""
        return weighed.misfit <= self.threshold

    @property
    def any_adequate(self) -> bool:
        """Whether there is an explanation at all."""
        return any(self.adequate(w) for w in self.sets)

    @cached_property
    def probabilities(self) -> FloatArray:
        """Of each set, among the adequate ones where there are any, else among all."""
        gated = self.any_adequate
        passed = np.array([0.0 if self.adequate(w) or not gated else -np.inf for w in self.sets])
        return probabilities(np.array([w.log_evidence for w in self.sets]) + passed, self._log_prior)

    @cached_property
    def ungated(self) -> FloatArray:
        """Probability of each set without the gate."""
        return probabilities(np.array([w.log_evidence for w in self.sets]), self._log_prior)

    @property
    def _log_prior(self) -> FloatArray:
        return np.array([w.log_prior for w in self.sets])

    @cached_property
    def posterior(self) -> Posterior:
        """Probabilities of the sets as `model.diagnosis.core` takes them, no cause first."""
        order = sorted(range(len(self.sets)), key=lambda i: bool(self.sets[i].hypothesis))
        keys = {use.key for w in self.sets for use in w.hypothesis}
        family_of_key = {key: EFFECTS[key].name for key in EFFECTS if key in keys}
        place = {key: i for i, key in enumerate(family_of_key)}
        most = max(len(w.hypothesis) for w in self.sets)
        members = np.full((len(order), max(most, 1)), -1, np.intp)
        for row, i in zip(members, order, strict=True):
            own = sorted(place[use.key] for use in self.sets[i].hypothesis)
            row[: len(own)] = own
        listed = replace(listed_sets(family_of_key, 0), members=members, log_prior=self._log_prior[order])
        evidence = np.array([self.sets[i].log_evidence for i in order])
        return Posterior(listed, evidence, self.probabilities[order], calibrated=True)

    def of_family(self, family: str, probabilities: FloatArray | None = None) -> float:
        """Return the probability that a family is among the causes."""
        p = self.probabilities if probabilities is None else probabilities
        return float(sum(x for x, w in zip(p, self.sets, strict=True) if family in w.families))

    def of_set(self, hypothesis: Hypothesis) -> Weighed:
        """Return a set."""
        return next(w for w in self.sets if w.hypothesis == hypothesis)


def weigh(
    problem: BenchProblem,
    uses: Sequence[CauseUse],
    most: int,
    rng: np.random.Generator,
) -> Weighing:
    """Weigh every set of up to `most` causes.

    Parameters
    ----------
    most : int
        0 to 3; sets of three are made of promising pairs.

    Raises
    ------
    DataError
        No soil near the laboratory's carries the wheel.
    """
    listed = listed_uses(uses, most)
    log_prior = sets_of(uses, listed)
    found = Optima(problem)
    for size in range(min(most, 2) + 1):
        found.add_all(h for h in log_prior if len(h) == size)
        if not size:
            _refuse_unanswered(found.best(()), problem)
    score = np.array([found.best(h).log_evidence + prior for h, prior in log_prior.items()])
    pairs = [i for i in np.argsort(-score, kind="stable").tolist() if (listed.members[i] >= 0).sum() == 2]
    promising = [i for i in pairs[:_MOST_PAIRS] if score[i] > score.max() - _PROMISING]
    if most > 2 and promising:
        log_prior = sets_of(uses, with_triples(listed, np.array(promising, np.intp)))
        found.add_all(log_prior)
    return weighed(found, log_prior, rng)


def _refuse_unanswered(null: Optimum, problem: BenchProblem) -> None:
    if np.isfinite(null.log_likelihood):
        return
    raise DataError.of(
        "the wheel sinks to its axle on every soil near the laboratory's",
        ", ".join(table.name for table in problem.tables),
        next_step="check cohesive_modulus_kn, frictional_modulus_kn, sinkage_exponent, the wheel and the loads",
    )


def weighed_again(near: Weighing, problem: BenchProblem, rng: np.random.Generator) -> Weighing:
    """Weigh the sets that count again, of the same rows with another noise, from where they fit best."""
    top = max(w.score for w in near.sets)
    chosen = [w for w in near.sets if w.score > top - _COUNTED or not w.hypothesis]
    found = Optima(problem)
    found.add_from([(w.hypothesis, w.optima[0].standard) for w in chosen])
    return weighed(found, {w.hypothesis: w.log_prior for w in chosen}, rng)


def weighed(found: Optima, log_prior: Mapping[Hypothesis, float], rng: np.random.Generator) -> Weighing:
    """Weigh sets that were searched for: put them to the gate, correct the evidence of those that count.

    Parameters
    ----------
    found : Optima
        With every set of `log_prior`.
    """
    sets = tuple(Weighed(h, p, found.best(h).log_evidence, found.ranked(h), np.inf) for h, p in log_prior.items())
    return _corrected(_gated(Weighing(found.problem, sets, threshold(found.problem, rng))), rng)


def _gated(weighing: Weighing) -> Weighing:
    """Put the sets that count to the gate; all of them where none of those passes."""
    top = max(w.score for w in weighing.sets)
    done = weighing
    for depth in (_GATED, np.inf):
        chosen = [w for w in weighing.sets if w.score > top - depth or not w.hypothesis]
        missed = misfits(weighing.problem, [w.optima[0] for w in chosen])
        misfit_of = dict(zip((w.hypothesis for w in chosen), missed.tolist(), strict=True))
        done = replace(
            weighing, sets=tuple(replace(w, misfit=misfit_of.get(w.hypothesis, np.inf)) for w in weighing.sets)
        )
        if done.any_adequate:
            break
    return done


def _corrected(weighing: Weighing, rng: np.random.Generator) -> Weighing:
    """Correct the evidence of the sets that count by importance sampling, and order the sets."""
    gated = [w for w in weighing.sets if weighing.adequate(w)] or list(weighing.sets)
    top = max(w.score for w in gated)
    chosen = sorted((w for w in gated if w.score > top - _CORRECTED), key=lambda w: -w.score)[:_MOST_CORRECTED]
    plain = [w for w in weighing.sets if not w.hypothesis and w not in chosen]
    posteriors = {w.hypothesis: posterior_of(weighing.problem, w.optima, rng) for w in (*chosen, *plain)}
    shifts = [posteriors[w.hypothesis].log_evidence - w.log_evidence for w in chosen]
    shift = float(np.median(shifts))
    done = [
        replace(w, log_evidence=posteriors[w.hypothesis].log_evidence, posterior=posteriors[w.hypothesis])
        if w.hypothesis in posteriors
        else replace(w, log_evidence=w.log_evidence + shift)
        for w in weighing.sets
    ]
    score: dict[tuple[bool, frozenset[str]], float] = {}
    for w in done:
        score[weighing.adequate(w), w.families] = float(
            np.logaddexp(score.get((weighing.adequate(w), w.families), -np.inf), w.score)
        )
    done.sort(key=lambda w: (not weighing.adequate(w), -score[weighing.adequate(w), w.families], -w.score))
    return replace(weighing, sets=tuple(done))
