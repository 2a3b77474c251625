import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from processing.pipeline.slip import slip_of, slip_sigma

speed = st.floats(0.0, 30.0)
sigma = st.floats(1e-3, 0.1)


def _slip(rim: float, ground: float, least: float = 0.5) -> float:
    return float(slip_of(np.array([rim]), np.array([ground]), least)[0])


@given(speed, speed)
def test_exchanging_the_speeds_changes_the_sign_only(rim: float, ground: float) -> None:
    np.testing.assert_array_equal(_slip(rim, ground), 0.0 - _slip(ground, rim))


@given(speed, speed)
def test_slip_stays_within_one_and_has_the_sign_of_the_difference(rim: float, ground: float) -> None:
    slip = _slip(rim, ground)
    if max(rim, ground) < 0.5:
        assert np.isnan(slip)
    else:
        assert -1 <= slip <= 1
        assert np.sign(slip) == np.sign(rim - ground)


def test_the_definitions_of_driving_and_braking() -> None:
    assert _slip(2.0, 1.0) == 0.5  # Eq. 6
    assert _slip(1.0, 2.0) == -0.5  # (r omega - V)/V
    assert _slip(3.0, 0.0) == 1.0  # spinning on the spot
    assert _slip(0.0, 3.0) == -1.0  # locked


@given(st.floats(0.6, 10.0), st.floats(0.6, 10.0), sigma, sigma)
def test_sigma_is_the_first_order_propagation(rim: float, ground: float, rim_sigma: float, ground_sigma: float) -> None:
    step = 1e-5
    by_rim = (_slip(rim + step, ground) - _slip(rim - step, ground)) / (2 * step)
    by_ground = (_slip(rim, ground + step) - _slip(rim, ground - step)) / (2 * step)
    expected = np.hypot(by_rim * rim_sigma, by_ground * ground_sigma)
    arrays = [np.array([value]) for value in (rim, ground, rim_sigma, ground_sigma)]
    if abs(rim - ground) > 2 * step:
        np.testing.assert_allclose(slip_sigma(*arrays, 0.5)[0], expected, rtol=1e-3)


def test_sigma_agrees_with_drawn_noise() -> None:
    rng = np.random.default_rng(1)
    rim, ground = 3.0 + 0.02 * rng.standard_normal(40_000), 2.0 + 0.03 * rng.standard_normal(40_000)
    one = np.ones(1)
    expected = slip_sigma(3.0 * one, 2.0 * one, 0.02 * one, 0.03 * one, 0.5)[0]
    np.testing.assert_allclose(np.std(slip_of(rim, ground, 0.5)), expected, rtol=0.02)


def test_no_slip_without_speed_and_none_without_a_value() -> None:
    values = slip_of(np.array([0.1, np.nan, 2.0]), np.array([0.2, 1.0, np.nan]), 0.5)
    assert np.isnan(values).all()
