"""What the laboratory knows of a soil: the covariance of the six parameters of `model.wheel_soil.SOIL_PARAMETERS`."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians

import numpy as np
from numpy.typing import NDArray

from daq.config import SOIL_KEYS, TerrainConfig
from model.soils import LABORATORY_SPREAD, SOIL_PARAMETERS, Soil

FloatArray = NDArray[np.float64]


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

    def sigma_of(self, name: str) -> float:
        """Return the one-sigma of one of `SOIL_PARAMETERS`; 0 where it is exactly known."""
        return float(np.sqrt(self.covariance.diagonal()[SOIL_PARAMETERS.index(name)]))

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
    """Build the prior from terrain.toml's ``[uncertainty]``, or from `LABORATORY_SPREAD`.

    A parameter that the section leaves out is taken as exactly known.
    """
    mean = np.array([getattr(soil, name) for name in SOIL_PARAMETERS])
    uncertainty = terrain.uncertainty if terrain else None
    if uncertainty is None:
        sigma = np.abs(mean) * np.array([LABORATORY_SPREAD[name] for name in SOIL_PARAMETERS])
        return SoilPrior(mean, np.diag(sigma**2), "default laboratory uncertainty")
    if uncertainty.covariance is not None:
        degree = radians(1.0) / cos(soil.friction_angle_rad) ** 2  # d tan(phi) per degree
        unit = np.array([1e3, degree, 1.0, 1.0, 1e3, 1e3])
        return SoilPrior(mean, np.array(uncertainty.covariance) * np.outer(unit, unit), "terrain.toml: covariance")
    relative = np.array([getattr(uncertainty, key) or 0.0 for key in SOIL_KEYS])
    return SoilPrior(mean, np.diag((np.abs(mean) * relative) ** 2), "terrain.toml: uncertainty")
