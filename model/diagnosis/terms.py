"""Small formulas that could describe what is left over: simple functions of what was measured, and their products."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions

FloatArray = NDArray[np.float64]

SLIP_SCALE = 0.1
"""Of exp(-|s|/0.1): what is there at little slip only."""
_SPREAD = 1e-3


@dataclass(frozen=True)
class Term:
    """A function of the conditions.

    Attributes
    ----------
    text : str
        As it stands in a formula.
    unit : str
        Empty for a pure number.
    values : array, shape (n,)
    """

    text: str
    unit: str
    values: FloatArray


def terms(conditions: Conditions, sinkage_m: FloatArray) -> tuple[Term, ...]:
    """Return the terms that these samples can tell: a constant, simple functions, products of two.

    Left out is what was not measured, and what is the same in every sample.

    Parameters
    ----------
    conditions : Conditions
        Arrays of shape (n,).
    sinkage_m : array, shape (n,)
        The model's.
    """
    simple = [_telling(group) for group in _simple(conditions, sinkage_m)]
    found = [Term("1", "", np.ones(len(sinkage_m))), *(term for group in simple for term in group)]
    for one, other in combinations(simple, 2):
        found += [_product(a, b) for a in one for b in other]
    return tuple(term for term in found if term.text == "1" or _varies(term.values))


def _simple(c: Conditions, sinkage_m: FloatArray) -> list[list[Term]]:
    """Return functions of one variable each, a list for each variable."""
    s, load = np.asarray(c.slip, float), np.asarray(c.vertical_load_n, float) / 1e3
    speed, rate = np.asarray(c.ground_speed_mps, float), np.asarray(c.ground_acceleration_mps2, float)
    time, place = np.asarray(c.campaign_time, float), np.asarray(c.line_position, float)
    return [
        [
            Term("s", "", s),
            Term("|s|", "", np.abs(s)),
            Term("max(s,0)", "", np.maximum(s, 0.0)),
            Term("s^2", "", s * s),
            Term("sign(s)", "", np.sign(s)),
            Term(f"exp(-|s|/{SLIP_SCALE:g})", "", np.exp(-np.abs(s) / SLIP_SCALE)),
        ],
        [Term("W", "kN", load)],
        [Term("V", "m/s", speed), Term("1/V", "s/m", 1.0 / np.maximum(speed, 0.1))],
        [Term("z", "m", np.asarray(sinkage_m, float)), Term("z^2", "m2", np.asarray(sinkage_m, float) ** 2)],
        [Term("t", "", time)],
        [Term("x", "", place), Term("x^2", "", place * place)],
        [Term("a", "m/s2", rate)],
    ]


def _telling(group: list[Term]) -> list[Term]:
    """Return the terms that are known, change, and are not one of the others again."""
    found: list[Term] = []
    for term in group:
        known = np.isfinite(term.values).all() and _varies(term.values)
        if known and not any(np.array_equal(term.values, other.values) for other in found):
            found.append(term)
    return found


def _product(a: Term, b: Term) -> Term:
    return Term(f"{a.text} {b.text}", " ".join(unit for unit in (a.unit, b.unit) if unit), a.values * b.values)


def _varies(values: FloatArray) -> bool:
    size = float(np.sqrt(np.mean(values**2)))
    return bool(size > 0 and np.std(values) > _SPREAD * size)
