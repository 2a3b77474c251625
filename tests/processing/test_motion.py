"""The vehicle's motion against dynamics of our own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from synthetic_run import RADIUS_M, channel, driven_speed, forces, speeds, stamps, vehicle

from daq import Channel, FloatArray, Severity, VehicleConfig, WheelSection
from processing import ProcessedRun, Reason, RunCode
from processing.pipeline import process

SECONDS, GRAVITY = 60.0, 9.80665
MASS_KG, PULL_N = 75.0, 500.0
GNSS_MPS, ACCELEROMETER_MPS2, BIAS_MPS2 = 0.0335, 0.1, 0.02
"""Noise of one sample of a receiver at 20 Hz and of an accelerometer at 100 Hz, and the latter's zero."""


def nose_up(time_s: FloatArray) -> FloatArray:
    """Return the pitch of a field of 3 degrees and of a body on springs."""
    return np.radians(3.0 * np.sin(0.4 * time_s) + 0.8 * np.sin(2.1 * time_s))


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


# --- nothing else -----------------------------------------------------------------------------------------------------


def test_roles_that_have_nothing_to_do_change_nothing() -> None:
    rng = np.random.default_rng(9)
    channels = speeds(SECONDS, rng=rng, jitter=0.2) | forces(SECONDS, rng=rng)
    at = stamps(SECONDS, 100.0)
    idle = {
        "longitudinal_acceleration": channel("longitudinal_acceleration", at, np.gradient(driven_speed(at), at)),
    }
    plain = process(channels, vehicle())
    assert_equal_runs(process(channels | idle, vehicle()), plain)
