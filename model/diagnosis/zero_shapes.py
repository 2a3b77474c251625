"""A zero that nobody lists: what a channel reads too much of, rolling or not, the more the larger the load.

A standstill shows it without any soil. Cross-talk and a constant zero, one taken for the other, leave it behind; where
no shape shows it, it passes for zeros that differ from run to run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions

FloatArray = NDArray[np.float64]

ZERO_WITH_LOAD = "zero, growing with load"
LOAD_SPREAD = 0.15
"""Departure from the mean load, as a share of it, at which a shape that grows with load is 1."""


def zero_shape(at: Conditions, drive: Conditions) -> FloatArray:
    """Return a zero that grows with the load, shape (n,): 1 where the load is `LOAD_SPREAD` above its mean.

    Parameters
    ----------
    at : Conditions
        Of samples or standstills.
    drive : Conditions
        Of the samples: their mean load is what a load is counted from.
    """
    mean = float(np.mean(np.asarray(drive.vertical_load_n)))
    return (np.asarray(at.vertical_load_n) / mean - 1.0) / LOAD_SPREAD
