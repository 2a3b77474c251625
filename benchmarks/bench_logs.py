"""Import of logs and of decoded series against the readers of python-can, pyarrow, npTDMS, scipy and h5py."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow.csv
import pyarrow.parquet
import scipy.io

from benchmarks.peer_environment import PeersMissingError, run_beside_peers
from benchmarks.table import Mark, Row, at_least, compared, compared_with_start, rate_of
from benchmarks.timing import side_by_side
from daq import FloatArray
from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag, messages_from_frames
from daq.logs import read_log, write_candump
from daq.series import read_series

FRAMES, TEXT_FRAMES = 300_000, 60_000
"""In a log; fewer in the formats that python-can reads slowly."""
SERIES_ROWS = 500_000
TDMS_SEGMENT = 1250
MOST = 1.3
"""Times what the library takes by itself."""
ROUNDS = 5
Arrays = dict[str, FloatArray]


def rows() -> list[Row]:
    import can

    frames = _bus_load()
    formats = [
        ("BLF", frames, can.BLFWriter, can.BLFReader, 15),
        ("candump", frames, None, can.CanutilsLogReader, 5),
        ("ASC", frames, can.ASCWriter, can.ASCReader, 10),
        ("TRC", frames, can.TRCWriter, can.TRCReader, 5),
        ("CSV", frames[:TEXT_FRAMES], can.CSVWriter, can.CSVReader, 3),
    ]
    with tempfile.TemporaryDirectory() as folder:
        return [*(_row(Path(folder), *one) for one in formats), *_series(Path(folder))]


def _series(folder: Path) -> list[Row]:
    """Measure decoded series: a time and six columns of float64, 56 bytes a row."""
    rng = np.random.default_rng(0)
    columns = {"time_s": np.arange(SERIES_ROWS) * 1e-3}
    columns |= {f"c{i}": rng.normal(size=SERIES_ROWS).round(4) for i in range(6)}
    compared_with = (
        ("csv", "pyarrow", _arrow_csv, at_least(0.8, "x")),
        ("parquet", "pyarrow", _arrow_parquet, None),
        ("tdms", "npTDMS", _nptdms, at_least(0.77, "x")),
    )
    found = [_series_row(_written(folder, columns, suffix), *others) for suffix, *others in compared_with]
    apart = (("mat", "scipy", _loadmat), ("h5", "h5py", _h5py))
    return found + _tables(folder) + [_row_apart(folder, columns, *others) for others in apart]


def _tables(folder: Path) -> list[Row]:
    """Measure the same tables beside the readers that are not installed with wheelsoil."""
    try:
        took = run_beside_peers(
            "series_peers", str(ROUNDS), *(str(folder / f"series.{one}") for one in ("csv", "parquet"))
        )
    except PeersMissingError as error:
        return [Row("tables: peers missing", str(error))]
    return [
        compared(
            f"{suffix} series, {SERIES_ROWS:,} rows",
            times["ours"],
            peer,
            times[peer],
            rate_of(SERIES_ROWS, "rows"),
            at_least(0.8, "x") if (suffix, peer) == ("csv", "polars") else None,
        )
        for suffix, times in took.items()
        for peer in ("polars", "duckdb")
    ]


def _series_row(path: Path, peer: str, read: Callable[[Path], Arrays], mark: Mark | None) -> Row:
    found = side_by_side(
        {"ours": partial(_read_series, path, SERIES_ROWS), "peer": partial(_read_by, read, path)}, ROUNDS
    )
    what = f"{path.suffix[1:]} series, {SERIES_ROWS:,} rows"
    return compared(what, found["ours"], peer, found["peer"], rate_of(SERIES_ROWS, "rows"), mark)


def _row_apart(folder: Path, columns: Arrays, suffix: str, peer: str, read: Callable[[Path], Arrays]) -> Row:
    """Compare a reader in a process of its own with the start of that process and `MOST` times what the peer takes."""
    path = _written(folder, columns, suffix)
    (folder / "small").mkdir(exist_ok=True)
    small = _written(folder / "small", {name: values[:2] for name, values in columns.items()}, suffix)
    found = side_by_side(
        {
            "ours": partial(_read_series, path, SERIES_ROWS),
            "start": partial(_read_series, small, 2),
            "peer": partial(_read_by, read, path),
        },
        ROUNDS,
    )
    what, as_text = f"{suffix} series, {SERIES_ROWS:,} rows", rate_of(SERIES_ROWS, "rows")
    return compared_with_start(what, found["ours"], found["start"], peer, found["peer"], MOST, as_text)


def _read_series(path: Path, rows: int) -> None:
    _all_of(rows, lambda: sum(len(block) for blocks in read_series(path).blocks() for block in blocks))


def _read_by(read: Callable[[Path], Arrays], path: Path) -> None:
    _all_of(SERIES_ROWS, lambda: min(len(values) for values in read(path).values()))


def _written(folder: Path, columns: Arrays, suffix: str) -> Path:
    """Write a table as its program does: MATLAB compresses, in v7 and (level 3) in v7.3."""
    path = folder / f"series.{suffix}"
    if suffix == "csv":
        pd.DataFrame(columns).to_csv(path, index=False)
    elif suffix == "parquet":
        pd.DataFrame(columns).to_parquet(path)
    elif suffix == "mat":
        scipy.io.savemat(path, columns, oned_as="column", do_compression=True)
    elif suffix == "h5":
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip", compression_opts=3)
    else:
        _write_tdms(path, columns)
    return path


def _write_tdms(path: Path, columns: Arrays) -> None:
    """Write segments as a logger appends them."""
    with nptdms.TdmsWriter(path) as writer:
        for start in range(0, SERIES_ROWS, TDMS_SEGMENT):
            part = slice(start, start + TDMS_SEGMENT)
            writer.write_segment([nptdms.ChannelObject("g", name, values[part]) for name, values in columns.items()])


def _arrow_csv(path: Path) -> Arrays:
    table = pyarrow.csv.read_csv(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def _arrow_parquet(path: Path) -> Arrays:
    table = pyarrow.parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def _nptdms(path: Path) -> Arrays:
    return {one.name: one[:] for group in nptdms.TdmsFile.read(path).groups() for one in group.channels()}


def _loadmat(path: Path) -> Arrays:
    return {name: values for name, values in scipy.io.loadmat(path).items() if not name.startswith("__")}


def _h5py(path: Path) -> Arrays:
    with h5py.File(path) as file:
        return {name: values[:] for name, values in file.items()}


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
    write_log(path, frames, writer)
    found = side_by_side(
        {
            "ours": partial(_all_of, len(frames), lambda: sum(len(batch) for batch in read_log(path))),
            "peer": partial(_all_of, len(frames), lambda: sum(1 for _ in reader(path))),
        },
        ROUNDS,
    )
    what = f"{name} import, {len(frames):,} frames"
    return compared(what, found["ours"], "python-can", found["peer"], rate_of(len(frames)), at_least(times, "x"))


def write_log(path: Path, frames: FrameBatch, writer: Callable[[Path], Any] | None) -> None:
    """Write frames by python-can's writer, or as candump."""
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
