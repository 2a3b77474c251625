"""Slip of Eq. 6 and its braking counterpart, with propagated uncertainty."""

from __future__ import annotations

import numpy as np

from processing.timebase import FloatArray

_BLOCK = 1 << 16
"""Rows at once: a long run's temporaries stay small."""


def slip_of(rim_speed_mps: FloatArray, ground_speed_mps: FloatArray, min_speed_mps: float) -> FloatArray:
    """Return the slip: (r omega - V)/(r omega) driving (Eq. 6), (r omega - V)/V braking.

    Both are (r omega - V) over the larger speed, so that exchanging the speeds changes the sign only.

    Parameters
    ----------
    rim_speed_mps, ground_speed_mps : float64 arrays, shape (n,)
        r omega and V.
    min_speed_mps : float
        NaN where the larger speed is below this.
    """
    larger = np.maximum(rim_speed_mps, ground_speed_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        slip = (rim_speed_mps - ground_speed_mps) / larger
    return np.where(larger >= min_speed_mps, slip, np.nan)


def slip_sigma(
    rim_speed_mps: FloatArray,
    ground_speed_mps: FloatArray,
    rim_sigma_mps: FloatArray,
    ground_sigma_mps: FloatArray,
    min_speed_mps: float,
) -> FloatArray:
    """Return the one-sigma of the slip to first order: 1 - |s| = smaller/larger, the two speeds being independent.

    Parameters
    ----------
    rim_speed_mps, ground_speed_mps, rim_sigma_mps, ground_sigma_mps : float64 arrays, shape (n,)
    min_speed_mps : float
        NaN where the larger speed is below this.
    """
    sigma = np.empty(len(rim_speed_mps))
    for start in range(0, len(sigma), _BLOCK):
        rows = slice(start, start + _BLOCK)
        speeds = np.stack([rim_speed_mps[rows], ground_speed_mps[rows]])
        sigmas = np.stack([rim_sigma_mps[rows], ground_sigma_mps[rows]])
        sigma[rows] = _sigma(speeds, sigmas, min_speed_mps)
    return sigma


def _sigma(speeds: FloatArray, sigmas: FloatArray, min_speed_mps: float) -> FloatArray:
    """Return `slip_sigma` of a block; rim and ground are the rows."""
    driving = speeds[0] >= speeds[1]
    (larger, smaller), (sigma_larger, sigma_smaller) = (np.where(driving, x, x[::-1]) for x in (speeds, sigmas))
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.hypot(sigma_smaller, smaller / larger * sigma_larger) / larger
    return np.where(larger >= min_speed_mps, sigma, np.nan)
