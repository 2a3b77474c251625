"""Whether measured sinkage lies in the band that forces give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq import FloatArray
from model.sinkage_from_forces.sinkage_growth import SlipBin

_OUTSIDE = 0.05
"""Share of rows that a 95 % band leaves out."""
_RARE = 0.05
"""Probability of as many rows outside, if the band is right, below which it is refuted."""
_FEWEST_OUTSIDE = 2
_SIGMAS = 1.96


@dataclass(frozen=True)
class Agreement:
    """Sinkage from forces beside the measured one.

    Attributes
    ----------
    rms_m : float
        Of sinkage from forces less measured sinkage.
    rows, inside : int
        Ranges of slip, or rows of a table, with measured sinkage; those in the 95 % band.
    outside_slips : tuple of float
        Slips of the others.
    refuted : bool
        More are outside than chance allows: the model behind the band does not hold here.
    """

    rms_m: float
    rows: int
    inside: int
    outside_slips: tuple[float, ...]
    refuted: bool


def agreement_of(bins: Sequence[SlipBin], measured_sigma_m: FloatArray | None = None) -> Agreement | None:
    """Compare sinkage from forces with the measured one; None where nothing was measured.

    Parameters
    ----------
    measured_sigma_m : array, shape (bins,), optional
        One-sigma of the measured sinkage, by which the band is wider; NaN counts as 0.
    """
    known = [
        i
        for i, slip_bin in enumerate(bins)
        if np.isfinite(slip_bin.measured_m) and np.isfinite(slip_bin.sinkage_m.value)
    ]
    if not known:
        return None
    own = np.zeros(len(bins)) if measured_sigma_m is None else np.nan_to_num(measured_sigma_m)
    error = np.array([bins[i].sinkage_m.value - bins[i].measured_m for i in known])
    outside = [i for i in known if not _inside(bins[i], float(own[i]))]
    chance = _tail(len(outside), len(known))
    return Agreement(
        rms_m=float(np.sqrt(np.mean(error**2))),
        rows=len(known),
        inside=len(known) - len(outside),
        outside_slips=tuple(bins[i].slip for i in outside),
        refuted=len(outside) >= _FEWEST_OUTSIDE and chance < _RARE,
    )


def _inside(slip_bin: SlipBin, sigma_m: float) -> bool:
    low, high = slip_bin.sinkage_m.interval95
    return low - _SIGMAS * sigma_m <= slip_bin.measured_m <= high + _SIGMAS * sigma_m


def _tail(outside: int, rows: int) -> float:
    """Return the probability of so many rows outside or more, each with 5 %."""
    from scipy.stats import binom

    return float(binom.sf(outside - 1, rows, _OUTSIDE))
