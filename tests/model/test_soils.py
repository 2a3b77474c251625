"""Soils against their sources, and terrain.toml's units."""

from __future__ import annotations

import numpy as np
import pytest

from daq import TerrainConfig
from model.fit import FitOptions
from model.wheel_soil import SOILS, soil_from_terrain

YANG_TABLE_1 = {  # c kPa, phi deg, K m, n, k_c kN/m^(n+1), k_phi kN/m^(n+2)
    "clay": (7.58, 14.0, 0.025, 0.85, 43.68, 499.3),
    "sandy": (1.00, 25.0, 0.025, 1.04, 1.00, 580.0),
}
TERRAIN = dict.fromkeys(("cohesion_kpa", "friction_angle_deg", "shear_modulus_m", "sinkage_exponent")) | dict.fromkeys(
    ("cohesive_modulus_kn", "frictional_modulus_kn")
)


@pytest.mark.parametrize("name", YANG_TABLE_1)
def test_the_papers_soils_are_those_of_its_table(name: str) -> None:
    values = YANG_TABLE_1[name]
    typed = TerrainConfig.model_validate({"soil": {"name": name, **dict(zip(TERRAIN, values, strict=True))}})
    expected = (7.58e3, 0.24434609527920614) if name == "clay" else (1.0e3, 0.4363323129985824)
    for soil in (SOILS[name], soil_from_terrain(typed)):
        assert (soil.cohesion_pa, soil.friction_angle_rad) == pytest.approx(expected, rel=1e-12)
        assert (soil.shear_modulus_m, soil.sinkage_exponent) == values[2:4]
        assert soil.cohesive_modulus == pytest.approx(values[4] * 1000, rel=1e-12)
        assert soil.frictional_modulus == pytest.approx(values[5] * 1000, rel=1e-12)
        assert soil.unit_weight_n_m3 == 16_500.0
        assert soil.tan_phi == pytest.approx(np.tan(np.radians(values[1])))
        assert soil.stiffness(0.318) == pytest.approx(1000 * (values[4] / 0.318 + values[5]), rel=1e-12)


def test_a_declared_unit_weight_is_in_kilonewton() -> None:
    values = dict(zip(TERRAIN, YANG_TABLE_1["clay"], strict=True))
    typed = TerrainConfig.model_validate({"soil": {"name": "clay", **values, "unit_weight_kn_m3": 18.0}})
    assert soil_from_terrain(typed).unit_weight_n_m3 == pytest.approx(18_000.0)


def test_the_papers_slip_thresholds() -> None:
    """Yang et al. (2016), section 1.3: 0.2 on clay, 0.1 on sandy soil."""
    assert FitOptions().threshold_on(SOILS["clay"]) == 0.2
    assert FitOptions().threshold_on(SOILS["sandy"]) == 0.1
