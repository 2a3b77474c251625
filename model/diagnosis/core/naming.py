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

from model.diagnosis.core.posterior import Posterior, short_set
from model.diagnosis.core.result import Adequacy, Gain, Verdict

NOTHING_AT = 0.2
"""Probability of "none" from which on nothing is said to be seen: to cry wolf is worse than to wait for another run."""
IDLE_AT = 0.05
"""The same where the causes that are chosen are of no use on left-out runs."""
MOVING = "the linearisation never stood still at it"


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
    barred : str
        Why a family that is likely enough is not named; else empty.
    """

    verdict: Verdict
    families: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    barred: str = ""


def judgement(
    found: Posterior,
    judged: Adequacy,
    gain: Gain | None,
    cannot_tell: Mapping[str, str] | None = None,
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
    barred = _barred(found, gain) or ("" if settled else MOVING)
    if sure and not barred:
        named = tuple(family for family in sure if family not in (cannot_tell or {}))
        if named:
            return Judgement("named", named, short_set(found, named))
        barred = (cannot_tell or {})[sure[0]]
    return Judgement("one_of", short_set(found), barred=barred if sure else "")


def _barred(found: Posterior, gain: Gain | None) -> str:
    if not found.calibrated or gain is None:
        return "with fewer than three runs or conditions no name can be checked against others"
    if not gain.log_likelihood_gain > 0 or gain.reduction_percent < 0:
        return "it does not foretell what was left out any better"
    return ""
