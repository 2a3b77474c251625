"""Causes of no family that the library knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from blind.hooks import Hidden, also, at_hub, braking_part, reads, softer
from blind.wheel import Moments, Physics

from daq import FloatArray


def _relaxed(physics: Physics, length: float) -> Physics:
    """Contact slip follows the slip over a relaxation length."""
    before = physics.slip

    def slip(m: Moments) -> FloatArray:
        now, out = before(m), np.empty(len(m.speed))
        gain = 1 - np.exp(-np.diff(m.distance_m, prepend=m.distance_m[0]) / max(length, 1e-6))
        state = now[0]
        fresh = np.diff(m.time_s, prepend=m.time_s[0] - 1) > 5
        for i, (target, share, new) in enumerate(zip(now.tolist(), gain.tolist(), fresh.tolist(), strict=True)):
            state = target if new else state + share * (target - state)
            out[i] = state
        return out

    return also(physics, slip=slip)


OUTSIDE = (
    Hidden("slip_relaxation", "", "", 0.3, (0, 8), "contact slip follows over a length", _relaxed, outside=True),
    Hidden(
        "pull_nonlinearity",
        "",
        "",
        200.0,
        (-3000, 3000),
        "Dp + a ((Dp/1 kN)^2 - 1) /2, a bent bridge",
        reads(lambda r, m, a: replace(r, pull=r.pull + a * 0.5 * ((r.pull / 1e3) ** 2) * m.rolls)),
        both=True,
        outside=True,
    ),
    Hidden(
        "hub_drag",
        "",
        "",
        30.0,
        (0, 400),
        "T + drag (.5 + omega/8 rad/s) while it turns",
        at_hub(lambda m, z, soil, a: (0.0, a * m.rolls * (0.5 + m.omega / 8.0))),
        outside=True,
    ),
    Hidden(
        "brake_asymmetry",
        "",
        "",
        0.2,
        (-3, 3),
        "T and Dp gain differ while braking: T (1 + a), s < 0",
        reads(lambda r, m, a: replace(r, torque=r.torque + a * 200.0 * np.tanh(braking_part(m.slip) / 0.1) * m.rolls)),
        both=True,
        outside=True,
    ),
    Hidden(
        "soft_patch",
        "",
        "",
        0.3,
        (0, 2.5),
        "k exp(-a) on a tenth of the line",
        softer(lambda m, a: np.exp(-a * np.exp(-(((m.line - 0.25) / 0.1) ** 4)))),
        outside=True,
    ),
    Hidden(
        "bridge_gain_drift",
        "",
        "",
        0.3,
        (-4, 4),
        "Dp gain grows over the campaign: Dp (1 + g t/T)",
        reads(lambda r, m, g: replace(r, pull=r.pull * (1 + g * (m.clock + 0.5)))),
        both=True,
        outside=True,
    ),
)
