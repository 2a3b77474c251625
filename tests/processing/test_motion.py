"""The vehicle's motion against kinematics of our own: positions of wheel and antenna in the world, differentiated."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from synthetic_run import RADIUS_M, START_NS, channel, driven_speed, forces, speeds, stamps, vehicle

from daq import Channel, FloatArray, RunInfo, SensorSection, Severity, VehicleConfig, VehicleSection, WheelSection
from processing import ProcessedRun, Reason, RunCode, SensorFacts
from processing.pipeline import process
from processing.pipeline.blending import blended
from processing.pipeline.resampling import OnBase

SECONDS, GRAVITY = 60.0, 9.80665
MASS_KG, PULL_N = 75.0, 500.0
GNSS_MPS, ACCELEROMETER_MPS2, BIAS_MPS2 = 0.0335, 0.1, 0.02
"""Noise of one sample of a receiver at 20 Hz and of an accelerometer at 100 Hz, and the latter's zero."""
ANTENNA, WHEEL = {"x_m": 2.4, "y_m": 0.1, "z_m": 1.6}, {"x_m": 0.3, "y_m": -0.9}


def nose_up(time_s: FloatArray) -> FloatArray:
    """Return the pitch of a field of 3 degrees and of a body on springs."""
    return np.radians(3.0 * np.sin(0.4 * time_s) + 0.8 * np.sin(2.1 * time_s))


def yaw_rate(time_s: FloatArray) -> FloatArray:
    """Return that of two curves to the left and two to the right, up to 0.35 rad/s, with straights between."""
    return 0.35 * np.sin(2 * np.pi * time_s / 30) ** 3


def outboard(time_s: FloatArray, slope: float, rng: np.random.Generator) -> dict[str, Channel]:
    """Return speeds, forces at the hub, and an accelerometer: m dV/dt = F_soil - F_hub - m g sin(theta)."""
    fine = stamps(SECONDS, 1000.0)
    theta = slope * nose_up(fine)
    felt = np.gradient(driven_speed(fine), fine) + GRAVITY * np.sin(theta)
    read = np.interp(time_s, fine, felt) + BIAS_MPS2 + ACCELEROMETER_MPS2 * rng.standard_normal(len(time_s))
    found = speeds(SECONDS)
    noisy = found["ground_speed"].values + GNSS_MPS * rng.standard_normal(len(found["ground_speed"]))
    return found | {
        "ground_speed": Channel("ground_speed", "m/s", found["ground_speed"].time_ns, noisy),
        "vertical_load": channel("vertical_load", fine, np.full(len(fine), 7000.0)),
        "drawbar_pull": channel("drawbar_pull", fine, PULL_N - MASS_KG * felt),
        "longitudinal_acceleration": channel("longitudinal_acceleration", time_s, read),
    }


def test_a_run_has_the_axle_of_its_wheel() -> None:
    rear = vehicle(vehicle=VehicleSection(axles=3), wheel=WheelSection(radius_m=RADIUS_M, width_m=0.3, axle=2))
    channels = speeds(SECONDS) | forces(SECONDS)
    assert process(channels, rear, RunInfo(pass_number=4)).passage == 11
    assert process(channels, vehicle(), RunInfo(pass_number=4)).passage == 4


def heavy(**sections: object) -> VehicleConfig:
    """Return a vehicle whose outboard mass is declared."""
    return vehicle(wheel=WheelSection(radius_m=RADIUS_M, width_m=0.3, outboard_mass_kg=MASS_KG), **sections)


def without(channels: Mapping[str, Channel], *roles: str) -> dict[str, Channel]:
    """Return the channels but for some roles."""
    return {role: held for role, held in channels.items() if role not in roles}


def codes(run: ProcessedRun) -> set[str]:
    """Return the codes of a run's notes."""
    return {note.code for note in run.quality.notes}


def assert_equal_runs(one: ProcessedRun, other: ProcessedRun) -> None:
    """See that what a model takes is equal, to the bit."""
    for name in ("slip", "slip_sigma", "ground_speed_mps", "drawbar_pull_n", "drawbar_pull_sigma_n", "reason"):
        np.testing.assert_array_equal(one.column(name), other.column(name), err_msg=name)


# --- outboard mass ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.0, 1.0], ids=["level", "hills"])
def test_the_error_of_the_compensation_falls_to_a_third(slope: float) -> None:
    channels = outboard(stamps(SECONDS, 100.0), slope, np.random.default_rng(5))
    by_speed = process(without(channels, "longitudinal_acceleration"), heavy())
    read = process(channels, heavy())
    error, before = (run.drawbar_pull_n[run.used] - PULL_N for run in (read, by_speed))
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean(before**2)) / 3
    noise = np.std(error - MASS_KG * BIAS_MPS2)
    assert np.mean(read.drawbar_pull_sigma_n) == pytest.approx(noise, rel=0.2)
    assert RunCode.OUTBOARD_BY_ACCELEROMETER in codes(read)


def test_the_hub_comes_before_the_body() -> None:
    channels = outboard(stamps(SECONDS, 100.0), 1.0, np.random.default_rng(5))
    right = channels["longitudinal_acceleration"]
    body = channel("longitudinal_acceleration", stamps(SECONDS, 100.0), right.values + 1.0)
    hub = Channel("wheel_acceleration_x", "", right.time_ns, right.values)
    run = process(channels | {"longitudinal_acceleration": body, "wheel_acceleration_x": hub}, heavy())
    np.testing.assert_array_equal(run.drawbar_pull_n, process(channels, heavy()).drawbar_pull_n)
    assert run.outboard_role == "wheel_acceleration_x"


@pytest.mark.parametrize(
    ("factor", "rate_hz", "code"),
    [
        (1 / GRAVITY, 100.0, RunCode.ACCELEROMETER_DOUBTED),
        (-1.0, 100.0, RunCode.ACCELEROMETER_DOUBTED),
        (1.0, 5.0, RunCode.ACCELEROMETER_SLOW),
    ],
    ids=["in g", "backward", "slow"],
)
def test_an_accelerometer_that_cannot_be_right_is_not_used(factor: float, rate_hz: float, code: RunCode) -> None:
    at = stamps(SECONDS, rate_hz)
    channels = outboard(at, 0.0, np.random.default_rng(6))
    wrong = channel("longitudinal_acceleration", at, factor * channels["longitudinal_acceleration"].values)
    run = process(channels | {"longitudinal_acceleration": wrong}, heavy())
    assert_equal_runs(run, process(without(channels, "longitudinal_acceleration"), heavy()))
    (note,) = (note for note in run.quality.notes if note.code == code)
    assert note.severity == Severity.DOUBT


def test_pull_without_its_accelerometer_is_a_gap() -> None:
    at = stamps(SECONDS, 100.0)
    channels = outboard(at, 1.0, np.random.default_rng(7))
    kept = (at < 20) | (at > 23)
    held = channels["longitudinal_acceleration"]
    cut = Channel(held.name, "", held.time_ns[kept], held.values[kept])
    run = process(channels | {"longitudinal_acceleration": cut}, heavy())
    inside = (run.time_s > 20.1) & (run.time_s < 22.9)
    assert (run.reason[inside] == Reason.GAP).all() and run.used[~inside].mean() > 0.9
    assert np.isfinite(run.drawbar_pull_n[run.used]).all()


# --- blended speed ----------------------------------------------------------------------------------------------------


def with_pitch(channels: Mapping[str, Channel], slope: float, rng: np.random.Generator) -> dict[str, Channel]:
    """Return the channels and a pitch with a noise of a tenth of a degree."""
    at = stamps(SECONDS, 100.0)
    pitch = slope * nose_up(at) + np.radians(0.1) * rng.standard_normal(len(at))
    return {**channels, "pitch": channel("pitch", at, pitch)}


@pytest.mark.parametrize("slope", [0.0, 1.0], ids=["level", "hills"])
def test_the_error_of_the_speed_falls_to_a_half(slope: float) -> None:
    rng = np.random.default_rng(10)
    channels = outboard(stamps(SECONDS, 100.0), slope, rng)
    run, before = (process(c, vehicle()) for c in (with_pitch(channels, slope, rng), channels))
    error, was = (one.ground_speed_mps[one.used] - driven_speed(one.time_s)[one.used] for one in (run, before))
    assert np.std(error) < np.std(was) / 2
    assert np.mean(run.ground_speed_sigma_mps) == pytest.approx(np.std(error), rel=0.25)
    assert np.mean(run.slip_sigma[run.used]) < 0.6 * np.mean(before.slip_sigma[before.used])
    change = np.gradient(driven_speed(run.time_s)) * run.rate_hz
    error, was = (one.ground_acceleration_mps2[one.used] - change[one.used] for one in (run, before))
    assert np.std(error) < np.std(was) / 3
    assert run.used.mean() > 0.98 * before.used.mean()


def test_a_zero_of_the_accelerometer_does_not_matter() -> None:
    rng = np.random.default_rng(11)
    channels = with_pitch(outboard(stamps(SECONDS, 100.0), 1.0, rng), 1.0, rng)
    held = channels["longitudinal_acceleration"]
    shifted = Channel(held.name, "", held.time_ns, held.values + 0.5 + 0.002 * np.arange(len(held)) / 100)
    one, other = (process(c, vehicle()) for c in (channels, channels | {held.name: shifted}))
    np.testing.assert_allclose(other.ground_speed_mps[one.used], one.ground_speed_mps[one.used], atol=1e-3)


def test_a_late_speed_is_still_seen_to_be_late() -> None:
    rng = np.random.default_rng(12)
    channels = with_pitch(outboard(stamps(SECONDS, 100.0), 0.0, rng), 0.0, rng)
    late = Channel(
        "ground_speed", "m/s", channels["ground_speed"].time_ns + 100_000_000, channels["ground_speed"].values
    )
    run = process(channels | {"ground_speed": late}, vehicle())
    assert RunCode.SPEED_BLENDED in codes(run)
    assert run.quality.residual_latency_s == pytest.approx(0.1, abs=0.01)
    error = (run.ground_speed_mps - driven_speed(run.time_s - 0.1))[run.used]
    assert np.std(error) < 0.012, "the whole of it is late"


@pytest.mark.parametrize(("kernel_s", "gains"), [(0.149, True), (0.151, False)])
def test_a_filter_of_half_the_blending_or_more_has_nothing_to_gain(kernel_s: float, gains: bool) -> None:
    at = np.arange(1000) / 100.0
    facts = SensorFacts(1000, 0, 100.0, 0, 0.01, 0.0, 0.01, "declared")
    still = OnBase(np.zeros(1000), np.zeros(1000), np.full(1000, Reason.USED, np.uint8), facts)
    assert (blended(still, still, still, at, 100.0, kernel_s) is not still) == gains


def test_where_pitch_is_missing_the_speed_is_not_used() -> None:
    rng = np.random.default_rng(13)
    channels = with_pitch(outboard(stamps(SECONDS, 100.0), 1.0, rng), 1.0, rng)
    held = channels["pitch"]
    kept = np.abs((held.time_ns - START_NS) * 1e-9 - 30) > 1
    run = process(channels | {"pitch": Channel("pitch", "", held.time_ns[kept], held.values[kept])}, vehicle())
    inside = np.abs(run.time_s - 30) < 0.9
    assert (run.reason[inside] == Reason.GAP).all() and run.used[~inside].mean() > 0.9
    error = (run.ground_speed_mps - driven_speed(run.time_s))[run.used]
    assert np.abs(error).max() < 0.06


# --- lever arm of the antenna -----------------------------------------------------------------------------------------


def curves(noise_radps: float = 0.0, delay_s: float = 0.0) -> tuple[dict[str, Channel], FloatArray, FloatArray]:
    """Return the channels of a drive in curves, and the wheel's speed forward over time.

    The vehicle pitches about its axle, which moves along the heading; antenna and wheel are placed in the world, and
    their speeds are differences of their positions.
    """
    at = np.arange(0, SECONDS, 1e-3)
    heading = np.cumsum(yaw_rate(at)) * 1e-3
    along = np.stack([np.cos(heading), np.sin(heading)])
    left = np.stack([-along[1], along[0]])
    axle = np.cumsum(driven_speed(at) * along, axis=1) * 1e-3
    pitch = nose_up(at)
    arm = ANTENNA["x_m"] - WHEEL["x_m"]
    antenna = axle + (arm * np.cos(pitch) - ANTENNA["z_m"] * np.sin(pitch)) * along + ANTENNA["y_m"] * left
    wheel = axle + WHEEL["y_m"] * left
    over_ground, at_wheel = (np.gradient(place, 1e-3, axis=1) for place in (antenna, wheel))
    forward = (at_wheel * along).sum(axis=0)
    rng = np.random.default_rng(8)
    every = slice(0, None, 10)
    turning = yaw_rate(at)[every] + noise_radps * rng.standard_normal(len(at[every]))
    channels = {
        "ground_speed": channel("ground_speed", at[::50] + delay_s, np.hypot(*over_ground)[::50], "m/s"),
        "wheel_speed": channel("wheel_speed", at[every], forward[every] / RADIUS_M, "rad/s"),
        "yaw_rate": channel("yaw_rate", at[every], turning),
        "pitch": channel("pitch", at[every], pitch[every]),
    }
    return channels, at, forward


def placed() -> VehicleConfig:
    """Return a vehicle with the places of antenna and wheel."""
    wheel = WheelSection(radius_m=RADIUS_M, width_m=0.3, **WHEEL)
    return vehicle(wheel=wheel, sensors={"ground_speed": SensorSection(**ANTENNA)})


def error_of(run: ProcessedRun, at: FloatArray, forward: FloatArray) -> FloatArray:
    """Return the error of the ground speed at the wheel, in the middle of the run."""
    middle = (run.time_s > 2) & (run.time_s < SECONDS - 2)
    offset_s = (run.start_ns - START_NS) * 1e-9
    return (run.ground_speed_mps - np.interp(run.time_s + offset_s, at, forward))[middle]


def test_the_speed_in_a_curve_is_that_of_the_wheel() -> None:
    channels, at, forward = curves()
    run = process(channels, placed())
    at_antenna = process(without(channels, "yaw_rate", "pitch"), placed())
    assert np.abs(error_of(at_antenna, at, forward)).max() > 0.3
    assert np.abs(error_of(run, at, forward)).max() < 0.03
    assert np.median(np.abs(run.slip[run.used])) < 0.002
    assert run.used.mean() > 0.97 and Reason.STEERED.name not in run.quality.shares
    assert RunCode.SPEED_AT_WHEEL in codes(run) and RunCode.STEERED not in codes(run)
    change = np.gradient(run.ground_speed_mps) * run.rate_hz
    assert np.abs((change - run.ground_acceleration_mps2)[100:-100]).max() < 0.05


def test_so_it_is_with_an_accelerometer_at_the_axle() -> None:
    channels, at, forward = curves()
    felt = np.gradient(driven_speed(at), at) + GRAVITY * np.sin(nose_up(at))
    body = channel("longitudinal_acceleration", at[::10], felt[::10])
    run = process(channels | {"longitudinal_acceleration": body}, placed())
    assert {RunCode.SPEED_AT_WHEEL, RunCode.SPEED_BLENDED} <= codes(run)
    assert np.abs(error_of(run, at, forward)).max() < 0.03


@pytest.mark.parametrize("role", ["yaw_rate", "pitch"])
def test_each_rate_has_its_part(role: str) -> None:
    channels, at, forward = curves()
    whole, less = (process(c, placed()) for c in (channels, without(channels, role)))
    assert np.std(error_of(less, at, forward)) > 3 * np.std(error_of(whole, at, forward))


def test_the_noise_of_the_yaw_rate_is_in_the_sigma() -> None:
    channels, at, forward = curves(noise_radps=0.2)
    run, clean = (process(c, placed()) for c in (channels, curves()[0]))
    added = np.std(error_of(run, at, forward) - error_of(clean, at, forward))
    assert np.mean(run.ground_speed_sigma_mps) == pytest.approx(added, rel=0.25)


def test_a_curve_without_places_is_excluded() -> None:
    channels, _, _ = curves()
    run = process(channels, vehicle())
    turning = np.abs(run.extras["yaw_rate_radps"]) > 0.05
    inside = run.reason != Reason.FILTER_EDGE
    np.testing.assert_array_equal((run.reason == Reason.STEERED)[inside], turning[inside])
    (note,) = (note for note in run.quality.notes if note.code == RunCode.STEERED)
    assert note.values == {"share": pytest.approx(turning.mean()), "lacking": "places"}


def test_so_is_one_that_only_the_steering_shows() -> None:
    channels, _, _ = curves()
    at = stamps(SECONDS, 50.0)
    steering = channel("steering_angle", at, np.radians(10) * np.sin(2 * np.pi * at / 30))
    run = process(without(channels, "yaw_rate") | {"steering_angle": steering}, placed())
    steered = np.abs(run.extras["steering_angle_rad"]) > np.radians(3.0)
    assert 0.5 < steered.mean() < 0.9
    inside = run.reason != Reason.FILTER_EDGE
    np.testing.assert_array_equal((run.reason == Reason.STEERED)[inside], steered[inside])


def test_a_hole_in_the_yaw_rate_is_excluded() -> None:
    channels, _, _ = curves()
    held = channels["yaw_rate"]
    kept = np.abs((held.time_ns - START_NS) * 1e-9 - 30) > 1
    cut = Channel("yaw_rate", "", held.time_ns[kept], held.values[kept])
    run = process(channels | {"yaw_rate": cut}, placed())
    inside = np.abs(run.time_s - 30) < 0.9
    assert (run.reason[inside] == Reason.GAP).all() and run.used[~inside].mean() > 0.9


# --- nothing else -----------------------------------------------------------------------------------------------------


def test_places_and_roles_that_have_nothing_to_do_change_nothing() -> None:
    rng = np.random.default_rng(9)
    channels = speeds(SECONDS, rng=rng, jitter=0.2) | forces(SECONDS, rng=rng)
    at = stamps(SECONDS, 100.0)
    idle = {
        "yaw_rate": channel("yaw_rate", at, np.full(len(at), 0.01)),
        "longitudinal_acceleration": channel("longitudinal_acceleration", at, np.gradient(driven_speed(at), at)),
    }
    pitch = channel("pitch", at, nose_up(at))
    plain = process(channels, vehicle())
    assert_equal_runs(process(channels | idle, vehicle()), plain)
    assert_equal_runs(process(channels | {"pitch": pitch}, vehicle()), plain)
    assert_equal_runs(process(channels, placed()), plain)
