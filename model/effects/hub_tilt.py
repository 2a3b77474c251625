r"""Tilt of an accelerometer at the hub under torque.

An accelerometer that points forward reads f = dV/dt + g (theta + c T), with theta the slope and c T the tilt that comes
with the torque T. Its integral less the ground speed,

.. math:: \int f\,dt - V = -V_0 + b t + e \int f\,dt + g \int \theta\,dt + g c \int T\,dt ,

has the noise of the speed and not of its slope. Start, zero b, gain error e and a slope that is a straight line over
the distance are free in every run; c is shared.

Source: specific force of a tilted accelerometer; ordinary least squares with a covariance by stretches of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np

from daq import ROLES, STANDARD_GRAVITY_MPS2, FloatArray
from processing import ProcessedRun, RunCode

ROLE = "wheel_acceleration_x"
_DOUBTS = (RunCode.ACCELEROMETER_SLOW, RunCode.ACCELEROMETER_DOUBTED)
_STRETCH_S = 5.0
"""Beyond which the errors of integral and speed are taken as independent."""
_LEAST_STRETCHES = 6
_LEAST_RAD_PER_KNM, _LEAST_SHARE = 5e-4, 0.2
"""One-sigma from hills that repeat the torque, and of what the transducer's stator has of the accelerometer's tilt."""


def hub_tilt_per_torque(runs: Sequence[ProcessedRun]) -> tuple[float, float] | None:
    """Return by how much the hub tilts, nose up, per torque, in rad per kN m, and its one-sigma.

    None without an accelerometer at the hub that processing trusts in every run, or where the runs say nothing of it.
    """
    if not runs or not all(map(_has_accelerometer, runs)):
        return None
    parts = [part for run in runs if (part := _freed(run)) is not None]
    by_torque = np.concatenate([part[0] for part in parts]) if parts else np.zeros((0, 1))
    left = np.concatenate([part[1] for part in parts]) if parts else np.zeros((0, 1))
    size = float((by_torque**2).sum())
    if len(left) < _LEAST_STRETCHES or not size > 0:
        return None
    angle = float((by_torque * left).sum()) / size
    scores = (by_torque * (left - angle * by_torque)).sum(axis=1)
    sigma = float(np.sqrt((scores**2).sum())) / size
    return angle, hypot(sigma, _LEAST_RAD_PER_KNM, _LEAST_SHARE * angle)


def _has_accelerometer(run: ProcessedRun) -> bool:
    doubted = (note.values.get("role") for note in run.quality.notes if note.code in _DOUBTS)
    return ROLES[ROLE].field in run.extras and ROLE not in doubted


def _freed(run: ProcessedRun) -> tuple[FloatArray, FloatArray] | None:
    """Return what a tilt of 1 rad per kN m does and what was measured, m/s, without what is free; a row a stretch."""
    felt = run.extras[ROLES[ROLE].field]
    columns = np.stack([felt, 1e-3 * run.driving_torque_nm, run.distance_m, run.ground_speed_mps])
    known = np.flatnonzero(np.isfinite(columns).all(axis=0))
    step = round(_STRETCH_S * run.rate_hz)
    if len(known) < step:
        return None
    rows = np.arange(known[0], known[-1] + 1)
    felt, torque, distance, speed = (np.interp(rows, known, column[known]) for column in columns)
    way, by_torque, along = (np.cumsum(x) / run.rate_hz for x in (felt, torque, distance))
    free = np.column_stack([np.ones(len(rows)), run.time_s[rows], along, way])
    wanted = np.column_stack([STANDARD_GRAVITY_MPS2 * by_torque, way - speed])
    left = wanted - free @ np.linalg.lstsq(free, wanted, rcond=None)[0]
    left = left[: len(left) // step * step].reshape(-1, step, 2)
    return left[..., 0], left[..., 1]
