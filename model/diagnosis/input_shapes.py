"""What an error of an input does to every channel at once: the catch-all's shapes for ground speed and load.

A speed that is off by the same everywhere is a listed cause, and so is a load. One that is off by more at some speeds
than at others is not, and no shape of a force alone shows it well: it is large where pull is steep in slip, and nothing
elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.hats import hats_of_speed
from model.diagnosis.linearise import Linear
from model.diagnosis.zero_shapes import LOAD_SPREAD

FloatArray = NDArray[np.float64]

SPEED_MPS = 0.03
"""One-sigma of an error of the ground speed that lasts over a range of speeds."""
LOAD_SHARE = 0.02
"""One-sigma of an error of the load, as a share of the mean load."""


@dataclass(frozen=True)
class InputShape:
    """An error of an input and what it does.

    Attributes
    ----------
    label : str
        "input|where", the input as a key of `model.diagnosis.channel_words.FIELDS`.
    columns : array, shape (c, n)
        In N, N m and m.
    height : float
        The error's largest value, in m/s or N.
    """

    label: str
    columns: FloatArray
    height: float


def input_shapes(linear: Linear) -> Iterator[InputShape]:
    """Yield the shapes; none where the input does not vary or nothing follows from it.

    Parameters
    ----------
    linear : Linear
    """
    at = linear.conditions
    by_speed, by_load = np.nan_to_num(linear.speed), np.nan_to_num(linear.load)
    for where, hat in hats_of_speed(np.asarray(at.ground_speed_mps)):
        yield InputShape(f"v|{where}", SPEED_MPS * by_speed * hat, SPEED_MPS)
    load = np.asarray(at.vertical_load_n)
    size = LOAD_SHARE * float(load.mean())
    growing = (load / load.mean() - 1.0) / LOAD_SPREAD
    yield InputShape("w|everywhere", size * by_load, size)
    if np.std(growing) > 0:
        yield InputShape("w|growing with load", size * by_load * growing, size * float(np.abs(growing).max()))
