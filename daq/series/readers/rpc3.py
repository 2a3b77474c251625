"""RPC III files (MTS: .rsp, .rpc, .tim, .drv) of decoded series.

The header is blocks of 512 bytes with a key of 32 and a value of 96 bytes in each quarter; the samples follow channel
by channel in groups of ``PTS_PER_GROUP``, as 16-bit integers with a scale a channel, or as 32-bit floats.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq import RecordingError, SeriesSection
from daq.series.blocks import Series, SeriesReport
from daq.series.readers.groups import Cells, Clock, Column, series_of

_BLOCK = 512
_RECORD, _KEY = 128, 32
_MOST_BLOCKS = 256
_MOST_CHANNELS = 512
_CLOCK = "table"


def read_rpc3(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open an RPC III file; it states names, units, scales and the rate, but no date.

    `RecordingError` where the header is damaged, or the samples are shorter than it says to the last group.
    """
    with path.open("rb") as file:
        header = _header(file.read(_BLOCK * _MOST_BLOCKS), path)
    channels = _integer(header, "CHANNELS", path, _MOST_CHANNELS)
    per_group = _integer(header, "PTS_PER_GROUP", path, 1 << 24)
    points = _integer(header, "FRAMES", path, 1 << 40) * _integer(header, "PTS_PER_FRAME", path, 1 << 24)
    is_float = header.get("DATA_TYPE", "SHORT_INTEGER").startswith("FLOAT")
    dtype = np.dtype("<f4" if is_float else "<i2")
    offset = _BLOCK * _integer(header, "NUM_HEADER_BLOCKS", path, _MOST_BLOCKS)
    groups = max(path.stat().st_size - offset, 0) // (per_group * channels * dtype.itemsize)
    if groups * per_group < points:
        report.known.append(f"the file ends after {groups * per_group} of {points} points")
        points = groups * per_group
    behind = path.stat().st_size - offset - -(-points // per_group) * per_group * channels * dtype.itemsize
    if behind > 0:
        report.known.append(f"{behind:,} bytes behind the last whole group of samples are not read")
    step_s = _number(header, "DELTA_T", path)
    if not points or not step_s > 0:
        raise RecordingError.of("the RPC III file holds no samples", path, f"{points} points, DELTA_T {step_s:g} s")
    columns = []
    for i in range(channels):
        scale = 1.0 if is_float else _number(header, f"SCALE.CHAN_{i + 1}", path)
        name = header.get(f"DESC.CHAN_{i + 1}", "") or f"CHAN_{i + 1}"
        cells = _cells(path, offset, (groups, channels, per_group), dtype, i, scale)
        columns.append(Column(name, header.get(f"UNITS.CHAN_{i + 1}", ""), points, cells, _CLOCK))
    return series_of(columns, layout, report, {_CLOCK: Clock(0, 1.0 / step_s)})


def _header(head: bytes, path: Path) -> dict[str, str]:
    found: dict[str, str] = {}
    count = 3
    while len(found) < count:
        record = head[len(found) * _RECORD : (len(found) + 1) * _RECORD]
        key = _text(record[:_KEY])
        if len(record) < _RECORD or not key or key in found:
            raise RecordingError.of("the RPC III header is damaged", path, f"{len(found)} of {count} parameters")
        found[key] = _text(record[_KEY:])
        if len(found) == 3:
            count = _integer(found, "NUM_PARAMS", path, _MOST_BLOCKS * _BLOCK // _RECORD)
    return found


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode("cp1252", "replace").strip()


def _number(header: dict[str, str], key: str, path: Path) -> float:
    try:
        return float(header[key])
    except (KeyError, ValueError):
        what = f"the RPC III header has no number {key}"
        raise RecordingError.of(what, path, repr(header.get(key, "")), next_step="export the file again") from None


def _integer(header: dict[str, str], key: str, path: Path, most: int) -> int:
    value = _number(header, key, path)
    if not 1 <= value <= most:
        raise RecordingError.of(f"the RPC III header has {key} = {value:g}", path, expected=f"1 to {most}")
    return int(value)


def _cells(
    path: Path, offset: int, shape: tuple[int, int, int], dtype: np.dtype[np.generic], channel: int, scale: float
) -> Cells:
    def read(start: int, end: int) -> np.ndarray:
        per_group = shape[2]
        first, last = start // per_group, -(-end // per_group)
        stored = np.memmap(path, dtype, "r", offset, shape)[first:last, channel].reshape(-1)
        return np.asarray(stored[start - first * per_group : end - first * per_group], np.float64) * scale

    return read
