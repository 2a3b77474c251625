"""The evidence of one hypothesis on few rows, by importance sampling around where it fits best.

With fifteen rows and a soil barely known a posterior is bent and one-sided, and Laplace's evidence may be off by a nat
or more. Draws from Student's t distributions around the optima, widened once to what the first draws show, are
weighted by prior times likelihood: an unbiased evidence with its own error, and a posterior for every parameter.

Source: Geweke (1989), Econometrica 57:1317; Veach & Guibas (1995) (balance heuristic of several proposals).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import lgamma, log, pi

import numpy as np

from daq import FloatArray
from model.diagnosis.single_wheel.problem import BenchProblem, Hypothesis
from model.diagnosis.single_wheel.search import Optimum, log_likelihood

_FREEDOM = 5.0
_STRETCHES = (1.0, 3.0, 10.0)
"""Of the first proposals: the noise is a mixture, and so the posterior narrow and wide at once."""
_FIRST, _ROUND = 180, 240
"""Draws around the optima, and from each proposal that the draws so far ask for."""
_ENOUGH = 80.0
"""Independent draws after which there are no more rounds."""
_ROUNDS = (2, 6)
"""Least and most."""
_MODE_GAP = 6.0
"""Nats by which another optimum may be less likely and still counts as one."""


@dataclass(frozen=True)
class SetPosterior:
    """Weighted draws of one hypothesis.

    Attributes
    ----------
    log_evidence_sigma : float
        Its own error.
    standard : array, shape (draws, p)
    log_weight : array, shape (draws,)
        ln (prior / proposal) of each draw: without the likelihood, so that rows can be held out.
    predicted : mapping channel -> array, shape (draws, n)
    log_likelihood : array, shape (draws,)
    """

    hypothesis: Hypothesis
    log_evidence: float
    log_evidence_sigma: float
    standard: FloatArray
    log_weight: FloatArray
    predicted: dict[str, FloatArray]
    log_likelihood: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Weights of the draws, shape (draws,); they sum to 1."""
        return _shares(self.log_weight + self.log_likelihood)

    @property
    def effective(self) -> float:
        """How many independent draws they are worth."""
        return _effective(self.log_weight + self.log_likelihood)


@dataclass(frozen=True)
class _Proposal:
    """A Student's t distribution."""

    centre: FloatArray
    root: FloatArray

    @staticmethod
    def of(centre: FloatArray, covariance: FloatArray) -> _Proposal:
        return _Proposal(centre, np.asarray(np.linalg.cholesky(covariance + 1e-10 * np.eye(len(centre))), np.float64))

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        normal = rng.standard_normal((count, len(self.centre)))
        stretch = np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, count))
        return np.asarray(self.centre + (normal * stretch[:, None]) @ self.root.T)

    def log_density(self, x: FloatArray) -> FloatArray:
        p = len(self.centre)
        z = np.linalg.solve(self.root, (x - self.centre).T)
        constant = lgamma((_FREEDOM + p) / 2) - lgamma(_FREEDOM / 2) - 0.5 * p * log(_FREEDOM * pi)
        determinant = np.log(np.diag(self.root)).sum()
        return np.asarray(constant - determinant - (_FREEDOM + p) / 2 * np.log1p((z**2).sum(axis=0) / _FREEDOM))


def posterior_of(
    problem: BenchProblem, optima: Sequence[Optimum], rng: np.random.Generator, rows: FloatArray | None = None
) -> SetPosterior:
    """Return the corrected evidence and the posterior of a hypothesis.

    The optima are of one hypothesis, from several starts, at least one with a finite likelihood. `rows`, shape (n,), is
    1 for those that count and 0 for those that are excluded.
    """
    modes = _distinct(optima)
    hypothesis = modes[0].hypothesis
    proposals, counts = _around(modes)
    draws = np.concatenate([p.draw(n, rng) for p, n in zip(proposals, counts, strict=True)])
    predicted, likelihood = _evaluated(problem, hypothesis, draws, rows)
    for done in range(_ROUNDS[1]):
        weight = _log_weight(draws, proposals, counts) + likelihood
        if done >= _ROUNDS[0] and _effective(weight) > _ENOUGH:
            break
        wide = _widened(draws, weight)
        new = wide.draw(_ROUND, rng)
        predicted_new, likelihood_new = _evaluated(problem, hypothesis, new, rows)
        draws, likelihood = np.concatenate([draws, new]), np.concatenate([likelihood, likelihood_new])
        predicted = {channel: np.concatenate([predicted[channel], predicted_new[channel]]) for channel in predicted}
        proposals, counts = [*proposals, wide], [*counts, _ROUND]
    return _summed(hypothesis, draws, _log_weight(draws, proposals, counts), predicted, likelihood)


def _around(modes: Sequence[Optimum]) -> tuple[list[_Proposal], list[int]]:
    """Return proposals around the optima, and how many draws each gives."""
    share = np.exp([mode.log_evidence - modes[0].log_evidence for mode in modes])
    share = np.maximum(share / share.sum(), 0.25 / len(modes)) / len(_STRETCHES)
    covariances = [np.asarray(np.linalg.inv(mode.information), np.float64) for mode in modes]
    proposals = [
        _Proposal.of(mode.standard, stretch * covariance)
        for mode, covariance in zip(modes, covariances, strict=True)
        for stretch in _STRETCHES
    ]
    return proposals, [int(_FIRST * s) for s in share for _ in _STRETCHES]


def _evaluated(
    problem: BenchProblem, hypothesis: Hypothesis, draws: FloatArray, rows: FloatArray | None
) -> tuple[dict[str, FloatArray], FloatArray]:
    predicted, _ = problem.evaluate([hypothesis] * len(draws), draws)
    return predicted, log_likelihood(problem, predicted, rows)


def _distinct(optima: Sequence[Optimum]) -> list[Optimum]:
    """Return the best optimum and those that are elsewhere and nearly as good."""
    ranked = sorted(optima, key=lambda o: -o.log_evidence)
    kept = ranked[:1]
    for other in ranked[1:]:
        near = other.log_evidence > kept[0].log_evidence - _MODE_GAP
        away = [(other.standard - k.standard) @ k.information @ (other.standard - k.standard) for k in kept]
        if near and min(away) > 1.0:
            kept.append(other)
    return kept


def _widened(draws: FloatArray, log_weight: FloatArray) -> _Proposal:
    """Return a proposal with the mean and the covariance that weighted draws have; few draws are not believed fully."""
    share = np.minimum(_shares(log_weight), 0.1)
    share /= share.sum()
    mean = share @ draws
    covariance = (draws - mean).T @ ((draws - mean) * share[:, None])
    effective = 1.0 / (share**2).sum()
    trust = effective / (effective + 2.0 * draws.shape[1])
    plain = np.cov(draws.T).reshape(covariance.shape)
    return _Proposal.of(mean, 1.2 * (trust * covariance + (1.0 - trust) * plain))


def _log_weight(draws: FloatArray, proposals: Sequence[_Proposal], counts: Sequence[int]) -> FloatArray:
    total = sum(counts)
    density = np.stack([p.log_density(draws) + log(n / total) for p, n in zip(proposals, counts, strict=True)])
    top = density.max(axis=0)
    mixture = top + np.log(np.exp(density - top).sum(axis=0))
    prior = -0.5 * (draws**2).sum(axis=1) - 0.5 * draws.shape[1] * log(2 * pi)
    return np.asarray(prior - mixture)


def _summed(
    hypothesis: Hypothesis,
    draws: FloatArray,
    log_weight: FloatArray,
    predicted: dict[str, FloatArray],
    likelihood: FloatArray,
) -> SetPosterior:
    predicted = {
        channel: np.where(np.isfinite(likelihood)[:, None], values, 0.0) for channel, values in predicted.items()
    }
    each = log_weight + likelihood
    top = float(each.max())
    share = np.exp(each - top)
    mean = float(share.mean())
    error = float(share.std() / np.sqrt(len(share)) / mean)
    return SetPosterior(hypothesis, top + log(mean), error, draws, log_weight, predicted, likelihood)


def _shares(log_weight: FloatArray) -> FloatArray:
    share = np.exp(log_weight - log_weight.max())
    return np.asarray(share / share.sum())


def _effective(log_weight: FloatArray) -> float:
    """Return how many independent draws weighted ones are worth (Kong 1992)."""
    return float(1.0 / (_shares(log_weight) ** 2).sum())
