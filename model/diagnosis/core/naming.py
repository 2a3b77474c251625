"""The verdict, in the published order.

1. Lack of fit above its threshold: `unexplained`.
2. "None" not unlikely: above `NOTHING_AT`, or above `IDLE_AT` where the causes that are chosen do not foretell
   left-out runs any better: `nothing_detectable`.
3. A family above `name_at`, with which left-out runs are foretold better than with no cause, in likelihood and in the
   error of the first channel: `named`.
4. Else `one_of`: the shortest set of families of which one is at work with 95 % if anything is.

A name needs three runs or more (of a table: three conditions), since its probability must be calibrated and its gain
be measured, and data that can tell the family: what stands in ``cannot_tell`` is never named, however likely, but may
be a member of a set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from daq import Note
from model.diagnosis.core.posterior import Posterior, short_set
from model.diagnosis.core.result import Adequacy, Gain, Verdict
from model.notes import LackCode

NOTHING_AT = 0.2
"""Probability of "none" from which on nothing is said to be seen: to cry wolf is worse than to wait for another run."""
IDLE_AT = 0.05
"""The same where the causes that are chosen are of no use on left-out runs."""


@dataclass(frozen=True)
class Judgement:
    """A verdict and what it is about.

    Attributes
    ----------
    verdict : see `Verdict`
    families : tuple of str
        The named ones; under "one_of" the set.
    beside : tuple of str
        Beside named ones: the families of which one more is likely at work; empty where nothing more need be.
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
    cannot_tell: Mapping[str, Note] | None = None,
    name_at: float = 0.9,
    settled: bool = True,
) -> Judgement:
    """Return the verdict.

    Parameters
    ----------
    found : Posterior
        Of samples averaged over resampled runs.
    judged : Adequacy
        Of the likeliest set.
    gain : Gain or None
        On left-out runs, the causes chosen anew in each fold.
    cannot_tell : mapping family -> why
    name_at : float
    settled : bool
        Whether the linearisation stood still.
    """
    if not judged.ok:
        return Judgement("unexplained")
    idle = gain is not None and not gain.log_likelihood_gain > 0
    if found.none >= (IDLE_AT if idle else NOTHING_AT):
        return Judgement("nothing_detectable")
    sure = [family for family, p in found.families().items() if p > name_at]
    barred = _barred(found, gain) or (None if settled else Note(LackCode.NOT_SETTLED))
    if sure and not barred:
        named = tuple(family for family in sure if family not in (cannot_tell or {}))
        if named:
            return Judgement("named", named, short_set(found, named))
        barred = (cannot_tell or {})[sure[0]]
    return Judgement("one_of", short_set(found), barred=barred if sure else None)


def _barred(found: Posterior, gain: Gain | None) -> Note | None:
    if not found.calibrated or gain is None:
        return Note(LackCode.NOT_CHECKED)
    if not gain.log_likelihood_gain > 0 or gain.reduction_percent < 0:
        return Note(LackCode.NO_BETTER)
    return None
