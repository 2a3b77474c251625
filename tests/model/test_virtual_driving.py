"""Kinematics and load of the virtual test."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import ConfigError
from model.simulation import SHORTEST_RUN_S, VehicleSetup
from model.simulation.motion import RoadLoad, WheelLoad, drawn_drive, smooth_steps, static_load_n

seeds = st.integers(0, 2**32 - 1)


def motion(seed: int, duration: float = 40.0, coast: float = -0.1):
    return drawn_drive(duration, 0.47, np.random.default_rng(seed), coast_slip=coast).motion()


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_a_run_covers_the_slip_and_stays_plausible(seed: int) -> None:
    run = motion(seed)
    assert 0.85 < run.slip.max() < 0.92
    assert -0.43 < run.slip.min() < -0.24
    assert 0.5 < run.ground_speed_mps.max() < 5
    assert np.abs(run.ground_acceleration_mps2).max() < 3
    assert np.abs(run.wheel_acceleration_radps2).max() < 13
    assert np.std(run.wheel_acceleration_radps2) < 4.5
    moving = run.ground_speed_mps > 0.5
    shares, _ = np.histogram(run.slip[moving], [0.0, 0.2, 0.4, 0.6, 1.0])
    assert (shares > 0.03 * moving.sum()).all()


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(SHORTEST_RUN_S, 90.0))
def test_it_starts_and_ends_at_rest(seed: int, duration: float) -> None:
    run = motion(seed, duration)
    rest = round(2.4 * 1000)
    for quantity in (run.ground_speed_mps, run.wheel_speed_radps, run.slip, run.wheel_acceleration_radps2):
        assert np.all(quantity[:rest] == 0)
        assert np.allclose(quantity[-rest:], 0, atol=1e-9)
    assert run.distance_m[-1] > 3
    np.testing.assert_array_equal(run.time_s, np.arange(round(duration * 1000)) / 1000)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_derivatives_and_integrals_belong_to_the_speeds(seed: int) -> None:
    run = motion(seed)
    for speed, rate, sum_ in (
        (run.ground_speed_mps, run.ground_acceleration_mps2, run.distance_m),
        (run.wheel_speed_radps, run.wheel_acceleration_radps2, run.wheel_angle_rad),
    ):
        assert np.allclose((speed[2:] - speed[:-2]) * 500, rate[1:-1], atol=0.02 * np.abs(rate).max())
        assert np.allclose((sum_[2:] - sum_[:-2]) * 500, speed[1:-1], atol=1e-3 * speed.max())
    rim, ground = 0.47 * run.wheel_speed_radps, run.ground_speed_mps
    moving = ground > 0
    expected = (rim - ground)[moving] / np.maximum(rim, ground)[moving]
    assert np.allclose(run.slip[moving], expected, atol=1e-9)


def test_the_number_of_cycles_is_three_or_four_in_forty_seconds() -> None:
    counts = set()
    for seed in range(20):
        slip = motion(seed).slip
        high = slip > 0.4
        counts.add(int(np.sum(high[1:] & ~high[:-1])))
    assert counts == {3, 4}


def test_smooth_steps_are_flat_at_their_knots() -> None:
    knots = np.array([(0.0, 1.0), (2.0, 3.0), (5.0, -1.0)]).T
    value, rate = smooth_steps(np.array([-1.0, 0.0, 1.0, 2.0, 3.5, 5.0, 9.0]), knots)
    assert value == pytest.approx([1, 1, 2, 3, 1, -1, -1])
    assert rate == pytest.approx([0, 0, np.pi / 2, 0, -2 * np.pi / 3, 0, 0], abs=1e-12)


def test_a_run_without_room_for_a_cycle_is_refused() -> None:
    with pytest.raises(ConfigError, match="too short"):
        motion(0, SHORTEST_RUN_S - 0.1)
    with pytest.raises(ConfigError, match="too short"):
        motion(0, float("nan"))


def test_acceleration_loads_the_rear_wheel() -> None:
    smooth = VehicleSetup(roughness_m3=0.0)
    acceleration = np.array([-2.0, 0.0, 1.0])
    load = WheelLoad(smooth, 200.0, 300.0, np.random.default_rng(0)).next_n(np.ones(3), acceleration)
    lever = smooth.centre_of_gravity_height_m / (2 * smooth.wheelbase_m)
    static = 8000 + 0.4 * 300 * 9.80665
    assert static_load_n(smooth, 300.0) == pytest.approx(static)
    assert load == pytest.approx(static + 3900 * lever * acceleration)


def test_the_road_shakes_at_body_frequency_and_rests_at_standstill() -> None:
    from scipy.signal import welch

    setup, n = VehicleSetup(), 200 * 400
    white = np.random.default_rng(1).standard_normal(n)
    slow, fast = (RoadLoad(setup, 8000.0, 200.0).next_n(np.full(n, v), white) for v in (1.0, 4.0))
    assert np.std(fast) == pytest.approx(2 * np.std(slow), rel=1e-9)
    assert 0.015 < np.std(slow) / 8000 < 0.06
    frequency, density = welch(fast, 200.0, nperseg=4096)
    assert 0.8 < frequency[np.argmax(density)] < 1.8
    assert not RoadLoad(setup, 8000.0, 200.0).next_n(np.zeros(n), white).any()


def test_the_road_has_the_density_of_its_class() -> None:
    """Below the wheel's and body's frequencies the load follows from the road alone: F = mass * acceleration."""
    from scipy.signal import welch

    setup, rate, n, v = VehicleSetup(), 200.0, 200 * 4000, 2.0
    load = RoadLoad(setup, 8000.0, rate).next_n(np.full(n, v), np.random.default_rng(2).standard_normal(n))
    frequency, density = welch(load, rate, nperseg=1 << 14)
    low = (frequency > 0.1) & (frequency < 0.25)
    mass = 8000 / 9.80665
    velocity_density = (2 * np.pi * 0.1) ** 2 * setup.roughness_m3 * v
    expected = velocity_density * (mass * 2 * np.pi * frequency[low]) ** 2
    assert np.mean(density[low] / expected) == pytest.approx(1.0, abs=0.15)
