"""Effective rolling radius: ground speed over rim speed where the wheel hardly slips."""

from __future__ import annotations

from math import nan, sqrt

import numpy as np
from numpy.typing import NDArray

from processing.robust import robust_linear
from processing.timebase import FloatArray

LEAST_SECONDS = 3.0
_LOW_TRACTION = 0.1
_LOW_TORQUE_SHARE = 0.3
_LEAST_SPEED_MPS = 1.0


def hardly_slipping(
    rim_speed_mps: FloatArray, torque_nm: FloatArray, load_n: FloatArray, radius_m: float
) -> NDArray[np.bool_]:
    """Return the moving samples on which the wheel transmits hardly any torque.

    Chosen without looking at ground speed: a choice by measured slip would confirm whatever error the speeds have.
    With torque and load: |T| < 0.1 W r; with torque only: the lowest three tenths of |T|; without torque: every moving
    sample (a road vehicle; off the road the result then includes the usual slip).

    Parameters
    ----------
    rim_speed_mps, torque_nm, load_n : float64 arrays, shape (n,)
        All NaN where not measured.
    radius_m : float
    """
    moving = rim_speed_mps > _LEAST_SPEED_MPS
    size = np.abs(torque_nm)
    known = moving & np.isfinite(size)
    if not known.any():
        return moving
    load = float(np.median(load_n[known])) if np.isfinite(load_n[known]).all() else nan
    bound = _LOW_TRACTION * load * radius_m if load > 0 else float(np.quantile(size[known], _LOW_TORQUE_SHARE))
    return np.asarray(known & (size <= bound))


def speed_scale(
    ground_speed_mps: FloatArray, rim_speed_mps: FloatArray, torque_nm: FloatArray, chosen: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return ground speed over rim speed at zero torque and its one-sigma; NaN below 20 samples.

    Parameters
    ----------
    ground_speed_mps, rim_speed_mps, torque_nm : float64 arrays, shape (n,)
        Latency removed, a few samples per second. Torque, where measured, takes the small slip it causes.
    chosen : bool array
        See `hardly_slipping`.
    """
    rows = chosen & np.isfinite(ground_speed_mps) & np.isfinite(rim_speed_mps)
    if rows.sum() < 20:
        return nan, nan
    matrix = speed_basis(rim_speed_mps[rows], torque_nm[rows])
    fit = robust_linear(matrix, ground_speed_mps[rows])
    return float(fit.coefficients[0]), sqrt(fit.covariance[0, 0])


def speed_basis(rim_speed_mps: FloatArray, torque_nm: FloatArray) -> FloatArray:
    """Return the columns r omega and, where torque is measured, r omega T / max|T|: V = a r omega (1 - c T)."""
    largest = float(np.abs(torque_nm[np.isfinite(torque_nm)]).max(initial=0.0))
    if not largest > 0:
        return rim_speed_mps[:, None]
    return np.column_stack([rim_speed_mps, rim_speed_mps * torque_nm / largest])
