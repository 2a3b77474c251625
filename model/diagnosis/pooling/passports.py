r"""A transducer's passport: what of it is wrong, since when, by how much, from the campaigns that it was in.

A campaign does not tell a gain of 0.3 % from a soil that is a little stronger. Twenty of them do: their soils differ,
their transducer is the same. With t the time, the parameters of a campaign are

.. math:: \theta = D(t)\varphi + \delta,\quad \varphi \sim N(0, I),\quad \delta \sim N(0, \tau^2 I)

in units of their prior scales, the slope a year in a quarter of them. A hypothesis is a set of up to two parameters,
each constant (one :math:`\varphi`) or drifting (a constant and a slope); all others are zero. :math:`\tau`, what
campaigns of one transducer scatter beside their own uncertainty, is integrated over a grid: where the model fits badly,
that is no drift. All is Gaussian: evidence, probabilities and intervals are exact.

What campaigns share need not be the transducer's: a wheel whose grousers are 2 mm shorter than stated looks, in all of
them, like a gain. So each hypothesis stands with and without one constant parameter of wheel, soil or speed.

Source: as `model.diagnosis.time_series.evidence`; of hierarchical pooling Gelman et al. (2013), Bayesian Data Analysis,
chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np
import scipy

from daq import FloatArray
from model.diagnosis.pooling.reduced import OF_THE_TRANSDUCER, Observation, Reduced, may_be_shared, reduced, scales_of
from model.diagnosis.pooling.sums import Sums, with_scatter

Course = Literal["constant", "drift"]
Decision = Literal["nothing", "flagged", "named"]

_SOUND = 0.8
"""Prior probability that nothing is wrong with a transducer."""
_PAIR = 0.1
"""Of two parameters that are wrong, for each one."""
_SHARED = 0.5
"""Prior probability that the campaigns share an error of wheel, soil or speed: no vehicle is described exactly."""
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
    wheel: str = ""


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
    shared : tuple of Candidate
        Effects of wheel, soil or speed that are the same in all campaigns; most probable first.
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
    shared: tuple[Candidate, ...]


Hypothesis = tuple[tuple[int, Course], ...]


def passport_of(sensor: str, observations: Sequence[Observation]) -> Passport:
    """Return a transducer's passport.

    Parameters
    ----------
    observations : sequence of Observation
        Its campaigns, in any order.
    """
    ordered = sorted(observations, key=lambda o: (o.years, o.campaign))
    shared = may_be_shared(ordered)
    data = [reduced(observation, shared) for observation in ordered]
    middle = float(np.mean([campaign.years for campaign in data])) if data else 0.0
    shown = [i for i in range(len(OF_THE_TRANSDUCER)) if any(campaign.precision[i, i] > 0 for campaign in data)]
    hypotheses = list(_hypotheses(shown, several=len({campaign.years for campaign in data}) > 1))
    weight = _weights(data, hypotheses, len(shared), middle)
    chance = weight.sum(axis=(0, 2))
    wrong = float(1.0 - chance[hypotheses.index(())])
    candidates = _candidates(shown, hypotheses, chance)
    decision, effects = _decided(wrong, candidates)
    tau, best, beside = np.unravel_index(int(np.argmax(weight)), weight.shape)
    places = _places(hypotheses[best], _size(len(shared)))
    if beside:
        places.append(_size(int(beside) - 1))
    return Passport(
        sensor,
        tuple(observation.campaign for observation in ordered),
        decision,
        effects,
        wrong,
        candidates,
        _trends(ordered, data, shown, middle),
        float(weight.sum(axis=(1, 2)) @ np.array(_SCATTER)),
        _disagreeing(ordered, data, places, _SCATTER[tau], middle),
        _shared(shared, weight.sum(axis=(0, 1))[1:]),
    )


def _size(shared: int) -> int:
    return len(OF_THE_TRANSDUCER) + shared


def _weights(data: Sequence[Reduced], hypotheses: Sequence[Hypothesis], shared: int, middle: float) -> FloatArray:
    """Return the posterior of scatter, hypothesis and what is shared (nothing first), shape (t, n, 1 + shared)."""
    prior = np.log([_prior(h, hypotheses) for h in hypotheses])
    beside = np.log([1.0 - _SHARED] + [_SHARED / shared] * shared) if shared else np.zeros(1)
    joint = np.array([_evidences(_sums(data, tau, middle), hypotheses, shared) for tau in _SCATTER])
    joint += prior[:, None] + beside
    found: FloatArray = np.exp(joint - scipy.special.logsumexp(joint))
    return found


def _sums(data: Sequence[Reduced], tau: float, middle: float) -> Sums:
    moments = [with_scatter(campaign.moments, tau, len(OF_THE_TRANSDUCER)) for campaign in data]
    return Sums.of(moments, [_SLOPE * (campaign.years - middle) for campaign in data])


def _evidences(sums: Sums, hypotheses: Sequence[Hypothesis], shared: int) -> FloatArray:
    """Return log evidences, shape (n, 1 + shared)."""
    found = np.empty((len(hypotheses), 1 + shared))
    listed = [_places(hypothesis, _size(shared)) for hypothesis in hypotheses]
    rivals = np.arange(len(OF_THE_TRANSDUCER), _size(shared))
    for size in {len(places) for places in listed}:
        rows = [i for i, places in enumerate(listed) if len(places) == size]
        own = np.array([listed[i] for i in rows], np.intp).reshape(len(rows), size)
        found[rows, 0] = sums.evidences(own)
        both = np.empty((len(rows), shared, size + 1), np.intp)
        both[..., :size], both[..., size] = own[:, None], rivals
        found[rows, 1:] = sums.evidences(both)
    return found


def _places(hypothesis: Hypothesis, size: int) -> list[int]:
    """Return the places in `Sums` of a hypothesis' parameters: a slope stands `size` behind its constant."""
    return [at for place, course in hypothesis for at in ((place, size + place) if course == "drift" else (place,))]


def _hypotheses(shown: Sequence[int], *, several: bool) -> list[Hypothesis]:
    courses: tuple[Course, ...] = ("constant", "drift") if several else ("constant",)
    found: list[Hypothesis] = [()]
    for count in (1, 2):
        for places in combinations(shown, count):
            found += [tuple(zip(places, each, strict=True)) for each in product(courses, repeat=count)]
    return found


def _prior(hypothesis: Hypothesis, of: Sequence[Hypothesis]) -> float:
    alike = sum(len(other) == len(hypothesis) for other in of)
    if not hypothesis:
        return _SOUND if len(of) > 1 else 1.0
    pairs = any(len(other) > 1 for other in of)
    share = (_PAIR if len(hypothesis) > 1 else 1.0 - _PAIR) if pairs else 1.0
    return (1.0 - _SOUND) * share / alike


def _candidates(shown: Sequence[int], hypotheses: Sequence[Hypothesis], chance: FloatArray) -> tuple[Candidate, ...]:
    found = []
    for place in shown:
        holds = [place in dict(h) for h in hypotheses]
        drifts = [dict(h).get(place) == "drift" for h in hypotheses]
        found.append(Candidate(OF_THE_TRANSDUCER[place], float(chance[holds].sum()), float(chance[drifts].sum())))
    return tuple(sorted(found, key=lambda c: -c.probability))


def _shared(shared: Sequence[tuple[str, str]], chance: FloatArray) -> tuple[Candidate, ...]:
    total: dict[str, float] = {}
    for (effect, _), each in zip(shared, chance.tolist(), strict=True):
        total[effect] = total.get(effect, 0.0) + each
    return tuple(sorted((Candidate(key, each, 0.0) for key, each in total.items()), key=lambda c: -c.probability))


def _decided(wrong: float, candidates: Sequence[Candidate]) -> tuple[Decision, tuple[str, ...]]:
    if wrong < _SURE:
        return "nothing", ()
    if named := tuple(candidate.effect for candidate in candidates if candidate.probability >= _SURE):
        return "named", named
    open_ones: list[str] = []
    total = 0.0
    for candidate in candidates:
        open_ones.append(candidate.effect)
        total += candidate.probability
        if total >= _SURE:
            break
    return "flagged", tuple(open_ones)


def _trends(
    ordered: Sequence[Observation], data: Sequence[Reduced], shown: Sequence[int], middle: float
) -> dict[str, Trend]:
    scales, names, units = scales_of(ordered)
    found = {}
    for place in shown:
        sums = _sums(data, 0.0, middle)
        mean, covariance = sums.fit([place, sums.size + place], _HARDLY_ANY)
        unit = scales[place] * np.array([1.0, _SLOPE])
        sigma, mean = np.sqrt(np.diag(covariance)) * abs(unit), mean * unit
        points = []
        for campaign, observation in zip(data, ordered, strict=True):
            own = campaign.precision[place, place]
            value, error = (campaign.score[place] / own, own**-0.5) if own > 0 else (np.nan, np.nan)
            points.append(
                Point(
                    observation.campaign,
                    campaign.years,
                    float(value * scales[place]),
                    float(error * abs(scales[place])),
                    observation.wheel,
                )
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
    ordered: Sequence[Observation], data: Sequence[Reduced], places: Sequence[int], tau: float, middle: float
) -> dict[str, float]:
    """Return the campaigns that the others do not predict, with the probability that one would be as far."""
    found = {}
    m = len(OF_THE_TRANSDUCER)
    whole = _sums(data, tau, middle)
    for i, campaign in enumerate(data):
        rest = whole.without(_sums([campaign], tau, middle)) if len(data) > 1 else Sums.none(len(campaign.score))
        mean, covariance = rest.fit(places)
        rows = campaign.precision[:m] @ rest.design(places, _SLOPE * (campaign.years - middle))
        error = campaign.score[:m] - rows @ mean
        own = campaign.precision[:m, :m]
        size, axes = np.linalg.eigh(own)
        seen = size > 1e-9 * max(float(size[-1]), 1.0)
        basis = axes[:, seen]
        spread = basis.T @ (own + rows @ covariance @ rows.T + tau**2 * own @ own) @ basis
        along = basis.T @ error
        p_value = float(scipy.special.chdtrc(int(seen.sum()), float(along @ np.linalg.solve(spread, along))))
        if p_value < _DISAGREES / len(data):
            found[ordered[i].campaign] = p_value
    return found
