"""What grows with the load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions

FloatArray = NDArray[np.float64]

ZERO_WITH_LOAD = "zero, growing with load"
LOAD_SPREAD = 0.15
"""Departure from the mean load, as a share of it, at which a shape that grows with load is 1."""
_SAME_LOAD = 1e-6
"""Share of the mean by which loads must differ to be two."""


def growing_with_load(at: Conditions, drive: Conditions) -> FloatArray:
    """Return a shape that grows with the load, shape (n,): 1 where the load is `LOAD_SPREAD` above its mean.

    Parameters
    ----------
    at : Conditions
        Of samples or standstills.
    drive : Conditions
        Of the samples: their mean load is what a load is counted from.
    """
    mean = float(np.mean(np.asarray(drive.vertical_load_n)))
    return (np.asarray(at.vertical_load_n) / mean - 1.0) / LOAD_SPREAD


def several_loads(drive: Conditions) -> bool:
    """Return whether there is more than one load."""
    load = np.asarray(drive.vertical_load_n)
    return bool(np.ptp(load) > _SAME_LOAD * load.mean())
