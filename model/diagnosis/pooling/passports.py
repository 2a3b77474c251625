r"""A transducer's passport: what of it is wrong, since when, by how much, from the campaigns that it was in.

A campaign does not tell a gain of 0.3 % from a soil that is a little stronger. Twenty of them do: their soils differ,
their transducer is the same. With t the time, the parameters of a campaign are

.. math:: \theta = D(t)\varphi + \delta,\quad \varphi \sim N(0, I),\quad \delta \sim N(0, \tau^2 I)

in units of their prior scales, the slope a year in a quarter of them. A hypothesis is a set of up to two parameters,
each constant (one :math:`\varphi`) or drifting (a constant and a slope); all others are zero. :math:`\tau`, what
campaigns of one transducer scatter beside their own uncertainty, is integrated over a grid: where the model fits badly,
that is no drift. All is Gaussian: evidence, probabilities and intervals are exact.

Source: as `model.diagnosis.time_series.evidence`; of hierarchical pooling Gelman et al. (2013), Bayesian Data Analysis,
chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from daq import FloatArray
from model.diagnosis.pooling.reduced import OF_THE_TRANSDUCER, Observation, Reduced, reduced, scales_of

Course = Literal["constant", "drift"]
Decision = Literal["nothing", "flagged", "named"]

_SOUND = 0.8
"""Prior probability that nothing is wrong with a transducer."""
_PAIR = 0.1
"""Of two parameters that are wrong, for each one."""
_SCATTER = (0.0, 0.01, 0.02, 0.04, 0.08)
"""Of the prior scales: 0.08 to 0.6 % of a gain in drawbar pull."""
_SURE = 0.9
"""Probability from which on something is flagged, and named: as of a cause."""
_SLOPE = 0.25
"""Prior one-sigma of a drift a year, of the prior scale: 2 % a year of a gain in drawbar pull, 37 N of its zero."""
_HARDLY_ANY = 0.01
"""Of the prior's precision: what a passport draws is the campaigns' own estimate, also where there is one date only."""
_DISAGREES = 0.01
"""Probability, over all campaigns of a transducer, from which on one disagrees."""
_Z95 = 1.959964


@dataclass(frozen=True)
class Point:
    """What one campaign says of a parameter if that alone is wrong; NaN where it does not show it."""

    campaign: str
    years: float
    value: float
    sigma: float


@dataclass(frozen=True)
class Trend:
    """The course of one parameter by the campaigns alone, as if it alone were wrong; in its unit.

    Attributes
    ----------
    at, per_year : (value, one-sigma)
        In the middle of the campaigns' times, and its slope.
    middle : float
        That time, in years.
    """

    effect: str
    parameter: str
    unit: str
    at: tuple[float, float]
    per_year: tuple[float, float]
    middle: float
    points: tuple[Point, ...]

    def value(self, years: float) -> tuple[float, float, float]:
        """Return the value at a time, with its 95 % interval."""
        away = years - self.middle
        mean = self.at[0] + away * self.per_year[0]
        half = _Z95 * float(np.hypot(self.at[1], away * self.per_year[1]))
        return mean, mean - half, mean + half


@dataclass(frozen=True)
class Candidate:
    """An effect of the transducer, its probability, and that it drifts."""

    effect: str
    probability: float
    drifts: float


@dataclass(frozen=True)
class Passport:
    """What is known of one transducer.

    Attributes
    ----------
    decision : "nothing", "flagged" or "named"
        Flagged: something is wrong with it, and which of the candidates is open.
    effects : tuple of str
        The named ones; flagged: those that together are probable enough.
    wrong : float
        Probability that something is.
    candidates : tuple of Candidate
        Most probable first.
    trends : mapping effect -> Trend
        Of every parameter that a campaign shows.
    scatter : float
        Posterior mean of tau, in prior scales.
    disagree : mapping campaign -> p-value
        Campaigns that the others do not predict.
    """

    sensor: str
    campaigns: tuple[str, ...]
    decision: Decision
    effects: tuple[str, ...]
    wrong: float
    candidates: tuple[Candidate, ...]
    trends: dict[str, Trend]
    scatter: float
    disagree: dict[str, float]


Hypothesis = tuple[tuple[int, Course], ...]


def passport_of(sensor: str, observations: Sequence[Observation]) -> Passport:
    """Return a transducer's passport.

    Parameters
    ----------
    observations : sequence of Observation
        Its campaigns, in any order.
    """
    ordered = sorted(observations, key=lambda one: (one.years, one.campaign))
    data = [reduced(one) for one in ordered]
    middle = float(np.mean([one.years for one in data])) if data else 0.0
    shown = [i for i in range(len(OF_THE_TRANSDUCER)) if any(one.precision[i, i] > 0 for one in data)]
    hypotheses = list(_hypotheses(shown, several=len({one.years for one in data}) > 1))
    prior = np.log([_prior(h, hypotheses) for h in hypotheses])
    evidence = np.array([[_fit(data, h, tau, middle).evidence for tau in _SCATTER] for h in hypotheses])
    joint = evidence + prior[:, None] - np.log(len(_SCATTER))
    weight = np.exp(joint - logsumexp(joint))
    chance = weight.sum(axis=1)
    scatter = float(weight.sum(axis=0) @ np.array(_SCATTER))
    candidates = _candidates(shown, hypotheses, chance)
    wrong = float(1.0 - chance[hypotheses.index(())])
    decision, effects = _decided(wrong, candidates)
    best, tau = np.unravel_index(int(np.argmax(joint)), joint.shape)
    return Passport(
        sensor,
        tuple(one.campaign for one in ordered),
        decision,
        effects,
        wrong,
        candidates,
        _trends(ordered, data, shown, middle),
        scatter,
        _disagreeing(ordered, data, hypotheses[int(best)], _SCATTER[int(tau)], middle),
    )


def _hypotheses(shown: Sequence[int], *, several: bool) -> list[Hypothesis]:
    courses: tuple[Course, ...] = ("constant", "drift") if several else ("constant",)
    found: list[Hypothesis] = [()]
    for count in (1, 2):
        for places in combinations(shown, count):
            found += [tuple(zip(places, each, strict=True)) for each in product(courses, repeat=count)]
    return found


def _prior(one: Hypothesis, of: Sequence[Hypothesis]) -> float:
    alike = sum(len(other) == len(one) for other in of)
    if not one:
        return _SOUND if len(of) > 1 else 1.0
    pairs = any(len(other) > 1 for other in of)
    share = (_PAIR if len(one) > 1 else 1.0 - _PAIR) if pairs else 1.0
    return (1.0 - _SOUND) * share / alike


@dataclass(frozen=True)
class _Fitted:
    """Log evidence of a hypothesis, less that of perfect sensors without scatter; mean and covariance of phi."""

    evidence: float
    mean: FloatArray
    covariance: FloatArray


def _fit(data: Sequence[Reduced], hypothesis: Hypothesis, tau: float, middle: float, prior: float = 1.0) -> _Fitted:
    size = sum(2 if course == "drift" else 1 for _, course in hypothesis)
    precision, side, total = prior * np.eye(size), np.zeros(size), 0.0
    for one in data:
        own, score, left = _scattered(one, tau)
        design = _design(hypothesis, one.years - middle)
        precision += design.T @ own @ design
        side += design.T @ score
        total += left
    covariance: FloatArray = np.asarray(np.linalg.inv(precision), float)
    total += 0.5 * float(side @ covariance @ side) - 0.5 * float(np.linalg.slogdet(precision)[1])
    return _Fitted(total, covariance @ side, covariance)


def _design(hypothesis: Hypothesis, years: float) -> FloatArray:
    """Return D of one campaign, shape (m, number of phi)."""
    columns: list[FloatArray] = []
    for place, course in hypothesis:
        unit = np.zeros(len(OF_THE_TRANSDUCER))
        unit[place] = 1.0
        columns += [unit, _SLOPE * years * unit] if course == "drift" else [unit]
    return np.stack(columns, axis=1) if columns else np.zeros((len(OF_THE_TRANSDUCER), 0))


def _scattered(one: Reduced, tau: float) -> tuple[FloatArray, FloatArray, float]:
    """Return precision and score with the scatter integrated out, and its share of the log evidence."""
    variance = tau**2
    inner = np.linalg.inv(np.eye(len(one.score)) + variance * one.precision)
    left = 0.5 * variance * float(one.score @ inner @ one.score) + 0.5 * float(np.linalg.slogdet(inner)[1])
    return one.precision @ inner, inner.T @ one.score, left


def _candidates(shown: Sequence[int], hypotheses: Sequence[Hypothesis], chance: FloatArray) -> tuple[Candidate, ...]:
    found = []
    for place in shown:
        holds = [place in dict(h) for h in hypotheses]
        drifts = [dict(h).get(place) == "drift" for h in hypotheses]
        found.append(Candidate(OF_THE_TRANSDUCER[place], float(chance[holds].sum()), float(chance[drifts].sum())))
    return tuple(sorted(found, key=lambda one: -one.probability))


def _decided(wrong: float, candidates: Sequence[Candidate]) -> tuple[Decision, tuple[str, ...]]:
    if wrong < _SURE:
        return "nothing", ()
    if named := tuple(one.effect for one in candidates if one.probability >= _SURE):
        return "named", named
    open_ones: list[str] = []
    total = 0.0
    for one in candidates:
        open_ones.append(one.effect)
        total += one.probability
        if total >= _SURE:
            break
    return "flagged", tuple(open_ones)


def _trends(
    ordered: Sequence[Observation], data: Sequence[Reduced], shown: Sequence[int], middle: float
) -> dict[str, Trend]:
    scales, names, units = scales_of(ordered)
    found = {}
    for place in shown:
        fitted = _fit(data, ((place, "drift"),), 0.0, middle, _HARDLY_ANY)
        unit = scales[place] * np.array([1.0, _SLOPE])
        sigma, mean = np.sqrt(np.diag(fitted.covariance)) * abs(unit), fitted.mean * unit
        points = []
        for one, campaign in zip(data, ordered, strict=True):
            own = one.precision[place, place]
            value, error = (one.score[place] / own, own**-0.5) if own > 0 else (np.nan, np.nan)
            points.append(
                Point(campaign.campaign, one.years, float(value * scales[place]), float(error * abs(scales[place])))
            )
        found[OF_THE_TRANSDUCER[place]] = Trend(
            effect=OF_THE_TRANSDUCER[place],
            parameter=names[place],
            unit=units[place],
            at=(float(mean[0]), float(sigma[0])),
            per_year=(float(mean[1]), float(sigma[1])),
            middle=middle,
            points=tuple(points),
        )
    return found


def _disagreeing(
    ordered: Sequence[Observation], data: Sequence[Reduced], hypothesis: Hypothesis, tau: float, middle: float
) -> dict[str, float]:
    """Return the campaigns that the others do not predict, with the probability that one would be as far."""
    found = {}
    for i, one in enumerate(data):
        rest = _fit([*data[:i], *data[i + 1 :]], hypothesis, tau, middle)
        design = _design(hypothesis, one.years - middle)
        error = one.score - one.precision @ design @ rest.mean
        spread = design @ rest.covariance @ design.T + tau**2 * np.eye(len(error))
        size, axes = np.linalg.eigh(one.precision)
        seen = size > 1e-9 * max(float(size[-1]), 1.0)
        basis = axes[:, seen]
        covariance = basis.T @ (one.precision + one.precision @ spread @ one.precision) @ basis
        along = basis.T @ error
        p_value = float(chi2.sf(float(along @ np.linalg.solve(covariance, along)), int(seen.sum())))
        if p_value < _DISAGREES / len(data):
            found[ordered[i].campaign] = p_value
    return found
