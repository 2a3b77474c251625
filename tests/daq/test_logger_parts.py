"""The logger's small parts: queue, reconnecting source, disk guard, service notification, feed, traces, run clock."""

from __future__ import annotations

import math
import os
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from frames_support import some_frames
from hypothesis import given
from hypothesis import strategies as st
from logger_support import Opener, recent_frames

from daq import BusSection, Channel, HardwareError, VehicleConfig
from daq.can import FrameBatch, concatenate, load_database, shipped_dbc
from daq.host_clock import HostClock
from daq.logger.health.report import HostStatus, Level
from daq.logger.host_monitor import DiskGuard, HostMonitor
from daq.logger.inspection import Feed
from daq.logger.listener import Arrival, ByteQueue, Listener
from daq.logger.recorder import RunClock
from daq.logger.run_files import folder_lock, safe_name
from daq.logger.session_monitor import Notifier
from daq.logger.snapshot import DiskState, RunState, SessionState, Traces, snapshot
from daq.sources.reconnect import ReconnectingSource


@given(sizes=st.lists(st.integers(1, 50), max_size=30), limit=st.integers(1, 60))
def test_a_queue_keeps_order_and_its_limit(sizes: list[int], limit: int) -> None:
    queue: ByteQueue[int] = ByteQueue(limit)
    taken: list[int] = []
    held: list[int] = []
    for number, size in enumerate(sizes):
        while not queue.put(number, size, 0.0):
            assert held
            assert sum(held) + size > limit
            taken += queue.take_some(1)
            held.pop(0)
        held.append(size)
        assert queue.share == sum(held) / limit
    while items := queue.take_some(60):
        taken += items
    assert taken == list(range(len(sizes)))
    assert queue.share == 0.0


def test_a_put_waits_for_room_and_a_wait_for_an_item() -> None:
    queue: ByteQueue[str] = ByteQueue(10)
    assert queue.put("a", 10, 0.0)
    assert not queue.put("b", 1, 0.01)
    waiting = threading.Thread(target=queue.put, args=("b", 1, 10.0))
    waiting.start()
    assert queue.take_some(99) == ["a"]
    queue.wait(10.0)
    assert queue.take_some(99) == ["b"]
    waiting.join()
    queue.wait(0.01)
    assert queue.take_some(99) == []


def test_an_interface_that_is_not_there_at_first_is_an_error() -> None:
    opener = Opener("x")
    opener.refused["x"] = "there is no interface x"
    with pytest.raises(HardwareError, match="there is no interface x"):
        ReconnectingSource(BusSection(channel="x"), opener)


def test_an_interface_that_is_down_at_first_is_a_remark() -> None:
    def opener(bus: BusSection):  # type: ignore[no-untyped-def]
        source = Opener("x")(bus)
        source.up = False  # type: ignore[attr-defined]
        return source

    source = ReconnectingSource(BusSection(channel="x"), opener)
    assert "x is down; it is recorded from when it is up" in source.remarks[0]
    assert source.status().state == "down"
    assert [change.state for change in source.changes()] == ["down"]
    source.close()


def test_a_source_counts_over_its_reopenings() -> None:
    opener = Opener("x")
    source = ReconnectingSource(BusSection(channel="x"), opener)
    for times in range(3):
        opener.source("x").dropped = 5
        opener.source("x").give(recent_frames(times, 7))
        assert len(source.read(0.1)) == 7
        opener.source("x").fail()
        until = time.monotonic() + 20
        while len(opener.opened["x"]) == times + 1:
            assert len(source.read(0.1)) == 0
            assert time.monotonic() < until
    assert source.counters.received == 21
    assert source.counters.dropped == 15
    assert source.status().reconnects == 3
    assert [change.state for change in source.changes()] == ["down", "up"] * 3
    assert source.changes() == []
    source.close()


def test_a_lost_bus_is_opened_again_after_half_a_second_and_then_every_two(monkeypatch: pytest.MonkeyPatch) -> None:
    now, tried, opener = [100.0], [], Opener("x")

    def tried_at(bus: BusSection) -> Any:
        tried.append(now[0])
        return opener(bus)

    def sleep(seconds: float) -> None:
        now[0] += seconds

    source = ReconnectingSource(BusSection(channel="x"), tried_at)
    monkeypatch.setattr("daq.sources.reconnect.time", SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    opener.source("x").fail()
    opener.refused["x"] = "it is unplugged"
    while now[0] < 106.0:
        source.read(0.25)
    assert tried == [100.0, 100.5, 102.5, 104.5]
    source.close()


def test_the_disk_lasts_as_long_as_its_growth_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [10_000_000_000]
    monkeypatch.setattr("daq.logger.host_monitor.shutil.disk_usage", lambda _: type("Usage", (), {"free": free[0]}))
    guard = DiskGuard(tmp_path, warn_min=60.0, reserve_mb=1000.0)
    assert math.isnan(guard.check(0.0, 0).minutes)
    state = guard.check(10.0, 10_000_000)
    assert state.bytes_per_s == pytest.approx(1e6)
    assert state.minutes == pytest.approx(9e9 / 1e6 / 60)
    assert state.level is Level.GREEN
    for left, level in ((5_500_000_000, Level.GREEN), (4_000_000_000, Level.AMBER)):  # 75 and 50 minutes
        free[0] = left
        assert guard.check(20.0, 20_000_000).level is level
    free[0] = 4_700_000_000  # 61 minutes: not yet the end of the warning
    assert guard.check(20.5, 20_500_000).level is Level.AMBER
    for second in range(30, 120, 10):  # a pause: the growth is that of the last minute
        state = guard.check(float(second), 20_000_000)
    assert state.bytes_per_s == 0.0
    assert math.isnan(state.minutes)
    assert state.level is Level.GREEN
    free[0] = 1_000_000_000
    assert guard.check(130.0, 20_000_000).level is Level.RED
    with pytest.raises(HardwareError, match="the disk is full up to the reserve"):
        DiskGuard(tmp_path, warn_min=60.0, reserve_mb=1000.0)


def test_a_disk_that_does_not_answer_is_no_end(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    guard = DiskGuard(folder, warn_min=60.0, reserve_mb=0.001)
    folder.rmdir()
    assert guard.check(1.0, 0).level is Level.GREEN


@pytest.mark.parametrize("abstract", [False, True])
def test_a_service_manager_receives_every_state(tmp_path: Path, abstract: bool) -> None:
    name = f"wheelsoil-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(f"\0{name}" if abstract else str(tmp_path / "notify"))
        address = f"@{name}" if abstract else str(tmp_path / "notify")
        notifier = Notifier.from_environment({"NOTIFY_SOCKET": address})
        notifier.ready("two\nlines")
        notifier.alive()
        notifier.status("recording")
        notifier.stopping()
        heard = [manager.recv(1000).decode() for _ in range(4)]
        notifier.close()
    assert heard == ["READY=1\nSTATUS=two lines", "WATCHDOG=1", "STATUS=recording", "STOPPING=1"]


def test_nobody_need_listen(tmp_path: Path) -> None:
    silent = Notifier.from_environment({})
    silent.ready()
    silent.close()
    gone = Notifier.from_environment({"NOTIFY_SOCKET": str(tmp_path / "nobody")})
    gone.alive()
    gone.close()


def test_a_lock_is_gone_with_its_holder(tmp_path: Path) -> None:
    with folder_lock(tmp_path), pytest.raises(HardwareError), folder_lock(tmp_path):
        pass
    with folder_lock(tmp_path):
        assert list(tmp_path.iterdir()) == []


@given(st.text())
def test_any_id_stays_in_its_folder(text: str) -> None:
    name = safe_name(text)
    assert name
    assert "/" not in name
    assert "\0" not in name
    assert not name.startswith(".")


def test_inspection_gives_way_while_the_queue_is_full_and_until_it_has_drained() -> None:
    feed, host = Feed(), HostStatus({})
    batches = [recent_frames(seed, 10) for seed in range(5)]
    for batch, share in zip(batches, (0.0, 0.3, 0.2, 0.01, 0.2), strict=True):
        feed.take(batch, share)
    task = feed.task(0, host)
    assert [len(task.skipped), len(task.batches), feed.skipped_frames] == [3, 2, 30]
    assert not feed.task(0, host).batches


def test_what_is_kept_for_the_inspection_is_bounded() -> None:
    feed = Feed()
    batch = recent_frames(1, 10_000)
    for _ in range(50):
        feed.take(batch, 0.0)
    task = feed.task(0, HostStatus({}))
    kept = concatenate(task.batches).frames.nbytes + concatenate(task.skipped).frames.nbytes
    assert kept <= (8 << 20) + batch.frames.nbytes
    assert feed.skipped_frames == 500_000 - sum(map(len, task.batches))


def test_traces_are_thinned_and_in_si() -> None:
    vehicle = VehicleConfig.model_validate({"bus": [{"channel": "x"}], "signals": {"ground_speed": "GNSS_2.Speed"}})
    traces = Traces(vehicle, {"x": (load_database(shipped_dbc("gnss.dbc")),)})
    time_ns = np.arange(0, 10**9, 10**6) + 5 * 10**9
    for part in np.array_split(np.arange(1000), 7):
        traces.take({("x", "GNSS_2.Speed"): Channel("GNSS_2.Speed", "kt", time_ns[part], np.full(len(part), 10.0))})
    [(role, (times, values))] = traces.fetch().items()
    assert role == "ground_speed"
    assert len(times) == 20
    assert np.all(np.diff(times) > 0)
    assert values == pytest.approx([10.0 * 1852 / 3600] * len(values))
    assert traces.fetch() == {}


@pytest.mark.parametrize(("number", "shown"), [(1.5, 1.5), (math.nan, None), (math.inf, None)])
def test_a_snapshot_has_each_number_but_those_that_are_none(number: float, shown: float | None) -> None:
    vehicle = VehicleConfig.model_validate({"bus": [{"channel": "x"}]})
    run, host = RunState("r", "r.mcap", 0.0, 1, 0, 0.0), HostStatus({}, cpu_share=number)
    disk, traces = DiskState(10**9, 0, number, number, Level.GREEN), {"ground_speed": ([2_000_000_000], [number])}
    now = snapshot(SessionState(vehicle, "recording", 0, 0, 10**9, run, None, host, disk, traces=traces))
    assert now["disk"]["minutes"] == shown
    assert now["cpu_percent"] == (shown and 100.0 * shown)
    assert now["traces"] == {"ground_speed": {"time_s": [1.0], "value": [shown]}}


class SetClock:
    """Two clocks, one of which can be set."""

    def __init__(self) -> None:
        self.monotonic = 1_000
        self.offset = 0

    def tick(self) -> int:
        self.monotonic += 1
        return self.monotonic

    def realtime(self) -> int:
        return self.tick() + self.offset


def test_a_run_begins_with_the_clock_as_it_is_set_then() -> None:
    clocks = SetClock()
    clock = HostClock(clocks.realtime, clocks.tick)
    first = RunClock(clock)
    batch = some_frames(np.random.default_rng(1), 10)
    assert first.frames(batch) is batch
    clocks.offset = 10**18
    clock.observe()
    assert first.now_ns() < 10**6
    second = RunClock(clock)
    assert abs(second.now_ns() - 10**18) < 10**6
    assert second.frames(batch).frames["time_ns"][0] - batch.frames["time_ns"][0] == second.shift_ns
    assert isinstance(second.frames(batch), FrameBatch)
    channel = Channel("a", "", batch.frames["time_ns"], np.zeros(10))
    moved = second.channels({("x", "a"): channel})["x", "a"]
    assert np.array_equal(moved.time_ns, second.frames(batch).frames["time_ns"])
    assert list(second.as_metadata(None)) == ["step.1"]


@pytest.mark.parametrize(
    ("silent_s", "opening", "hopeless"),
    [
        ((0.1, 0.1), False, False),
        ((9.0, 0.1), False, False),  # the other bus is worth more than a restart
        ((9.0, 9.0), False, True),
        ((61.0, 0.1), False, True),
        ((30.0, 30.0), True, False),  # an interface may take its time to open
        ((70.0, 70.0), True, True),
    ],
)
def test_only_a_logger_that_a_restart_helps_is_given_up(
    tmp_path: Path, silent_s: tuple[float, float], opening: bool, hopeless: bool
) -> None:
    opener, clock = Opener(), HostClock()
    queue: ByteQueue[Arrival] = ByteQueue(1000)
    sections = [BusSection(channel=name, interface="virtual") for name in ("a", "b")]
    sources = [ReconnectingSource(section, opener) for section in sections]
    listeners = [Listener(i, one, ("a", "b"), clock, queue, threading.Event()) for i, one in enumerate(sources)]
    for listener, silent in zip(listeners, silent_s, strict=True):
        listener.alive_at = time.monotonic() - silent
        listener.source.opening = opening
    watch = HostMonitor(clock, listeners, queue, DiskGuard(tmp_path, warn_min=1.0, reserve_mb=1.0))

    assert watch.hopeless() is hopeless


def test_every_turn_of_a_listener_is_a_sign_of_life() -> None:
    stop, section = threading.Event(), BusSection(channel="a", interface="virtual")
    stop.set()
    listener = Listener(0, ReconnectingSource(section, Opener()), ("a",), HostClock(), ByteQueue(1000), stop)
    listener.alive_at -= 100.0
    listener.run()
    assert listener.stuck_s < 50.0


def test_the_host_is_measured_once_a_second_and_a_change_is_reported_once(tmp_path: Path) -> None:
    queue: ByteQueue[Arrival] = ByteQueue(1000)
    watch = HostMonitor(HostClock(), [], queue, DiskGuard(tmp_path, warn_min=1.0, reserve_mb=1.0))
    assert [watch.refresh(now_s, 0) for now_s in (100.0, 100.9, 101.0, 101.9)] == [True, False, True, False]
    assert [len(watch.events(behind)) for behind in (False, True, True, False, False)] == [0, 1, 0, 1, 0]
    watch.disk = replace(watch.disk, level=Level.RED)
    assert [len(watch.events(False)) for _ in range(2)] == [1, 0]
