"""Soils: published ones as presets, each with its source, and what a laboratory knows of one; SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, radians, tan

import numpy as np

from daq import SOIL_KEYS, FloatArray, TerrainConfig
from model.wheel_soil import Number, pressure_sinkage

SOIL_PARAMETERS = (
    "cohesion_pa",
    "tan_phi",
    "shear_modulus_m",
    "sinkage_exponent",
    "cohesive_modulus",
    "frictional_modulus",
)
"""Names of the parameters that Eq. 2 and 4 take, in the order of every covariance."""


REFERENCE_SPEED_MPS = 2.0
"""Forward speed at which a soil is taken for the laboratory's where the speed of its plate tests is not stated."""
PRESSING_SHARE = 1.0 / 3.0
"""Mean vertical speed of a rim over its forward speed, tan(theta_1/2), at an entry angle of 37 deg; .18 at 20 deg and
.58 at 60 deg, which moves k by 6 % for an exponent of .1."""


@dataclass(frozen=True)
class Soil:
    """Parameters of Bekker's and Janosi-Hanamoto's equations.

    Attributes
    ----------
    cohesion_pa : c of Eq. 4
    friction_angle_rad : phi of Eq. 4
    shear_modulus_m : K of Eq. 4
    sinkage_exponent : n of Eq. 2
    cohesive_modulus : k_c of Eq. 2, N/m^(n+1)
    frictional_modulus : k_phi of Eq. 2, N/m^(n+2)
    reference_speed_mps : forward speed of a wheel that presses the soil as fast as the plate tests did
    """

    name: str
    cohesion_pa: float
    friction_angle_rad: float
    shear_modulus_m: float
    sinkage_exponent: float
    cohesive_modulus: float
    frictional_modulus: float
    unit_weight_n_m3: float = 16_500.0
    source: str = ""
    reference_speed_mps: float = REFERENCE_SPEED_MPS

    @property
    def tan_phi(self) -> float:
        """Tangent of the friction angle."""
        return tan(self.friction_angle_rad)

    def stiffness(self, width_m: float) -> float:
        """Return k of Eq. 2 in Pa/m^n."""
        return float(pressure_sinkage.stiffness(self.cohesive_modulus, self.frictional_modulus, width_m))

    def state(self, parameters: Mapping[str, Number]) -> SoilState:
        """Return the soil with other values of `SOIL_PARAMETERS`."""
        plain = SoilState(*(parameters[name] for name in SOIL_PARAMETERS))
        return replace(plain, reference_speed=self.reference_speed_mps)


@dataclass(frozen=True)
class SoilState:
    """The soil's parameters under given conditions, as columns or scalars in SI units.

    ``interface`` multiplies tan phi where soil shears on the rim; the soil itself keeps its friction.
    ``reference_speed`` is the wheel's speed at which it is the laboratory's soil, in m/s.
    """

    cohesion: Number
    tan_phi: Number
    shear_modulus: Number
    exponent: Number
    cohesive_modulus: Number
    frictional_modulus: Number
    interface: Number = 1.0
    reference_speed: Number = REFERENCE_SPEED_MPS

    def map(self, function: Callable[[Number], Number]) -> SoilState:
        """Return the soil with `function` applied to every parameter."""
        return SoilState(**{name: function(getattr(self, name)) for name in self.__dataclass_fields__})

    def stiffness(self, width: Number) -> Number:
        """Return k of Eq. 2 in Pa/m^n at a width in m."""
        return pressure_sinkage.stiffness(self.cohesive_modulus, self.frictional_modulus, width)

    def stiffer(self, factor: Number) -> SoilState:
        """Return the soil with k of Eq. 2 multiplied by a factor."""
        return replace(
            self,
            cohesive_modulus=self.cohesive_modulus * factor,
            frictional_modulus=self.frictional_modulus * factor,
        )


def soil_from_terrain(terrain: TerrainConfig) -> Soil:
    """Build a `Soil` in SI units from terrain.toml."""
    s = terrain.soil
    return Soil(
        name=s.name,
        cohesion_pa=s.cohesion_kpa * 1e3,
        friction_angle_rad=radians(s.friction_angle_deg),
        shear_modulus_m=s.shear_modulus_m,
        sinkage_exponent=s.sinkage_exponent,
        cohesive_modulus=s.cohesive_modulus_kn * 1e3,
        frictional_modulus=s.frictional_modulus_kn * 1e3,
        unit_weight_n_m3=(s.unit_weight_kn_m3 or 16.5) * 1e3,
        source="terrain.toml",
        reference_speed_mps=s.plate_speed_mps / PRESSING_SHARE if s.plate_speed_mps else REFERENCE_SPEED_MPS,
    )


def _soil(name: str, c: float, phi_deg: float, K: float, n: float, kc: float, kphi: float, source: str) -> Soil:
    return Soil(name, c, radians(phi_deg), K, n, kc, kphi, source=source)


_YANG = "Yang, Lin, Zhang, Wang (2016), J. Southeast Univ. 32(2), Tab. 1"
_DING = "Ding et al. (2015), as in unitsSpaceLab/gz-terramechanics soil_params.yaml"
_WONG = "Wong, Theory of Ground Vehicles, as in A. Lines' thesis code"

SOILS: dict[str, Soil] = {
    "clay": _soil("clay", 7580, 14, 0.025, 0.85, 43.68e3, 499.3e3, _YANG),
    "sandy": _soil("sandy", 1000, 25, 0.025, 1.04, 1.00e3, 580.0e3, _YANG),
    "ding_clay": _soil("ding_clay", 4140, 13, 0.006, 0.5, 13.19e3, 692.15e3, _DING),
    "dry_sand": _soil("dry_sand", 1040, 28, 0.010, 1.10, 0.99e3, 1528.43e3, _DING),
    "lunar": _soil("lunar", 170, 35, 0.018, 1.0, 1.4e3, 820e3, _DING),
    "hit_lss1": _soil("hit_lss1", 250, 31.9, 0.010, 1.10, 15.6e3, 2407.4e3, _DING),
    "sandy_loam": _soil("sandy_loam", 3300, 33.7, 0.025, 1.1, 74.6e3, 2080e3, _WONG),
}
"""Presets by name; ``SOILS["clay"]`` and ``SOILS["sandy"]`` are the paper's."""

LABORATORY_SPREAD: dict[str, float] = {
    "cohesion_pa": 0.10,
    "tan_phi": 0.06,
    "shear_modulus_m": 0.20,
    "sinkage_exponent": 0.04,
    "cohesive_modulus": 0.10,
    "frictional_modulus": 0.10,
}
"""Relative one-sigma of a laboratory's soil parameters, where terrain.toml states none."""


@dataclass(frozen=True)
class SoilPrior:
    """A normal distribution over the soil's parameters, in the order of `SOIL_PARAMETERS`, SI units.

    Attributes
    ----------
    mean : array, shape (6,)
    covariance : array, shape (6, 6)
    """

    mean: FloatArray
    covariance: FloatArray
    source: str
    assumed: bool = False
    """Whether no laboratory has said how uncertain it is."""

    def sized(self) -> dict[str, tuple[float, float]]:
        """Return mean and one-sigma of the parameters that are not known exactly."""
        sigmas = np.sqrt(np.diag(self.covariance)).tolist()
        each = zip(SOIL_PARAMETERS, self.mean.tolist(), sigmas, strict=True)
        return {name: (mean, sigma) for name, mean, sigma in each if sigma > 0}

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
        return SoilPrior(mean, np.diag(sigma**2), "default laboratory uncertainty", assumed=True)
    if uncertainty.covariance is not None:
        degree = radians(1.0) / cos(soil.friction_angle_rad) ** 2  # d tan(phi) per degree
        unit = np.array([1e3, degree, 1.0, 1.0, 1e3, 1e3])
        return SoilPrior(mean, np.array(uncertainty.covariance) * np.outer(unit, unit), "terrain.toml: covariance")
    relative = np.array([getattr(uncertainty, key) or 0.0 for key in SOIL_KEYS])
    return SoilPrior(mean, np.diag((np.abs(mean) * relative) ** 2), "terrain.toml: uncertainty")
