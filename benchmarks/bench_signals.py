"""From a log file to physical signals, against python-can with cantools: what every analyst does first."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import can
import cantools.database
import numpy as np

from benchmarks.bench_logs import write_log
from benchmarks.can_log import databases, test_log
from benchmarks.table import Row, at_least, compared, rate_of
from benchmarks.timing import side_by_side
from daq import FloatArray
from daq.can import Database, Decoder, concatenate
from daq.logs import read_log

SECONDS, ROUNDS = 20.0, 5
LEAST = 5.0
FORMATS: dict[str, tuple[Callable[[Path], Any] | None, Callable[[Path], Iterable[can.Message]]]] = {
    "blf": (can.BLFWriter, can.BLFReader),
    "log": (None, can.CanutilsLogReader),
    "asc": (can.ASCWriter, can.ASCReader),
    "trc": (can.TRCWriter, can.TRCReader),
    "csv": (can.CSVWriter, can.CSVReader),
}
Signals = dict[str, FloatArray]


def rows() -> list[Row]:
    """Measure each format with four databases, once both have given the same values."""
    known = databases()
    frames = test_log(SECONDS, known)
    merged = cantools.database.Database()
    for database in known:
        merged.add_dbc_string(database.content.decode())
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix, (writer, reader) in FORMATS.items():
            path = Path(folder) / f"run.{suffix}"
            write_log(path, frames, writer)
            ours, theirs = partial(_ours, path, known), partial(_by_cantools, path, reader, merged)
            _equal(ours(), theirs())
            took = side_by_side({"ours": ours, "peer": theirs}, ROUNDS)
            what = f"{suffix} to all signals, {len(frames):,} frames, four DBCs"
            mark, text = at_least(LEAST, "x"), rate_of(len(frames))
            found.append(compared(what, took["ours"], "python-can + cantools", took["peer"], text, mark))
    return found


def _ours(path: Path, known: list[Database]) -> Signals:
    frames = concatenate(list(read_log(path)))
    decoded = Decoder(dict.fromkeys(frames.buses, known)).decode(frames)
    return {name: channel.values for (_, name), channel in decoded.items()}


def _by_cantools(path: Path, reader: Callable[[Path], Iterable[can.Message]], known: Any) -> Signals:
    values: dict[str, list[float]] = defaultdict(list)
    names = {message.frame_id: message.name for message in known.messages}
    for message in reader(path):
        signals = known.decode_message(message.arbitration_id, message.data, decode_choices=False)
        for name, value in signals.items():
            values[f"{names[message.arbitration_id]}.{name}"].append(value)
    return {name: np.array(column) for name, column in values.items()}


def _equal(ours: Signals, theirs: Signals) -> None:
    assert ours.keys() == theirs.keys(), ours.keys() ^ theirs.keys()
    for name, values in ours.items():
        came = values[~np.isnan(values)]  # a multiplexed signal is not in every frame
        np.testing.assert_allclose(came, theirs[name], rtol=1e-9, atol=1e-9, err_msg=name)
