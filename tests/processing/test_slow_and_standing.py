"""Slow machines, wheels that stand under torque, and time spent standing."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_run import RADIUS_M, channel, speeds, stamps, vehicle

from daq import Channel, FloatArray
from processing import ProcessedRun, Reason, RunCode, Segment
from processing.pipeline import process

DURATION_S = 40.0


def found(run: ProcessedRun, code: RunCode) -> dict[str, object] | None:
    return next((dict(note.values) for note in run.quality.notes if note.code == code), None)


def codes(run: ProcessedRun) -> set[str]:
    return {note.code for note in run.quality.notes}


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
    assert RunCode.IMPLAUSIBLE not in codes(run) and RunCode.ZERO_AT_STANDSTILL not in codes(run)
    assert run.quality.sensors["driving_torque"].sigma < 0.1


def test_time_spent_standing_is_said() -> None:
    run = process(speeds(DURATION_S, speed=lambda t: np.clip(t - 30.0, 0.0, 3.0)), vehicle())
    said = found(run, RunCode.MOSTLY_STANDING)
    assert said is not None and said["share"] == pytest.approx(0.75, abs=0.03)
