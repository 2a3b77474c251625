"""What the laboratory knows of a soil: the covariance of the six parameters of `model.wheel_soil.SOIL_PARAMETERS`."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians

import numpy as np
from numpy.typing import NDArray

from daq.config import TerrainConfig
from model.soils import Soil
from model.wheel_soil import SOIL_PARAMETERS

FloatArray = NDArray[np.float64]

DEFAULT_RELATIVE_SIGMA = {
    "cohesion_pa": 0.10,
    "tan_phi": 0.06,
    "shear_modulus_m": 0.20,
    "sinkage_exponent": 0.04,
    "cohesive_modulus": 0.10,
    "frictional_modulus": 0.10,
}
"""One-sigma where terrain.toml states none: c 10 %, tan phi 6 %, K 20 %, k 10 %, n 4 %."""


@dataclass(frozen=True)
class SoilPrior:
    """A normal distribution over the soil's parameters, in the order of `SOIL_PARAMETERS`, SI units.

    Attributes
    ----------
    mean : array, shape (6,)
    covariance : array, shape (6, 6)
    source : str
    """

    mean: FloatArray
    covariance: FloatArray
    source: str

    def whitener(self) -> FloatArray:
        """Return A, shape (rank, 6), with A'A the inverse covariance; an exactly known parameter has no row."""
        sigma = np.sqrt(np.diag(self.covariance))
        known = sigma > 0
        rows = np.zeros((int(known.sum()), len(sigma)))
        if known.any():
            correlation = self.covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known])
            rows[:, known] = np.linalg.solve(np.linalg.cholesky(correlation), np.diag(1.0 / sigma[known]))
        return rows


def prior_of(soil: Soil, terrain: TerrainConfig | None = None) -> SoilPrior:
    """Build the prior from terrain.toml's ``[uncertainty]``, or from `DEFAULT_RELATIVE_SIGMA`.

    A parameter that the section leaves out is taken as exactly known.
    """
    mean = np.array([getattr(soil, name) for name in SOIL_PARAMETERS])
    uncertainty = terrain.uncertainty if terrain else None
    if uncertainty is None:
        sigma = np.abs(mean) * np.array([DEFAULT_RELATIVE_SIGMA[name] for name in SOIL_PARAMETERS])
        return SoilPrior(mean, np.diag(sigma**2), "default laboratory uncertainty")
    if uncertainty.covariance is not None:
        degree = radians(1.0) / cos(soil.friction_angle_rad) ** 2  # d tan(phi) per degree
        unit = np.array([1e3, degree, 1.0, 1.0, 1e3, 1e3])
        return SoilPrior(mean, np.array(uncertainty.covariance) * np.outer(unit, unit), "terrain.toml: covariance")
    keys = (
        "cohesion_kpa",
        "friction_angle_deg",
        "shear_modulus_m",
        "sinkage_exponent",
        "cohesive_modulus_kn",
        "frictional_modulus_kn",
    )
    relative = np.array([getattr(uncertainty, key) or 0.0 for key in keys])
    return SoilPrior(mean, np.diag((np.abs(mean) * relative) ** 2), "terrain.toml: uncertainty")
