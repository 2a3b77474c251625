"""Effects whose formula is one line, by hand: sign, unit and factor of each."""

from __future__ import annotations

import numpy as np
import pytest
from effects_support import WHEEL

from model.effects import EFFECTS
from model.effects.wheel_forces import INERTIA_KGM2, MASS_KG
from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, Reaction, SoilState, WheelSoilModel, WheelState

CONDITIONS = Conditions(
    slip=np.array([0.2, 0.2]),
    vertical_load_n=np.array([8e3, 8e3]),
    ground_speed_mps=np.array([2.0, 2.0]),
    wheel_speed_radps=np.array([2.0, 2.0]) / 0.8 / WHEEL.radius_m,
    ground_acceleration_mps2=np.array([0.5, -0.5]),
    ground_jerk_mps3=np.array([2.0, 2.0]),
    wheel_acceleration_radps2=np.array([3.0, -3.0]),
    campaign_time=np.array([-0.5, 0.5]),
    direction=np.array([1.0, -1.0]),
    body_pitch_rad=np.array([4e-3, -4e-3]),
)
SOIL = SoilState(*(getattr(SOILS["clay"], name) for name in SOIL_PARAMETERS))
STATE = WheelState(CONDITIONS, SOIL, WHEEL.radius_m, WHEEL.width_m, np.nan, np.nan)
REACTION = Reaction(np.full(2, 1000.0), np.full(2, 700.0))


@pytest.mark.parametrize(
    ("key", "values", "pull", "torque"),
    [
        # m dV/dt is not felt as pull, I domega/dt is felt as torque, for a transducer inboard of the wheel
        ("wheel_inertia", {"scale": 1.0}, [-MASS_KG / 2, MASS_KG / 2], [3 * INERTIA_KGM2, -3 * INERTIA_KGM2]),
        # uphill out, downhill back: of 75 kg outboard of the transducer
        ("slope", {"angle_rad": 0.02}, [-75 * 9.80665 * np.sin(0.02), 75 * 9.80665 * np.sin(0.02)], [0, 0]),
        ("crosstalk", {"coefficient": 0.01}, [80.0, 80.0], [0, 0]),
        ("body_pitch", {"share": 0.5}, [16.0, -16.0], [0, 0]),
        # d is the whole span of the campaign
        ("zero_drift", {"campaign_span_n": 100.0}, [-50.0, 50.0], [0, 0]),
    ],
)
def test_forces_change_by(key: str, values: dict[str, float], pull: list[float], torque: list[float]) -> None:
    effect = EFFECTS[key]()
    found = effect.observation(effect.resultants(REACTION, STATE, values), STATE, values)
    np.testing.assert_allclose(found.drawbar_pull - REACTION.drawbar_pull, pull, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.driving_torque - REACTION.driving_torque, torque, rtol=1e-9, atol=1e-9)


def test_a_wheel_that_is_larger_than_declared_slips_more() -> None:
    """r (1 + e) omega is larger than r omega: of s = 0.2 it makes 1 - 0.8/1.02."""
    found = EFFECTS["wheel_radius"]().inputs(CONDITIONS, {"relative": 0.02})
    np.testing.assert_allclose(found.slip, 1 - 0.8 / 1.02, rtol=1e-12)


def test_a_late_ground_speed_is_carried_forward_by_taylors_series() -> None:
    found = EFFECTS["speed_latency"]().inputs(CONDITIONS, {"extra_delay_s": 0.1})
    np.testing.assert_allclose(found.ground_speed_mps, [2.0 + 0.05 + 0.01, 2.0 - 0.05 + 0.01], rtol=1e-12)
    np.testing.assert_allclose(found.ground_acceleration_mps2, [0.7, -0.3], rtol=1e-12)
    np.testing.assert_allclose(found.slip, 1 - 0.8 * np.array([2.06, 1.96]) / 2.0, rtol=1e-12)


def test_a_neutral_effect_is_not_evaluated() -> None:
    """A model without an answer for its formula has one at neutral: line_position is not known here."""
    model = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["track_drift"],))
    values = {"track_drift.log_stiffness_half_span": 0.0}
    assert not EFFECTS["track_drift"].is_active({"log_stiffness_half_span": 0.0})
    assert EFFECTS["track_drift"].is_active({"log_stiffness_half_span": 1e-12})
    assert np.isfinite(model.predict(CONDITIONS, values).drawbar_pull_n).all()
