"""Hats: shapes that are one at a knot and fall straight to nothing at its neighbours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import exp

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LEAST_SPEED_MPS = 0.1
_OF_SPEED = (0.02, 0.35, 0.65, 0.98)
"""Quantiles of the logarithm of the ground speed at which a hat stands."""


def hats(
    what: str,
    x: FloatArray,
    knots: tuple[float, ...],
    on: NDArray[np.bool_],
    say: Callable[[float], float] = float,
    unit: str = "",
) -> Iterator[tuple[str, FloatArray]]:
    """Yield label and shape of a hat over each knot; the outer ones go on.

    Parameters
    ----------
    what : str
        First words of the labels.
    x : array, shape (n,)
    knots : tuple of float
        Ascending; of equal ones the last is kept.
    on : bool array, shape (n,)
        Where it may differ from zero; elsewhere it is zero.
    say : callable
        Turns a knot into what is said of it.
    unit : str
        Behind what is said.
    """
    knots = tuple(k for k, after in zip(knots, (*knots[1:], np.inf), strict=True) if after > k)
    clipped = np.clip(np.where(on, x, knots[0]), knots[0], knots[-1])
    for i in range(len(knots)):
        height = np.zeros(len(knots))
        height[i] = 1.0
        low, high = ends(knots, i)
        yield hat_label(what, say(low), say(high), unit), np.where(on, np.interp(clipped, knots, height), 0.0)


def ends(knots: tuple[float, ...], i: int) -> tuple[float, float]:
    """Return a hat's neighbours; an outer one ends at its own knot."""
    return knots[max(i - 1, 0)], knots[min(i + 1, len(knots) - 1)]


def hat_label(what: str, low: float, high: float, unit: str = "") -> str:
    """Return "what low to high"."""
    return f"{what} {low:.2g} to {high:.2g}{unit}"


def hats_of_speed(speed_mps: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield label and shape of hats over the logarithm of the ground speed, shape (n,)."""
    tempo = np.log(np.maximum(speed_mps, _LEAST_SPEED_MPS))
    yield from hats("ground speed", tempo, tuple(np.quantile(tempo, _OF_SPEED)), np.ones(len(tempo), bool), exp)
