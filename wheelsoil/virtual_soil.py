"""The soil of a simulated field, drawn from what terrain.toml says of its uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from daq.config import SOIL_KEYS, SoilSection, TerrainConfig, UncertaintySection
from daq.errors import ConfigError, Fault
from model.soils import LABORATORY_SPREAD, Soil, soil_from_terrain
from model.virtual_test import drawn_soil

FloatArray = NDArray[np.float64]

_TRIES = 1000
_ROUNDING = 1e-9
"""Share of the variances by which a covariance may miss being positive."""


def soil_of_the_field(
    laboratory: Soil, terrain: TerrainConfig, width_m: float, rng: np.random.Generator, where: str
) -> Soil:
    """Draw a soil about the laboratory's.

    Relative one-sigmas are those of `model.virtual_test.drawn_soil`. From a covariance the soil is normal in the keys
    and units of ``[soil]``, and drawn again while a value is out of its range or the soil has no stiffness.

    Parameters
    ----------
    laboratory : Soil
    terrain : TerrainConfig
        States the uncertainty; `model.soils.LABORATORY_SPREAD` where it states none.
    width_m : float
        Of the wheel.
    rng : numpy.random.Generator
    where : str
        Name of the file, for messages.

    Raises
    ------
    ConfigError
        The covariance is not positive semi-definite, or no soil can be drawn from it.
    """
    stated = terrain.uncertainty
    if stated is None:
        return drawn_soil(laboratory, rng)
    if stated.covariance is None:
        return drawn_soil(laboratory, rng, spread_of(stated))
    root = _root(np.array(stated.covariance), where)
    mean = np.array([getattr(terrain.soil, key) for key in SOIL_KEYS])
    for _ in range(_TRIES):
        values = mean + root @ rng.standard_normal(len(SOIL_KEYS))
        soil = _soil(terrain.soil, values)
        if soil and soil.stiffness(width_m) > 0:
            return soil
    raise ConfigError(
        Fault(
            "no soil can be drawn from the covariance",
            where,
            f"{_TRIES} draws, each with a value out of its range",
            next_step="check the covariance: its rows are " + ", ".join(SOIL_KEYS),
        )
    )


def spread_of(stated: UncertaintySection) -> dict[str, float]:
    """Return relative one-sigmas by the names of `model.soils.LABORATORY_SPREAD`; zero: exactly known."""
    return {name: getattr(stated, key) or 0.0 for name, key in zip(LABORATORY_SPREAD, SOIL_KEYS, strict=True)}


def _root(covariance: FloatArray, where: str) -> FloatArray:
    """Return a lower triangle whose product with its transpose is the covariance."""
    variances = np.diag(covariance)
    sigma = np.sqrt(np.where(variances > 0, variances, 0.0))
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(scale, scale)
    try:
        if not (np.isfinite(covariance).all() and np.allclose(correlation, correlation.T) and (variances >= 0).all()):
            raise np.linalg.LinAlgError
        root = np.linalg.cholesky(correlation + _ROUNDING * np.eye(len(covariance)))
    except np.linalg.LinAlgError:
        raise ConfigError(
            Fault(
                "the covariance is not positive semi-definite",
                where,
                expected="symmetric, no variance or combination of them below zero",
                next_step="take it as `wheelsoil soil` writes it, or state relative one-sigmas under [uncertainty]",
            )
        ) from None
    return np.asarray(sigma[:, np.newaxis] * root)


def _soil(laboratory: SoilSection, values: FloatArray) -> Soil | None:
    drawn = laboratory.model_dump() | dict(zip(SOIL_KEYS, values.tolist(), strict=True))
    try:
        return soil_from_terrain(TerrainConfig(soil=SoilSection(**drawn)))
    except ValidationError:
        return None
