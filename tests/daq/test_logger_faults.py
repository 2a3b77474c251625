"""What goes wrong while the logger records costs as little as it can, and is reported."""

from __future__ import annotations

import errno
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from closed_folders import as_nobody
from frames_support import content
from logger_support import Handset, Opener, Recorder, ScriptedSource, recent_frames, virtual_bus, wait_until
from recording_support import limited

from daq import BusSection, ConfigError, Fault, HardwareError, LoggerSection, RunInfo, VehicleConfig
from daq.can import FrameBatch, concatenate, load_database, shipped_dbc
from daq.logger import LogSummary, log
from daq.logger.host_monitor import DiskGuard
from daq.logger.inspection import Inspection
from daq.recording import PartWriter, Recording
from daq.sources import InterfaceDownError, open_sink
from daq.sources.python_can import PythonCanSource
from daq.sources.reconnect import ReconnectingSource
from daq.sources.socketcan import fault_of

SCRIPTED = VehicleConfig(bus=(BusSection(channel="x"),))


def texts(summary: LogSummary, name: str) -> list[str]:
    return [event.text for path in summary.paths for event in Recording.open(path).events() if event.name == name]


def test_a_bus_that_fails_comes_back_and_the_other_never_notices(tmp_path: Path) -> None:
    opener, panel, good = Opener("x"), Handset(), virtual_bus()
    vehicle = VehicleConfig(bus=(BusSection(channel="x"), good))
    recorder = Recorder(vehicle, tmp_path, opener=opener, panel=panel)
    sink = open_sink(good)
    sent = [recent_frames(seed, 20) for seed in range(3)]
    first = opener.source("x")
    first.dropped = 3
    first.give(sent[0])
    opener.refused["x"] = "the adapter is not there"
    first.fail("the adapter is gone")
    panel.wait_for(lambda now: now["buses"][0]["state"] == "down" and "not there" in now["buses"][0]["detail"])
    sink.send(sent[2].frames, 1.0)
    opener.refused.clear()
    panel.snapshots.clear()
    panel.wait_for(lambda now: now["buses"][0]["state"] == "up")
    second = opener.source("x")
    assert first.closed == 1
    second.dropped = 4
    second.give(sent[1])
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 40)
    summary = recorder.end()
    sink.close()

    assert summary.frames == {"x": 40, good.channel: 20}
    assert summary.drops == {"x": 7}
    assert summary.losses == {"kernel.x": 7}
    assert summary.faults == ()
    assert summary.ended_by == "stop"
    recording = Recording.open(summary.path)
    assert content(recording.frames("x")) == content(concatenate(sent[:2]))
    assert recording.metadata["run_end"]["drops.x"] == "7"
    assert recording.metadata["losses"]["kernel.x"] == "7"
    down, up = texts(summary, "bus")
    assert "the adapter is gone" in down
    assert "x is back after" in up


def test_an_interface_that_is_taken_down_keeps_its_socket(tmp_path: Path) -> None:
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    source = opener.source("x")
    source.up = False
    source.give(InterfaceDownError(Fault("the interface is down", next_step="ip link set x up")))
    panel.wait_for(lambda now: now["buses"][0]["state"] == "down" and now["level"] != "green")
    source.up = True
    panel.snapshots.clear()
    panel.wait_for(lambda now: now["buses"][0]["state"] == "up")
    source.give(recent_frames(1, 10))
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 10)
    assert recorder.end().frames == {"x": 10}
    assert len(opener.opened["x"]) == 1


def test_a_bus_that_is_down_at_the_end_is_a_fault_and_no_end(tmp_path: Path) -> None:
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    opener.source("x").give(recent_frames(1, 10))
    opener.refused["x"] = "the adapter is gone"
    opener.source("x").fail("the adapter is gone")
    panel.wait_for(lambda now: now["buses"][0]["state"] == "down")
    assert recorder.running
    summary = recorder.end()
    assert [fault.what for fault in summary.faults] == ["the adapter is gone"]
    assert summary.ended_by == "stop"
    assert Recording.open(summary.path).metadata["run_end"]["exit_status"] == "ok"


def test_bus_off_is_reported_and_so_is_the_restart(tmp_path: Path) -> None:
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    for can_id, state in ((0x40, "bus_off"), (0x100, "up")):
        batch = recent_frames(1, 1)
        batch.frames["flags"], batch.frames["can_id"] = 4, can_id
        opener.source("x").give(batch)
        panel.wait_for(lambda now, state=state: now["buses"][0]["state"] == state)
        panel.snapshots.clear()
    off, on = texts(recorder.end(), "bus")
    assert "bus-off" in off
    assert "is back" in on


def test_a_virtual_bus_that_is_shut_down_under_the_logger_comes_back(tmp_path: Path) -> None:
    bus, panel = virtual_bus(), Handset()
    opened: list[PythonCanSource] = []

    def opener(section: BusSection) -> PythonCanSource:
        opened.append(PythonCanSource(section))
        return opened[-1]

    recorder = Recorder(VehicleConfig(bus=(bus,)), tmp_path, opener=opener, panel=panel)
    opened[0]._bus.shutdown()
    wait_until(lambda: len(opened) == 2)
    sink = open_sink(bus)
    batch = recent_frames(1, 10, bus.channel)
    sink.send(batch.frames, 1.0)
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 10)
    sink.close()
    assert content(Recording.open(recorder.end().path).frames()) == content(batch)


def test_an_inspection_that_fails_costs_no_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("a strange frame")

    monkeypatch.setattr(Inspection, "inspect", fail)
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    batch = recent_frames(1, 100)
    opener.source("x").give(batch)
    now = panel.wait_for(lambda now: now["level"] == "amber" and now["buses"][0]["frames"] == 100)
    assert now["reasons"][0]["code"] == "inspection_failed"
    summary = recorder.end()
    assert any("ZeroDivisionError: a strange frame" in remark for remark in summary.remarks)
    assert content(Recording.open(summary.path).frames()) == content(batch)
    [event] = texts(summary, "logger")
    assert "could not be inspected" in event


def test_an_inspection_that_is_stuck_costs_no_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    release = threading.Event()
    monkeypatch.setattr(Inspection, "inspect", lambda *_: release.wait(60))
    monkeypatch.setattr("daq.logger.session_monitor._INSPECTION_STUCK_S", 0.3)
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    now = panel.wait_for(lambda now: now["level"] == "red")
    assert now["reasons"][0]["code"] == "inspection_stuck"
    batch = recent_frames(1, 100)
    opener.source("x").give(batch)
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 100)
    summary = recorder.end()
    release.set()
    assert content(Recording.open(summary.path).frames()) == content(batch)


def test_with_a_full_queue_the_readers_wait_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is held for a while; the frames wait in the queue and behind it, and decoding gives way first."""
    held = threading.Event()
    write = PartWriter.write_frames

    def slow(self: PartWriter, batch: FrameBatch) -> None:
        assert held.wait(60)
        write(self, batch)

    monkeypatch.setattr(PartWriter, "write_frames", slow)
    opener, panel = Opener("x"), Handset()
    vehicle = SCRIPTED.model_copy(update={"logger": LoggerSection(queue_mb=0.05)})
    databases = {"x": (load_database(shipped_dbc("wft.dbc")),)}
    recorder = Recorder(vehicle, tmp_path, opener=opener, panel=panel, databases=databases)
    sent = [recent_frames(seed, 200) for seed in range(10)]  # 16 kB each
    for batch in sent:
        opener.source("x").give(batch)
    wait_until(lambda: opener.source("x").counters.received >= 600)
    time.sleep(0.1)
    assert opener.source("x").counters.received < 2000
    held.set()
    wait_until(lambda: opener.source("x").counters.received == 2000)
    summary = recorder.end()
    assert summary.losses == {}
    assert content(Recording.open(summary.path).frames()) == content(concatenate(sent))
    assert "frames are recorded, but not decoded" in texts(summary, "logger")[0]


@pytest.mark.parametrize("taken", [0, 150])
def test_what_a_failing_disk_does_not_take_is_counted(tmp_path: Path, taken: int) -> None:
    """Each frame received is in the file or counted: those gathered, queued, and waiting for the queue."""
    opener, panel = Opener("x"), Handset()
    vehicle = SCRIPTED.model_copy(update={"logger": LoggerSection(queue_mb=0.05)})
    recorder = Recorder(vehicle, tmp_path, opener=opener, panel=panel)
    source = opener.source("x")
    if taken:
        source.give(recent_frames(9, taken))
        panel.wait_for(lambda now: now["buses"][0]["frames"] == taken and now["run"]["mb"] * 1e6 > 2000)
    [path] = tmp_path.glob("*.mcap")
    with limited(resource.RLIMIT_FSIZE, path.stat().st_size + 1000):
        for seed in range(20):
            source.give(recent_frames(seed, 200))
        summary = recorder.result()
    assert summary.ended_by == "disk"
    assert len(Recording.open(path).frames()) == summary.frames["x"] == taken
    received = source.counters.received
    assert received > taken
    assert summary.losses == {"queue.x": received - taken}


@pytest.mark.parametrize("stuck", [False, True])
def test_the_service_manager_hears_of_life_until_no_source_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stuck: bool
) -> None:
    monkeypatch.setattr("daq.logger.host_monitor._REFRESH_EVERY_S", 0.02)
    monkeypatch.setattr("daq.logger.host_monitor._STUCK_S", 0.2)
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    released, source = threading.Event(), ScriptedSource("x")
    if stuck:
        source.read = lambda _: released.wait(60) and FrameBatch.empty(("x",))  # type: ignore[assignment, method-assign]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(20)
        recorder = Recorder(SCRIPTED, tmp_path / "out", opener=lambda _: source)
        while not (heard := manager.recv(1000).decode()).startswith("STATUS=red" if stuck else "STATUS=green"):
            assert "READY" in heard or "STATUS" in heard or "WATCHDOG" in heard
        later = {manager.recv(1000).decode().partition("=")[0] for _ in range(6)}
        released.set()
        recorder.end()
    assert later == ({"STATUS"} if stuck else {"STATUS", "WATCHDOG"})


def test_a_disk_without_its_reserve_is_reported_before_a_file_is_made(tmp_path: Path) -> None:
    vehicle = SCRIPTED.model_copy(update={"logger": LoggerSection(disk_reserve_mb=1e9)})
    with pytest.raises(HardwareError, match="the disk is full up to the reserve") as caught:
        log(vehicle, tmp_path, duration_s=1.0, opener=Opener("x"))
    assert caught.value.exit_code == 4
    assert list(tmp_path.iterdir()) == []


def test_a_reserve_below_a_megabyte_is_shown_as_it_was_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = type("Usage", (), {"free": 150_000})
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    with pytest.raises(HardwareError) as caught:
        DiskGuard(tmp_path, warn_min=10.0, reserve_mb=0.2)
    fault = caught.value.faults[0]
    assert (fault.found, fault.expected) == ("0.15 MB free", "more than [logger] disk_reserve_mb = 0.2")


def test_recording_ends_with_a_whole_file_when_the_reserve_is_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    real, taken = shutil.disk_usage, []
    monkeypatch.setattr(
        "daq.logger.host_monitor.shutil.disk_usage", lambda path: real(path)._replace(free=0) if taken else real(path)
    )
    opener, panel = Opener("x"), Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    batch = recent_frames(1, 100)
    opener.source("x").give(batch)
    opener.source("x").drain()
    taken.append(True)
    summary = recorder.result()
    assert summary.ended_by == "disk"
    [shown] = [one["what"] for one in panel.snapshots[-1]["reasons"] if one["code"] == "disk_failed"]
    assert "recording has ended: the disk is full up to the reserve (0 MB free)" in shown
    assert "the disk is full up to the reserve" in summary.faults[0].what
    recording = Recording.open(summary.path)
    assert recording.loss == ()
    assert recording.metadata["run_end"]["exit_status"] == "disk full or failed"
    assert content(recording.frames()) == content(batch)
    assert any("reserve" in text for text in texts(summary, "disk"))


def test_a_disk_that_fails_leaves_what_was_written(tmp_path: Path) -> None:
    """A real failing write: the process may not write files beyond 100 kB."""
    (tmp_path / "run.py").write_text(
        """
import resource, sys
import can
from wheelsoil.cli.app import main
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
bus = can.Bus(interface="virtual", channel="x")
import os
tasks = [bus.send_periodic(can.Message(arbitration_id=i, data=os.urandom(8)), 0.001) for i in range(8)]
sys.argv = ["wheelsoil", "log", "vehicle.toml", "--out", "out", "--no-page", "--duration", "60"]
try:
    main()
finally:
    for task in tasks:
        task.stop()
    bus.shutdown()
""",
        encoding="utf-8",
    )
    (tmp_path / "vehicle.toml").write_text('[[bus]]\nchannel = "x"\ninterface = "virtual"\n', encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "run.py"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 4, done.stderr
    assert "the recording cannot be written on" in done.stderr
    assert "Traceback" not in done.stderr
    [path] = (tmp_path / "out").iterdir()
    recording = Recording.open(path)
    assert len(recording.frames()) > 100
    assert path.stat().st_size <= 100_000


def test_a_folder_that_must_not_be_written_is_a_usage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="the folder cannot be made"):
        log(SCRIPTED, tmp_path / "file" / "out", duration_s=0.1, opener=Opener("x"))
    with pytest.raises(ConfigError, match="the folder cannot be made"):
        log(SCRIPTED, "/proc/out", duration_s=0.1, opener=Opener("x"))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("moment", ["reading", "closing", "opening again"])
def test_a_driver_that_fails_in_its_own_way_is_opened_again(tmp_path: Path, moment: str) -> None:
    """The driver of an adapter that was pulled out raises what it likes, when it is closed too."""
    failures: list[KeyError] = [KeyError("endpoint")]

    class Driver(ScriptedSource):
        def read(self, timeout_s: float) -> FrameBatch:
            if moment == "reading" and failures:
                raise failures.pop()
            return super().read(timeout_s)

        def close(self) -> None:
            super().close()
            if moment == "closing":
                raise KeyError("endpoint")

    opened: list[Driver] = []

    def opener(bus: BusSection) -> Driver:
        if moment == "opening again" and opened and failures:
            raise failures.pop()
        opened.append(Driver(bus.channel))
        return opened[-1]

    panel = Handset()
    recorder = Recorder(SCRIPTED, tmp_path, opener=opener, panel=panel)
    if moment != "reading":
        opened[0].fail()
    wait_until(lambda: len(opened) == 2)
    opened[1].give(recent_frames(1, 10))
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 10 and now["buses"][0]["state"] == "up")
    summary = recorder.end()
    assert summary.frames == {"x": 10}
    assert len(texts(summary, "bus")) == 2


def test_a_bus_that_is_away_is_asked_for_every_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    opener, asked, now = Opener("x"), [], [0.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda wait_s: now.__setitem__(0, now[0] + wait_s))
    monkeypatch.setattr("daq.sources.reconnect.time", clock)

    def ask(bus: BusSection) -> ScriptedSource:
        asked.append(now[0])
        return opener(bus)  # type: ignore[return-value]

    source = ReconnectingSource(SCRIPTED.bus[0], ask)
    opener.source("x").fail()
    opener.refused["x"] = "unplugged"
    while now[0] < 6.0:
        source.read(0.25)
    assert asked == [0.0, 0.5, 2.5, 4.5]


def test_a_driver_that_hangs_when_it_is_closed_stops_no_other_bus(tmp_path: Path) -> None:
    released = threading.Event()
    opener, panel = Opener("x", "y"), Handset()
    vehicle = VehicleConfig(bus=(BusSection(channel="x"), BusSection(channel="y")))
    recorder = Recorder(vehicle, tmp_path, opener=opener, panel=panel)
    stuck = opener.source("x")
    stuck.close = lambda: released.wait(60)  # type: ignore[assignment, method-assign, return-value]
    stuck.fail("the adapter is gone")
    panel.wait_for(lambda now: now["buses"][0]["state"] == "down")
    opener.source("y").give(recent_frames(1, 10, "y"))
    panel.wait_for(lambda now: now["buses"][1]["frames"] == 10)
    assert not released.is_set()
    released.set()
    assert recorder.end().frames == {"x": 0, "y": 10}


@pytest.mark.parametrize("away", ["folder removed", "file removed", "file moved"])
def test_a_file_that_is_taken_away_is_reported_and_another_is_begun(tmp_path: Path, away: str) -> None:
    opener, panel, out = Opener("x"), Handset(), tmp_path / "out"
    recorder = Recorder(SCRIPTED, out, opener=opener, panel=panel, run=RunInfo(id="r"))
    source = opener.source("x")
    sent = [recent_frames(seed, 20) for seed in range(2)]
    source.give(sent[0])
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 20)
    if away == "folder removed":
        shutil.rmtree(out)
    elif away == "file removed":
        (out / "r.mcap").unlink()
    else:
        (out / "r.mcap").rename(tmp_path / "elsewhere.mcap")
    event = panel.wait_for(lambda now: now["run"]["file"] == "r.part2.mcap" and now["level"] == "red")
    assert [one["where"] for one in event["reasons"] if one["code"] == "file_gone"] == ["recording"]
    source.give(sent[1])
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 40)
    with pytest.raises(HardwareError, match="another logger records into this folder"):
        log(SCRIPTED, out, duration_s=0.1, opener=Opener("x"))
    summary = recorder.end()
    assert any("r.mcap was moved or removed" in remark for remark in summary.remarks)
    assert content(Recording.open(out / "r.part2.mcap").frames()) == content(sent[1])
    if away == "file moved":
        moved = Recording.open(tmp_path / "elsewhere.mcap")
        assert moved.loss == ()
        assert content(moved.frames()) == content(sent[0])


@pytest.mark.parametrize("mode", [0o555, 0o000])
def test_a_folder_that_takes_no_file_any_more_is_reported_and_no_frame_is_lost(open_folder: Path, mode: int) -> None:
    """The file stays open: only the next one cannot be made."""
    opener, panel, out = Opener("x"), Handset(), open_folder / "out"
    recorder = Recorder(SCRIPTED, out, opener=opener, panel=panel, run=RunInfo(id="r"))
    source, sent = opener.source("x"), [recent_frames(seed, 20) for seed in range(3)]
    source.give(sent[0])
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 20 and not closed(now))
    out.chmod(mode)
    with as_nobody():
        source.give(sent[1])
        shown = panel.wait_for(closed)
        panel.press("start", "second")
        panel.wait_for(lambda now: any("recording continues in r.mcap" in text for text in now["remarks"]))
    out.chmod(0o755)
    panel.snapshots.clear()
    panel.wait_for(lambda now: not closed(now))
    source.give(sent[2])
    panel.wait_for(lambda now: now["buses"][0]["frames"] == 60)
    summary = recorder.end()
    assert closed(shown) == [("amber", "recording", f"no file can be made in {out}; recording continues in r.mcap")]
    assert [path.name for path in summary.paths] == ["r.mcap"]
    assert not any("moved or removed" in text for text in summary.remarks)
    assert content(Recording.open(summary.path).frames()) == [row for batch in sent for row in content(batch)]
    assert len(texts(summary, "folder")) == 2


@pytest.mark.parametrize("shut", ["out", "out/between"])
def test_a_folder_that_the_next_run_or_pause_needs_is_looked_at_too(open_folder: Path, shut: str) -> None:
    """Between runs the next run begins in another folder than that of the file that is written; in a run, a pause."""
    opener, panel, out = Opener("x"), Handset(), open_folder / "out"
    recorder = Recorder(SCRIPTED, out, opener=opener, panel=panel, run=RunInfo(id="r"), wait=True)
    panel.wait_for(lambda now: now["state"] == "between" and not closed(now))
    if shut == "out/between":
        panel.press("start", "r")
        panel.wait_for(lambda now: now["state"] == "recording" and not closed(now))
    out.chmod(0o777)
    (open_folder / shut).chmod(0o555)
    with as_nobody():
        shown = panel.wait_for(closed)
    recorder.end()
    assert [what for _, _, what in closed(shown)] == [
        f"no file can be made in {open_folder / shut}; recording continues in {shown['run']['file']}"
    ]


def closed(now: dict[str, Any]) -> list[tuple[str, str, str]]:
    return [(one["level"], one["where"], one["what"]) for one in now["reasons"] if one["code"] == "folder_closed"]


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that every user can reach."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        Path(name).chmod(0o755)
        yield Path(name)


def test_a_source_that_is_never_empty_is_left_at_the_end(tmp_path: Path) -> None:
    class Flood(ScriptedSource):
        def read(self, timeout_s: float) -> FrameBatch:
            time.sleep(0.1)
            self._received += 1024
            return FrameBatch(flood.frames.copy(), ("x",))

    before = set(threading.enumerate())
    flood, source = recent_frames(1, 1024), Flood("x")
    recorder = Recorder(SCRIPTED, tmp_path, opener=lambda _: source)
    wait_until(lambda: source.counters.received > 0)
    summary = recorder.end()
    received = source.counters.received
    assert summary.frames["x"] == received
    assert summary.losses == {}
    assert source.closed
    assert "source x" not in [thread.name for thread in set(threading.enumerate()) - before]
    assert source.counters.received == received


def test_an_errno_of_a_socket_has_its_next_step() -> None:
    missing, closed, other = (fault_of("can7", code) for code in (errno.ENODEV, errno.EPERM, errno.EIO))
    assert missing.what == "there is no interface can7" and "type vcan" in missing.next_step
    assert closed.what == "the interface must not be opened"
    assert other.what not in (missing.what, closed.what) and other.found == "EIO"
