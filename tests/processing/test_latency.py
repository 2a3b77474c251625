"""Residual latency and scale of ground speed, on made-up drives whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from synthetic_run import RADIUS_M, channel, driven_speed, speeds, stamps, vehicle

from daq import Channel
from processing import ProcessedRun
from processing.pipeline import process
from processing.pipeline.latency import SpeedSignals, residual_latency, rolls_freely, speed_scale


def _road(delay_s: float, scale: float, seed: int, duration_s: float = 60.0) -> ProcessedRun:
    """Return a road drive: no force channels, a noisy receiver at 10 Hz."""
    rng = np.random.default_rng(seed)
    channels = speeds(duration_s, rng=rng, jitter=0.3, ground_rate_hz=10.0, delay_s=delay_s)
    speed = channels["ground_speed"]
    noisy = scale * speed.values + 0.05 * rng.standard_normal(len(speed))
    return process(channels | {"ground_speed": Channel("s", "", speed.time_ns, noisy)}, vehicle())


@given(st.floats(-0.3, 1.2), st.floats(0.95, 1.05), st.integers(0, 2**32))
@examples(25, gate=6)
def test_delay_and_scale_come_back_with_honest_sigmas(delay: float, scale: float, seed: int) -> None:
    quality = _road(delay, scale, seed).quality
    assert quality.residual_latency_sigma_s < 0.02
    assert abs(quality.residual_latency_s - delay) < 5 * quality.residual_latency_sigma_s + 1e-3
    assert abs(quality.speed_scale - scale) < 5 * quality.speed_scale_sigma + 1e-4


def test_the_sigma_is_that_of_repeated_drives() -> None:
    found = [_road(0.16, 1.009, seed).quality for seed in range(12)]
    errors = np.array([q.residual_latency_s - 0.16 for q in found])
    assert np.sqrt(np.mean([q.residual_latency_sigma_s**2 for q in found])) == pytest.approx(np.std(errors), rel=0.5)


def test_a_wild_receiver_does_not_move_it() -> None:
    rng = np.random.default_rng(4)
    channels = speeds(60.0, ground_rate_hz=10.0, delay_s=0.16, rng=rng, jitter=0.2)
    speed = channels["ground_speed"]
    wild = np.where(rng.random(len(speed)) < 0.03, 0.0, speed.values)
    quality = process(channels | {"ground_speed": Channel("s", "", speed.time_ns, wild)}, vehicle()).quality
    assert quality.residual_latency_s == pytest.approx(0.16, abs=0.03)


def test_steady_speed_tells_nothing_of_delay_but_of_scale() -> None:
    rng = np.random.default_rng(5)
    at = stamps(60.0, 20.0)
    channels = {
        "ground_speed": channel("v", at, 5.05 + 0.03 * rng.standard_normal(len(at))),
        "wheel_speed": channel("w", at, (5.0 + 0.003 * rng.standard_normal(len(at))) / RADIUS_M),
    }
    quality = process(channels, vehicle()).quality
    assert np.isnan(quality.residual_latency_s) or quality.residual_latency_sigma_s > 0.1
    assert quality.speed_scale == pytest.approx(1.01, abs=0.002)


def test_too_short_or_standing_runs_tell_nothing() -> None:
    assert np.isnan(process(speeds(2.0), vehicle()).quality.residual_latency_s)
    standing = process(speeds(30.0, speed=np.zeros_like), vehicle()).quality
    assert np.isnan(standing.residual_latency_s)
    assert np.isnan(standing.speed_scale)


def test_free_rolling_needs_neither_torque_nor_drag() -> None:
    rim, load = np.full(4, 3.0), np.full(4, 8000.0)
    torque, pull = np.array([0.0, 600.0, 50.0, 0.0]), np.array([-100.0, 0.0, -1500.0, np.nan])
    np.testing.assert_array_equal(rolls_freely(rim, torque, load, pull, RADIUS_M), [True, False, False, False])
    nothing = np.full(4, np.nan)
    np.testing.assert_array_equal(rolls_freely(rim, nothing, nothing, nothing, RADIUS_M), [True] * 4)
    assert np.isnan(speed_scale(rim, rim)[0])


def test_slip_that_follows_torque_is_not_taken_for_delay() -> None:
    """On hard ground the tyre creeps in proportion to torque, and torque to acceleration: the estimate knows both."""
    at = stamps(60.0, 1000.0)
    acceleration = np.gradient(driven_speed(at), at)
    torque = 8000 * RADIUS_M * (0.015 + 0.1 * acceleration)
    traction = torque / (8000 * RADIUS_M)
    rim = driven_speed(at) / (1 - 0.3 * traction)
    ground_at = stamps(60.0, 20.0)
    channels = {
        "ground_speed": channel("v", ground_at + 0.05, driven_speed(ground_at)),
        "wheel_speed": channel("w", at[::10], rim[::10] / RADIUS_M),
        "driving_torque": channel("T", at, torque),
        "vertical_load": channel("W", at, np.full(len(at), 8000.0)),
        "drawbar_pull": channel("D", at, 800 * acceleration),
    }
    quality = process(channels, vehicle()).quality
    assert quality.residual_latency_s == pytest.approx(0.05, abs=0.005)
    assert quality.speed_scale == pytest.approx(1.0, abs=0.01)


def _bent_slip(seed: int) -> SpeedSignals:
    """Return a drive, ground speed late by 0.1 s, whose slip rises with traction as steeply as no cubic does."""
    rate, delay, rng = 50.0, 0.1, np.random.default_rng(seed)
    time = np.arange(0.0, 60.0, 1 / rate)
    ground = 4 + 1.5 * np.sin(0.5 * time) + 0.6 * np.sin(1.3 * time + seed)
    traction = 0.1 + 0.15 * np.gradient(ground, time) + 0.05 * np.sin(0.23 * time + seed)
    slip = 0.25 / (1 + np.exp(-20 * (traction - np.median(traction))))
    shown = np.interp(time - delay, time, ground) + 0.02 * rng.standard_normal(len(time))
    return SpeedSignals(shown, ground / (1 - slip), traction, rate)


@pytest.mark.parametrize("seed", range(4))
def test_a_slip_curve_beyond_the_model_is_in_the_sigma(seed: int) -> None:
    """Leaving out stretches alone would state a sigma three to five times too small."""
    delay, sigma = residual_latency(_bent_slip(seed))
    assert sigma < 0.03
    assert abs(delay - 0.1) < 2 * sigma
