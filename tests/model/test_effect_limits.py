"""Effects where a plain formula would leave what is possible: many passes, the power of a tyre, the plate's speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Conditions, Prediction, Soil, Wheel, WheelSoilModel

WHEEL = Wheel(0.47, 0.318)
SLIP = np.array([0.1, 0.3, 0.6])


def _with(soil: Soil, key: str, value: float, **more: float) -> Prediction:
    (name,) = EFFECTS[key].parameter_keys().values()
    model = WheelSoilModel(WHEEL, soil, [EFFECTS[key]])
    return model.predict(Conditions(SLIP, np.full(3, 8e3), **more), {name: value})


@pytest.mark.parametrize("soil", ["clay", "sandy"])
def test_loosening_leaves_a_soil_after_any_number_of_passes(soil: str) -> None:
    lowest = EFFECTS["multi_pass"].parameters[0].lower
    depth = [_with(SOILS[soil], "multi_pass", lowest, pass_number=n).sinkage_m[0] for n in (1.0, 2.0, 4.0, 8.0)]
    assert (np.diff(depth) > 0).all()  # a NaN fails, too
    factor = SOILS[soil].stiffness(WHEEL.width_m) * (1 + lowest) ** 2
    scaled = replace(SOILS[soil], cohesive_modulus=0.0, frictional_modulus=factor)
    assert depth[2] == pytest.approx(
        WheelSoilModel(WHEEL, scaled).predict(Conditions(SLIP, np.full(3, 8e3))).sinkage_m[0]
    )


@pytest.mark.parametrize("soil", ["clay", "sandy"])
def test_a_flattened_tyre_takes_in_no_power_that_goes_nowhere(soil: str) -> None:
    """T omega is r omega times the shear force on the substitute circle, whose arm is larger."""
    gain, load, pressure = 0.1, 8e3, 250.0
    larger = 1 + gain * load / 10e3 * 340.0 / pressure
    flat = _with(SOILS[soil], "tyre_flattening", gain, inflation_kpa=pressure)
    circle = Wheel(WHEEL.radius_m * larger, WHEEL.width_m)
    rigid = WheelSoilModel(circle, SOILS[soil]).predict(Conditions(SLIP, np.full(3, load)))
    assert flat.drawbar_pull_n == pytest.approx(rigid.drawbar_pull_n)
    assert flat.driving_torque_nm == pytest.approx(rigid.driving_torque_nm / larger)


def test_the_soil_is_the_laboratory_s_where_the_wheel_presses_as_fast_as_the_plate() -> None:
    slow = replace(SOILS["clay"], reference_speed_mps=0.6)
    plain = WheelSoilModel(WHEEL, slow).predict(Conditions(SLIP, np.full(3, 8e3)))
    at_it, faster = (_with(slow, "rate_stiffness", 0.1, ground_speed_mps=v) for v in (0.6, 2.0))
    assert at_it.sinkage_m == pytest.approx(plain.sinkage_m)
    assert (faster.sinkage_m < 0.95 * plain.sinkage_m).all()
