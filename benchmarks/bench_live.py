"""The live path: what a frame costs from the socket to the file, against python-can; what flushing costs."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import stand_in
from benchmarks.can_log import databases, test_log
from benchmarks.table import Row, at_least, at_most, compared, judged
from benchmarks.timing import cpu_seconds
from daq.can import FrameArray, FrameBatch
from daq.recording import RecordingWriter
from daq.sources import SocketCanSource

READ = 160
"""Frames a reading: what 20 ms bring at 8 kframes/s."""
ROUNDS = 300
RATE_HZ = 8000.0
FLUSHED = 1600
"""Frames in 0.2 s."""
DISK = Path(__file__).parents[1] / "out" / "bench"
"""Where temporary files are on a disk; /tmp may be memory."""
SESSIONS = 3
SESSION_S, WARM_UP_S = 10.0, 2.0


def rows() -> list[Row]:
    frames = test_log(26.0, databases()).frames
    DISK.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=DISK) as folder:
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
            costs.append(cpu_seconds(function) / READ)
    source.close()
    bus.shutdown()
    to_ours.close()
    to_theirs.close()
    what = f"receive a frame, {READ} waiting"
    return compared(what, ours, "python-can Bus.recv", theirs, _microseconds, at_least(6, "x"))


def _whole_logger(frames: FrameArray, folder: Path) -> list[Row]:
    """Return the rows of whole loggers; each session of ours gives its cost with and without judging."""
    messages = stand_in.datagrams(frames[: round(RATE_HZ * SESSION_S)])
    found: dict[str, list[tuple[float, float]]] = {"ours": [], "can_logger": [], "notifier": []}
    for _ in range(SESSIONS):
        for kind, costs in found.items():
            costs.append(_session(kind, messages, folder))
        flushed_mb = _size_mb(folder / "flushed.mcap")
    _session("unflushed", messages, folder)
    unflushed_mb = _size_mb(folder / "unflushed.mcap")
    whole = [cost for cost, _ in found["ours"]]
    logging = [cost - judging for cost, judging in found["ours"]]
    what = f"logger at {RATE_HZ / 1e3:g} kframes/s: receive, decode and write a frame"
    table = []
    for kind, less in (("can_logger", 1), ("notifier", 4)):
        peer = f"python-can {kind} to BLF, receive and write"
        theirs = [cost for cost, _ in found[kind]]
        table += [
            compared(f"{what}, with health", whole, peer, theirs, _microseconds, at_least(1, "x")),
            compared(f"{what}, health not counted", logging, peer, theirs, _microseconds, at_least(less, "x")),
        ]
    share, growth = 100 * statistics.median(whole) * RATE_HZ, 100 * (flushed_mb / unflushed_mb - 1)
    return [
        *table,
        Row(f"{what}, with health: share of a core", f"{share:.1f} %"),
        judged(
            "size of its file, flushed every 0.2 s, above that of one flushed at the end",
            f"{growth:+.1f} % ({flushed_mb:.3f} MB, {unflushed_mb:.3f} MB)",
            growth,
            at_most(2, "%"),
        ),
    ]


def _microseconds(seconds: float) -> str:
    return f"{1e6 * seconds:.2f} us"


def _size_mb(path: Path) -> float:
    """Return the size of a recording, and remove it for the next one."""
    size = path.stat().st_size
    path.unlink()
    return size / 1e6


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
        child.stdin.close()
        cpu_s, judged_s, count = json.loads(child.stdout.readline())
        sender.close()
    assert count == len(messages), f"{kind}: {count} of {len(messages)}"
    measured = count - warm_up
    return cpu_s / measured, judged_s / measured


def _flushing(frames: FrameArray, folder: Path) -> Row:
    costs: list[float] = []
    with RecordingWriter(folder / "synced.mcap", flush_every_s=None, sync_every_s=None) as writer:
        for start in range(0, len(frames), FLUSHED):
            writer.write_frames(FrameBatch(frames[start : start + FLUSHED], ("can0",)))
            began = time.perf_counter()
            writer.sync()
            costs.append(1e3 * (time.perf_counter() - began))
    p50, p99 = np.percentile(costs, [50, 99])
    return Row("flush and fsync 0.2 s of frames, wall", f"median {p50:.2f} ms, 99 % within {p99:.2f} ms")
