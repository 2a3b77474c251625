"""Sets of causes: which are weighed, how probable each is before any data, and given the data.

The prior is published, because it decides the Occam factor: no cause .5, one .35, two .12, three .03; every set of
families of one size is as likely as any other, and within a family every form. The sizes are in the parameters' prior
scales (`model.effects`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations
from math import comb

import numpy as np

from daq import BoolArray, FloatArray, IndexArray, Note
from model.diagnosis.core.result import Candidate, Cause, CauseSet, ParameterEstimate
from model.effects.catalogue import EFFECTS
from model.notes import DiagnosisCode

SIZE_PRIOR = (0.5, 0.35, 0.12, 0.03)
"""Probability of none, one, two and three causes."""

_NONE = np.zeros(0)

LEVEL = 0.95
"""Of a set."""
SETS_SHOWN = 6
"""Sets of causes, at most."""
MORE_AT = 0.8
"""Probability from which on a further cause is reported beside a named one."""
ALIKE_NATS = 4.0
"""Log evidence, its prior apart, that more causes at once may lack and still look the same."""


@dataclass(frozen=True)
class Hypotheses:
    """Sets of effects, at most one form of a family in each.

    Attributes
    ----------
    effects : tuple of str
        Keys in the library.
    families : tuple of str
        Distinct, in the order of the effects.
    family : int array, shape (effects,)
        Index of each effect's family.
    members : int array, shape (n, most)
        Indices of each set's effects, -1 where there is none; the first set is empty.
    log_prior : array, shape (n,)
        Of each set among all sets of up to `most` causes, also of those that are not listed.
    """

    effects: tuple[str, ...]
    families: tuple[str, ...]
    family: IndexArray
    members: IndexArray
    log_prior: FloatArray

    def __len__(self) -> int:
        return len(self.members)

    @cached_property
    def has_effect(self) -> BoolArray:
        """Whether a set holds an effect, shape (n, effects)."""
        holds = np.zeros((len(self), len(self.effects) + 1), bool)
        np.put_along_axis(holds, self.members, values=True, axis=1)
        return holds[:, :-1]

    @cached_property
    def has_family(self) -> BoolArray:
        """Whether a set holds a family, shape (n, families)."""
        same = self.family[:, None] == np.arange(len(self.families))
        return np.asarray(self.has_effect.astype(np.intp) @ same > 0)

    def keys_of(self, index: int) -> tuple[str, ...]:
        """Return the keys of a set's effects."""
        return tuple(self.effects[i] for i in self.members[index] if i >= 0)

    def index_of(self, keys: tuple[str, ...]) -> int:
        """Return the position of a set; `KeyError` where it is not listed."""
        found = self.position(keys)
        if found is None:
            raise KeyError(keys)
        return found

    def position(self, keys: tuple[str, ...]) -> int | None:
        """Return the position of a set; None where it is not listed."""
        if not set(keys) <= set(self.effects):
            return None
        wanted = np.array([effect in keys for effect in self.effects], bool)
        found = np.flatnonzero((self.has_effect == wanted).all(axis=1))
        return int(found[0]) if found.size else None


def listed_sets(family_of: Mapping[str, str], most: int = 3, triples: bool = True) -> Hypotheses:
    """List the sets of up to `most` (0 to 3) causes, from the family of every effect that is considered.

    Without `triples` sets of three wait for `with_triples`; their prior counts all the same.
    """
    return _listed_sets(tuple(family_of.items()), most, triples)


@lru_cache(maxsize=8)  # the same ones are weighed hundreds of times
def _listed_sets(family_of: tuple[tuple[str, str], ...], most: int, triples: bool) -> Hypotheses:
    families = tuple(dict.fromkeys(own for _, own in family_of))
    family = np.array([families.index(own) for _, own in family_of], np.intp)
    effects = tuple(effect for effect, _ in family_of)
    listed = Hypotheses(effects, families, family, np.zeros((0, max(most, 1)), np.intp), _NONE)
    sizes = range(min(most, 3 if triples else 2) + 1)
    return _listing(listed, [_combinations(len(family_of), size) for size in sizes], most)


def with_triples(pairs: Hypotheses, promising: IndexArray) -> Hypotheses:
    """Add the sets of three that one of the promising pairs, by their indices, is part of."""
    two = pairs.members[promising]
    third = np.arange(len(pairs.effects))
    triples = np.column_stack([np.repeat(two[:, :2], third.size, axis=0), np.tile(third, len(two))])
    triples = np.sort(triples, axis=1)
    triples = triples[np.unique(triples @ np.array([third.size**2, third.size, 1]), return_index=True)[1]]
    sizes = (pairs.members >= 0).sum(axis=1)
    sets = [pairs.members[sizes == size][:, :size] for size in range(3)]
    return _listing(pairs, [*sets, triples], pairs.members.shape[1])


def _combinations(count: int, size: int) -> IndexArray:
    return np.array(list(combinations(range(count), size)), np.intp).reshape(comb(count, size), size)


def _listing(listed: Hypotheses, sets: list[IndexArray], most: int) -> Hypotheses:
    """Put sets of 0, 1, 2 ... effects into one table with their prior, without those that hold a family twice."""
    count = len(listed.families)
    forms = np.bincount(listed.family, minlength=count)
    share = np.log([p if comb(count, size) and size <= most else 1e-300 for size, p in enumerate(SIZE_PRIOR)])
    share -= np.log(np.exp(share).sum())
    members, priors = [], []
    for size, chosen in enumerate(sets):
        of = np.sort(listed.family[chosen], axis=1)
        distinct = chosen[(np.diff(of, axis=1) > 0).all(axis=1)]
        members.append(np.pad(distinct, ((0, 0), (0, listed.members.shape[1] - size)), constant_values=-1))
        each = share[size] - np.log(max(comb(count, size), 1))
        priors.append(each - np.log(forms[listed.family[distinct]]).sum(axis=1))
    return replace(listed, members=np.concatenate(members), log_prior=np.concatenate(priors))


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

    def as_they_are(self) -> Posterior:
        """Return the probabilities by the evidence alone, not averaged over resampled data."""
        return replace(self, probability=probabilities(self.log_evidence, self.hypotheses.log_prior))

    def best(self) -> tuple[str, ...]:
        """Return the most probable set."""
        return self.hypotheses.keys_of(int(np.argmax(self.probability)))


def probabilities(log_evidence: FloatArray, log_prior: FloatArray) -> FloatArray:
    """Return the sets' probabilities, normalised along the last axis."""
    joint = log_evidence + log_prior
    joint = np.exp(joint - joint.max(axis=-1, keepdims=True))
    return np.asarray(joint / joint.sum(axis=-1, keepdims=True))


def short_set(found: Posterior, given: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the shortest set of families of which one acts with `LEVEL`, if any cause acts; most probable first.

    Families that are `given` act in any case; the set holds what acts beside them. It is then empty where that is less
    probable than `MORE_AT`.
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


def nearest_rival(found: Posterior, family: str) -> tuple[str, ...]:
    """Return the family that would take the place of another: of the most probable set of causes without that one."""
    h = found.hypotheses
    left = found.probability * ~h.has_family[:, h.families.index(family)] * h.has_family.any(axis=1)
    if not left.any():
        return ()
    best = h.has_family[int(np.argmax(left))]
    chances = found.families()
    return (max((h.families[i] for i in np.flatnonzero(best)), key=lambda name: chances[name]),)


def more_alike(found: Posterior, families: Sequence[str]) -> dict[tuple[str, ...], float]:
    """Return more causes at once that look the same as some families: the prior of their number is what decides.

    The result has what would act in place of the families, fewest causes first, and by how much its log evidence is
    less.
    """
    h = found.hypotheses
    score, given = found.log_evidence + h.log_prior, np.isin(h.families, families)
    holds = h.has_family[:, given].any(axis=1)
    best = int(np.argmax(np.where(holds, score, -np.inf)))
    kept, lacks = h.has_family[best] & ~given, found.log_evidence[best] - found.log_evidence
    alike = ~holds & h.has_family[:, kept].all(axis=1) & (lacks < ALIKE_NATS) & (found.probability > 0)
    instead: dict[tuple[str, ...], float] = {}
    for i in sorted(np.flatnonzero(alike).tolist(), key=lambda i: (h.has_family[i].sum(), -score[i])):
        acts = {h.families[j] for j in np.flatnonzero(h.has_family[i] & ~kept)}
        if not any(acts >= set(fewer) for fewer in instead):
            instead[tuple(sorted(acts))] = float(lacks[i])
    return {names: less for names, less in instead.items() if len(names) > h.has_family[best, given].sum()}


def notes_of_more_alike(found: Posterior, verdict: str, families: tuple[str, ...]) -> tuple[Note, ...]:
    """Return a note for each named family, or for the set of which one acts, that more causes look the same as."""
    asked = [(family,) for family in families] if verdict == "named" else [families] if families else []
    return tuple(
        Note(DiagnosisCode.MORE_ALIKE, values={"families": own, "instead": (*more,), "nats": (*more.values(),)})
        for own in asked
        if (more := more_alike(found, own))
    )


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
        if sum(cause_set.probability for cause_set in chosen) >= LEVEL:
            break
        chosen.append(CauseSet(tuple(sorted(own, key=lambda family: (-families[family], family))), total[own]))
    return tuple(chosen)


def probable_sets(found: Posterior, most: int, given: tuple[str, ...] = ()) -> dict[tuple[str, ...], float]:
    """Return the most probable sets of effects with their probabilities, at most so many.

    Each of them holds the families that are `given`; where there is none, "none" is always one.
    """
    h = found.hypotheses
    holds = np.asarray(h.has_family[:, np.isin(h.families, given)].all(axis=1))
    order = np.argsort(-found.probability, kind="stable")
    order = order[holds[order]]
    kept = order[:most] if given or 0 in order[:most] else np.r_[order[: most - 1], 0]
    return {
        found.hypotheses.keys_of(int(i)): float(found.probability[i]) for i in kept if not i or found.probability[i] > 0
    }


def most_probable_form(found: Posterior, family: str) -> str:
    """Return the key of a family's most probable form."""
    return next(iter(found.forms(family)))


def cause_of(found: Posterior, family: str, key: str, parameters: tuple[ParameterEstimate, ...]) -> Cause:
    """Return a cause with its probabilities; `key` is its form, whose parameters are given."""
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
