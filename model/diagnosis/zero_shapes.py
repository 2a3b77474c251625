"""Zeros that nobody lists: what a channel reads too much of, rolling or not.

A standstill shows them without any soil. Only there is a zero that grows with the load told from a soil that does:
cross-talk and a constant zero, one taken for the other, leave it behind.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions

FloatArray = NDArray[np.float64]

_LOAD_SPREAD = 0.15
"""Departure from the mean load, as a share of it, at which a shape is 1."""


def zero_shapes(at: Conditions, drive: Conditions) -> Iterator[tuple[str, FloatArray]]:
    """Yield label and shape, shape (n,).

    Parameters
    ----------
    at : Conditions
        Of samples or standstills.
    drive : Conditions
        Of the samples: their mean load is what a load is counted from.
    """
    mean = float(np.mean(np.asarray(drive.vertical_load_n)))
    yield "zero, growing with load", (np.asarray(at.vertical_load_n) / mean - 1.0) / _LOAD_SPREAD
    yield "zero, with the direction", np.asarray(at.direction, float) * np.ones_like(np.asarray(at.vertical_load_n))
    yield "zero, over the campaign", np.nan_to_num(at.campaign_time)
