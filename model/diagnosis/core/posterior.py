"""Probabilities of sets of causes, given the data, and what they say of families and forms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import FloatArray
from model.diagnosis.core.prior import Hypotheses
from model.diagnosis.core.result import Candidate, Cause, CauseSet, ParameterEstimate
from model.effects.catalogue import EFFECTS

LEVEL = 0.95
"""Of a set."""
SETS_SHOWN = 6
"""Sets of causes, at most."""
MORE_AT = 0.8
"""Probability from which on a further cause is reported beside a named one."""


@dataclass(frozen=True)
class Posterior:
    """Probabilities of sets of causes.

    Attributes
    ----------
    log_evidence : array, shape (n,)
        Up to a constant.
    probability : array, shape (n,)
        Of each set, given the data; sums to 1.
    calibrated : bool
        Whether the probabilities are calibrated on resampled data; a name requires this.
    """

    hypotheses: Hypotheses
    log_evidence: FloatArray
    probability: FloatArray
    calibrated: bool = False

    @property
    def none(self) -> float:
        """Probability that no cause acts."""
        return float(self.probability[0])

    def families(self) -> dict[str, float]:
        """Return the probability of each family to be among the causes, most probable first."""
        inclusion = self.probability @ self.hypotheses.has_family
        order = np.argsort(-inclusion, kind="stable")
        return {self.hypotheses.families[i]: float(inclusion[i]) for i in order}

    def forms(self, family: str) -> dict[str, float]:
        """Return the probability of each form (by its key), given that its family acts; most probable first."""
        h = self.hypotheses
        own = np.flatnonzero(h.family == h.families.index(family))
        inclusion = self.probability @ h.has_effect[:, own]
        total = inclusion.sum()
        shares = inclusion / total if total > 0 else np.full(own.size, 1.0 / own.size)
        return {h.effects[own[i]]: float(shares[i]) for i in np.argsort(-shares, kind="stable")}

    def best(self, least: int = 0) -> tuple[str, ...]:
        """Return the most probable set with `least` causes or more; with none where there are no such."""
        enough = (self.hypotheses.members >= 0).sum(axis=1) >= least
        return self.hypotheses.keys_of(int(np.argmax(np.where(enough, self.probability, -1.0))))


def probabilities(log_evidence: FloatArray, log_prior: FloatArray) -> FloatArray:
    """Return the sets' probabilities, normalised along the last axis."""
    joint = log_evidence + log_prior
    joint = np.exp(joint - joint.max(axis=-1, keepdims=True))
    return np.asarray(joint / joint.sum(axis=-1, keepdims=True))


def short_set(found: Posterior, given: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the shortest set of families of which one acts with `LEVEL`, if any cause acts; most probable first.

    Parameters
    ----------
    given : tuple of str
        Families that act in any case; the set holds what acts beside them. It is empty where that is less probable
        than `MORE_AT`.
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


def candidates(found: Posterior) -> tuple[Candidate, ...]:
    """Return every family's probability of being among the causes, and that of "none", most probable first."""
    chances = {**found.families(), "none": found.none}
    return tuple(Candidate(name, p) for name, p in sorted(chances.items(), key=lambda item: -item[1]))


def likely_sets(found: Posterior) -> tuple[CauseSet, ...]:
    """Return the most probable sets of families, forms put together, up to `LEVEL` or `SETS_SHOWN` of them."""
    h, families = found.hypotheses, found.families()
    total: dict[frozenset[str], float] = {}
    for i in np.flatnonzero(found.probability > 0).tolist():
        own = frozenset(h.families[j] for j in np.flatnonzero(h.has_family[i]))
        total[own] = total.get(own, 0.0) + float(found.probability[i])
    chosen: list[CauseSet] = []
    for own in sorted(total, key=lambda key: -total[key])[:SETS_SHOWN]:
        if sum(one.probability for one in chosen) >= LEVEL:
            break
        chosen.append(CauseSet(tuple(sorted(own, key=lambda family: (-families[family], family))), total[own]))
    return tuple(chosen)


def most_probable_form(found: Posterior, family: str) -> str:
    """Return the key of a family's most probable form."""
    return next(iter(found.forms(family)))


def cause_of(found: Posterior, family: str, key: str, parameters: tuple[ParameterEstimate, ...]) -> Cause:
    """Return a cause with its probabilities.

    Parameters
    ----------
    key : str
        Of its form.
    parameters : tuple of ParameterEstimate
        As if it were the one.
    """
    effect = EFFECTS[key]
    return Cause(
        name=family,
        form=effect.form,
        kind=effect.kind,
        key=key,
        probability=found.families()[family],
        form_probability=found.forms(family)[key],
        parameters=parameters,
    )
