"""The pressure-sinkage law of a soil: Bekker's (Eq. 2), and the closed form of a wheel's sinkage that follows (Eq. 10).

Another law takes the place of these three formulas.

Sources: Bekker (1969); Yang et al. (2016), where Eq. 2 is misprinted: k = k_c/b + k_phi.
"""

from __future__ import annotations

import numpy as np

from model.wheel_soil.dual import Number


def stiffness(cohesive_modulus: Number, frictional_modulus: Number, width: Number) -> Number:
    """Return k = k_c/b + k_phi of Eq. 2 in Pa/m^n, of k_c in N/m^(n+1), k_phi in N/m^(n+2) and b in m."""
    return cohesive_modulus / width + frictional_modulus


def normal_stress(stiffness: Number, sinkage: Number, exponent: Number) -> Number:
    """Return sigma of Eq. 2 in Pa: k Z^n, with k in Pa/m^n and Z = r drop > 0 of Eq. 3 in m."""
    return stiffness * np.exp(exponent * np.log(sinkage))


def closed_form(load: Number, radius: Number, width: Number, stiffness: Number, exponent: Number) -> Number:
    """Return Z0 of Eq. 10 in metres, of a load > 0 in N and the stiffness k of Eq. 2 in Pa/m^n at that width.

    It neglects shear and assumes Z0 much smaller than 2 r. Source: Bekker (1969); Yang et al. (2016), Eq. 10.
    """
    ratio = 3.0 * load / (np.sqrt(2.0 * radius) * width * stiffness * (3.0 - exponent))
    return np.exp(np.log(ratio) * (2.0 / (2.0 * exponent + 1.0)))
