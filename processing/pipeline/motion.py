r"""How the vehicle moves: the accelerometer of the outboard mass.

An accelerometer that points forward reads the specific force f = dV/dt + g sin(theta), with theta positive nose up: at
rest with its nose up, +g sin(theta). That is what the parts outboard of the transducer need of it, slope included,

.. math:: F_{x,soil} = F_{x,wft} + m_o (\dot V + g \sin\theta) = F_{x,wft} + m_o f ,

so that its reading is taken as it is: without pitch taken off, and without a zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan, sqrt

import numpy as np

from daq import Note, Severity
from processing.notes import RunCode
from processing.pipeline.filters import CUTOFF_PER_RATE
from processing.pipeline.resampling import OnBase
from processing.processed_run import GROUND_SPEED, Reason
from processing.robust import block_covariance, robust_linear

ACCELEROMETERS = ("wheel_acceleration_x", "longitudinal_acceleration")
"""Roles that can compensate the outboard mass, the one at the hub first."""
_NEARLY = 0.95
"""A rate is known no better."""
_ROWS = 3000
_LEAST_ROWS = 100
_MOST_RATIO, _LEAST_RATIO, _SURE = 3.0, -0.5, 4.0
"""Hills and coasting put dV/dt between these shares of what a right accelerometer reads."""


def accelerometer_of(roles: Mapping[str, OnBase], cutoff_hz: float) -> tuple[str, list[Note]]:
    """Return the role by whose acceleration the outboard mass is compensated, and notes on it.

    An accelerometer too slow for the common filter, or one that contradicts the ground speed, is not used: the slope of
    the ground speed is, as without one.

    Parameters
    ----------
    roles : mapping role -> OnBase
    cutoff_hz : float
        Of the common filter.
    """
    notes = []
    for role in ACCELEROMETERS:
        rate_hz = roles[role].facts.rate_hz if role in roles else nan
        if not isfinite(rate_hz):
            continue
        if rate_hz * CUTOFF_PER_RATE < _NEARLY * cutoff_hz:
            least_hz = cutoff_hz / CUTOFF_PER_RATE
            facts = {"role": role, "rate_hz": rate_hz, "least_hz": least_hz}
            notes.append(Note(RunCode.ACCELEROMETER_SLOW, Severity.DOUBT, facts))
            continue
        ratio, sigma = _speed_over(roles[role], roles.get(GROUND_SPEED))
        if ratio - _SURE * sigma > _MOST_RATIO or ratio + _SURE * sigma < _LEAST_RATIO:
            facts = {"role": role, "ratio": ratio, "sigma": sigma}
            notes.append(Note(RunCode.ACCELEROMETER_DOUBTED, Severity.DOUBT, facts))
            continue
        return role, [*notes, Note(RunCode.OUTBOARD_BY_ACCELEROMETER, values={"role": role})]
    return GROUND_SPEED, notes


def _speed_over(accelerometer: OnBase, speed: OnBase | None) -> tuple[float, float]:
    """Return the slope of the ground speed over the accelerometer's reading, and its one-sigma; NaN where unknown."""
    nothing = (nan, nan)
    if speed is None:
        return nothing
    rows = np.flatnonzero((accelerometer.reason == Reason.USED) & (speed.reason == Reason.USED))
    rows = rows[:: max(1, -(-len(rows) // _ROWS))]
    if len(rows) < _LEAST_ROWS:
        return nothing
    matrix = np.column_stack([accelerometer.values[rows], np.ones(len(rows))])
    fit = robust_linear(matrix, speed.slope[rows])
    return float(fit.coefficients[0]), sqrt(block_covariance(matrix, speed.slope[rows], fit.weights)[0, 0])
