"""Data that cannot decide much: a verdict that says what is missing, never a confident guess, never a traceback."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import invoke, ok

from daq import RunInfo
from daq.can import FrameBatch, encode, load_database, merge, shipped_dbc
from daq.recording import Recording, RecordingWriter
from daq.runs import open_runs
from processing import ProcessOptions
from wheelsoil.workflows import process_runs

STEADY_S = 12
VERDICTS = {"named", "one_of", "unexplained", "nothing_detectable"}
ALONE = ("--most-causes", 1)
WFT = ("WFT_Forces", "WFT_Moments", "WFT_Wheel")


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of four runs on clay in which the wheel digs in with slip."""
    folder = tmp_path_factory.mktemp("poor") / "clay"
    ok("simulate", "-o", folder, "--runs", 4, "--duration", 20, "--seed", 3, "--effect", "vasilev:H_m=0.04")
    return folder


def diagnosed(*args: object) -> dict[str, Any]:
    """Diagnose through the command line; every answer has the contract's shape."""
    result = invoke("diagnose", *args, "--json")
    assert result.code == 0, result.err
    assert "Traceback" not in result.err
    found: dict[str, Any] = result.json
    assert found["verdict"] in VERDICTS
    assert found["sentence"].strip()
    return found


def said(found: dict[str, Any]) -> str:
    """Return all that a person is told in words."""
    return " ".join([found["sentence"], *found["notes"], *found["cannot_tell"], *found["cannot_tell"].values()])


def copied(campaign: Path, target: Path, keep: Callable[[FrameBatch], np.ndarray]) -> Path:
    """Return a campaign folder of which only some frames are left."""
    shutil.copytree(campaign, target)
    for path in target.glob("*.mcap"):
        whole = Recording.open(campaign / path.name)
        frames = whole.frames()
        kept = FrameBatch(frames.frames[keep(frames)], frames.buses)
        path.unlink()
        with RecordingWriter(path, run=whole.run, attachments=whole.attachments) as writer:
            writer.write_frames(kept)
    return target


def edited(campaign: Path, target: Path, name: str, change: Callable[[str], str]) -> Path:
    """Return a campaign folder with one of its files changed."""
    shutil.copytree(campaign, target)
    before = (target / name).read_text()
    (target / name).write_text(change(before))
    assert (target / name).read_text() != before
    return target


@pytest.mark.slow
def test_one_run_only(driven):
    found = diagnosed(driven / "run-2.mcap")
    assert found["gain"] is None
    assert found["verdict"] != "named"


@pytest.mark.slow
def test_one_direction(driven):
    found = diagnosed(driven / "run-1.mcap", driven / "run-3.mcap", "--effects", "vasilev,slope", *ALONE)
    assert "slope" in found["cannot_tell"]
    assert "one way" in found["cannot_tell"]["slope"]


def test_no_braking(driven, tmp_path):
    braking = {}
    for run, done in process_runs(open_runs([driven]), ProcessOptions(purpose="diagnose")):
        at = done.time_s[np.nan_to_num(done.slip, nan=0.0) < 0.0]
        braking[run.path.name] = done.start_ns + (at * 1e9).astype(np.int64)

    def keep(frames: FrameBatch) -> np.ndarray:
        stamps = frames.frames["time_ns"]
        at = next(times for times in braking.values() if stamps[0] - 10**9 < times[0] < stamps[-1])
        nearest = at[np.clip(np.searchsorted(at, stamps), 1, len(at) - 1)]
        before = at[np.clip(np.searchsorted(at, stamps) - 1, 0, len(at) - 1)]
        return np.asarray(np.minimum(abs(nearest - stamps), abs(before - stamps)) > 10_000_000)

    found = diagnosed(copied(driven, tmp_path / "clay", keep), "--effects", "vasilev,skid_sinkage", *ALONE)
    assert "skid_sinkage" in found["cannot_tell"]
    assert "brak" in found["cannot_tell"]["skid_sinkage"]


@pytest.mark.slow
def test_no_torque_channel(driven, tmp_path):
    folder = edited(
        driven, tmp_path / "clay", "vehicle.toml", lambda t: re.sub(r'(?m)^driving_torque = "[^"]*"\n', "", t)
    )
    found = diagnosed(folder, "--effects", "vasilev,torque_zero,torque_gain", *ALONE)
    assert {finding["channel"] for finding in found["what_is_wrong"]} <= {"drawbar_pull"}
    for family in ("torque_zero", "torque_gain"):
        assert "torque" in found["cannot_tell"][family]
    if found["verdict"] == "named":
        assert {cause["name"] for cause in found["causes"]} == {"slip_sinkage"}


@pytest.mark.slow
def test_channels_that_were_measured_and_not_looked_at_are_not_said_to_be_missing(driven):
    found = diagnosed(driven, "--channels", "z")
    assert "drawbar pull and driving torque were measured and not looked at" in found["sentence"]
    assert "take dp or t into --channels" in found["sentence"]
    assert "vehicle.toml" not in found["sentence"]
    pull = diagnosed(driven, "--channels", "dp", "--effects", "vasilev,torque_zero", "--most-causes", 1)
    assert pull["cannot_tell"]["torque_zero"] == "driving torque was measured and not looked at"


@pytest.mark.slow
def test_no_soil_uncertainty(driven, tmp_path):
    folder = edited(driven, tmp_path / "clay", "terrain.toml", lambda t: t.split("[uncertainty]")[0])
    found = diagnosed(folder, "--effects", "vasilev", *ALONE)
    assert any("no uncertainty of the soil is stated" in note for note in found["notes"])


def test_fewer_than_50_usable_samples(driven, tmp_path):
    def first_seconds(frames: FrameBatch) -> np.ndarray:
        stamps = frames.frames["time_ns"]
        return np.asarray(stamps < stamps[0] + 6_000_000_000)

    found = diagnosed(copied(driven, tmp_path / "clay", first_seconds))
    assert found["verdict"] == "nothing_detectable"
    assert re.search(r"\b\d+ (usable )?samples", said(found))
    assert found["gain"] is None


@pytest.mark.slow
def test_slip_all_below_a_tenth(driven, tmp_path):
    folder = tmp_path / "steady"
    folder.mkdir()
    for name in ("vehicle.toml", "terrain.toml", *(path.name for path in driven.glob("*.dbc"))):
        shutil.copy(driven / name, folder / name)
    for i, slip in enumerate((0.06, 0.07, 0.08)):
        write_steady(folder / f"run-{i}.mcap", slip)
    found = diagnosed(folder)
    assert found["verdict"] != "named"
    assert "slip" in said(found)


def write_steady(path: Path, slip: float) -> None:
    """Write some steady driving at a small slip, with forces about right."""
    messages = {
        m.name: m for f in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc") for m in load_database(shipped_dbc(f)).messages
    }
    rng = np.random.default_rng(int(1000 * slip))

    def at(rate: float) -> np.ndarray:
        return 1_780_000_000_000_000_000 + (np.arange(int(STEADY_S * rate)) / rate * 1e9).astype(np.int64)

    n = len(at(200))
    wave = np.sin(np.arange(n) / 200 * 1.3)
    ground = 1.5 + 0.3 * np.sin(np.arange(len(at(20))) / 20 * 0.9)
    rim = np.interp(at(100), at(20), ground) / (1 - slip)
    forces = {"Fx": 100 + 10 * rng.standard_normal(n), "Fz": 9000 + 300 * wave}
    parts = [
        encode(messages["WheelSpeeds"], {"RearLeft": rim / 0.47 * 60 / (2 * np.pi)}, at(100), "can0").frames,
        encode(messages["GNSS_2"], {"Speed": ground * 3600 / 1852}, at(20), "can0").frames,
        encode(messages["GNSS_3"], {"SpeedValid": 1}, at(20), "can0").frames,
        encode(messages["WFT_Forces"], forces, at(200), "can0").frames,
        encode(messages["WFT_Moments"], {"My": 900 + 5 * rng.standard_normal(n)}, at(200), "can0").frames,
    ]
    with RecordingWriter(path, run=RunInfo(id=path.stem)) as writer:
        writer.write_frames(merge(parts))


@pytest.fixture(scope="module")
def with_holes(driven, tmp_path_factory):
    """Return the campaign without the forces in a fifth of the time."""
    ids = {m.name: m.can_id for m in load_database(shipped_dbc("wft.dbc")).messages}
    forces = [ids[name] for name in WFT]

    def holes(frames: FrameBatch) -> np.ndarray:
        stamps = (frames.frames["time_ns"] - frames.frames["time_ns"][0]) * 1e-9
        silent = (stamps % 7.0 < 1.5) & np.isin(frames.frames["can_id"], forces)
        return np.asarray(~silent)

    return copied(driven, tmp_path_factory.mktemp("holes") / "clay", holes)


@pytest.mark.parametrize(
    "options", [pytest.param((), marks=pytest.mark.slow), ("--effects", "vasilev,slope,torque_zero,speed_bias", *ALONE)]
)
def test_stretches_without_data(options, with_holes):
    found = diagnosed(with_holes, *options)
    if found["verdict"] == "named":
        assert {cause["name"] for cause in found["causes"]} == {"slip_sinkage"}


@pytest.mark.slow
def test_two_terrains_that_say_so_are_two_campaigns(driven, tmp_path):
    sand = tmp_path / "sand"
    ok("simulate", "-o", sand, "--soil", "sandy", "--runs", 2, "--duration", 20, "--effect", "vasilev:H_m=0.04")
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for source, name in ((driven, "run-1"), (driven, "run-2"), (sand, "run-1"), (sand, "run-2")):
        shutil.copy(source / f"{name}.mcap", mixed / f"{source.name}-{name}.mcap")
    found = diagnosed(mixed, "--effects", "vasilev", *ALONE)
    assert len(found["soils"]) == 2


@pytest.mark.slow
def test_two_terrains_under_one_name_are_reported(driven, tmp_path):
    sand = tmp_path / "sand"
    ok("simulate", "-o", sand, "--soil", "sandy", "--runs", 2, "--duration", 20)
    folder = tmp_path / "clay"
    shutil.copytree(driven, folder)
    (folder / "runs.toml").unlink()
    for name in ("run-1", "run-2"):
        shutil.copy(sand / f"{name}.mcap", folder / f"other-{name}.mcap")
    found = diagnosed(folder)
    assert found["verdict"] == "unexplained" or "not of one soil" in found["sentence"]
    if found["verdict"] == "named":
        assert {cause["name"] for cause in found["causes"]} == {"slip_sinkage"}
