r"""What more data would do to a set of causes that cannot be told apart yet.

Let member i of the set be the cause at its estimated size. Data with cross products G then favour it over member j,
at whatever size j imitates it best, by an expected

.. math:: \tfrac12\, d^2_{i|j}(G) = \tfrac12\, z_i^2 (1 - \cos^2_{ij})

nats (`model.diagnosis.isolability`: z is d, and the cosine is that of the signatures once the soil is projected out).
What one more run adds is the difference of that with and without it. Against the whole rest of the set, with weights
:math:`w_j`, i gains :math:`-\ln \sum_j w_j \exp(-\Delta_{ij})`: a run that parts i from all others but one look-alike
is worth little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.grams import Grams
from model.diagnosis.isolability import Projected, least_left, own_columns, without_soil

FloatArray = NDArray[np.float64]

PARTS = 2.0
"""Expected nats, whichever of both is the cause, from which on a run is said to part two members: odds of 7 to 1."""


@dataclass(frozen=True)
class Member:
    """A cause of the set.

    Attributes
    ----------
    key : str
    size : array, shape (parameters,)
        Coefficients, in units of the prior scale.
    probability : float
        Weight; need not sum to 1.
    """

    key: str
    size: FloatArray
    probability: float = 1.0


@dataclass(frozen=True)
class Split:
    """What more data would do.

    Attributes
    ----------
    nats : array, shape (members, members)
        What they add to the expected log Bayes factor of the row's member, if it is the cause, over the column's.
    expected_log_bayes_factor : float
        Of the true member over the rest, averaged over which is true; nats.
    parted : tuple of str
        Keys of the members that come apart from at least one other.
    """

    nats: FloatArray
    expected_log_bayes_factor: float
    parted: tuple[str, ...]


def split(grams: Grams, added: FloatArray, members: tuple[Member, ...], now: FloatArray | None = None) -> Split:
    """Say what more data would do to a set of causes.

    Parameters
    ----------
    grams : Grams
        Names the columns; its sum over runs is what is known now.
    added : array, shape (m, m)
        Cross products of the data to be added.
    members : tuple of Member
    now : array, shape (m, m), optional
        Another sum than that of all runs.
    """
    total = grams.total() if now is None else now
    before = _pairwise(grams, without_soil(grams, total), members)
    nats = np.maximum(_pairwise(grams, without_soil(grams, total + added), members) - before, 0.0)
    weights = np.array([max(member.probability, 1e-9) for member in members])
    weights = weights / weights.sum()
    gained = [against_rest(nats[i], weights, i) for i in range(len(members))] if len(members) > 1 else [0.0]
    comes_apart = np.any(0.5 * (nats + nats.T) >= PARTS, axis=1).tolist()
    parted = tuple(member.key for member, apart in zip(members, comes_apart, strict=True) if apart)
    return Split(nats, float(weights @ gained), parted)


def against_rest(nats: FloatArray, weights: FloatArray, i: int) -> float:
    """Return the expected log Bayes factor of member i against all others together.

    Parameters
    ----------
    nats : array, shape (members,)
        Against each.
    weights : array, shape (members,)
        Probabilities.
    i : int
    """
    rest = np.arange(len(weights)) != i
    share = weights[rest] / weights[rest].sum()
    least = float(nats[rest].min())
    return least - float(np.log(share @ np.exp(least - nats[rest])))


def _pairwise(grams: Grams, projected: Projected, members: tuple[Member, ...]) -> FloatArray:
    """Return half of d^2 of each member that each other leaves, shape (members, members); 0 on the diagonal."""
    found = np.zeros((len(members), len(members)))
    for i, one in enumerate(members):
        for j, other in enumerate(members):
            if i != j:
                columns = own_columns(grams, other.key)
                sided = np.array([grams.causes[c].one_sided for c in columns])
                left = least_left(projected.information, own_columns(grams, one.key), one.size, columns, sided)
                found[i, j] = 0.5 * left**2
    return found


def members_of(sizes: Mapping[str, FloatArray], probabilities: Mapping[str, float]) -> tuple[Member, ...]:
    """Return the members of a set by their keys; one without a probability counts as any other."""
    return tuple(Member(key, np.asarray(size, float), probabilities.get(key, 1.0)) for key, size in sizes.items())
