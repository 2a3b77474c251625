"""Bevameter results as a terrain.toml, in its units and with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, degrees

import numpy as np
from pydantic import ValidationError

from daq import SOIL_KEYS, ConfigError, DataError, Fault, FloatArray, SoilSection, TerrainConfig, UncertaintySection
from model.bevameter.joint import JointFit
from model.bevameter.pressure_sinkage import PressureSinkage
from model.bevameter.shear_strength import ShearStrength
from model.wheel_soil.soils import SOIL_PARAMETERS, prior_of, soil_from_terrain

_DIGITS = 9


def terrain_of(
    name: str,
    pressure: PressureSinkage | None = None,
    shear: ShearStrength | None = None,
    *,
    base: TerrainConfig | None = None,
) -> TerrainConfig:
    """Return terrain.toml's content: what was tested from the tests, the rest from `base`.

    The covariance is that of the normal distribution with the same 95 % intervals as Student's t
    (`JointFit.normal_covariance`); plate and shear tests are independent of each other.

    Parameters
    ----------
    name : of the terrain
    pressure, shear : optional
        What the tests gave.
    base : TerrainConfig, optional
        What to take where there is no test; with its own uncertainty, or the usual laboratory's where it states none.

    Raises
    ------
    ConfigError
        A half is neither tested nor in `base`.
    DataError
        The tests do not part k_c from k_phi or c from phi, or gave values that no soil has.
    """
    joints = _usable(pressure, shear, base)
    values, covariance = np.full(6, np.nan), np.zeros((6, 6))
    if base is not None:
        prior = prior_of(soil_from_terrain(base), base)
        values, covariance = prior.mean.copy(), prior.covariance.copy()
    for joint in joints:
        index = [SOIL_PARAMETERS.index(parameter) for parameter in joint.names]
        values[index] = joint.values
        covariance[index, :] = covariance[:, index] = 0.0
        covariance[np.ix_(index, index)] = joint.normal_covariance
    return _in_file_units(name, values, covariance, base.soil.unit_weight_kn_m3 if base else None)


def terrain_toml(terrain: TerrainConfig, comments: Sequence[str] = ()) -> str:
    """Return the text of a terrain.toml, with comment lines at its head."""
    import tomli_w

    head = "".join(f"# {line}\n" for text in comments for line in text.splitlines())
    content = terrain.model_dump(exclude_none=True)
    matrix = content.get("uncertainty", {}).pop("covariance", None)
    text = head + ("\n" if head else "") + tomli_w.dumps(content)
    if matrix is None:
        return text
    order = f"# order: {', '.join(SOIL_KEYS)}; units of [soil]\n"
    rows = "".join(f"  [{', '.join(repr(value) for value in row)}],\n" for row in matrix)
    return f"{text}{order}covariance = [\n{rows}]\n"


def _usable(
    pressure: PressureSinkage | None, shear: ShearStrength | None, base: TerrainConfig | None
) -> list[JointFit]:
    missing = [
        Fault(
            f"there is no {test} test, so that {what} are not known",
            next_step=f"give {option}, or with --base a terrain.toml that has them",
        )
        for result, test, what, option in (
            (pressure, "plate", "k_c, k_phi and n", "--plate"),
            (shear, "shear", "c, phi and K", "--shear"),
        )
        if result is None and base is None
    ]
    if missing:
        raise ConfigError(*missing)
    together = [
        Fault(f"the {test} tests do not part {what}", next_step=f"test at a second {of}")
        for result, test, what, of in (
            (pressure, "plate", "k_c from k_phi", "plate width, at least 1.5 times as wide"),
            (shear, "shear", "c from phi", "normal stress, at least twice as large"),
        )
        if result is not None and not result.separate
    ]
    if together:
        raise DataError(*together)
    return [result.joint for result in (pressure, shear) if result is not None]


def _in_file_units(name: str, values: FloatArray, covariance: FloatArray, unit_weight: float | None) -> TerrainConfig:
    cohesion, tan_phi, modulus, exponent, k_c, k_phi = (float(value) for value in values)
    angle = np.arctan(tan_phi)
    unit = np.array([1e-3, degrees(cos(angle) ** 2), 1.0, 1.0, 1e-3, 1e-3])
    in_units = covariance * np.outer(unit, unit)
    try:
        return TerrainConfig(
            soil=SoilSection(
                name=name,
                cohesion_kpa=_rounded(cohesion / 1e3),
                friction_angle_deg=_rounded(degrees(angle)),
                shear_modulus_m=_rounded(modulus),
                sinkage_exponent=_rounded(exponent),
                cohesive_modulus_kn=_rounded(k_c / 1e3),
                frictional_modulus_kn=_rounded(k_phi / 1e3),
                unit_weight_kn_m3=unit_weight,
            ),
            uncertainty=UncertaintySection(covariance=tuple(tuple(_rounded(x) for x in row) for row in in_units)),
        )
    except ValidationError as error:
        raise DataError(
            *(
                Fault(
                    f"the tests give a value that no soil has: {item['loc'][-1]}",
                    found=str(item["input"]),
                    expected=item["msg"],
                    next_step="check units, zero and window of the tests",
                )
                for item in error.errors()
            )
        ) from None


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
