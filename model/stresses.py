r"""Normal and shear stress under a wheel, as functions of the angle behind the entry.

Everything is written in :math:`\delta = \theta_1 - \theta`, so that nothing cancels near the entry.

Sources: Bekker (1969); Wong, Theory of Ground Vehicles (2008); Janosi & Hanamoto (1961); Yang et al. (2016),
Eq. 2-5, where Eq. 2 is misprinted: k = k_c/b + k_phi.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.dual import Number, value_of, where


@dataclass(frozen=True)
class Geometry:
    """Where a point of the contact patch is; each entry broadcasts to (n, nodes).

    Attributes
    ----------
    cos, sin : of theta
    drop : cos(theta) - cos(theta_1), exact near the entry
    advance : sin(theta_1) - sin(theta), exact near the entry
    """

    cos: Number
    sin: Number
    drop: Number
    advance: Number


def geometry(entry_angle: Number, delta: Number) -> Geometry:
    """Return the geometry of points an angle `delta` (rad) behind the entry at `entry_angle` (rad)."""
    cos1, sin1 = np.cos(entry_angle), np.sin(entry_angle)
    q = np.sin(delta)
    half = np.sin(delta * 0.5)
    a = 2.0 * half * half
    drop = sin1 * q - cos1 * a
    advance = sin1 * a + cos1 * q
    return Geometry(cos1 + drop, sin1 - advance, drop, advance)


def normal_stress(stiffness: Number, sinkage: Number, exponent: Number) -> Number:
    """Return sigma of Eq. 2 in Pa: k Z^n, with k in Pa/m^n and Z = r drop > 0 of Eq. 3 in m."""
    return stiffness * np.exp(exponent * np.log(sinkage))


def shear_displacement(delta: Number, advance: Number, radius: Number, speed_ratio: Number) -> Number:
    """Return j of Eq. 5 in metres; one formula for driving and braking.

    Parameters
    ----------
    delta : rad, theta_1 - theta
    advance : sin(theta_1) - sin(theta)
    radius : m
    speed_ratio : V/(r omega)
        1 - s when driving, 1/(1 + s_b) when braking.
    """
    return radius * (delta - speed_ratio * advance)


def mobilisation(displacement: Number, shear_modulus: Number) -> Number:
    """Return the share of the shear strength that is mobilised (Eq. 4), with the sign of the displacement."""
    sign = np.sign(value_of(displacement))
    return -sign * np.expm1(-sign * displacement / shear_modulus)


def speed_ratio(slip: Number) -> Number:
    """Return V/(r omega) for a slip ratio: 1 - s (Eq. 6) when driving, 1/(1 + s_b) when braking.

    A locked wheel (s_b = -1) is the limit of a very large ratio, for which `mobilisation` is exactly -1.
    """
    braking = value_of(slip) < 0.0
    turning = where(braking, slip + 1.0, 1.0)
    turning = where(value_of(turning) < 1e-9, 1e-9, turning)
    return where(braking, 1.0 / turning, 1.0 - slip)
