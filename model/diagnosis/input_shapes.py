"""What an error of an input does to every channel at once: the catch-all's shapes for ground speed and load.

A speed that is off by the same everywhere is a listed cause. One that is off by more at some speeds than at others is
not, and no shape of a force alone shows it well: it is large where pull is steep in slip, and nothing elsewhere. The
shapes of the load are what two listed causes do, a zero and a gain of the load, asked of sets without them.

An error is measured less true, as everywhere: the model, which is given what was measured, is off by minus its slope.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.hats import hats_of_speed
from model.diagnosis.linearise import Linear
from model.diagnosis.with_load import growing_with_load, several_loads

FloatArray = NDArray[np.float64]

SPEED_MPS = 0.03
"""One-sigma of an error of the ground speed that lasts over a range of speeds."""
LOAD_SHARE = 0.02
"""One-sigma of an error of the load, as a share of the mean load."""


MISREAD = "as if misread"
"""First words of a label's second part."""


@dataclass(frozen=True)
class InputShape:
    """An error of an input and what it does.

    Attributes
    ----------
    label : str
        "input|where", the input as a key of `model.diagnosis.channel_words.INPUTS`.
    columns : array, shape (c, n)
        In N, N m and m.
    height : float
        The error's largest value, in m/s or N.
    """

    label: str
    columns: FloatArray
    height: float


def input_shapes(linear: Linear) -> Iterator[InputShape]:
    """Yield the shapes; what grows with the load only where there is more than one load.

    Parameters
    ----------
    linear : Linear
    """
    at = linear.conditions
    by_speed, by_load = np.nan_to_num(linear.speed), np.nan_to_num(linear.load)
    for where, hat in hats_of_speed(np.asarray(at.ground_speed_mps)):
        yield InputShape(f"v|{MISREAD}, {where}", -SPEED_MPS * by_speed * hat, SPEED_MPS)
    size = LOAD_SHARE * float(np.mean(np.asarray(at.vertical_load_n)))
    yield InputShape(f"w|{MISREAD} everywhere", -size * by_load, size)
    if several_loads(at):
        growing = growing_with_load(at, at)
        yield InputShape(
            f"w|{MISREAD}, growing with the load", -size * by_load * growing, size * float(np.abs(growing).max())
        )
