"""`simulate --steering`: a slalom whose recordings, processed, give each wheel's slip, or exclude what is steered."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cli_support import ok
from shared_results import made_once

from daq import ConfigError, FloatArray, VehicleConfig, load_toml
from model.simulation import Truth, whole
from processing import LOOK, ProcessedRun, ProcessOptions, Reason
from wheelsoil.simulation import SimulationOptions, simulate_campaign
from wheelsoil.simulation.campaign import simulated_stretches, simulated_vehicle
from wheelsoil.workflows import Files, process_runs
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.vehicle import doubts_of_wheels

IDS = ("FL", "FR", "RL", "RR")
STRAIGHT = SimulationOptions(soil="sandy", runs=1, duration_s=40.0, wheels=4, transducer_rate_hz=100.0, seed=3)
OPTIONS = replace(STRAIGHT, steering_deg=15.0)
CLOCK_AHEAD_S = 0.25


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of one run in a slalom of 15 degrees. Not to be written to."""
    return made_once(tmp_path_factory, "steered", lambda folder: simulate_campaign(folder / "a", OPTIONS)) / "a"


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "not_steered", lambda folder: simulate_campaign(folder / "a", STRAIGHT)) / "a"


def processed(folder: Path, vehicle: Path | None = None) -> dict[str, Processed]:
    opened = Files(vehicle=vehicle).runs_of_wheels([folder], set_aside=lambda _: None)
    return {wheel: process_runs(runs, ProcessOptions(purpose=LOOK)) for wheel, runs in opened.items()}


@pytest.fixture(scope="module")
def corrected(steered: Path) -> dict[str, Processed]:
    return processed(steered)


def truth_of(wheel: str, options: SimulationOptions = OPTIONS) -> Truth:
    return whole(simulated_stretches(options, 0, wheel)).truth


def at_samples(done: ProcessedRun, truth: Truth, name: str) -> FloatArray:
    time_s = done.time_s + done.start_ns * 1e-9 - OPTIONS.start.timestamp() - CLOCK_AHEAD_S
    return np.interp(time_s, truth.time_s, getattr(truth, name))


def errors(runs: Processed, wheel: str, options: SimulationOptions = OPTIONS) -> dict[str, FloatArray]:
    """Return what is measured less what is true, of the used samples of a wheel that drives."""
    [(_, done)] = runs
    truth = truth_of(wheel, options)
    rows = done.used & (done.ground_speed_mps > 0.5)
    names = ("ground_speed_mps", "slip", "vertical_load_n")
    return {name: (getattr(done, name) - at_samples(done, truth, name))[rows] for name in names}


def changed_vehicle(folder: Path, to: Path, change: Mapping[str, str | None]) -> Path:
    """Write vehicle.toml without the roles that become None, and with other texts; the DBCs beside it."""
    vehicle = load_toml(folder / "vehicle.toml", VehicleConfig).model_dump(
        mode="json", exclude_none=True, exclude_defaults=True
    )
    for role in [role for role, text in change.items() if text is None]:
        vehicle["signals"].pop(role, None)
        vehicle["sensors"].pop(role, None)
    if "places" in change:
        del vehicle["sensors"]["ground_speed"]["x_m"], vehicle["sensors"]["ground_speed"]["y_m"]
    to.write_bytes(tomli_w.dumps(vehicle).encode())
    for dbc in folder.glob("*.dbc"):
        shutil.copy(dbc, to.parent)
    return to


@pytest.mark.parametrize("wheel", IDS)
def test_the_slip_of_each_wheel_is_as_good_as_on_a_straight_line(
    wheel: str, corrected: dict[str, Processed], straight: Path
) -> None:
    """The receiver's noise is the same in both; the sensors of the motion add hardly anything."""
    curve, line = errors(corrected[wheel], wheel), errors(processed(straight)[wheel], wheel, STRAIGHT)
    for name, least in (("ground_speed_mps", 0.001), ("slip", 0.001), ("vertical_load_n", 10.0)):
        assert np.std(curve[name]) < 1.05 * np.std(line[name]), name
        assert abs(np.mean(curve[name]) - np.mean(line[name])) < least, name
    [(_, done)] = corrected[wheel]
    assert np.std(curve["ground_speed_mps"]) < np.mean(done.ground_speed_sigma_mps)


def test_the_antenna_alone_is_far_from_the_wheels(corrected: dict[str, Processed]) -> None:
    """What is corrected: up to half a metre a second, inner and outer wheel apart, front and rear too."""
    axle = {wheel: truth_of(wheel).ground_speed_mps for wheel in IDS}
    [(_, done)] = corrected["RL"]
    yaw = done.extras["yaw_rate_radps"][done.used]
    assert np.abs(yaw).max() > 0.2
    assert np.abs(axle["RL"] - axle["RR"]).max() == pytest.approx(1.8 * np.abs(yaw).max(), rel=0.15)
    assert np.max(axle["FL"] + axle["FR"] - axle["RL"] - axle["RR"]) > 0.05


@pytest.mark.parametrize("wheel", ["FL", "RR"])
def test_the_acceleration_of_a_wheel_is_that_of_its_speed(wheel: str) -> None:
    truth = truth_of(wheel)
    change = np.gradient(truth.ground_speed_mps, truth.time_s)
    assert np.abs(change - truth.ground_acceleration_mps2)[1:-1].max() < 0.01


def test_the_outer_wheels_carry_more(corrected: dict[str, Processed]) -> None:
    """M a h/track, half on each axle, and the acceleration is V r."""
    load = {wheel: truth_of(wheel).vertical_load_n for wheel in IDS}
    line = {wheel: truth_of(wheel, STRAIGHT).vertical_load_n for wheel in IDS}
    [(_, done)] = corrected["RL"]
    lateral = done.extras["lateral_acceleration_mps2"]
    used = done.used
    for left, right in (("FL", "FR"), ("RL", "RR")):
        moved = (load[right] - line[right] - load[left] + line[left]) / 2
        there = at_samples(done, replace(truth_of("RL"), sinkage_m=moved), "sinkage_m")
        slope = np.polyfit(lateral[used], there[used], 1)[0]
        assert slope == pytest.approx(3600.0 * 0.9 / (2 * 1.8), rel=0.05)
    middle = (truth_of("RL").ground_speed_mps + truth_of("RR").ground_speed_mps) / 2
    speed = at_samples(done, replace(truth_of("RL"), sinkage_m=middle), "sinkage_m")
    assert np.std((lateral - speed * done.extras["yaw_rate_radps"])[used]) < 0.05


@pytest.mark.parametrize(
    ("change", "lacking"), [({"yaw_rate": None}, "yaw_rate"), ({"places": "", "steering_angle": None}, "places")]
)
def test_without_its_role_what_is_steered_is_excluded(
    change: dict[str, str | None], lacking: str, steered: Path, tmp_path: Path
) -> None:
    runs = processed(steered, changed_vehicle(steered, tmp_path / "vehicle.toml", change))
    for wheel in IDS:
        [(_, done)] = runs[wheel]
        least = {"steering_angle_rad": np.radians(3.0), "yaw_rate_radps": 0.05}
        [found] = [np.abs(done.extras[name]) > limit for name, limit in least.items() if name in done.extras]
        assert 0.3 < (done.reason == Reason.STEERED).mean() < 0.9
        assert found[done.reason == Reason.STEERED].all() and not (done.used & found).any() and done.used.any()
        assert lacking in [note.values.get("lacking") for note in done.quality.notes]


def test_nothing_is_excluded_where_no_role_shows_it(steered: Path, tmp_path: Path) -> None:
    """Then the slip is wrong, which is why the roles are there."""
    nothing = {"yaw_rate": None, "steering_angle": None, "lateral_acceleration": None}
    runs = processed(steered, changed_vehicle(steered, tmp_path / "vehicle.toml", nothing))
    for wheel in IDS:
        assert np.std(errors(runs[wheel], wheel)["ground_speed_mps"]) > 1.5 * 0.0307
        assert (runs[wheel][0][1].reason != Reason.STEERED).all()


def test_left_and_right_exchanged_are_named(steered: Path, tmp_path: Path, corrected: dict[str, Processed]) -> None:
    assert doubts_of_wheels(corrected) == []
    text = (steered / "vehicle.toml").read_text(encoding="utf-8")
    for one, other in (("can0:WFT", "can1:WFT"), ("FrontLeft", "FrontRight")):
        text = text.replace(one, "\0").replace(other, one).replace("\0", other)
    (tmp_path / "vehicle.toml").write_text(text, encoding="utf-8")
    for dbc in steered.glob("*.dbc"):
        shutil.copy(dbc, tmp_path)
    [doubt] = doubts_of_wheels(processed(steered, tmp_path / "vehicle.toml"))
    assert doubt.what == "in curves to the left wheel FL rolls faster than wheel FR"


def test_the_folder_says_how_it_was_driven(steered: Path, tmp_path: Path) -> None:
    assert "--steering 15.0" in OPTIONS.command and "--steering" not in STRAIGHT.command
    assert "steering_deg = 15.0" in (steered / "manifest.toml").read_text(encoding="utf-8")
    assert (steered / "motion.dbc").is_file() and "yaw_rate" not in simulated_vehicle(STRAIGHT).signals
    with pytest.raises(ConfigError, match="steering is out of range"):
        replace(OPTIONS, steering_deg=25.0)
    ok("simulate", "-o", tmp_path / "one", "--runs", 1, "--duration", 15, "--steering", 8, "--lifted")
    assert "steered" not in ok("process", tmp_path / "one", "--json").out.lower()
