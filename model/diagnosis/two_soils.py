"""Whether the runs of a campaign were driven on one soil: a campaign of two terrains explains nothing well.

The evidence of two groups of runs, each with a soil of its own from the laboratory's prior, against one soil for all.
Every pair of groups is asked where there are few runs, else they are parted one run at a time.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.grams import Grams

FloatArray = NDArray[np.float64]

LEAST = 20.0
"""Nats by which two soils must be likelier than one."""
_FEW = 8


def two_soils(grams: Grams) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the runs of the one soil and of the other, the smaller group first; None where one soil will do.

    Parameters
    ----------
    grams : Grams
        Of one campaign.
    """
    count = len(grams.run_names)
    if count < 2 or not grams.soil:
        return None
    together = _evidence(grams, np.ones(count, bool))
    best, group = max(((_gain(grams, own) - together, own.tolist()) for own in _groups(grams, count)), key=_first)
    if best < LEAST:
        return None
    names = np.array(grams.run_names)
    one, other = names[group], names[~np.array(group)]
    return tuple(one.tolist()), tuple(other.tolist())


def _first(pair: tuple[float, list[bool]]) -> float:
    return pair[0]


def _gain(grams: Grams, own: NDArray[np.bool_]) -> float:
    return _evidence(grams, own) + _evidence(grams, ~own)


def _groups(grams: Grams, count: int) -> list[NDArray[np.bool_]]:
    """Return the groups to ask: all of up to half of the runs, or what parting one run at a time goes through."""
    if count <= _FEW:
        sizes = range(1, count // 2 + 1)
        return [np.isin(np.arange(count), own) for size in sizes for own in combinations(range(count), size)]
    groups = [np.zeros(count, bool)]
    for _ in range(count // 2):
        larger = [groups[-1] | (np.arange(count) == run) for run in np.flatnonzero(~groups[-1])]
        groups.append(max(larger, key=lambda own: _gain(grams, own)))
    return groups[1:]


def _evidence(grams: Grams, own: NDArray[np.bool_]) -> float:
    """Return the log evidence of some runs with a soil of their own, up to a constant."""
    total = grams.matrices[own].sum(axis=0)
    soil = grams.soil_columns
    inner = np.eye(len(grams.soil)) + total[soil, soil]
    side = total[soil, 0]
    explained = float(side @ np.linalg.solve(inner, side))
    return 0.5 * (explained - float(total[0, 0])) - 0.5 * float(np.linalg.slogdet(inner)[1])
