"""Import of BLF and candump logs against python-can."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benchmarks.row import Row
from daq.frames import CLASSIC_DTYPE, FrameBatch, FrameFlag
from daq.logs import read_log, write_candump
from daq.messages import messages_from_frames

FRAMES = 300_000
ROUNDS = 3


def rows() -> list[Row]:
    import can

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        frames = _bus_load()
        write_candump([frames], folder / "run.log")
        with can.BLFWriter(folder / "run.blf") as writer:
            for message in messages_from_frames(frames.frames):
                message.channel = 0
                writer(message)
        return [
            _row("BLF import", folder / "run.blf", lambda path: can.BLFReader(path), 15),
            _row("candump import", folder / "run.log", lambda path: can.CanutilsLogReader(path), 5),
        ]


def _bus_load() -> FrameBatch:
    """Return a log like that of an instrumented vehicle: slowly changing forces at 1 kHz, counters, slow messages."""
    rng = np.random.default_rng(0)
    frames = np.zeros(FRAMES, CLASSIC_DTYPE)
    frames["time_ns"] = 1_700_000_000 * 10**9 + np.arange(FRAMES) * 312_000
    kind = np.arange(FRAMES) % 10
    frames["can_id"] = np.array([0x100, 0x101, 0x102, 0x100, 0x101, 0x102, 0x100, 0x101, 0x102, 0x18FEF100])[kind]
    frames["flags"] = np.where(kind == 9, FrameFlag.EXTENDED, 0)
    frames["length"] = 8
    walk = np.cumsum(rng.integers(-20, 21, (FRAMES, 4)), axis=0).astype("<i2")
    frames["data"] = walk.view(np.uint8)
    return FrameBatch(frames, ("can0",))


def _row(what: str, path: Path, peer: Callable[[Path], Iterable[object]], at_least: int) -> Row:
    ours, theirs = [], []
    for _ in range(ROUNDS):
        ours.append(_seconds(lambda: sum(len(batch) for batch in read_log(path))))
        theirs.append(_seconds(lambda: sum(1 for _ in peer(path))))
    mine, other = statistics.median(ours), statistics.median(theirs)
    return Row(
        f"{what}, {FRAMES:,} frames",
        f"{FRAMES / mine / 1e6:.2f} Mframes/s",
        f"python-can {FRAMES / other / 1e6:.2f}",
        f"{other / mine:.1f}x",
        f">= {at_least}x",
        other / mine >= at_least,
    )


def _seconds(count: Callable[[], int]) -> float:
    start = time.perf_counter()
    if count() != FRAMES:
        raise AssertionError("a reader lost frames")
    return time.perf_counter() - start
