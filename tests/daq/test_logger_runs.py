"""Runs of the logger: their files, what comes between them, and how a run that was cut off continues."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from frames_support import content, some_frames
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from logger_support import Handset, Opener, Recorder, recent_frames, virtual_bus, wait_until
from property_settings import examples

from daq import BusSection, HardwareError, LoggerSection, RecordingError, RunInfo, VehicleConfig, VehicleSection
from daq.can import concatenate
from daq.logger import Command, log
from daq.recording import Event, PartWriter, Recording, RunRecording

SCRIPTED = VehicleConfig(vehicle=VehicleSection(name="test rig"), bus=(BusSection(channel="x"),))


def events(path: Path) -> list[Event]:
    return list(Recording.open(path).events())


def record(folder: Path, count: int = 10, **options: object) -> Path:
    """Record a few frames; return the last file."""
    opener = Opener("x")
    recorder = Recorder(SCRIPTED, folder, opener=opener, **options)
    opener.source("x").give(recent_frames(count, count))
    opener.source("x").drain()
    return recorder.end().paths[-1]


def test_runs_are_started_marked_and_stopped_from_a_panel(tmp_path: Path) -> None:
    """Everything that came is in one file or another, and nowhere twice."""
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel, wait=True)
    source = opener.source("x")
    sent = [recent_frames(seed, 50) for seed in range(4)]

    panel.wait_for(lambda now: now["state"] == "between")
    source.give(sent[0])
    panel.wait_for(lambda now: now["run"]["frames"] == 50)
    panel.press("start", "dry / 1")
    panel.wait_for(lambda now: now["run"]["id"] == "dry / 1")
    source.give(sent[1])
    panel.press("mark", "gate 1")
    panel.wait_for(lambda now: now["run"]["frames"] == 50 and now["marks"])
    panel.press("start", "dry / 1")
    panel.wait_for(lambda now: now["run"]["id"] == "dry / 1-2")
    source.give(sent[2])
    panel.wait_for(lambda now: now["run"]["frames"] == 50)
    panel.press("stop")
    panel.press("stop")
    panel.wait_for(lambda now: now["state"] == "between")
    source.give(sent[3])
    source.drain()
    summary = recorder.end()

    assert [path.parent.name for path in summary.paths] == ["between", tmp_path.name, tmp_path.name, "between"]
    assert [path.name for path in summary.paths[1:3]] == ["dry-1.mcap", "dry-1-2.mcap"]
    assert summary.runs == ("dry / 1", "dry / 1-2")
    assert summary.frames == {"x": 200}
    assert any("there is a run 'dry / 1' already" in remark for remark in summary.remarks)
    for path, batch in zip(summary.paths, sent, strict=True):
        recording = Recording.open(path)
        assert recording.loss == ()
        assert recording.metadata["run_end"]["exit_status"] == "ok"
        assert content(recording.frames()) == content(batch), path
    assert [event.text for event in events(summary.paths[1]) if event.name == "mark"] == ["gate 1"]
    assert Recording.open(summary.paths[0]).metadata["run_start"]["between_runs"] == "yes"
    assert panel.snapshots[-1]["state"] == "stopping"


@examples(8, gate=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rotate_kb=st.integers(5, 60), sizes=st.lists(st.integers(1, 900), min_size=1, max_size=12))
def test_rotation_loses_nothing_and_doubles_nothing(
    tmp_path_factory: pytest.TempPathFactory, rotate_kb: int, sizes: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("rotation")
    vehicle = SCRIPTED.model_copy(update={"logger": LoggerSection(rotate_mb=rotate_kb / 1000, flush_s=0.01)})
    opener = Opener("x")
    recorder = Recorder(vehicle, folder, opener=opener, run=RunInfo(id="r"))
    sent = [recent_frames(seed, size) for seed, size in enumerate(sizes)]
    for batch in sent:
        opener.source("x").give(batch)
        opener.source("x").drain()
    summary = recorder.end()
    assert summary.frames == {"x": sum(sizes)}
    assert summary.paths == (
        folder / "r.mcap",
        *(folder / f"r.part{number}.mcap" for number in range(2, len(summary.paths) + 1)),
    )
    parts = [Recording.open(path) for path in summary.paths]
    assert all(part.loss == () for part in parts)
    assert content(concatenate([part.frames() for part in parts])) == content(concatenate(sent))


def test_a_killed_logger_goes_on_in_the_next_part_of_its_run(tmp_path: Path) -> None:
    """A real process, killed without warning."""
    (tmp_path / "run.py").write_text(
        """
import sys, time
import can
from daq.config import BusSection, LoggerSection, VehicleConfig, VehicleSection
from daq.logger.field_logger import log
bus = can.Bus(interface="virtual", channel="x")
bus.send_periodic(can.Message(arbitration_id=0x123, data=[1, 2, 3]), 0.002)
vehicle = VehicleConfig(vehicle=VehicleSection(name="test rig"), bus=(BusSection(channel="x", interface="virtual"),))
done = log(vehicle, sys.argv[1], duration_s=float(sys.argv[2]) or None)
print(*done.remarks, sep="\\n")
bus.shutdown()
""",
        encoding="utf-8",
    )
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, tmp_path / "run.py", out, "0"])
    wait_until(lambda: [path for path in out.glob("*.mcap") if path.stat().st_size > 8000])
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    [first] = out.glob("*.mcap")
    assert "run_end" not in Recording.open(first).metadata

    done = subprocess.run(
        [sys.executable, tmp_path / "run.py", out, "0.5"], capture_output=True, text=True, check=True, timeout=60
    )
    second = first.with_name(f"{first.stem}.part2.mcap")
    assert f"run '{first.stem}' was cut off: it continues in {second.name}" in done.stdout
    assert sorted(out.iterdir()) == sorted([first, second])
    recording = Recording.open(second)
    assert recording.run is not None
    assert recording.run.id == first.stem
    assert recording.metadata["run_end"]["exit_status"] == "ok"
    assert len(recording.frames()) > 50
    assert events(second)[0].severity == "warning"


def cut(path: Path) -> Path:
    """Take the end off a recording, as a kill does."""
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.rindex(b"exit_status") - 200])
    assert "run_end" not in Recording.open(path).metadata
    return path


def test_only_a_young_cut_off_run_of_this_vehicle_goes_on(tmp_path: Path) -> None:
    other = SCRIPTED.model_copy(update={"vehicle": VehicleSection(name="another")})
    old = cut(record(tmp_path / "old", run=RunInfo(id="r")))
    stamps = old.read_bytes()
    assert record(tmp_path / "old").name == "r.part2.mcap"
    assert old.read_bytes() == stamps

    cut(record(tmp_path / "other", run=RunInfo(id="r")))
    assert log(other, tmp_path / "other", duration_s=0.0, opener=Opener("x")).path.name.startswith("another_")
    with pytest.raises(RecordingError, match="there is a file already"):
        log(other, tmp_path / "other", duration_s=0.0, opener=Opener("x"), run=RunInfo(id="r"))

    cut(record(tmp_path / "named", run=RunInfo(id="r")))
    assert record(tmp_path / "named", run=RunInfo(id="q")).name == "q.mcap"
    assert record(tmp_path / "named", run=RunInfo(id="r")).name == "r.part2.mcap"
    with pytest.raises(RecordingError, match="there is a file already"):
        log(SCRIPTED, tmp_path / "named", duration_s=0.0, opener=Opener("x"), run=RunInfo(id="r"))

    assert record(tmp_path / "whole", run=RunInfo(id="r")).name == "r.mcap"
    assert record(tmp_path / "whole").name.startswith("test-rig_")


@pytest.mark.parametrize("begun", [b"", b"\0" * 4096, b"\x89MCA", b"\x89MCAP0\r\n\x01\x0e\0\0\0"])
@pytest.mark.parametrize("named", [True, False])
def test_a_part_that_was_just_begun_when_the_power_went_stops_no_run(tmp_path: Path, begun: bytes, named: bool) -> None:
    cut(record(tmp_path, run=RunInfo(id="r")))
    (tmp_path / "r.part2.mcap").write_bytes(begun)
    options = {"run": RunInfo(id="r")} if named else {}
    assert record(tmp_path, **options).name == "r.part3.mcap"
    assert (tmp_path / "r.part2.mcap").read_bytes() == begun


def test_a_run_whose_first_file_is_empty_begins_in_the_next(tmp_path: Path) -> None:
    (tmp_path / "r.mcap").touch()
    path = record(tmp_path, run=RunInfo(id="r"))
    assert path.name == "r.part2.mcap"
    assert next(event.text for event in events(path)) == "there is nothing in r.mcap: run 'r' begins in r.part2.mcap"
    assert len(RunRecording.open(tmp_path / "r.mcap").frames()) == 10


def test_a_file_of_another_kind_is_never_taken_for_a_part(tmp_path: Path) -> None:
    (tmp_path / "r.mcap").write_bytes(b"minutes of a meeting")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        log(SCRIPTED, tmp_path, duration_s=0.0, opener=Opener("x"), run=RunInfo(id="r"))
    assert record(tmp_path).name.startswith("test-rig_")


def test_an_old_cut_off_run_goes_on_only_when_it_is_asked_for(tmp_path: Path) -> None:
    writer = PartWriter(
        tmp_path / "r.mcap", run=RunInfo(id="r"), session_id="s", metadata={"vehicle": "test rig", "created_ns": "1"}
    )
    writer.write_frames(some_frames(np.random.default_rng(1), 100))  # of November 2023
    writer.flush()
    assert record(tmp_path).name.startswith("test-rig_")
    assert record(tmp_path, run=RunInfo(id="r")).name == "r.part2.mcap"
    writer.close()


def test_a_folder_takes_one_logger(tmp_path: Path) -> None:
    recorder = Recorder(VehicleConfig(bus=(virtual_bus(),)), tmp_path)
    there = sorted(tmp_path.iterdir())
    opener = Opener("x")
    with pytest.raises(HardwareError, match="another logger records into this folder") as caught:
        log(SCRIPTED, tmp_path, duration_s=0.1, opener=opener)
    assert caught.value.exit_code == 4
    assert opener.opened["x"] == []
    assert sorted(tmp_path.iterdir()) == there
    recorder.end()
    record(tmp_path)


@pytest.mark.parametrize("run_id", ["a" * 300, "ü日" * 100, "../" * 100 + "x"])
def test_a_run_of_any_name_is_recorded(tmp_path: Path, run_id: str) -> None:
    """Where a terminal takes 300 letters, a file system does not."""
    panel = Handset()
    recorder = Recorder(SCRIPTED, tmp_path / "out", opener=Opener("x"), panel=panel, wait=True)
    panel.storm([Command("start", run_id), Command("start", run_id)])
    panel.wait_for(lambda now: now["run"]["id"].endswith("-2"))
    summary = recorder.end()
    assert len(summary.runs) == 2
    assert {path.parent for path in summary.paths[1:]} == {tmp_path / "out"}


def test_a_file_that_is_named_gives_the_run_its_id(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap")
    assert path == tmp_path / "run.mcap"
    info = Recording.open(path).run
    assert info is not None
    assert (info.id, info.file) == ("run", "run.mcap")


def test_every_run_has_its_own_losses_and_the_id_that_was_asked_for(tmp_path: Path) -> None:
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel, wait=True, run=RunInfo(id="r", pass_number=3))
    source = opener.source("x")
    source.dropped = 2
    panel.wait_for(lambda now: now["buses"][0]["kernel_drops"] == 2)
    panel.press("start")
    panel.wait_for(lambda now: now["run"]["id"] == "r")
    source.give(recent_frames(1, 10))
    source.dropped = 7
    panel.wait_for(lambda now: now["run"]["frames"] == 10 and now["losses"] == {"kernel.x": 7})
    panel.press("start")
    panel.wait_for(lambda now: now["run"]["id"] == "r-2")
    summary = recorder.end()
    assert summary.losses == {"kernel.x": 7}
    dropped = [Recording.open(path).metadata["run_end"]["drops.x"] for path in summary.paths]
    assert dropped == ["2", "5", "0"]
    run = Recording.open(tmp_path / "r-2.mcap").run
    assert run is not None
    assert run.pass_number == 3


def test_a_storm_of_commands_holds_up_no_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A button that sticks: what is asked for too often is not done."""
    monkeypatch.setattr("daq.logger.session_monitor._SWITCH_EVERY_S", 0.2)
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    for _ in range(10):
        panel.storm([Command("start", "r"), Command("mark", "m"), Command("stop", "")] * 20)
        opener.source("x").give(recent_frames(1, 10))
        time.sleep(0.05)
    panel.snapshots.clear()
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 100)
    summary = recorder.end()
    assert summary.frames == {"x": 100}
    assert len(summary.paths) < 100
    assert sum(len(Recording.open(path).frames()) for path in summary.paths) == 100


def test_runs_that_are_asked_for_one_after_the_other_are_all_recorded(tmp_path: Path) -> None:
    panel = Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=Opener("x"), panel=panel, wait=True)
    panel.storm([Command("start", "a"), Command("mark", "in a"), Command("start", "b"), Command("mark", "in b")])
    panel.wait_for(lambda now: len(now["marks"]) == 2)
    assert recorder.end().runs == ("a", "b")
    for name in ("a", "b"):
        assert [event.text for event in events(tmp_path / f"{name}.mcap") if event.name == "mark"] == [f"in {name}"]
