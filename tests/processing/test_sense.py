"""Roles that cannot be what they are called: mixed-up units, engine speed, impossible forces; slow machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_run import RADIUS_M, channel, forces, speeds, stamps, vehicle

from daq import Channel, FloatArray
from processing.notes import RunCode
from processing.pipeline.pipeline import process
from processing.processed_run import ProcessedRun, Reason, Segment

DURATION_S = 40.0


def scaled(channels: dict[str, Channel], **factors: float) -> dict[str, Channel]:
    return channels | {role: replace(channels[role], values=channels[role].values * f) for role, f in factors.items()}


def found(run: ProcessedRun, code: RunCode) -> dict[str, object] | None:
    return next((dict(note.values) for note in run.quality.notes if note.code == code), None)


def codes(run: ProcessedRun) -> set[str]:
    return {note.code for note in run.quality.notes}


SENSE = {RunCode.ROLLING_RATIO, RunCode.LOAD_AGAINST_MASS, RunCode.FORCE_AGAINST_LOAD, RunCode.SLOW_VEHICLE}


def test_a_sound_run_is_not_doubted() -> None:
    run = process({**speeds(DURATION_S, 0.1), **forces(DURATION_S)}, vehicle(vehicle={"mass_kg": 3200}))
    assert not codes(run) & (SENSE | {RunCode.STALLED, RunCode.MOSTLY_STANDING})


@pytest.mark.parametrize(
    ("role", "factor", "unit"),
    [
        ("ground_speed", 1 / 3.6, "km/h for m/s"),
        ("ground_speed", 3.6, "m/s for km/h"),
        ("wheel_speed", 60 / (2 * np.pi), "rpm for rad/s"),
        ("wheel_speed", 5.3, ""),
    ],
)
def test_a_mixed_up_unit_of_a_speed_is_named(role: str, factor: float, unit: str) -> None:
    said = found(process(scaled(speeds(DURATION_S), **{role: factor}), vehicle()), RunCode.ROLLING_RATIO)
    assert said is not None and said["steady"] and said["unit"] == unit
    assert said["ratio"] == pytest.approx(factor if role == "wheel_speed" else 1 / factor, rel=0.02)


def test_a_ratio_that_gears_change_is_an_engines() -> None:
    channels = speeds(DURATION_S)
    at = np.arange(len(channels["wheel_speed"])) / 100
    gears = np.select([at < 13, at < 26], [12.0, 6.5], 3.8)
    channels["wheel_speed"] = replace(channels["wheel_speed"], values=channels["wheel_speed"].values * gears)
    said = found(process(channels, vehicle()), RunCode.ROLLING_RATIO)
    assert said is not None and not said["steady"]


def test_slip_under_load_is_no_mixed_up_unit() -> None:
    """A wheel at 60 % slip turns 2.5 times as fast as it travels, and pulls."""
    at = stamps(DURATION_S, 100.0)
    pulling = {
        "vertical_load": channel("vertical_load", at, np.full(len(at), 8000.0)),
        "drawbar_pull": channel("drawbar_pull", at, 1500 + 100 * np.sin(at)),
        "driving_torque": channel("driving_torque", at, 1400 + 50 * np.sin(at)),
    }
    assert RunCode.ROLLING_RATIO not in codes(process({**speeds(DURATION_S, 0.6), **pulling}, vehicle()))


@pytest.mark.parametrize(("factor", "doubted"), [(1.0, False), (1e-3, True), (9.80665, True)])
def test_a_load_that_the_mass_cannot_give_is_doubted(factor: float, doubted: bool) -> None:
    channels = scaled({**speeds(DURATION_S), **forces(DURATION_S)}, vertical_load=factor)
    run = process(channels, vehicle(vehicle={"mass_kg": 3200}))
    assert (RunCode.LOAD_AGAINST_MASS in codes(run)) is doubted
    assert (RunCode.FORCE_AGAINST_LOAD in codes(run)) is (factor < 1)


def robot(stop_s: float = 0.0) -> dict[str, Channel]:
    """Return a robot at up to 0.3 m/s that is stuck for some time with its wheel under torque."""

    def slow(t: FloatArray) -> FloatArray:
        return np.where(t < stop_s, 0.0, 0.2 + 0.08 * np.sin(0.7 * t))

    at = stamps(DURATION_S, 200.0)
    stuck = at < stop_s
    torque = np.where(stuck, 6 + 2 * np.sin(3 * at), 5 + np.sin(0.9 * at))
    rng = np.random.default_rng(4)
    torques = channel("driving_torque", at, torque + 0.02 * rng.standard_normal(len(at)))
    loads = channel("vertical_load", at, 60 + rng.standard_normal(len(at)))
    return {**speeds(DURATION_S, 0.2, speed=slow), "vertical_load": loads, "driving_torque": torques}


def test_a_robot_at_a_quarter_of_a_metre_a_second_slips_too() -> None:
    run = process(robot(), vehicle(wheel={"radius_m": RADIUS_M, "width_m": 0.1}))
    used = run.reason == Reason.USED
    assert used.mean() > 0.9
    assert np.median(run.slip[used]) == pytest.approx(0.2, abs=0.01)
    said = found(run, RunCode.SLOW_VEHICLE)
    assert said is not None and 0.04 < said["least_mps"] < 0.1  # type: ignore[operator]


def test_a_stalled_wheel_is_neither_a_zero_nor_noise() -> None:
    run = process(robot(stop_s=10.0), vehicle(wheel={"radius_m": RADIUS_M, "width_m": 0.1}))
    assert (run.segment[: 9 * 100] == Segment.STANDSTILL).all()
    said = found(run, RunCode.STALLED)
    assert said is not None and said["time_s"] == pytest.approx(10.0, abs=0.5)
    assert not run.quality.standstills
    assert RunCode.SIGNS_OPPOSED not in codes(run) and RunCode.ZERO_AT_STANDSTILL not in codes(run)
    assert run.quality.sensors["driving_torque"].sigma < 0.1


def test_time_spent_standing_is_said() -> None:
    run = process(speeds(DURATION_S, speed=lambda t: np.clip(t - 30.0, 0.0, 3.0)), vehicle())
    said = found(run, RunCode.MOSTLY_STANDING)
    assert said is not None and said["share"] == pytest.approx(0.75, abs=0.03)
