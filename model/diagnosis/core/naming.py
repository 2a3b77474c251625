"""The verdict, in the published order.

1. Lack of fit above its threshold: `unexplained`.
2. "None" not unlikely: above `NOTHING_AT`, or above `IDLE_AT` where the causes that are chosen do not predict
   held-out runs any better: `nothing_detectable`.
3. A family above `name_at`, with which held-out runs are predicted better than with no cause, in likelihood, and of a
   table in the error of the first channel too: `named`. Of driven runs that error is no demand: a zero of the torque or
   a cause of the braked wheel shows in the likelihood only (docs/decisions/diagnosis-intervals.md).
4. Else `one_of`: the shortest set of families of which one acts with 95 % probability, given that any cause acts.

A name needs three runs or more (of a table: three conditions), since its probability must be calibrated and its gain
be measured, and data that identify the family: what stands in ``not_identifiable`` is never named, however probable,
but may be a member of a set. What is named must have a value that bears the name, see `confirmed`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq import Note
from model.diagnosis.core.hypotheses import Posterior, short_set
from model.diagnosis.core.result import Adequacy, Cause, Gain, Verdict
from model.effects.catalogue import EFFECTS
from model.notes import LackCode

NOTHING_AT = 0.2
"""Probability of "none" from which on no cause is reported: a false alarm costs more than a further run."""
IDLE_AT = 0.05
"""The same where the causes that are chosen are of no use on held-out runs."""


@dataclass(frozen=True)
class Judgement:
    """A verdict and what it is about.

    Attributes
    ----------
    families : tuple of str
        The named ones; under "one_of" the set.
    beside : tuple of str
        Beside named ones: the families of which one more probably acts; empty where none is needed.
    barred : Note or None
        Why a family that is likely enough is not named.
    """

    verdict: Verdict
    families: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    barred: Note | None = None


def judgement(
    found: Posterior,
    judged: Adequacy,
    gain: Gain | None,
    not_identifiable: Mapping[str, Note] | None = None,
    name_at: float = 0.9,
    converged: bool = True,
    error_must_fall: bool = False,
) -> Judgement:
    """Return the verdict.

    Parameters
    ----------
    found : Posterior
        Of samples averaged over resampled runs.
    judged : Adequacy
        Of the most probable set.
    gain : Gain or None
        On held-out runs, the causes chosen anew in each fold.
    converged : bool
        Whether the linearisation converged.
    error_must_fall : bool
        Whether a name also needs a held-out error that does not grow in the first channel, as in a table.
    """
    if not judged.ok:
        return Judgement("unexplained")
    idle = gain is not None and not gain.log_likelihood_gain > 0
    if found.none >= (IDLE_AT if idle else NOTHING_AT):
        return Judgement("nothing_detectable")
    sure = [family for family, p in found.families().items() if p > name_at]
    barred = _barred(found, gain, error_must_fall) or (None if converged else Note(LackCode.NOT_SETTLED))
    if sure and not barred:
        named = tuple(family for family in sure if family not in (not_identifiable or {}))
        if named:
            return Judgement("named", named, short_set(found, named))
        barred = (not_identifiable or {})[sure[0]]
    return Judgement("one_of", short_set(found), barred=barred if sure else None)


def _barred(found: Posterior, gain: Gain | None, error_must_fall: bool) -> Note | None:
    if not found.calibrated or gain is None:
        return Note(LackCode.NOT_CHECKED)
    if not gain.log_likelihood_gain > 0 or (error_must_fall and gain.reduction_percent < 0):
        return Note(LackCode.NO_BETTER)
    return None


def confirmed(verdict: Judgement, found: Posterior, causes: Sequence[Cause]) -> Judgement:
    """Return the verdict once its causes have their values: a value that does not bear its name takes the name back.

    Parameters
    ----------
    causes : sequence of Cause
        Of the verdict, with their values.
    """
    if verdict.verdict == "named" and (why := doubtful(causes)):
        return Judgement("one_of", short_set(found), barred=why)
    return verdict


def doubtful(causes: Sequence[Cause]) -> Note | None:
    """Return why a cause's value does not bear its name; None where all do.

    Parameters
    ----------
    causes : sequence of Cause
        With their values.
    """
    for cause in causes:
        limits = {p.name: p for p in EFFECTS[cause.key].parameters}
        for found in cause.parameters:
            own = limits.get(found.name)
            if own is None:  # a combination, as Lyasko's p
                continue
            edges = [edge for edge in (own.lower, own.upper) if edge != own.neutral]
            if np.isclose(found.value, edges, rtol=1e-3, atol=0.0).any():
                facts = {"family": cause.name, "parameter": found.name, "value": found.value, "unit": found.unit}
                return Note(LackCode.VALUE_AT_LIMIT, values=facts)
            low, high = found.interval95
            if len(cause.parameters) == 1 and low < own.neutral < high:
                facts = {"family": cause.name, "parameter": found.name, "neutral": own.neutral, "unit": found.unit}
                return Note(LackCode.VALUE_MAY_BE_NEUTRAL, values={**facts, "low": low, "high": high})
    return None
