"""Coordinates in which every unknown of the prior is standard normal: the soil's and the causes' parameters.

A soil that is barely known must stay a soil: the stiffness k = k_c/b + k_phi at the wheel's width and the shear modulus
K are lognormal with the laboratory's value as median and its relative one-sigma as one-sigma of the logarithm (their
covariances with the rest are kept), the cohesion is cut off at 0. A cause's parameter has its published scale, cut off
at its bounds; a one-sided one is half-normal. Cut-off distributions come from a standard normal one by their
quantiles, so that no bound is left to a search or to an integral.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from daq import ConfigError, FloatArray
from model.diagnosis.core.campaign import Bench
from model.effects.base import Parameter
from model.wheel_soil.conditions import Wheel
from model.wheel_soil.soils import SOIL_PARAMETERS

SOIL_COORDINATES = ("cohesion_pa", "tan_phi", "ln_shear_modulus", "sinkage_exponent", "ln_stiffness")
_TYPICAL_LOAD_N = 10_000.0
_LOAD_UNITS = ("N", "N m", "Nm")
_FAR = 30.0
_NEVER = 8.0
"""One-sigmas beyond which a bound cuts nothing off."""


@dataclass(frozen=True)
class SoilCoordinates:
    """One soil, shared by the tables that name it.

    Attributes
    ----------
    names : tuple of str
        Of `SOIL_COORDINATES` those that are not exactly known, q of them.
    fixed : mapping
        Values of all coordinates at the laboratory's soil.
    mean : array, shape (q,)
    root : array, shape (q, q)
        Lower triangle; coordinates are ``mean + root @ u`` with u standard normal, the cohesion's cut off at 0.
    cohesive_share : float
        k_c / k: k_c and k_phi grow together, one width cannot part them.
    """

    names: tuple[str, ...]
    fixed: Mapping[str, float]
    mean: FloatArray
    root: FloatArray
    cohesive_share: float

    @staticmethod
    def of(table: Bench) -> SoilCoordinates:
        """Return the coordinates of a table's soil.

        Raises
        ------
        ConfigError
            The laboratory's stiffness at the wheel's width is not positive.
        """
        c, tan_phi, shear, n, kc, kphi = (float(x) for x in table.soil_prior.mean)
        k = kc / table.wheel.width_m + kphi
        if not k > 0:
            raise ConfigError.of(
                "the soil does not carry the wheel: k_c/b + k_phi is not positive",
                table.name,
                f"{k:.4g} Pa/m^n at b = {table.wheel.width_m:g} m",
                next_step="take k of the plate nearest to the wheel's width as frictional_modulus_kn",
            )
        to_coordinates = np.zeros((5, len(SOIL_PARAMETERS)))
        to_coordinates[[0, 1, 2, 3], [0, 1, 2, 3]] = 1.0, 1.0, 1.0 / shear, 1.0
        to_coordinates[4, 4:] = 1.0 / (table.wheel.width_m * k), 1.0 / k
        covariance = to_coordinates @ table.soil_prior.covariance @ to_coordinates.T
        known = np.diag(covariance) > 0
        fixed = dict(zip(SOIL_COORDINATES, (c, tan_phi, np.log(shear), n, np.log(k)), strict=True))
        names = tuple(name for name, free in zip(SOIL_COORDINATES, known, strict=True) if free)
        root = np.zeros((len(names), len(names)))
        root[:] = np.linalg.cholesky(covariance[np.ix_(known, known)])
        mean = np.array([fixed[name] for name in names])
        return SoilCoordinates(names, fixed, mean, root, kc / table.wheel.width_m / k)

    def values(self, standard: FloatArray) -> tuple[dict[str, FloatArray], FloatArray]:
        """Return the coordinates and their derivatives.

        Parameters
        ----------
        standard : array, shape (m, q)

        Returns
        -------
        values : mapping coordinate -> array (m,)
        derivative : array, shape (m, 5, q)
            By the standard-normal ones, in the order of `SOIL_COORDINATES`.
        """
        m, q = standard.shape
        u, slope = standard.copy(), np.ones((m, q))
        if "cohesion_pa" in self.names:
            u[:, 0], slope[:, 0] = cut_off(standard[:, 0], -self.mean[0] / self.root[0, 0], np.inf)
        free = self.mean + u @ self.root.T
        if "cohesion_pa" in self.names:
            free[:, 0] = np.maximum(free[:, 0], 0.0)
        derivative = np.zeros((m, len(SOIL_COORDINATES), q))
        values = {name: np.full(m, value) for name, value in self.fixed.items()}
        for i, name in enumerate(self.names):
            values[name] = free[:, i]
            derivative[:, SOIL_COORDINATES.index(name)] = self.root[i] * slope
        return values, derivative

    def soil_parameters(self, values: Mapping[str, FloatArray], width_m: float) -> dict[str, FloatArray]:
        """Return the model's soil parameters for `values` of the coordinates."""
        k = np.exp(values["ln_stiffness"])
        return {
            "cohesion_pa": values["cohesion_pa"],
            "tan_phi": values["tan_phi"],
            "shear_modulus_m": np.exp(values["ln_shear_modulus"]),
            "sinkage_exponent": values["sinkage_exponent"],
            "cohesive_modulus": self.cohesive_share * width_m * k,
            "frictional_modulus": (1.0 - self.cohesive_share) * k,
        }


@dataclass(frozen=True)
class CauseCoordinate:
    """One parameter of one cause: ``centre + scale * x``, x a cut-off standard normal.

    Attributes
    ----------
    name, unit : of the parameter
    neutral, centre, scale : in its unit
        Where the cause does not act; where it is expected, if it does: the neutral value unless something is declared.
    lower, upper : of x
    """

    name: str
    unit: str
    neutral: float
    scale: float
    lower: float
    upper: float
    centre: float

    @staticmethod
    def of(
        parameter: Parameter, wheel: Wheel, load_n: float, declared: tuple[float, float] | None = None
    ) -> CauseCoordinate:
        """Return the coordinate for a wheel under a typical load; `declared` are centre and scale, if they are known.

        Scales in N and N m are stated for a vehicle's wheel under 10 kN and shrink with the load (moments with the
        load only: a single-wheel test's torque sensor has the range that its loads ask for).
        """
        scale = parameter.scale(wheel)
        if parameter.unit in _LOAD_UNITS:
            scale *= load_n / _TYPICAL_LOAD_N
        centre, scale = declared or (parameter.neutral, scale)
        bounds = sorted((parameter.lower, parameter.upper))
        least = max(bounds[0], parameter.neutral) if parameter.side > 0 else bounds[0]
        most = min(bounds[1], parameter.neutral) if parameter.side < 0 else bounds[1]
        lower, upper = (least - centre) / scale, (most - centre) / scale
        return CauseCoordinate(parameter.name, parameter.unit, parameter.neutral, scale, lower, upper, centre)

    @property
    def side(self) -> float:
        """1 where the parameter may be above neutral, else -1."""
        return 1.0 if self.upper > 0 else -1.0

    def values(self, standard: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameter and its derivative by the standard-normal coordinate, shape (m,) each."""
        x, slope = cut_off(standard, self.lower, self.upper)
        return self.centre + self.scale * x, self.scale * slope

    def standard(self, value: float) -> float:
        """Return the standard-normal coordinate of a value inside the bounds."""
        x = (value - self.centre) / self.scale
        above, below = scipy.special.ndtr(-self.lower), scipy.special.ndtr(-self.upper)
        return float(
            -scipy.special.ndtri(np.clip((scipy.special.ndtr(-x) - below) / (above - below), 1e-12, 1 - 1e-12))
        )


def cut_off(standard: FloatArray, lower: float, upper: float) -> tuple[FloatArray, FloatArray]:
    """Return a standard normal quantity cut off at `lower` and `upper`, and its derivative by `standard`.

    The probability above stays what it is: ``P(x > cut_off(v)) = P(v' > v)``.
    """
    lower, upper = (bound if abs(bound) < _NEVER else np.copysign(np.inf, bound) for bound in (lower, upper))
    if np.isneginf(lower) and np.isposinf(upper):
        return standard, np.ones_like(standard)
    if np.isneginf(lower):
        x, slope = cut_off(-standard, -upper, np.inf)
        return -x, slope
    standard = np.clip(standard, -_FAR, _FAR)
    above, below = scipy.special.ndtr(-lower), scipy.special.ndtr(-upper)
    x = np.clip(-scipy.special.ndtri(below + (above - below) * scipy.special.ndtr(-standard)), lower, upper)
    return x, (above - below) * np.exp(0.5 * (x * x - standard * standard))
