"""Sensors of the virtual test: noise, ripple, axes, latency, clocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import fit_clock
from daq.config import TransducerSection
from model.simulation import GnssSetup, HostClock, Track, TransducerSetup, WheelSpeedSetup
from model.simulation.motion import Motion, drawn_drive
from model.simulation.speed_sensors import GnssReceiver, WheelSpeedSensor
from model.simulation.transducer import ColouredNoise, HubLoads, Readings, SampleTimes, Transducer
from processing.pipeline.wheel_frames import rotate

QUIET = TransducerSetup(
    drawbar_pull_noise_n=0,
    load_noise_n=0,
    lateral_noise_n=0,
    torque_noise_nm=0,
    white_noise_n=0,
    white_noise_nm=0,
    zero_offset_n=(0, 0),
)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def rolling(omega: float = 6.0, seconds: float = 20.0) -> HubLoads:
    time = np.arange(round(seconds * 1000)) / 1000
    return HubLoads(
        time,
        np.full(time.shape, 500.0),
        np.full(time.shape, 8000.0),
        np.full(time.shape, 900.0),
        omega * time,
        omega + 0 * time,
    )


def steady(speed: float, slip: float = 0.0, seconds: float = 30.0) -> Motion:
    time = np.arange(round(seconds * 1000)) / 1000
    v, omega, zero = np.full(time.shape, speed), np.full(time.shape, speed / (1 - slip) / 0.47), np.zeros(time.shape)
    return Motion(time, v, zero, omega, zero, omega * time, v * time, np.full(time.shape, slip))


def coloured_noise(
    count: int, rate_hz: float, sigma: float, correlation_time_s: float, rng: np.random.Generator
) -> np.ndarray:
    return ColouredNoise(rate_hz, sigma, correlation_time_s, rng).next(count)


def measured_loads(setup: TransducerSetup, hub: HubLoads, rng: np.random.Generator) -> Readings:
    return Transducer(setup, len(hub.time_s) / 1000, 0.47, 75.0, rng).read(hub)


def measured_wheel_speed(setup: WheelSpeedSetup, motion: Motion) -> Readings:
    return WheelSpeedSensor(setup, len(motion.time_s) / 1000, rng(), rng(1)).read(motion)


def measured_gnss(setup: GnssSetup, motion: Motion, direction: str = "out", seconds_of_day: float = 0.0) -> Readings:
    last_s = float(motion.time_s[-1])
    return GnssReceiver(setup, Track(), direction, seconds_of_day, last_s, rng()).read(motion)


def test_coloured_noise_has_its_spread_and_its_memory() -> None:
    x = coloured_noise(400_000, 1000.0, 46.0, 0.1, rng())
    assert np.std(x) == pytest.approx(46.0, rel=0.05)
    lagged = np.mean(x[100:] * x[:-100]) / np.var(x)
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.05)
    assert np.std(coloured_noise(1, 1000.0, 1.0, 0.1, rng(3))) == 0
    first = [coloured_noise(2, 1000.0, 46.0, 0.1, rng(seed))[0] for seed in range(4000)]
    assert np.std(first) == pytest.approx(46.0, rel=0.05)


def test_the_transducer_has_its_noise() -> None:
    setup = TransducerSetup(zero_offset_n=(0, 0))
    values = measured_loads(setup, rolling(seconds=120.0), rng()).values
    assert np.mean(values["drawbar_pull"]) == pytest.approx(500, abs=10)
    assert np.std(values["drawbar_pull"]) == pytest.approx(np.hypot(46, 5), rel=0.08)
    assert np.std(values["vertical_load"]) == pytest.approx(np.hypot(60, 5), rel=0.08)
    assert np.std(values["driving_torque"]) == pytest.approx(np.hypot(14, 1), rel=0.08)
    assert np.array_equal(values["counter"][:17], [*range(16), 0])


@pytest.mark.parametrize("frame", ["vehicle", "wheel"])
def test_a_rotating_zero_is_a_ripple_of_first_order(frame: str) -> None:
    setup = replace(QUIET, zero_offset_n=(25.0, -15.0), frame=frame)
    omega = 6.0
    measured = measured_loads(setup, rolling(omega, 60.0), rng())
    fx, fz, angle = (measured.values[name] for name in ("drawbar_pull", "vertical_load", "wheel_angle"))
    if frame == "wheel":
        fx, fz = rotate(fx, fz, angle, TransducerSection(frame="wheel"))
    for force, mean in ((fx, 500.0), (fz, 8000.0)):
        order = [abs(np.mean((force - mean) * np.exp(-1j * k * angle))) * 2 for k in (1, 2, 3)]
        assert order[0] == pytest.approx(np.hypot(25, 15), rel=0.01)
        assert max(order[1:]) < 0.5
        assert np.mean(force) == pytest.approx(mean, abs=1.0)


@settings(max_examples=30, deadline=None)
@given(
    side=st.sampled_from(["left", "right"]),
    direction=st.sampled_from([1, -1]),
    offset=st.floats(-180, 180),
    seed=st.integers(0, 1000),
)
def test_wheel_axes_turn_back_into_vehicle_axes(side: str, direction: int, offset: float, seed: int) -> None:
    axes = {"side": side, "angle_direction": direction, "angle_offset_deg": offset, "frame": "wheel"}
    sent = measured_loads(replace(QUIET, **axes), rolling(seconds=2.0), rng(seed)).values
    fx, fz = rotate(sent["drawbar_pull"], sent["vertical_load"], sent["wheel_angle"], TransducerSection(**axes))
    assert fx == pytest.approx(500.0, abs=1e-6)
    assert fz == pytest.approx(8000.0, abs=1e-6)
    assert np.all(sent["driving_torque"] == (-900 if side == "right" else 900))


def test_a_spin_zero_misses_the_outboard_weight() -> None:
    measured = measured_loads(replace(QUIET, zero="spin"), rolling(), rng())
    assert measured.values["vertical_load"] == pytest.approx(8000 - 75 * 9.80665)


@pytest.mark.parametrize("omega", [1.0, 3.0, 9.0, 17.0])
def test_edges_give_the_speed_of_a_steady_wheel(omega: float) -> None:
    ideal = WheelSpeedSetup(pitch_error=0, eccentricity=0)
    values = measured_wheel_speed(ideal, steady(omega * 0.47)).values["wheel_speed"]
    settled = values[50:]
    assert settled == pytest.approx(omega, rel=2e-4)  # a microsecond in a tooth's time
    real = measured_wheel_speed(WheelSpeedSetup(), steady(omega * 0.47)).values["wheel_speed"][50:]
    assert 1e-4 < np.std(real) / omega < 0.006
    assert np.mean(real) == pytest.approx(omega, rel=1e-3)


def test_a_stopped_wheel_reads_zero_after_the_timeout() -> None:
    time = np.arange(6000) / 1000
    omega = np.where(time < 3, 5.0, 0.0)
    angle = np.minimum(5.0 * time, 15.0)
    motion = Motion(time, 0.47 * omega, 0 * time, omega, 0 * time, angle, 0.47 * angle, 0 * time)
    read = measured_wheel_speed(WheelSpeedSetup(), motion)
    after = read.values["wheel_speed"][read.time_s > 3.0]
    assert np.all(read.values["wheel_speed"][read.time_s > 3.0 + 0.26] == 0)
    assert np.all(np.diff(after) <= 1e-9)
    standing = replace(motion, wheel_angle_rad=0 * time)
    assert not measured_wheel_speed(WheelSpeedSetup(), standing).values["wheel_speed"].any()


def test_declared_latencies_are_those_of_the_readings() -> None:
    """Shift the truth until it fits best: GNSS to a millisecond, the wheel to what its slowest edges allow."""
    motion = drawn_drive(40.0, 0.47, rng(5)).motion()
    moving = (motion.ground_speed_mps > 0.7).astype(float)
    gnss = GnssSetup(speed_noise_mps=0, speed_white_noise_mps=0)
    ring = WheelSpeedSetup(pitch_error=0, eccentricity=0)
    fixes = measured_gnss(gnss, motion)
    wheel = measured_wheel_speed(ring, motion)
    for read, name, truth, declared, tolerance in (
        (fixes, "ground_speed", motion.ground_speed_mps, gnss.latency_s, 0.002),
        (wheel, "wheel_speed", motion.wheel_speed_radps, ring.latency_s, 0.012),
    ):
        arrival = read.time_s + read.latency_s
        use = np.interp(arrival, motion.time_s, moving) == 1
        delays = np.arange(0, 0.15, 0.001)
        error = [np.std((read.values[name] - np.interp(arrival - d, motion.time_s, truth))[use]) for d in delays]
        assert delays[int(np.argmin(error))] == pytest.approx(declared, abs=tolerance)


def test_gnss_speed_has_its_noise_and_the_position_its_line() -> None:
    setup, track = GnssSetup(), Track()
    out = measured_gnss(setup, steady(1.5, seconds=600.0), "out", 100.0).values
    assert np.std(out["ground_speed"]) == pytest.approx(np.hypot(0.03, 0.015), rel=0.15)
    assert np.mean(out["ground_speed"]) == pytest.approx(1.5, abs=0.01)
    assert np.degrees(np.mean(out["course"])) == pytest.approx(track.bearing_deg, abs=0.2)
    back = measured_gnss(setup, steady(1.5, seconds=30.0), "back", 100.0).values
    assert np.degrees(np.mean(back["course"])) == pytest.approx(track.bearing_deg + 180, abs=0.5)
    north = 6_371_008.8 * (out["latitude"][600] - out["latitude"][0])
    east = 6_371_008.8 * (out["longitude"][600] - out["longitude"][0]) * np.cos(out["latitude"][0])
    assert np.hypot(north, east) == pytest.approx(45.0, abs=2.5)
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(track.bearing_deg, abs=3)


def test_gnss_epochs_are_whole_and_pass_midnight() -> None:
    read = measured_gnss(GnssSetup(), steady(1.0, seconds=10.0), "out", 86_395.013)
    assert np.allclose(np.mod(read.values["gnss_time"] * 20 + 1e-6, 1), 0, atol=1e-4)
    assert read.values["gnss_time"].max() < 86_400
    assert np.sum(np.diff(read.values["gnss_time"]) < 0) == 1


def test_the_host_clock_is_off_and_drifts_as_declared() -> None:
    clock = HostClock(offset_s=0.25, drift_ppm=8.0)
    setup = GnssSetup()
    day_ns = 1_780_012_800 * 10**9  # midnight
    read = measured_gnss(setup, steady(1.0, seconds=600.0))
    host = clock.stamps_ns(read.time_s + read.latency_s, day_ns, 0.0, rng(1))
    assert np.all(np.diff(host) > 0)
    assert np.all(host % 1000 == 0)
    fit = fit_clock(host, read.values["gnss_time"])
    delay = setup.transport_s + clock.jitter_s * np.log(2)
    assert fit.drift_ppm == pytest.approx(8.0, abs=0.1)
    assert fit.offset_s == pytest.approx(0.25 + delay + 300 * 8e-6, abs=2e-4)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(-200, 200), st.sampled_from([20.0, 100.0, 1000.0]))
def test_free_running_sensors_sample_inside_the_run(seed: int, ppm: float, rate: float) -> None:
    at = SampleTimes(20.0, rate, ppm, rng(seed)).next_s()
    assert at[0] >= 0
    assert 20.0 - 2.1 / rate <= at[-1] <= 20.0 - 0.9 / rate
    assert np.diff(at) == pytest.approx(1 / rate, rel=3e-4)
