from __future__ import annotations

import numpy as np
import pytest
from bench_soil import plate_tests, shear_tests

from daq import SOIL_KEYS, ConfigError, DataError, TerrainConfig, parse_toml
from model.bevameter import fit_pressure_sinkage, fit_shear_strength, terrain_of, terrain_toml
from model.wheel_soil import prior_of, soil_from_terrain

BASE = """
[soil]
name = "field"
cohesion_kpa = 7.58
friction_angle_deg = 14
shear_modulus_m = 0.025
sinkage_exponent = 0.85
cohesive_modulus_kn = 43.68
frictional_modulus_kn = 499.3
unit_weight_kn_m3 = 17.0
"""


def _plates(**keywords: object) -> list:
    return plate_tests(np.random.default_rng(7), scatter=(0.1, 0.05), noise=0.01, **keywords)  # type: ignore[arg-type]


def _shears(**keywords: object) -> list:
    return shear_tests(np.random.default_rng(8), scatter=(0.05, 0.1), noise=0.01, **keywords)  # type: ignore[arg-type]


def test_the_file_carries_the_values_and_the_covariance_to_the_prior() -> None:
    pressure, shear = fit_pressure_sinkage(_plates()), fit_shear_strength(_shears())
    text = terrain_toml(terrain_of("lab", pressure, shear), ["from tests", "two\nlines"])
    assert text.startswith("# from tests\n# two\n# lines\n\n[soil]\n")
    terrain = parse_toml(text, TerrainConfig, "t")
    prior = prior_of(soil_from_terrain(terrain), terrain)
    values = np.concatenate([shear.joint.values, pressure.joint.values[[2, 0, 1]]])
    assert prior.mean == pytest.approx(values, rel=1e-8)
    sigma = np.sqrt(np.diag(prior.covariance))
    # a normal distribution with the 95 % intervals of the tests, of the logarithm where a parameter is above 0
    low, high = np.concatenate([shear.joint.interval95, pressure.joint.interval95[[2, 0, 1]]]).T
    assert (low[1:4] > 0).all()
    half = np.where(np.isin(np.arange(6), (1, 2, 3)), values * np.log(high / np.where(low > 0, low, 1.0)), high - low)
    assert 1.959964 * sigma * 2 == pytest.approx(half, rel=1e-6)
    assert np.count_nonzero(prior.covariance[:3, 3:]) == 0
    expected = pressure.joint.covariance[0, 1] / np.sqrt(np.prod(np.diag(pressure.joint.covariance)[:2]))
    assert prior.covariance[4, 5] / (sigma[4] * sigma[5]) == pytest.approx(expected, rel=1e-6)
    assert np.linalg.eigvalsh(prior.covariance / np.outer(sigma, sigma)).min() > 0
    prior.whitener()  # positive definite as written


def test_what_is_not_tested_comes_from_the_base() -> None:
    base = parse_toml(BASE, TerrainConfig, "base")
    terrain = terrain_of("mixed", fit_pressure_sinkage(_plates()), base=base)
    assert terrain.soil.cohesion_kpa == pytest.approx(7.58)
    assert terrain.soil.friction_angle_deg == pytest.approx(14)
    assert terrain.soil.unit_weight_kn_m3 == 17.0
    assert terrain.soil.sinkage_exponent == pytest.approx(0.8, abs=0.1)
    assert terrain.uncertainty is not None
    matrix = np.array(terrain.uncertainty.covariance)
    assert np.sqrt(matrix[0, 0]) == pytest.approx(0.1 * 7.58)  # the usual laboratory's 10 %
    other = terrain_of("mixed", shear=fit_shear_strength(_shears()), base=base)
    assert other.soil.cohesive_modulus_kn == pytest.approx(43.68)
    assert other.soil.cohesion_kpa == pytest.approx(4.14, rel=0.5)


def test_a_base_with_relative_uncertainty_keeps_it() -> None:
    text = BASE + "\n[uncertainty]\ncohesion_kpa = 0.3\nfriction_angle_deg = 0.05\n"
    base = parse_toml(text, TerrainConfig, "base")
    matrix = np.array(terrain_of("x", fit_pressure_sinkage(_plates()), base=base).uncertainty.covariance)  # type: ignore[union-attr]
    assert np.sqrt(matrix[0, 0]) == pytest.approx(0.3 * 7.58)
    assert matrix[SOIL_KEYS.index("shear_modulus_m")].tolist() == [0] * 6


def test_what_is_missing_is_said() -> None:
    with pytest.raises(ConfigError, match=r"no shear test(.|\n)*c, phi and K(.|\n)*--shear"):
        terrain_of("x", fit_pressure_sinkage(_plates()))
    with pytest.raises(ConfigError, match="2 faults"):
        terrain_of("x")


def test_tests_that_do_not_part_their_parameters_give_no_file() -> None:
    pressure = fit_pressure_sinkage(_plates(widths_m=(0.05,)))
    shear = fit_shear_strength(_shears(normal_stresses_pa=(2e4,)))
    with pytest.raises(DataError, match=r"2 faults(.|\n)*k_c from k_phi(.|\n)*second plate width(.|\n)*c from phi"):
        terrain_of("x", pressure, shear)


def test_a_value_that_no_soil_has_is_said() -> None:
    pressure = fit_pressure_sinkage(_plates(n=3.4))
    with pytest.raises(DataError, match="sinkage_exponent"):
        terrain_of("x", pressure, fit_shear_strength(_shears()))
