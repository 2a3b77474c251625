"""Replay on python-can's virtual bus: what goes where, when, and what is left out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from frames_support import START_NS, classical, content, same, some_frames
from hypothesis import given
from hypothesis import strategies as st

from daq import BusSection, ConfigError, DataError, HardwareError, RecordingError, RunInfo
from daq.can import FrameArray, FrameBatch, FrameFlag, concatenate, split
from daq.logs import write_candump
from daq.recording import PartWriter, RecordingWriter
from daq.recording import reader as raw_frames
from daq.recording.chunks import ChunkEntry, read_chunk
from daq.sources import ReplaySummary, Source, open_source, replay, replay_batches
from daq.sources.player import Looping


def listening() -> Source:
    return open_source(BusSection(channel=f"bus-{uuid.uuid4().hex}", interface="virtual", fd=True))


def heard(source: Source) -> FrameBatch:
    batches = []
    while len(batch := source.read(0.05)):
        batches.append(batch)
    source.close()
    return concatenate(batches)


def data_frames(batch: FrameBatch) -> FrameBatch:
    return batch[(batch.frames["flags"] & FrameFlag.ERROR) == 0]


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, FrameBatch]:
    sent = some_frames(np.random.default_rng(1), 900, rate_hz=3000, buses=("can0", "can1"))
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.write_frames(sent)
    return tmp_path / "run.mcap", sent


def without_bus(batch: FrameBatch) -> list[tuple[int, int, int, bytes]]:
    return [frame[1:] for frame in content(batch)]


def test_each_bus_goes_to_its_channel(recording: tuple[Path, FrameBatch]) -> None:
    path, sent = recording
    sources = {"can0": listening(), "can1": listening()}
    channels = {bus: source.name for bus, source in sources.items()}
    summary = replay(path, "virtual", channels=channels, speed=None, fd=True)
    for bus, source in sources.items():
        assert without_bus(heard(source)) == without_bus(data_frames(sent.on_bus(bus)))
        assert summary.frames[source.name] == len(data_frames(sent.on_bus(bus)))
    assert summary.skipped_error_frames == len(sent) - len(data_frames(sent))
    assert summary.recorded_duration_s == pytest.approx(0.2997, abs=0.02)
    assert np.isnan(summary.lateness_p99_s)


def test_one_bus_and_error_frames_on_demand(recording: tuple[Path, FrameBatch]) -> None:
    path, sent = recording
    source = listening()
    summary = replay(path, "virtual", channels={"can1": source.name}, speed=None, fd=True, send_error_frames=True)
    assert without_bus(heard(source)) == without_bus(sent.on_bus("can1"))
    assert summary.frames == {source.name: len(sent.on_bus("can1"))}
    assert summary.skipped_error_frames == 0


def test_part_of_a_log_of_another_format(tmp_path: Path) -> None:
    sent = classical(some_frames(np.random.default_rng(2), 1000, rate_hz=1000))
    write_candump([sent], tmp_path / "run.log")
    source = listening()
    replay(tmp_path / "run.log", "virtual", channels={"can0": source.name}, speed=None, from_s=0.25, to_s=0.5)
    seconds = (sent.frames["time_ns"] - sent.frames["time_ns"][0]) / 1e9
    assert without_bus(heard(source)) == without_bus(data_frames(sent[(seconds >= 0.25) & (seconds < 0.5)]))


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_frames_are_sent_when_they_are_due(recording: tuple[Path, FrameBatch], speed: float) -> None:
    path, sent = recording
    source = listening()
    started_ns = time.time_ns()
    summary = replay(path, "virtual", channels={"can0": source.name}, speed=speed, fd=True)
    received = heard(source)
    due_ns = data_frames(sent.on_bus("can0")).frames["time_ns"] - sent.frames["time_ns"][0]
    late_ns = received.frames["time_ns"] - started_ns - due_ns / speed
    assert late_ns.min() > -1_000_000  # none is early, but for the rounding of the clocks
    assert summary.lateness_p50_s <= summary.lateness_p99_s <= summary.lateness_max_s * 1.03 + 1e-6


class RefusingSink:
    name = "deaf"

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        raise HardwareError("the bus takes no frames")

    def close(self) -> None:
        pass


class PromptSink(RefusingSink):
    def __init__(self) -> None:
        self.at: list[float] = []
        self.frames: list[int] = []

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        self.at += [time.perf_counter()] * len(frames)
        self.frames += frames["can_id"].tolist()


def test_quantiles_of_lateness_are_those_of_what_was_measured() -> None:
    """A batch that comes late makes all its frames late by a known amount."""
    sent = some_frames(np.random.default_rng(3), 200, rate_hz=10_000)
    sent.frames["flags"] = 0
    sink = PromptSink()

    def batches() -> list[FrameBatch]:
        return list(split(sent, 100))

    def slow() -> object:
        first, second = batches()
        yield first
        time.sleep(0.1)
        yield second

    summary = replay_batches(slow(), {"can0": sink})  # type: ignore[arg-type]
    assert sink.frames == sent.frames["can_id"].tolist()
    assert 0.07 < summary.lateness_p99_s <= summary.lateness_max_s * 1.03
    assert summary.lateness_p50_s <= summary.lateness_p99_s


@given(size=st.integers(1, 60), pieces=st.integers(1, 70), loops=st.integers(1, 4), seed=st.integers(0, 99))
def test_rounds_join_one_mean_interval_apart(size: int, pieces: int, loops: int, seed: int) -> None:
    """Time goes on over every joint, the bytes are those of the first round, and what was read is left alone."""
    once = some_frames(np.random.default_rng(seed), size, rate_hz=3000)
    before = once.frames.copy()
    rounds = Looping(lambda: split(once, pieces), loops)
    everything = concatenate(list(rounds)).frames
    assert rounds.begun == loops
    assert same(once.frames, before)
    time_ns = everything["time_ns"].reshape(loops, size)
    mean_ns = int(np.ptp(time_ns[0])) // (size - 1) if size > 1 else 10**9
    assert (time_ns[1:, 0] - time_ns[:-1, -1] == mean_ns).all()
    assert (time_ns - time_ns[:, :1] == before["time_ns"] - before["time_ns"][0]).all()
    everything["time_ns"] = np.tile(before["time_ns"], loops)
    assert same(everything, np.tile(before, loops))


def test_rounds_of_nothing_end() -> None:
    assert list(Looping(lambda: [FrameBatch.empty(("can0",))], None)) == []


def test_rounds_of_a_log_take_their_time_and_say_what_they_cost(tmp_path: Path) -> None:
    sent = classical(some_frames(np.random.default_rng(2), 300, rate_hz=3000))
    write_candump([sent], tmp_path / "run.log")
    source = listening()
    summary = replay(tmp_path / "run.log", "virtual", channels={"can0": source.name}, loops=3)
    assert without_bus(heard(source)) == 3 * without_bus(data_frames(sent))
    assert summary.recorded_duration_s == pytest.approx(0.3, abs=0.02)
    assert summary.duration_s >= 0.28
    assert summary.cpu_s > 0
    assert summary.cpu_percent == pytest.approx(100 * summary.cpu_s / summary.duration_s)


@pytest.mark.parametrize("named", ["run.mcap", "run.part2.mcap"])
def test_the_parts_of_a_run_are_sent_as_one(tmp_path: Path, named: str) -> None:
    sent = some_frames(np.random.default_rng(4), 900, rate_hz=3000)
    with PartWriter(tmp_path / "run.mcap", run=RunInfo(id="run"), session_id="s", rotate_bytes=8_000) as parts:
        for batch in split(sent, 50):
            parts.write_frames(batch)
            parts.tick()
            parts.flush()
    assert (tmp_path / "run.part2.mcap").exists()
    source = listening()
    replay(
        tmp_path / named,
        "virtual",
        channels={"can0": source.name},
        speed=None,
        from_s=0.02,
        to_s=0.28,
        loops=2,
        fd=True,
    )
    seconds = (sent.frames["time_ns"] - sent.frames["time_ns"][0]) / 1e9
    asked = data_frames(sent[(seconds >= 0.02) & (seconds < 0.28)])
    assert without_bus(heard(source)) == 2 * without_bus(asked)


def test_what_lies_behind_the_part_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent = classical(some_frames(np.random.default_rng(6), 900, rate_hz=3))
    with RecordingWriter(tmp_path / "run.mcap", flush_every_s=None) as writer:
        for batch in split(sent, 30):
            writer.write_frames(batch)
            writer.flush()
    read = []

    def watched(file: BinaryIO, entry: ChunkEntry) -> bytes:
        read.append(entry.offset)
        return read_chunk(file, entry)

    source = listening()
    monkeypatch.setattr(raw_frames, "read_chunk", watched)
    replay(tmp_path / "run.mcap", "virtual", channels={"can0": source.name}, speed=None, to_s=1.5)
    seconds = (sent.frames["time_ns"] - sent.frames["time_ns"][0]) / 1e9
    assert without_bus(heard(source)) == without_bus(data_frames(sent[seconds < 1.5]))
    looked_for_ends = 2 * len(set(read))
    assert len(read) - looked_for_ends < 5


def test_ctrl_c_ends_an_endless_replay_with_its_summary(recording: tuple[Path, FrameBatch]) -> None:
    path, sent = recording
    channel = f"239.74.163.{1 + os.getpid() % 250}"
    command = [sys.executable, "-c", "from wheelsoil.cli.app import main; main()", "replay", str(path), "--json"]
    options = ["--interface", "udp_multicast", "--fd", "--channel", f"can0={channel}", "--loop", "forever"]
    source = open_source(BusSection(channel=channel, interface="udp_multicast", fd=True))
    process = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        received, end = 0, time.monotonic() + 60
        while received < 2 * len(sent.on_bus("can0")):
            received += len(source.read(0.1))
            assert time.monotonic() < end
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    finally:
        process.kill()
        source.close()
    assert process.returncode == 130, err
    summary = json.loads(out)
    assert summary["interrupted"]
    assert summary["rounds"] >= 2
    assert summary["frames"][channel] >= received - 16  # of the burst that Ctrl-C falls into
    assert summary["recorded_duration_s"] <= summary["duration_s"] + 0.01  # what was sent, not the whole last batch


def test_order_is_kept_where_times_go_back() -> None:
    sent = some_frames(np.random.default_rng(3), 50)
    sent.frames["flags"] = 0
    sent.frames["time_ns"][20] = START_NS - 10**9
    sink = PromptSink()
    summary = replay_batches([sent], {"can0": sink}, speed=5.0)
    assert sink.frames == sent.frames["can_id"].tolist()
    assert isinstance(summary, ReplaySummary)


def test_what_is_due_within_20_us_is_sent_in_one_call(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []

    class CountingSink(PromptSink):
        def send(self, frames: FrameArray, timeout_s: float) -> None:
            calls.append(len(frames))

    monkeypatch.setattr("daq.sources.player.wait_until", lambda at: at)  # as if never late
    sent = some_frames(np.random.default_rng(4), 4)
    sent.frames["flags"] = 0
    sent.frames["time_ns"] = START_NS + np.array([0, 15_000, 36_000, 60_000])
    replay_batches([sent], {"can0": CountingSink()}, speed=1.0)
    assert calls == [2, 1, 1]


def test_each_way_to_fail(recording: tuple[Path, FrameBatch], tmp_path: Path) -> None:
    path, sent = recording
    with pytest.raises(ConfigError, match=r"no bus is called 'can9'[\s\S]*can0"):
        replay(path, "virtual", channels={"can9": "x"})
    with pytest.raises(ConfigError, match="speed must be positive"):
        replay(path, "virtual", channels={"can0": "x"}, speed=-1.0)
    with pytest.raises(ConfigError, match="at least once"):
        replay(path, "virtual", channels={"can0": "x"}, loops=0)
    for bounds in ({"from_s": np.nan}, {"from_s": np.inf}, {"to_s": np.nan}):
        with pytest.raises(ConfigError, match="numbers of seconds"):
            replay(path, "virtual", channels={"can0": "x"}, **bounds)
    with pytest.raises(DataError, match="no frame lies in this part"):
        replay(path, "virtual", channels={"can0": "x"}, from_s=1000.0)
    with pytest.raises(RecordingError, match="no such file"):
        replay(tmp_path / "none.mcap", "virtual")
    with pytest.raises(ConfigError, match="knows no interface"):
        replay(path, "virtuel")
    with pytest.raises(HardwareError, match="takes no frames"):
        replay_batches([sent], {"can0": RefusingSink()}, speed=None)
    with pytest.raises(HardwareError) as caught:
        replay(path, "socketcan", channels={"can0": "nocan0"})
    assert caught.value.exit_code == 4
