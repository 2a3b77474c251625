"""The live path: what a frame costs from the socket to the file, against python-can; what flushing costs."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import stand_in
from benchmarks.can_log import databases, test_log
from benchmarks.row import Row
from daq.frames import FrameArray, FrameBatch
from daq.recording import RecordingWriter
from daq.socketcan import SocketCanSource

READ = 160
"""Frames a reading: what 20 ms bring at 8 kframes/s."""
ROUNDS = 300
RATE_HZ = 8000.0
FLUSHED = 1600
"""Frames in 0.2 s."""
SESSIONS = 3
SESSION_S, WARM_UP_S = 10.0, 2.0


def rows() -> list[Row]:
    frames = test_log(26.0, databases()).frames
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
        return [_receiving(frames[:READ]), *_whole_logger(frames, Path(folder)), _flushing(frames, Path(folder))]


def _receiving(frames: FrameArray) -> Row:
    messages = stand_in.datagrams(frames)
    to_ours, from_ours = stand_in.pair()
    to_theirs, from_theirs = stand_in.pair()
    source, bus = SocketCanSource("can0", made=from_ours), stand_in.python_can_bus(from_theirs)

    def take() -> None:
        assert len(source.read(1.0)) == READ

    def receive() -> None:
        assert sum(bus.recv(1.0) is not None for _ in range(READ)) == READ

    ours, theirs = [], []
    for _ in range(ROUNDS):
        for sender, function, costs in ((to_ours, take, ours), (to_theirs, receive, theirs)):
            for message in messages:
                sender.send(message)
            costs.append(_cpu_s(function) / READ)
    source.close()
    bus.shutdown()
    to_ours.close()
    to_theirs.close()
    ratio = statistics.median(their / our for our, their in zip(ours, theirs, strict=True))
    return Row(
        f"receive a frame, {READ} waiting (CPU)",
        f"{1e6 * statistics.median(ours):.2f} us",
        f"python-can Bus.recv: {1e6 * statistics.median(theirs):.2f} us",
        f"{ratio:.1f}x",
        ">= 6x",
        ratio >= 6,
    )


def _cpu_s(function: Callable[[], None]) -> float:
    start = time.thread_time()
    function()
    return time.thread_time() - start


def _whole_logger(frames: FrameArray, folder: Path) -> list[Row]:
    messages = stand_in.datagrams(frames[: round(RATE_HZ * SESSION_S)])
    ours, judging, theirs = [], [], []
    for _ in range(SESSIONS):
        whole, judged = _session("ours", messages, folder)
        ours.append(whole)
        judging.append(judged)
        flushed = (folder / "flushed.mcap").stat().st_size
        (folder / "flushed.mcap").unlink()
        theirs.append(_session("theirs", messages, folder)[0])
    _session("unflushed", messages, folder)
    unflushed = (folder / "unflushed.mcap").stat().st_size
    logging = [one - judged for one, judged in zip(ours, judging, strict=True)]
    ratio = statistics.median(their / one for one, their in zip(logging, theirs, strict=True))
    with_judging = statistics.median(their / one for one, their in zip(ours, theirs, strict=True))
    peer = f"python-can, Notifier and BLF: {1e6 * statistics.median(theirs):.2f} us"
    share = 100 * statistics.median(ours) * RATE_HZ
    growth = 100 * (flushed / unflushed - 1)
    return [
        Row(
            "whole logger at 8 kframes/s: receive, write, decode (CPU a frame)",
            f"{1e6 * statistics.median(logging):.2f} us",
            peer,
            f"{ratio:.1f}x",
            ">= 4x",
            ratio >= 4,
        ),
        Row(
            "the same, and judge every message and signal (health)",
            f"{1e6 * statistics.median(ours):.2f} us",
            f"{peer}, which judges nothing",
            f"{with_judging:.1f}x",
            "stated",
            None,
        ),
        Row("all of it, of one core", f"{share:.1f} %", "-", "-", "< 25 %", share < 25),
        Row(
            "size of its file, flushed every 0.2 s",
            f"{flushed / 1e6:.3f} MB",
            f"unflushed: {unflushed / 1e6:.3f} MB",
            f"{growth:+.1f} %",
            "<= 2 %",
            growth <= 2,
        ),
    ]


def _session(kind: str, messages: list[bytes], folder: Path) -> tuple[float, float]:
    """Return the processor time that a logger took for a frame, warm, and how much of it for judging."""
    command = [sys.executable, "-m", "benchmarks.live_child", kind, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        sender = stand_in.sending(int(child.stdout.readline()))
        warm_up = round(RATE_HZ * WARM_UP_S)
        stand_in.send(sender, messages[:warm_up], RATE_HZ)
        child.stdin.write("\n")
        child.stdin.flush()
        stand_in.send(sender, messages[warm_up:], RATE_HZ)
        time.sleep(0.3)
        child.stdin.close()
        cpu_s, judged_s, count = json.loads(child.stdout.readline())
        sender.close()
    assert count == len(messages), f"{kind}: {count} of {len(messages)}"
    return cpu_s / (count - warm_up), judged_s / (count - warm_up)


def _flushing(frames: FrameArray, folder: Path) -> Row:
    costs: list[float] = []
    with RecordingWriter(folder / "synced.mcap", flush_every_s=None, sync_every_s=None) as writer:
        for start in range(0, len(frames), FLUSHED):
            writer.write_frames(FrameBatch(frames[start : start + FLUSHED], ("can0",)))
            began = time.perf_counter()
            writer.sync()
            costs.append(1e3 * (time.perf_counter() - began))
    p50, p99 = np.percentile(costs, [50, 99])
    return Row("flush and fsync 0.2 s of frames", f"{p50:.2f} ms, p99 {p99:.2f} ms", "-", "-", "stated", None)
