"""What takes a name back from the rows of a single-wheel test: what soils usually do, and causes that cancel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from daq import FloatArray, Note
from model.diagnosis.core.naming import LEAST_NATS, REMAINDER
from model.diagnosis.single_wheel.problem import CauseUse, Hypothesis
from model.diagnosis.single_wheel.search import Optima
from model.diagnosis.single_wheel.sets import family_of, listed_uses, sets_of
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, weighed
from model.effects.catalogue import EFFECTS
from model.notes import LackCode

_MOST_BESIDE = 2
"""Causes in a set beside what soils usually do."""


def usual_families(uses: Sequence[CauseUse]) -> tuple[str, ...]:
    """Return the families among the candidates that soils usually have."""
    return tuple(dict.fromkeys(family_of(use) for use in uses if EFFECTS[use.key].is_usual()))


def chances_beside_usual_soil(
    weighing: Weighing, uses: Sequence[CauseUse], most: int, rng: np.random.Generator
) -> Mapping[str, float]:
    """Return the probability of every other family where the soil has what soils usually have.

    `uses` are all candidates. The largest set has `most` causes; no more than two are asked for.
    """
    usual = tuple(replace(use, usual=True) for use in uses if EFFECTS[use.key].is_usual())
    others = tuple(use for use in uses if not EFFECTS[use.key].is_usual())
    listed = sets_of(others, listed_uses(others, min(most, _MOST_BESIDE)))
    beside: dict[Hypothesis, float] = {(*hypothesis, *usual): prior for hypothesis, prior in listed.items()}
    found = Optima(weighing.problem)
    for size in sorted({len(hypothesis) for hypothesis in beside}):
        found.add_all(h for h in beside if len(h) == size)
    again = weighed(found, beside, rng)
    return {family: again.of_family(family) for family in dict.fromkeys(map(family_of, others))}


def cancelling(weighing: Weighing) -> Note | None:
    """Return which two causes of the most probable set cancel each other where one of them less would do as well.

    As well means that the rows' evidence falls by less than `LEAST_NATS` without it.
    """
    best = weighing.sets[0]
    for first, second in combinations(best.hypothesis, 2):
        alone = [_changes(weighing, best, (use,)) for use in (first, second)]
        if _size(weighing, _changes(weighing, best, (first, second))) > REMAINDER * min(
            _size(weighing, change) for change in alone
        ):
            continue
        for use in (first, second):
            fewer = [w for w in weighing.sets if set(w.hypothesis) == set(best.hypothesis) - {use}]
            if fewer and best.log_evidence - fewer[0].log_evidence < LEAST_NATS:
                facts = {"families": tuple(family_of(u) for u in (first, second)), "without": family_of(use)}
                return Note(LackCode.PARTS_CANCEL, values=facts)
    return None


def _changes(weighing: Weighing, best: Weighed, causes: Sequence[CauseUse]) -> dict[str, FloatArray]:
    """Return by how much causes of a set change each channel, on the soil that was found with all of them."""
    problem, standard = weighing.problem, best.optima[0].standard
    kept = tuple(use for use in best.hypothesis if use not in causes)
    places = problem.positions(best.hypothesis)
    left = np.concatenate([standard[: problem.soil_offsets[-1]], *(standard[places[use]] for use in kept)])
    without, _ = problem.evaluate([kept], left[None])
    return {channel: best.optima[0].predicted[channel] - without[channel][0] for channel in without}


def _size(weighing: Weighing, change: Mapping[str, FloatArray]) -> float:
    """Return the size of a change over the error that a right model may have."""
    noises = zip(weighing.problem.noises, weighing.problem.rows, strict=True)
    return float(np.sqrt(sum(np.nansum(change[n.channel][rows] ** 2) / n.form_scale**2 for n, rows in noises)))
