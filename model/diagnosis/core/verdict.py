"""The verdict, in the published order.

1. Lack of fit above its threshold: `unexplained`.
2. "None" not unlikely: above `NOTHING_AT`, or above `IDLE_AT` where the causes that are chosen do not foretell
   left-out runs any better: `nothing_detectable`.
3. A family above `name_at` that foretells left-out runs better than no cause: `named`.
4. Else `one_of`: the shortest set of families of which one is at work with 95 % if anything is.

A name needs three runs or more, since its probability is calibrated by drawing runs anew, and data that can tell the
family: what stands in ``cannot_tell`` is never named, however likely, but may be a member of a set.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from model.diagnosis.core.result import Adequacy, CauseSet, Gain, Verdict
from model.diagnosis.time_series.evidence import Posterior

LEVEL = 0.95
"""Of a set."""
NOTHING_AT = 0.2
"""Probability of "none" from which on nothing is said to be seen: to cry wolf is worse than to wait for another run."""
IDLE_AT = 0.05
"""The same where the causes that are chosen are of no use on left-out runs."""
SETS_SHOWN = 6
"""Sets of causes, at most."""
MORE_AT = 0.8
"""Probability from which on something is said to be at work beside a named cause."""


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
        Averaged over resampled runs.
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
    if not found.resampled or gain is None:
        return "with fewer than three runs no name can be checked against other runs"
    if not gain.log_likelihood_gain > 0:
        return "it does not foretell runs that were left out any better"
    return ""


def short_set(found: Posterior, given: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the shortest set of families of which one is at work with `LEVEL`, if anything is; likeliest first.

    Parameters
    ----------
    found : Posterior
    given : tuple of str
        Families that are at work anyway; the set is of what is at work beside them. It is empty where that is less
        likely than `MORE_AT`.
    """
    h = found.hypotheses
    known = np.isin(h.families, given)
    holds = h.has_family[:, known].all(axis=1)
    others = h.has_family & ~known
    mass = np.where(holds & others.any(axis=1), found.probability, 0.0)
    if mass.sum() <= 0 or (given and mass.sum() < MORE_AT * found.probability[holds].sum()):
        return ()
    whole, chosen = mass.sum(), []
    while mass.sum() > (1.0 - LEVEL) * whole:
        best = int(np.argmax(mass @ others))
        chosen.append(best)
        mass = np.where(others[:, best], 0.0, mass)
    order = found.families()
    return tuple(sorted((h.families[i] for i in chosen), key=lambda family: -order[family]))


def candidates(found: Posterior) -> dict[str, float]:
    """Return every family's probability of being among the causes, and that of "none", likeliest first."""
    chances = {**found.families(), "none": found.none}
    return dict(sorted(chances.items(), key=lambda item: -item[1]))


def likely_sets(found: Posterior) -> tuple[CauseSet, ...]:
    """Return the likeliest sets of families, forms put together; see `likeliest_of`.

    Parameters
    ----------
    found : Posterior
    """
    h = found.hypotheses
    possible = np.flatnonzero(found.probability > 0).tolist()
    chances = [
        (frozenset(h.families[j] for j in np.flatnonzero(h.has_family[i])), float(found.probability[i]))
        for i in possible
    ]
    return likeliest_of(chances, found.families())


def likeliest_of(
    chances: Iterable[tuple[frozenset[str], float]], families: Mapping[str, float]
) -> tuple[CauseSet, ...]:
    """Return sets of families with their probabilities, likeliest first, up to `LEVEL` or `SETS_SHOWN` of them.

    Parameters
    ----------
    chances : iterable of (families, probability)
        What is there more than once is added up.
    families : mapping family -> probability
        In a set the likeliest comes first.
    """
    total: dict[frozenset[str], float] = {}
    for own, p in chances:
        total[own] = total.get(own, 0.0) + p
    chosen: list[CauseSet] = []
    for own in sorted(total, key=lambda key: -total[key])[:SETS_SHOWN]:
        if sum(one.probability for one in chosen) >= LEVEL:
            break
        chosen.append(CauseSet(tuple(sorted(own, key=lambda family: (-families[family], family))), total[own]))
    return tuple(chosen)
