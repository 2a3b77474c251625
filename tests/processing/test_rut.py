"""Rut readings of runs.toml: what is refused, and which sample gets which depth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from daq import ConfigError, DataError, RunInfo, RunsConfig, RutReading, parse_toml
from processing import REBOUND_M, ProcessedRun, RunCode, Segment
from processing.pipeline import process
from processing.pipeline.rut import with_ruts
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.simulation.campaign import runs_toml
from wheelsoil.workflows.grading import doubted_runs

PLACES = st.one_of(
    st.floats(0, 1e4).map(lambda t: {"time_s": t}),
    st.floats(0, 1e4).map(lambda x: {"distance_m": x}),
    st.tuples(st.floats(-90, 90), st.floats(-180, 180)).map(lambda p: {"latitude_deg": p[0], "longitude_deg": p[1]}),
)
READINGS = st.builds(
    lambda place, depth, sigma, after: RutReading(depth_m=depth, sigma_m=sigma, after_pass=after, **place),
    PLACES,
    st.floats(0, 0.5),
    st.floats(1e-4, 0.1),
    st.none() | st.integers(1, 9),
)


@pytest.fixture(scope="module")
def run() -> ProcessedRun:
    channels, vehicle, info = simulated_roles(SimulationOptions(soil="sandy", runs=1, duration_s=20.0), 0)
    return process(channels, vehicle, info)


def with_readings(run: ProcessedRun, *readings: dict[str, Any], **changes: object) -> ProcessedRun:
    info = run.run.model_copy(update={"rut": tuple(RutReading(**reading) for reading in readings)})
    return with_ruts(ProcessedRun(**{**vars(run), "run": info, **changes}))


@given(st.lists(READINGS, max_size=4), st.integers(0, 2))
def test_readings_come_back_from_toml(readings: list[RutReading], which: int) -> None:
    infos = [RunInfo(file=f"run-{i}.mcap", id=f"run-{i}") for i in range(3)]
    infos[which] = infos[which].model_copy(update={"rut": tuple(readings)})
    text = runs_toml(infos).decode()
    assert parse_toml(text, RunsConfig, "runs.toml").run == tuple(infos)
    assert ("rut" in text) == bool(readings)


@pytest.mark.parametrize(
    ("reading", "said"),
    [
        ({"depth_m": -0.01, "sigma_m": 0.005, "time_s": 1.0}, "greater than or equal to 0"),
        ({"depth_m": 0.05, "time_s": 1.0}, "sigma_m"),
        ({"depth_m": 0.05, "sigma_m": 0.0, "time_s": 1.0}, "greater than 0"),
        ({"depth_m": 0.05, "sigma_m": 0.005}, "give one place"),
        ({"depth_m": 0.05, "sigma_m": 0.005, "time_s": 1.0, "distance_m": 2.0}, "give one place"),
        ({"depth_m": 0.05, "sigma_m": 0.005, "latitude_deg": 48.0}, "go together"),
    ],
)
def test_a_reading_that_says_too_little_is_refused(reading: dict[str, float], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        RutReading(**reading)


@given(st.floats(0, 1), st.floats(0, 0.4))
def test_the_nearest_sample_gets_the_depth(run: ProcessedRun, share: float, depth: float) -> None:
    """Placed by time, by distance or by position it is the same sample, or one within what the place is known to."""
    row = round(share * (len(run) - 1))
    sized = {"depth_m": depth, "sigma_m": 0.004}
    found = with_readings(run, {**sized, "time_s": float(run.time_s[row])})
    assert np.flatnonzero(np.isfinite(found.sinkage_m)).tolist() == [row]
    assert found.sinkage_m[row] == pytest.approx(depth + REBOUND_M)
    assert found.sinkage_sigma_m[row] == 0.004
    if not np.isfinite(run.distance_m[row]):  # before the first fix
        return
    by_distance = with_readings(run, {**sized, "distance_m": float(run.distance_m[row])})
    [there] = np.flatnonzero(np.isfinite(by_distance.sinkage_m))
    assert run.distance_m[there] == pytest.approx(run.distance_m[row], abs=1e-9)


def test_a_position_is_the_place_where_the_wheel_was(run: ProcessedRun) -> None:
    """On a straight track; one degree of latitude is 111 km."""
    track = {"latitude_deg": 48.0 + run.distance_m / 111_195.0, "longitude_deg": np.full(len(run), 11.0)}
    place = {"latitude_deg": 48.0 + 5.0 / 111_195.0, "longitude_deg": 11.0 + 1e-6}
    found = with_readings(run, {"depth_m": 0.05, "sigma_m": 0.004, **place}, **track)
    [row] = np.flatnonzero(np.isfinite(found.sinkage_m))
    assert run.distance_m[row] == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize(
    ("place", "what", "found"),
    [
        ({"time_s": 21.5}, "outside the run", "time_s = 21.5"),
        ({"distance_m": 5000.0}, "outside the run", "m from its track"),
        ({"latitude_deg": 48.0, "longitude_deg": 11.0}, "no positions", ""),
        ({"time_s": 3.0, "after_pass": 2}, "after another pass", "after_pass = 2"),
    ],
)
def test_a_reading_that_is_none_of_this_run_is_refused(
    run: ProcessedRun, place: dict[str, float], what: str, found: str
) -> None:
    nowhere = np.full(len(run), np.nan)
    with pytest.raises(DataError, match=what) as caught:
        with_readings(run, {"depth_m": 0.05, "sigma_m": 0.004, **place}, latitude_deg=nowhere, longitude_deg=nowhere)
    [fault] = caught.value.faults
    assert "run-1" in fault.where and "[[run.rut]] 1" in fault.where
    assert found in fault.found


@pytest.mark.parametrize(
    ("key", "value", "step"),
    [
        ("depth_m", 83.0, "83 mm are 0.083 m: write depth_m = 0.083"),
        ("depth_m", 8.3, "8.3 mm are 0.0083 m"),
        ("sigma_m", 5.0, "5 mm are 0.005 m"),
        ("depth_m", 1e4, "give it in metres"),
    ],
)
def test_a_reading_above_the_radius_is_refused(run: ProcessedRun, key: str, value: float, step: str) -> None:
    reading = {"depth_m": 0.05, "sigma_m": 0.004, "time_s": 3.0, key: value}
    with pytest.raises(ConfigError, match=f"{key} is larger than the wheel's radius") as caught:
        with_readings(run, {**reading, key: run.wheel_radius_m}, reading)
    [fault] = caught.value.faults
    assert "[[run.rut]] 2" in fault.where and step in fault.next_step


def test_a_reading_at_an_excluded_sample_is_noted(run: ProcessedRun) -> None:
    [used, *_], [standing, *_] = np.flatnonzero(run.used), np.flatnonzero(run.segment == Segment.STANDSTILL)
    sized = {"depth_m": 0.05, "sigma_m": 0.004}
    found = with_readings(run, *({**sized, "time_s": float(run.time_s[row])} for row in (used, standing)))
    [note] = [note for note in found.quality.notes if note.code == RunCode.RUT_NOT_USED]
    assert note.values["number"] == 2
    time_s = f"{run.time_s[standing]:.1f}"
    assert f"run-1: rut reading 2 at {time_s} s is not used: the wheel stands" in doubted_runs([found])[0]


def test_readings_beside_a_sensor_are_refused(run: ProcessedRun) -> None:
    with pytest.raises(ConfigError, match="both a sinkage signal and rut readings"):
        with_readings(run, {"depth_m": 0.05, "sigma_m": 0.004, "time_s": 3.0}, sinkage_m=np.full(len(run), 0.05))
