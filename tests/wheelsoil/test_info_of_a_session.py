"""What `info` and others say of a logger's files: still growing, cut off and gone on with, a clock that was set."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from cli_support import invoke, ok, small_campaign
from frames_support import some_frames

from daq import BusSection, RunInfo, VehicleConfig
from daq.can import FrameBatch
from daq.host_clock import HostClock, monotonic_ns
from daq.logger import is_being_recorded
from daq.logger.listener import Arrival
from daq.logger.recorder import Recorder, RecorderOptions
from daq.logger.run_files import RunFiles, folder_lock
from daq.recording import PartWriter, Recording, part_path
from daq.runs import MessageFacts
from wheelsoil.cli.recordings import _print_messages
from wheelsoil.workflows import FileFacts


def frames_at(time_ns: int, count: int = 50) -> FrameBatch:
    """Return frames, the first one at a time."""
    batch = some_frames(np.random.default_rng(0), count)
    batch.frames["time_ns"] += time_ns - batch.frames["time_ns"].min()
    return batch


def parts_of(folder: Path) -> PartWriter:
    return PartWriter(folder / "run.mcap", run=RunInfo(id="run"), session_id="a")


@pytest.mark.parametrize("where", [".", "between"])
def test_a_file_that_grows_is_not_to_be_recovered(tmp_path, where):
    folder = tmp_path / where
    folder.mkdir(exist_ok=True)
    with folder_lock(tmp_path), parts_of(folder) as writer:
        writer.write_frames(frames_at(time.time_ns()))
        writer.flush()
        done = ok("info", writer.path)
        assert "still being recorded" in done.err
        assert "recover" not in done.err
        told = ok("info", writer.path, "--json").json
        assert told[0]["recording_now"] is True
        assert told[0]["exit_status"] == "still being recorded"
        refused = invoke("recover", writer.path)
        assert refused.code == 3
        assert "still recording" in refused.err
        assert list(folder.glob("*recovered*")) == []
        os.utime(writer.path, (0, 0))
        assert "wheelsoil recover" in ok("info", writer.path).err, "an old file of a folder in use is not growing"
    os.utime(writer.path)
    assert not is_being_recorded(writer.path)
    assert ok("info", writer.path, "--json").json[0]["recording_now"] is False


def test_looking_does_not_keep_a_logger_out(tmp_path):
    path = tmp_path / "run.mcap"
    path.touch()
    assert not is_being_recorded(path)
    with folder_lock(tmp_path):
        assert is_being_recorded(path)
    with folder_lock(tmp_path):
        pass


def test_what_a_kill_left_unrecorded_is_reported(tmp_path):
    campaign = small_campaign(tmp_path / "campaign", runs=1)
    (path,) = campaign.glob("*.mcap")
    recording = Recording.open(path)
    frames = recording.frames()
    start_ns = int(frames.frames["time_ns"].min())
    early = frames[frames.frames["time_ns"] < start_ns + 8 * 10**9]
    late = frames[frames.frames["time_ns"] > start_ns + 11 * 10**9]
    run, attachments = recording.run, recording.attachments
    assert run is not None
    path.unlink()
    for number, batch in ((1, early), (2, late)):
        with PartWriter(path, run=run, session_id=str(number), attachments=attachments, first_part=number) as writer:
            writer.write_frames(batch)
            writer.flush()
            cut = writer.path.read_bytes()
        part_path(path, number).write_bytes(cut)
    told = ok("info", path, "--json").json[0]
    (gap,) = told["gaps"]
    length_s = (int(late.frames["time_ns"].min()) - int(early.frames["time_ns"].max())) * 1e-9
    assert length_s == pytest.approx(3.0, abs=0.1)
    said = f"{length_s:.2f} s between part 1 and part 2 were not recorded"
    assert gap["text"] == said
    assert (gap["before"], gap["after"]) == (1, 2)
    assert any(line.split(maxsplit=1) == ["gap", said] for line in ok("info", path).out.splitlines())
    assert said in ok("process", path, "--json").json[0]["quality"]["notes"]


def test_a_clock_that_was_set_is_reported(tmp_path):
    offset_ns = [0]
    clock = HostClock(lambda: time.time_ns() + offset_ns[0], monotonic_ns)
    vehicle = VehicleConfig(bus=(BusSection(channel="can0"),))
    options = RecorderOptions(vehicle, tmp_path, {}, {}, None)
    recorder = Recorder(options, clock, RunFiles(tmp_path / "run.mcap", 1, RunInfo(id="run")), RunInfo())
    recorder.write(Arrival(frames_at(clock.now_ns()), "can0", clock.realtime_minus_monotonic_ns))
    offset_ns[0] = 3_600 * 10**9
    clock.observe()
    recorder.close("ok")
    told = ok("info", tmp_path / "run.mcap", "--json").json[0]["clock_steps"]
    assert [round(float(text.removesuffix(" s"))) for text in told.values()] == [3600]
    (line,) = (line for line in ok("info", tmp_path / "run.mcap").out.splitlines() if line.startswith("clock steps"))
    assert "+3600.00" in line or "+3599.99" in line


@pytest.mark.parametrize(("limit", "shown"), [(None, "abc"), (2, "ac"), (1, "c")])
def test_the_messages_that_are_listed_have_most_samples(
    capsys: pytest.CaptureFixture[str], limit: int | None, shown: str
) -> None:
    counts = {"a": 20, "b": 10, "c": 30}
    messages = [MessageFacts("can0", name, count, 10.0, 0.0, 0.1, 0.0, ()) for name, count in counts.items()]
    _print_messages(cast(FileFacts, SimpleNamespace(messages=messages, frames={"can0": 60})), limit)
    listed = re.findall(r"(?m)^ *can0 +(\w) +(\d+) ", capsys.readouterr().out)
    assert listed == [(name, str(counts[name])) for name in shown]
