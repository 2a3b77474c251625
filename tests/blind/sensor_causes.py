"""Causes that lie in the measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from blind.hooks import Hidden, also, reads
from blind.wheel import Physics, slip_of


def _rolling_radius(physics: Physics, e: float) -> Physics:
    return also(physics, slip=lambda m: slip_of(m.vehicle.radius_m * (1 + e) * m.omega, m.speed))


MEASUREMENT = (
    Hidden(
        "wheel_radius",
        "wheel_radius",
        "relative",
        0.03,
        (-0.15, 0.15),
        "true r (1 + e) in the slip",
        _rolling_radius,
        both=True,
    ),
    Hidden(
        "speed_latency",
        "speed_latency",
        "extra_delay_s",
        0.15,
        (-0.55, 0.55),
        "ground speed late by tau",
        reads(lambda r, m, tau: replace(r, speed=m.later(-tau))),
        both=True,
    ),
    Hidden(
        "speed_bias",
        "speed_bias",
        "offset_mps",
        0.08,
        (-0.35, 0.45),
        "ground speed + b, not at rest",
        reads(lambda r, m, b: replace(r, speed=np.maximum(r.speed + b * m.rolls, 0.0))),
        both=True,
    ),
    Hidden(
        "drawbar_pull_zero",
        "drawbar_pull_zero",
        "offset_n",
        100.0,
        (-900, 900),
        "Dp + zero",
        reads(lambda r, m, x: replace(r, pull=r.pull + x)),
        both=True,
    ),
    Hidden(
        "torque_zero",
        "torque_zero",
        "offset_nm",
        40.0,
        (-300, 300),
        "T + zero",
        reads(lambda r, m, x: replace(r, torque=r.torque + x)),
        both=True,
    ),
    Hidden(
        "load_zero",
        "load_zero",
        "offset_n",
        400.0,
        (-2800, 2800),
        "W + zero",
        reads(lambda r, m, x: replace(r, load=r.load + x)),
        both=True,
    ),
    Hidden(
        "drawbar_pull_gain",
        "drawbar_pull_gain",
        "relative",
        0.1,
        (-0.45, 0.45),
        "Dp (1 + g)",
        reads(lambda r, m, g: replace(r, pull=r.pull * (1 + g))),
        both=True,
    ),
    Hidden(
        "torque_gain",
        "torque_gain",
        "relative",
        0.05,
        (-0.45, 0.45),
        "T (1 + g)",
        reads(lambda r, m, g: replace(r, torque=r.torque * (1 + g))),
        both=True,
    ),
    Hidden(
        "load_gain",
        "load_gain",
        "relative",
        0.05,
        (-0.4, 0.45),
        "W (1 + g)",
        reads(lambda r, m, g: replace(r, load=r.load * (1 + g))),
        both=True,
    ),
    Hidden(
        "crosstalk",
        "crosstalk",
        "coefficient",
        0.01,
        (-0.1, 0.1),
        "Dp + k W",
        reads(lambda r, m, k: replace(r, pull=r.pull + k * m.load)),
        both=True,
    ),
    Hidden(
        "zero_drift",
        "zero_drift",
        "campaign_span_n",
        150.0,
        (-1500, 1500),
        "Dp + d (t/T - 1/2)",
        reads(lambda r, m, d: replace(r, pull=r.pull + d * m.clock)),
        both=True,
    ),
    Hidden(
        "settling_zero",
        "zero_drift",
        "",
        150.0,
        (-1500, 1500),
        "Dp + d (.5 - exp(-1.5 t/T)), a warming bridge",
        reads(lambda r, m, d: replace(r, pull=r.pull + d * (0.5 - np.exp(-1.5 * (m.clock + 0.5))))),
        both=True,
        variant=True,
    ),
)
