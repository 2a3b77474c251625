"""Readings of the rut's depth by hand, drawn from a simulated run's true sinkage."""

from __future__ import annotations

import numpy as np

from daq import FloatArray, RutReading
from model.simulation import Truth
from processing import REBOUND_M, REBOUND_SIGMA_M

SLIPS = (0.05, 0.8)
"""Between which the readings of a campaign are evenly spread."""
READING_SIGMA_M = 0.005
"""Of a ruler in a rut."""
_DRIVING_MPS = 0.2
"""Ground speed above which slip says where the wheel worked the soil."""


def slips_read(readings: int, run: int, runs: int) -> FloatArray:
    """Return the slips at which one run of a campaign is read: it takes every `runs`-th of all."""
    return np.linspace(*SLIPS, readings)[run::runs]


def drawn_rebound_m(rng: np.random.Generator) -> float:
    """Return how far the soil of a field rises behind the wheel, m."""
    return max(float(rng.normal(REBOUND_M, REBOUND_SIGMA_M)), 0.0)


def rut_readings(truth: Truth, slips: FloatArray, rebound_m: float, rng: np.random.Generator) -> tuple[RutReading, ...]:
    """Return readings where the run's slip is nearest to each of some slips, placed by time and rounded to 0.1 mm."""
    slip = np.where(truth.ground_speed_mps > _DRIVING_MPS, truth.slip, np.inf)
    rows = [int(np.argmin(np.abs(slip - wanted))) for wanted in slips]
    depths = truth.sinkage_m[rows] - rebound_m + READING_SIGMA_M * rng.standard_normal(len(rows))
    return tuple(
        RutReading(depth_m=round(max(depth, 0.0), 4), sigma_m=READING_SIGMA_M, time_s=round(time, 2))
        for depth, time in zip(depths.tolist(), truth.time_s[rows].tolist(), strict=True)
    )
