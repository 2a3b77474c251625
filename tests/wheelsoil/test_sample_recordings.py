"""recordings/: what is in the repository is what its manifest says, and its command makes it again."""

from __future__ import annotations

import shlex
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import ok

from daq.can import FrameBatch, concatenate
from daq.recording import Recording
from daq.runs import open_runs
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import campaign_frames, frames_sha256, simulated_run
from wheelsoil.simulation.vehicle import virtual_frames

FOLDER = Path(__file__).parents[2] / "recordings"
CAMPAIGNS = {"clay": (6, 40.0), "sandy": (6, 40.0), "four": (3, 20.0)}
"""Runs, and seconds of each."""
FAST = {("clay", 3), ("sandy", 2)}
FOUR: dict[str, Any] = {
    "runs": 3,
    "duration_s": 20.0,
    "wheels": 4,
    "faulty_wheel": "FR",
    "transducer_rate_hz": 250.0,
}


@cache
def manifest(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / name / "manifest.toml").read_text())


def options(name: str) -> SimulationOptions:
    truth = manifest(name)["truth"]
    return SimulationOptions(
        soil=truth["soil"]["name"],
        effects={effect["name"]: effect["parameters"] for effect in truth["effect"]},
        reading=truth["reading"],
        seed=truth["seed"],
        tilt_deg=truth["tilt_deg"],
        brakes=truth["brakes"],
        **(FOUR if name == "four" else {}),
    )


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_frames_are_those_of_the_manifest(name: str) -> None:
    facts, (runs, length) = manifest(name)["run"], CAMPAIGNS[name]
    assert len(facts) == runs
    for fact in facts:
        recording = Recording.open(FOLDER / name / fact["file"])
        frames = concatenate(list(recording.frame_batches()))
        assert len(frames) == fact["frames"]
        assert frames_sha256(frames) == fact["frames_sha256"]
        assert all("raw" in topic.name for topic in recording.topics)
        assert not recording.loss
        seconds = np.ptp(frames.frames["time_ns"]) * 1e-9
        assert seconds == pytest.approx(length, abs=0.1)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_the_command_is_that_of_the_truth(name: str) -> None:
    said = options(name)
    assert shlex.split(manifest(name)["command"]) == shlex.split(said.command)
    assert (said.runs, said.duration_s, said.reading) == (*CAMPAIGNS[name], "balanced")
    assert (said.wheel.radius_m, said.wheel.width_m) == (0.47, 0.318)


@pytest.mark.parametrize(
    ("name", "index"),
    [
        pytest.param(name, index, marks=() if (name, index) in FAST else pytest.mark.slow)
        for name in ("clay", "sandy")
        for index in range(6)
    ],
)
def test_the_same_frames_can_be_made_again(name: str, index: int) -> None:
    frames = virtual_frames(simulated_run(options(name), index))
    is_of_the_manifest(name, index, frames)


@pytest.mark.slow
def test_the_frames_of_four_wheels_can_be_made_again() -> None:
    for index, (_, batches) in enumerate(campaign_frames(options("four"))):
        is_of_the_manifest("four", index, concatenate(list(batches)))


def is_of_the_manifest(name: str, index: int, frames: FrameBatch) -> None:
    assert frames_sha256(frames) == manifest(name)["run"][index]["frames_sha256"], (
        f"made with numpy {manifest(name)['numpy_version']}, here is {np.__version__}; see recordings/README.md"
    )


@pytest.mark.slow
def test_four_wheels_together_name_the_fault_and_its_wheel() -> None:
    """One transducer's gain, by its own wheel and by all."""
    found = {each["wheel"]: each for each in ok("diagnose", FOLDER / "four", "--json").json}
    assert (found["FR"]["verdict"], [cause["name"] for cause in found["FR"]["causes"]]) == ("named", ["torque_gain"])
    assert {found[wheel]["verdict"] for wheel in ("FL", "RL", "RR")} == {"nothing_detectable"}
    [cause] = found["all"]["causes"]
    assert (found["all"]["verdict"], cause["name"], cause["wheel"]) == ("named", "torque_gain", "FR")
    low, high = cause["parameters"][0]["interval95"]
    assert low < 0.06 < high


@pytest.mark.parametrize("name", ["clay", "sandy"])
def test_a_campaign_opens_as_a_folder(name: str) -> None:
    runs = open_runs([FOLDER / name])
    assert [run.info.added_load_kg for run in runs] == [0, 300, 500, 0, 300, 500]
    assert {run.info.direction for run in runs} == {"out", "back"}
    assert all(run.terrain is not None and run.terrain.soil.name == name for run in runs)


def test_they_are_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) < 17_000_000
