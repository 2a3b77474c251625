"""Where a wheel rolls freely, and the rolling radius that follows, at the limits that the documents state."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_run import forces, speeds, vehicle

from processing.pipeline import process
from processing.pipeline.latency import compare_speeds, rolls_freely, speed_scale

RADIUS_M = 0.47
LOAD_N = 8000.0
NOTHING = np.full(4, np.nan)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_neither_torque_nor_pull_may_exceed_six_percent_of_the_load(sign: float) -> None:
    rim, load = np.full(4, 3.0), np.full(4, LOAD_N)
    force = sign * LOAD_N * np.array([0.059, 0.061, 0.0, 0.0])
    expected = [True, False, True, True]
    np.testing.assert_array_equal(rolls_freely(rim, force * RADIUS_M, load, 0 * rim, RADIUS_M), expected)
    np.testing.assert_array_equal(rolls_freely(rim, 0 * rim, load, force, RADIUS_M), expected)


def test_a_declared_rolling_radius_is_of_the_slip_only() -> None:
    declared = vehicle()
    wheel = declared.wheel.model_copy(update={"rolling_radius_m": 1.04 * declared.wheel.radius_m})
    channels = {**speeds(20.0, slip=0.2), **forces(20.0)}
    plain, rolling = (process(channels, each) for each in (declared, declared.model_copy(update={"wheel": wheel})))
    used = plain.used & rolling.used
    np.testing.assert_allclose(1 - rolling.slip[used], (1 - plain.slip[used]) / 1.04)
    np.testing.assert_allclose(rolling.rim_speed_mps, 1.04 * plain.rim_speed_mps)
    assert used.any() and rolling.wheel_radius_m == plain.wheel_radius_m


def test_of_a_wheel_with_one_force_alone_nothing_is_known() -> None:
    rim, small = np.full(4, 3.0), np.full(4, 1.0)
    assert rolls_freely(rim, NOTHING, NOTHING, NOTHING, RADIUS_M).all()
    assert not rolls_freely(rim, small, NOTHING, NOTHING, RADIUS_M).any()
    assert not rolls_freely(rim, NOTHING, NOTHING, small, RADIUS_M).any()


def test_a_radius_needs_twenty_samples() -> None:
    rim = np.linspace(2.0, 5.0, 20)
    assert speed_scale(1.02 * rim, rim)[0] == pytest.approx(1.02)
    assert np.isnan(speed_scale(1.02 * rim[:19], rim[:19])).all()


@pytest.mark.parametrize(("spread", "is_known"), [(0.03, True), (0.2, False)])
def test_a_radius_that_is_not_known_to_two_percent_is_none(spread: float, is_known: bool) -> None:
    """The scale alternates between the twelfths of the run: its sigma is the spread over the root of 11."""
    rim = np.full(1200, 4.0)
    scale = 1 + spread * np.repeat(np.tile([1.0, -1.0], 6), 100)
    found, sigma = speed_scale(rim * scale, rim)
    if is_known:
        assert found == pytest.approx(1.0)
        assert sigma == pytest.approx(spread / np.sqrt(11))
    else:
        assert np.isnan([found, sigma]).all()


def test_the_delay_is_taken_off_before_the_speeds_are_compared() -> None:
    rate, delay = 100.0, 0.5
    time = np.arange(0.0, 60.0, 1 / rate)

    def speed(at: np.ndarray) -> np.ndarray:
        return 2.0 + 0.2 * at + 0.3 * np.sin(at)

    nothing = np.full(len(time), np.nan)
    found = compare_speeds(1.01 * speed(time - delay), speed(time), nothing, nothing, nothing, RADIUS_M, rate)
    assert found.latency_s == pytest.approx(delay, abs=1e-3)
    assert found.scale == pytest.approx(1.01, abs=1e-4)


def test_samples_without_load_are_left_out_of_the_delay() -> None:
    rate = 100.0
    time = np.arange(0.0, 60.0, 1 / rate)
    torque = 300.0 + 200.0 * np.sin(0.7 * time)
    rim, lifted = 2.0 + 0.3 * np.sin(time), time > 45.0
    ground = (2.0 + 0.3 * np.sin(time - 0.3)) * (1.0 - 0.5 * torque / RADIUS_M / LOAD_N)
    zero, unknown = (
        compare_speeds(ground, rim, torque, np.where(lifted, load, LOAD_N), np.zeros(len(time)), RADIUS_M, rate)
        for load in (0.0, np.nan)
    )
    assert zero.latency_s == unknown.latency_s == pytest.approx(0.3, abs=0.05)
