"""Replay of a wheel force transducer's traffic into a real UDP socket: how late, and what it costs."""

from __future__ import annotations

import os
import socket
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.table import Row, at_most, judged
from daq.can import CLASSIC_DTYPE, FrameArray, FrameBatch, split
from daq.recording import Recording, RecordingWriter
from daq.sources import ReplaySummary, replay_batches

SECONDS = 10
REPEATS = 3


class UdpSink:
    """Stands in for SocketCAN on a host without it: one system call a frame, which is the dearer way."""

    name = "udp"

    def __init__(self) -> None:
        self._receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._receiver.bind(("127.0.0.1", 0))
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.connect(self._receiver.getsockname())

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        """See `daq.sources.can_source.Sink`."""
        for frame in frames.view(f"V{frames.dtype.itemsize}").tolist():
            self._sender.send(frame)

    def close(self) -> None:
        """See `daq.sources.can_source.Sink`."""
        self._sender.close()
        self._receiver.close()


@contextmanager
def undisturbed() -> Iterator[str]:
    """Give this process real-time priority where that is allowed, as if the machine were idle; say which it is."""
    before = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except PermissionError:
        yield "usual priority"
        return
    try:
        yield "real-time priority"
    finally:
        os.sched_setscheduler(0, before, os.sched_param(0))


def rows() -> list[Row]:
    sent = vehicle_traffic(SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with RecordingWriter(path) as writer:
            for batch in split(sent, len(sent) // (5 * SECONDS)):  # flushed every 0.2 s, as the logger does
                writer.write_frames(batch)
                writer.flush()
        with undisturbed() as how:
            done = [_replayed(path) for _ in range(REPEATS)]
    late_ms = statistics.median(1e3 * summary.lateness_p99_s for summary in done)
    typical_ms = statistics.median(1e3 * summary.lateness_p50_s for summary in done)
    cpu = statistics.median(summary.cpu_percent for summary in done)
    what = f"replay at {len(sent) / SECONDS / 1e3:.1f} kframes/s"
    return [
        judged(
            f"{what}, {how}: 99 % of the frames late by at most (half of them), wall",
            f"{late_ms:.2f} ms ({typical_ms:.3f} ms)",
            late_ms,
            at_most(1, "ms"),
            "a frame at 125 kbit/s takes 1 ms",
        ),
        Row(f"{what}: share of a core", f"{cpu:.0f} %"),
    ]


def vehicle_traffic(seconds: int) -> FrameBatch:
    """Return three messages at 1 kHz and two at 100 Hz, each some tens of microseconds off its time."""
    rng = np.random.default_rng(0)
    fast = np.arange(1000 * seconds)[:, None] * 1_000_000 + [0, 130_000, 260_000]
    slow = np.arange(100 * seconds)[:, None] * 10_000_000 + [57_000, 457_000]
    due = np.concatenate([fast.ravel(), slow.ravel()])
    frames = np.zeros(len(due), CLASSIC_DTYPE)
    frames["time_ns"] = 1_700_000_000_000_000_000 + np.sort(due + rng.integers(0, 40_000, len(due)))
    frames["can_id"] = 0x100
    frames["length"] = 8
    frames["data"] = rng.integers(0, 256, (len(due), 8))
    return FrameBatch(frames, ("can0",))


def _replayed(path: Path) -> ReplaySummary:
    sink = UdpSink()
    try:
        return replay_batches(Recording.open(path).frame_batches(), {"can0": sink})
    finally:
        sink.close()
