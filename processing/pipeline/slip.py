"""Slip ratio of Eq. 6 and its braking counterpart, with propagated uncertainty, and the effective rolling radius."""

from __future__ import annotations

from math import nan, sqrt

import numpy as np

from daq import BoolArray, FloatArray
from processing.robust import block_covariance, robust_linear

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


LEAST_SPEED_MPS = 1.0
_FREE_SHARE = 0.06
_LEAST_SAMPLES = 20
_MOST_SIGMA = 0.02
"""Relative one-sigma of a radius beyond which it is none: a wheel that rolls freely keeps its radius to a percent."""


def rolls_freely(
    rim_speed_mps: FloatArray,
    torque_nm: FloatArray,
    load_n: FloatArray,
    drawbar_pull_n: FloatArray,
    radius_m: float,
) -> BoolArray:
    """Return the moving samples on which the wheel hardly slips.

    Chosen without looking at ground speed: a choice by measured slip would confirm whatever error the speeds have.
    Where torque and drawbar pull are measured, neither |T|/r nor |Dp| may exceed 6 % of the load: on soft soil no
    sample passes, since a wheel without torque is dragged there and skids. Where neither is measured every moving
    sample passes (a road vehicle); where one of them is not, none: nobody can tell then.

    Parameters
    ----------
    rim_speed_mps, torque_nm, load_n, drawbar_pull_n : float64 arrays, shape (n,)
        All NaN where not measured.
    """
    moving = rim_speed_mps > LEAST_SPEED_MPS
    measured = [bool(np.isfinite(force).any()) for force in (torque_nm, drawbar_pull_n)]
    if not all(measured):
        return moving & (not any(measured))
    force = np.maximum(np.abs(torque_nm) / radius_m, np.abs(drawbar_pull_n))
    known = moving & np.isfinite(force)
    load = load_n[known & (load_n > 0)]
    scale = float(np.median(load) if len(load) else force[known].max(initial=0.0))
    return np.asarray(known & (force <= _FREE_SHARE * scale))


def speed_scale(ground_speed_mps: FloatArray, rim_speed_mps: FloatArray) -> tuple[float, float]:
    """Return ground speed over rim speed and its one-sigma; NaN below 20 samples, or where the wheel slips after all.

    Parameters
    ----------
    ground_speed_mps, rim_speed_mps : float64 arrays, shape (n,)
        Latency removed; NaN is left out.
    """
    rows = np.isfinite(ground_speed_mps) & np.isfinite(rim_speed_mps)
    if rows.sum() < _LEAST_SAMPLES:
        return nan, nan
    matrix, y = rim_speed_mps[rows, None], ground_speed_mps[rows]
    fit = robust_linear(matrix, y)
    scale, sigma = float(fit.coefficients[0]), sqrt(block_covariance(matrix, y, fit.weights)[0, 0])
    return (scale, sigma) if sigma <= _MOST_SIGMA * abs(scale) else (nan, nan)
