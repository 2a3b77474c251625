r"""Where points of the rim are, and the shear stress there, as functions of the angle behind the entry.

Everything is written in :math:`\delta = \theta_1 - \theta`, so that nothing cancels near the entry.

Sources: Wong, Theory of Ground Vehicles (2008); Janosi & Hanamoto (1961); Yang et al. (2016), Eq. 3-5.
"""

from __future__ import annotations

import numpy as np

from model.wheel_soil.dual import Number, value_of, where

SOFTENING_LENGTH_M = 0.15
"""Shear displacement over which a softening soil loses 63 % of what it loses."""


def geometry(entry_angle: Number, delta: Number) -> tuple[Number, Number]:
    """Return where points an angle `delta` (rad, 0 <= delta < pi) behind the entry are, exactly also near the entry.

    The drop is cos(theta) - cos(theta_1), and Z(theta) of Eq. 3 is r times it; the advance is sin(theta_1) -
    sin(theta).
    """
    cos1, sin1 = np.cos(entry_angle), np.sin(entry_angle)
    half = np.sin(delta * 0.5)
    square = half * half
    a = square + square  # 1 - cos(delta)
    q = 2.0 * (half * np.sqrt(1.0 - square))  # sin(delta)
    return sin1 * q - cos1 * a, sin1 * a + cos1 * q


def shear_displacement(delta: Number, advance: Number, radius: Number, speed_ratio: Number) -> Number:
    """Return j of Eq. 5 in metres; one formula for driving and braking.

    `delta` is theta_1 - theta in rad, `advance` is sin(theta_1) - sin(theta). The speed ratio V/(r omega) is 1 - s when
    driving and 1/(1 + s_b) when braking.
    """
    return radius * (delta - speed_ratio * advance)


def mobilisation(displacement: Number, shear_modulus: Number, *, signed: bool) -> Number:
    """Return the share of the shear strength that is mobilised (Eq. 4), with the sign of the displacement.

    `signed` is whether the displacement may be negative (braking).
    """
    rate = -1.0 / shear_modulus
    if not signed:
        return -np.expm1(displacement * rate)
    sign = np.sign(value_of(displacement))
    return -sign * np.expm1(sign * displacement * rate)


def softened(displacement: Number, fraction: Number, *, signed: bool) -> Number:
    """Return the share of Eq. 4 that is left of the shear stress: 1 - q (1 - exp(-|j| / 0.15 m)).

    `fraction` is q; `signed` is whether the displacement may be negative (braking).
    """
    size = displacement * np.sign(value_of(displacement)) if signed else displacement
    return 1.0 + fraction * np.expm1(size * (-1.0 / SOFTENING_LENGTH_M))


def speed_ratio(slip: Number) -> Number:
    """Return V/(r omega) for a slip ratio: 1 - s (Eq. 6) when driving, 1/(1 + s_b) when braking.

    A locked wheel (s_b = -1) is the limit of a very large ratio, for which `mobilisation` is exactly -1.
    """
    braking = value_of(slip) < 0.0
    turning = where(braking, slip + 1.0, 1.0)
    turning = where(value_of(turning) < 1e-9, 1e-9, turning)
    return where(braking, 1.0 / turning, 1.0 - slip)


def slip_of_ratio(ratio: Number) -> Number:
    """Return the slip ratio for V/(r omega); the inverse of `speed_ratio`."""
    braking = value_of(ratio) > 1.0
    return where(braking, 1.0 / where(braking, ratio, 1.0) - 1.0, 1.0 - ratio)
