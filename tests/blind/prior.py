"""The engine's own prior, transcribed: how many causes, of which form, how large (docs/diagnosis.md)."""

from __future__ import annotations

import numpy as np
from blind.causes import FAMILIES, KNOWN

SIZES = (0.5, 0.35, 0.12, 0.03)
"""Probability of none, one, two and three causes."""
SCALES = {
    "vasilev": 0.05,
    "lyasko": 0.35,
    "ding": 0.3,
    "skid_sinkage": 0.6,
    "stress_peak_shift": 0.3,
    "interface_friction": 0.4,
    "bulldozing": 0.6,
    "exit_angle": 0.25,
    "rate_stiffness": 0.15,
    "multi_pass": 0.15,
    "track_drift": 0.2,
    "shear_softening": 0.3,
    "grouser": 0.02,
    "tyre_flattening": 0.15,
    "slope": 0.03,
    "wheel_inertia": 1.0,
    "wheel_radius": 0.03,
    "speed_latency": 0.2,
    "speed_bias": 0.1,
    "drawbar_pull_zero": 150.0,
    "torque_zero": 60.0,
    "load_zero": 500.0,
    "drawbar_pull_gain": 0.08,
    "torque_gain": 0.06,
    "load_gain": 0.06,
    "crosstalk": 0.02,
    "zero_drift": 150.0,
}
"""One-sigma of each form's parameter: of m1 and of m2 for Lyasko's law, of c1 = c2 for the peak; skid in wheel radii.

The second-order slip sinkage of the engine is not drawn: Vasil'ev's law is its first term.
"""


def drawn_causes(rng: np.random.Generator, radius_m: float) -> tuple[tuple[str, float], ...]:
    """Draw causes and sizes: normal about neutral, half-normal on the plausible side, again where out of limits."""
    count = int(rng.choice(len(SIZES), p=SIZES))
    families = rng.choice(list(FAMILIES), count, replace=False)
    return tuple(_drawn(str(family), rng, radius_m) for family in families)


def _drawn(family: str, rng: np.random.Generator, radius_m: float) -> tuple[str, float]:
    keys = [key for key in SCALES if KNOWN[key].family == family]
    key = str(rng.choice(keys))
    hidden = KNOWN[key]
    scale = SCALES[key] * (radius_m if key == "skid_sinkage" else 1.0)
    while True:
        size = scale * float(rng.standard_normal())
        size += scale * abs(float(rng.standard_normal())) * np.sign(size) if key == "lyasko" else 0.0
        size = size if hidden.both else abs(size) * float(np.sign(hidden.scale))
        if hidden.limits[0] <= size <= hidden.limits[1]:
            return key, size
