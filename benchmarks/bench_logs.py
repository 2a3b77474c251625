"""Import of logs against python-can's own readers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.table import Row, at_least, compared, judged, rate_of
from benchmarks.timing import median_cpu_seconds, side_by_side
from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag, messages_from_frames
from daq.logs import read_log, write_candump
from daq.series import read_series

FRAMES, TEXT_FRAMES = 300_000, 60_000
"""In a log; fewer in the formats that python-can reads slowly."""
SERIES_ROWS = 500_000
ROUNDS = 5


def rows() -> list[Row]:
    import can

    frames = _bus_load()
    formats = [
        ("BLF", frames, can.BLFWriter, can.BLFReader, 15),
        ("candump", frames, None, can.CanutilsLogReader, 5),
        ("ASC", frames, can.ASCWriter, can.ASCReader, 10),
        ("TRC", frames, can.TRCWriter, can.TRCReader, 5),
        ("CSV", frames[:TEXT_FRAMES], can.CSVWriter, can.CSVReader, 1),
    ]
    with tempfile.TemporaryDirectory() as folder:
        return [*(_row(Path(folder), *one) for one in formats), *_series(Path(folder))]


def _series(folder: Path) -> list[Row]:
    """Measure decoded series: seven columns of float64 are 56 bytes a row."""
    rng = np.random.default_rng(0)
    columns = {"time_s": np.arange(SERIES_ROWS) * 1e-3}
    columns |= {f"c{i} [N]": rng.normal(size=SERIES_ROWS).round(4) for i in range(6)}
    found = []
    for suffix, least in (("csv", 50), ("parquet", 200)):
        path = folder / f"series.{suffix}"
        pd.DataFrame(columns).to_csv(path, index=False) if suffix == "csv" else pd.DataFrame(columns).to_parquet(path)

        def read(path: Path = path) -> None:
            rows = sum(len(block) for blocks in read_series(path).blocks() for block in blocks)
            if rows != SERIES_ROWS:
                raise AssertionError(f"{rows} of {SERIES_ROWS} rows")

        rate = SERIES_ROWS * 56 / 1e6 / median_cpu_seconds(read)
        found.append(judged(f"{suffix} series, decoded bytes", f"{rate:.0f} MB/s", rate, at_least(least, "MB/s")))
    return found


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


def _row(
    folder: Path,
    name: str,
    frames: FrameBatch,
    writer: Callable[[Path], Any] | None,
    reader: Callable[[Path], Iterable[object]],
    times: float,
) -> Row:
    path = folder / f"run.{'log' if name == 'candump' else name.lower()}"
    _write(path, frames, writer)
    found = side_by_side(
        {
            "ours": partial(_all_of, len(frames), lambda: sum(len(batch) for batch in read_log(path))),
            "peer": partial(_all_of, len(frames), lambda: sum(1 for _ in reader(path))),
        },
        ROUNDS,
    )
    what = f"{name} import, {len(frames):,} frames"
    return compared(what, found["ours"], "python-can", found["peer"], rate_of(len(frames)), at_least(times, "x"))


def _write(path: Path, frames: FrameBatch, writer: Callable[[Path], Any] | None) -> None:
    if writer is None:
        write_candump([frames], path)
        return
    with writer(path) as opened:
        for message in messages_from_frames(frames.frames):
            message.channel = 0
            opened(message)


def _all_of(expected: int, count: Callable[[], int]) -> None:
    if (found := count()) != expected:
        raise AssertionError(f"a reader gave {found} of {expected} frames")
