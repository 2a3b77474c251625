"""Whether a name survives a base model with what soils usually do.

At neutral an effect is not there, which is where most of them belong: a simulation without them is not wrong before the
data say so. A stress peak ahead of the wheel's bottom is the rule in nature, and it imitates slip sinkage. So a
physical cause that is named is asked again with such parameters among the soil's, with their usual mean and spread
(`model.effects.Parameter.usual`), about a point at which they have these values.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.diagnosis.core.clock import Clock
from model.diagnosis.core.hypotheses import Posterior
from model.diagnosis.findings.held_out import bagged
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import SetEstimate, best_set
from model.diagnosis.time_series.linearisation_point import linearisation_points
from model.diagnosis.time_series.linearised_campaign import (
    LinearisedCampaign,
    campaigns_at,
    joined_grams,
)
from model.effects.catalogue import EFFECTS

_ROUNDS = 2
"""Linearisations with the usual soil: the second about what the first one finds."""


def usual_effects(grams: Grams) -> tuple[str, ...]:
    """Return the keys of the effects among the causes that soils usually have."""
    return tuple(key for key in dict.fromkeys(c.key for c in grams.causes) if EFFECTS[key].is_usual())


def with_usual_soil(grams: Grams) -> Grams:
    """Return the Gram matrices with the parameters of `usual_effects` as columns of the soil."""
    usual = usual_effects(grams)
    start, soils, width = grams.cause_columns.start, len(grams.soil), grams.matrices.shape[-1]
    moved = [(start + i, c) for i, c in enumerate(grams.causes) if c.key in usual]
    others = [start + i for i, c in enumerate(grams.causes) if c.key not in usual]
    order = [*range(1 + soils), *(at for at, _ in moved), *others, *range(grams.cause_columns.stop, width)]
    turn = np.eye(width)[:, order]
    for column, (at, cause) in enumerate(moved, 1 + soils):
        mean, sigma = _usual(cause.key, cause.parameter)
        turn[at, 0] = -(mean - cause.neutral) / cause.scale
        turn[at, column] = sigma / cause.scale
    return replace(
        grams,
        matrices=turn.T @ grams.matrices @ turn,
        static=turn.T @ grams.static @ turn if np.ndim(grams.static) else 0.0,
        own=tuple(replace(gram, across=gram.across @ turn) for gram in grams.own),
        soil=(*grams.soil, *(f"{cause.key}.{cause.parameter}" for _, cause in moved)),
        causes=tuple(c for c in grams.causes if c.key not in usual),
    )


def _usual(key: str, parameter: str) -> tuple[float, float]:
    return next(p.usual for p in EFFECTS[key].parameters if p.name == parameter and p.usual)


def posterior_with_usual_soil(
    linearised: LinearisedCampaign, rng: np.random.Generator, factor: float, clock: Clock
) -> Posterior:
    """Return the probabilities of the sets of all other causes beside what soils usually do.

    The generator draws runs anew; `factor` is on the noise's variance.
    """
    grams, campaigns = linearised.grams, linearised.campaigns
    usual = set(usual_effects(grams))
    excluded = linearised.excluded | usual
    best = tuple(key for key in linearised.best.keys if key not in usual)
    for rounds in range(_ROUNDS):
        found = best_set(with_usual_soil(grams), linearised.excluded, linearised.most_causes, best)
        best = found.keys
        points = linearisation_points(campaigns, grams, _in_columns_of(grams, found))
        del campaigns, grams  # as large as those that come
        last = rounds == _ROUNDS - 1
        campaigns, _ = campaigns_at(linearised.starts, points, clock, keep_noise=True, catch_all=last)
        grams = joined_grams(campaigns)
    del campaigns
    return bagged(with_usual_soil(grams), rng, excluded, linearised.most_causes, factor)


def _in_columns_of(grams: Grams, found: SetEstimate) -> SetEstimate:
    """Return an estimate with the usual soil's parameters among the causes, as the Gram matrices have them."""
    soils = len(grams.soil)
    coefficients = np.zeros(len(grams.causes))
    usual, moved, others = usual_effects(grams), iter(found.soil[soils:]), iter(found.coefficients)
    for i, cause in enumerate(grams.causes):
        if cause.key in usual:
            mean, sigma = _usual(cause.key, cause.parameter)
            value = max(mean + sigma * float(next(moved)), cause.neutral)
            coefficients[i] = (value - cause.neutral) / cause.scale
        else:
            coefficients[i] = next(others)
    return replace(found, soil=found.soil[:soils], coefficients=coefficients)
