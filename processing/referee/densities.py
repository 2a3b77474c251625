r"""Densities of the referee's residuals, fixed on simulated sound runs (`tests/fit_referee.py`).

Of a wheel on any ground, traction T/(r W) follows slip, and traction less pull D/W is a resistance that hardly depends
on it. Every ground is one of a grid of curves

.. math:: T/(r W) = A (1 - e^{-|s - s_0|/K}) \, sgn(s - s_0), \qquad (T/r - D)/W = R, \qquad s_0 = -c R^2

with A larger where the wheel is braked.
Residuals have Student's density, scaled to 1 at its peak: the logarithm is at most 0.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from math import log

import numpy as np
from numpy.typing import NDArray

from daq import FloatArray

TRACTIONS = (0.25, 0.35, 0.5, 0.7, 1.0)
SLIPS = (0.02, 0.05, 0.12, 0.25, 0.5)
RESISTANCES = (0.01, 0.06, 0.12, 0.2, 0.28, 0.36, 0.46)
TOWED_SLIP = 1.6
"""c of s_0 = -c R^2."""
TRACTION_WEIGHTS = (0.4, 0.34, 1.0, 0.76, 0.12)
SLIP_WEIGHTS = (0.1, 0.26, 0.8, 1.0, 0.4)
RESISTANCE_WEIGHTS = (0.15, 1.0, 0.46, 0.83, 0.78, 0.27, 0.1)
"""How often each occurs."""
BRAKED = 1.35
"""A of a braked wheel over that of a driven one."""
NODES = np.linspace(-1.0, 1.0, 401)
"""Slips of the tables of `grounds`."""
TAIL = 3.0
"""Degrees of freedom."""
LEAST_SAMPLES, PER_CELL = 8.0, 1.2
"""A run's samples share their systematic errors: all of them together count for so many."""

TRACTION_SIGMA, TRACTION_GAIN = 0.04, 0.15
RESISTANCE_SIGMA, RESISTANCE_GAIN = 0.03, 0.08
SINKAGE_SIGMA = 0.12
"""Resistance that a slipping wheel may add as it sinks, per slip."""
SLIP_SIGMA, SPEED_SIGMA_MPS = 0.03, 0.1
OF_LIFTED_LOAD = -4.0
"""Log density of a load that pulls the wheel up."""
EXCESS_SIGMA = 0.1
"""Of a slip beyond 1, which rollback and a wrong delay cause."""
FREE_SLIP = ((0.0, 0.1, 0.1), (-3.0, 0.3, 0.8))
"""Log weight and scales of braking and driving slip where no force is measured: of a rolling and of a slipping run."""

LOG_SPEED = (log(3.0), 1.0, TAIL)
LOG_LOAD = (log(3000.0), 2.5, TAIL)
LOG_RADIUS = (log(0.4), 0.7, TAIL)
LOG_SHARE = (log(0.25), 0.18, 8.0)
LOG_TRACK = (0.0, 0.02, 8.0)
"""Median, scale and degrees of freedom of ln of the speed in m/s, load in N, radius in m, load in weights, ground speed
in track speeds."""
OF_WRONG_REFERENCE = -12.0
"""Log density of these at the least: the mass or the positions may be wrong themselves."""
LEAST_SLIP, LEAST_SLIDING_MPS, AXIS_SIGMA = 0.25, 2.0, 0.07
"""Scales of a run as a whole: 10 % quantiles of slip and of rim less ground speed, as no wheel spins fast all the time;
angle in rad between pull over traction and one to one, by gains and sinkage."""
MEND_PRIOR = 1e-3
"""Of each mend against sound."""
UNLISTED = -1.0
"""Log score of a sample under a mistake that no mend undoes. Sound runs and right mends have -0.6 at the least, with a
measurement cause of three prior scales -0.9, with a wrong mend -1.3 and less."""


def student(residual: FloatArray | NDArray[np.float32], sigma: FloatArray | float, freedom: float = TAIL) -> FloatArray:
    """Return the log density of residuals, 0 at its peak."""
    return np.asarray(-(freedom + 1) / 2 * np.log1p((residual / sigma) ** 2 / freedom))


@lru_cache(maxsize=1)
def grounds() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return traction and its slope over slip of every ground at `NODES`, shape (k, nodes), and resistance, (k,)."""
    grid = np.array(list(product(TRACTIONS, SLIPS, RESISTANCES)))
    most, scale, resistance = grid.T[:, :, np.newaxis]
    beyond = NODES + TOWED_SLIP * resistance**2
    decay = np.exp(-np.abs(beyond) / scale)
    most = np.where(beyond < 0, BRAKED * most, most)
    traction = most * (1 - decay) * np.sign(beyond)
    slope = most / scale * decay
    return traction.astype(np.float32), slope.astype(np.float32), grid[:, 2].astype(np.float32)


@lru_cache(maxsize=1)
def ground_weights() -> FloatArray:
    """Return the log of how often each ground occurs, shape (k,), 0 for the most frequent."""
    weights = np.prod(list(product(TRACTION_WEIGHTS, SLIP_WEIGHTS, RESISTANCE_WEIGHTS)), axis=1)
    return np.asarray(np.log(weights / weights.max()))
