"""The recorder by clocks that a test moves: when frames are in the file, when they are on the disk, and their times."""

from __future__ import annotations

import os
import stat
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames_support import some_frames
from logger_support import Clocks
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from daq import BusSection, LoggerSection, RunInfo, VehicleConfig
from daq.can import FrameBatch
from daq.host_clock import HostClock
from daq.logger.listener import Arrival
from daq.logger.recorder import Recorder, RecorderOptions
from daq.logger.run_files import new_run
from daq.recording import Recording

TICK_S = 0.01
MOST_LOST_BY_A_KILL_S, MOST_LOST_BY_A_POWER_CUT_S = 0.25, 1.2
STEP_NS = 3_600 * 10**9


def recorder_by(clocks: Clocks, folder: Path, *, wait: bool = False, **logger: float) -> Recorder:
    """Return a recorder that has begun run "r", or between runs."""
    vehicle = VehicleConfig(bus=(BusSection(channel="x"),), logger=LoggerSection(**logger))
    clock = HostClock(clocks.realtime, clocks.monotonic)
    files = None if wait else new_run(folder, RunInfo(id="r"), vehicle)
    return Recorder(RecorderOptions(vehicle, folder, {}, {}, None), clock, files, RunInfo())


def frame_now(clocks: Clocks, recorder: Recorder) -> Arrival:
    """Return one frame that comes now."""
    batch = some_frames(np.random.default_rng(1), 1, buses=("x",))
    batch.frames["time_ns"] = recorder.now_ns()
    return Arrival(batch, "x", clocks.offset_ns)


class Growing:
    """How many frames a file had at each of its sizes; it is read when it has grown."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames = {0: 0}

    def count(self) -> int:
        size = self.path.stat().st_size
        if size not in self.frames:
            self.frames[size] = len(Recording.open(self.path).frames())
        return self.frames[size]


@dataclass(frozen=True)
class Sync:
    """An fsync: of which file and how much of it, or of which folder with which names in it."""

    at_s: float
    place: int
    size: int
    names: tuple[str, ...]


class Disk:
    """What has been put on the disk."""

    def __init__(self) -> None:
        self.syncs: list[Sync] = []
        self.clocks = Clocks()
        self.takes_s = 0.0
        self._really = os.fsync

    def fsync(self, descriptor: int) -> None:
        status = os.fstat(descriptor)
        names = tuple(os.listdir(descriptor)) if stat.S_ISDIR(status.st_mode) else ()
        self.syncs.append(Sync(self.clocks.seconds(), status.st_ino, status.st_size, names))
        self._really(descriptor)
        self.clocks.pass_s(self.takes_s)

    def of(self, path: Path) -> list[Sync]:
        return [sync for sync in self.syncs if sync.place == path.stat().st_ino]

    def knows(self, path: Path) -> bool:
        """Whether the name of a file or folder survives a power cut."""
        return any(path.name in sync.names for sync in self.of(path.parent))


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    made = Disk()
    monkeypatch.setattr(os, "fsync", made.fsync)
    yield made
    put_down()


def put_down() -> None:
    """Wait for the fsync that is under way."""
    for thread in threading.enumerate():
        if thread.name == "fsync":
            thread.join()


@pytest.mark.parametrize("flush_s", [LoggerSection().flush_s, 0.05])
def test_a_frame_is_in_the_file_after_the_flush_interval(tmp_path: Path, flush_s: float) -> None:
    """A frame each tick: the oldest that is not in the file is never older, and not much younger."""
    clocks = Clocks()
    recorder = recorder_by(clocks, tmp_path, flush_s=flush_s, sync_s=1000.0)
    file, oldest_s = Growing(recorder.path), []
    for sent in range(1, 51):
        recorder.write(frame_now(clocks, recorder))
        clocks.pass_s(TICK_S)
        recorder.tick()
        oldest_s.append((sent - file.count()) * TICK_S)
    recorder.close("ok")
    assert flush_s - 2 * TICK_S <= max(oldest_s) <= flush_s
    assert max(oldest_s) <= MOST_LOST_BY_A_KILL_S


def test_the_next_flush_is_due_when_the_interval_is_over(tmp_path: Path) -> None:
    clocks = Clocks()
    recorder = recorder_by(clocks, tmp_path)
    assert recorder.flush_due_s == pytest.approx(0.2)
    clocks.pass_s(0.15)
    recorder.tick()
    assert recorder.flush_due_s == pytest.approx(0.05)
    clocks.pass_s(0.06)
    recorder.tick()
    assert recorder.flush_due_s == pytest.approx(0.2)
    recorder.close("ok")


@pytest.mark.parametrize("takes_s", [0.0, 0.15])
def test_a_frame_is_on_the_disk_after_the_sync_interval(tmp_path: Path, disk: Disk, takes_s: float) -> None:
    """A disk that takes its time is asked so much earlier."""
    clocks, sync_s = disk.clocks, LoggerSection().sync_s
    recorder = recorder_by(clocks, tmp_path)
    disk.syncs.clear()
    disk.takes_s = takes_s
    came_s: list[float] = []
    file, oldest_s = Growing(recorder.path), []
    while len(disk.syncs) < 5:
        came_s.append(clocks.seconds())
        recorder.write(frame_now(clocks, recorder))
        clocks.pass_s(TICK_S)
        recorder.tick()
        file.count()
        before = file.frames[disk.syncs[-1].size if disk.syncs else 0]
        put_down()
        oldest_s.append(clocks.seconds() - came_s[before] if before < len(came_s) else 0.0)
    disk.takes_s = 0.0
    recorder.close("ok")
    begun_s = np.diff([sync.at_s for sync in disk.syncs[1:5]])
    assert begun_s == pytest.approx([sync_s - takes_s] * 3, abs=1.5 * TICK_S)
    assert max(oldest_s) <= sync_s + takes_s + 2 * TICK_S <= MOST_LOST_BY_A_POWER_CUT_S


def test_the_name_of_every_new_file_and_folder_is_put_on_the_disk(tmp_path: Path, disk: Disk) -> None:
    recorder = recorder_by(disk.clocks, tmp_path, wait=True, rotate_mb=0.000_001)
    assert disk.knows(tmp_path / "between")
    recorder.start("a")
    recorder.write(frame_now(disk.clocks, recorder))
    disk.clocks.pass_s(1.0)
    recorder.tick()
    recorder.stop()
    recorder.close("ok")
    assert [path.name for path in recorder.paths[1:3]] == ["a.mcap", "a.part2.mcap"]
    assert [path.name for path in recorder.paths if not disk.knows(path)] == []


def test_a_file_is_on_the_disk_when_it_has_begun_and_when_it_has_ended(tmp_path: Path, disk: Disk) -> None:
    recorder = recorder_by(disk.clocks, tmp_path)
    [begun] = disk.of(recorder.path)
    head = tmp_path / "head.mcap"
    head.write_bytes(recorder.path.read_bytes()[: begun.size])
    assert Recording.open(head).metadata["run_start"]["part"] == "1"
    recorder.write(frame_now(disk.clocks, recorder))
    recorder.close("ok")
    assert disk.of(recorder.path)[-1].size == recorder.path.stat().st_size


def host_clock(path: Path) -> list[Any]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=["/clock/host"])]


def test_the_offset_of_the_hosts_clock_is_reported_with_its_sign(tmp_path: Path) -> None:
    """File time less realtime: nothing at first, minus an hour when the clock was set forward by one."""
    clocks = Clocks()
    recorder = recorder_by(clocks, tmp_path)
    recorder.write(frame_now(clocks, recorder))
    clocks.offset_ns += STEP_NS
    clocks.pass_s(0.1)
    recorder.write(frame_now(clocks, recorder))
    recorder.close("ok")
    offsets = host_clock(recorder.path)
    assert [one.file_minus_realtime_ns for one in offsets] == [0, -STEP_NS]
    assert [one.realtime_minus_monotonic_ns for one in offsets] == [clocks.offset_ns - STEP_NS, clocks.offset_ns]
    times_ns = [one.time_ns for one in offsets]
    assert np.diff(times_ns).tolist() == [100_000_000]
    assert times_ns == Recording.open(recorder.path).frames().frames["time_ns"].tolist()


def test_a_run_whose_later_part_is_there_already_goes_behind_it(tmp_path: Path) -> None:
    """Another program may have copied a part into the folder: nothing is written over, nothing is refused."""
    clocks = Clocks()
    recorder = recorder_by(clocks, tmp_path, rotate_mb=0.000_001)
    (tmp_path / "r.part5.mcap").touch()
    recorder.write(frame_now(clocks, recorder))
    clocks.pass_s(1.0)
    recorder.tick()
    assert recorder.path.name == "r.part6.mcap"
    recorder.close("ok")
    assert isinstance(Recording.open(tmp_path / "r.mcap").frames(), FrameBatch)
