"""TDMS files (National Instruments) of decoded series, through npTDMS, which is an extra."""

from __future__ import annotations

import logging
import struct
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from daq import RecordingError, SeriesSection, not_installed
from daq.series.blocks import Series, SeriesReport
from daq.series.held import Held, state_of
from daq.series.readers.groups import Cells, Clock, Column, series_of

_LEAD_IN = struct.Struct("<4sL4xQ8x")
_BIG_ENDIAN, _OPEN = 1 << 6, (1 << 64) - 1
_MOST_WAITING_BYTES = 256 << 20
_LARGEST_SCALING = 4
"""Bytes of a scaled value in memory for one in the file: float64 for int16."""
_Name = tuple[str, str]
"""Of a channel: its group's and its own."""
_UNIT_KEYS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_tdms(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a TDMS file: columns are ``group/channel``, timed by their waveform properties or by a time channel.

    `ConfigError` without npTDMS, `RecordingError` for a file that cannot be read, `DataError` where no channel has a
    time.
    """
    try:
        from nptdms.log import log_manager
    except ImportError:
        raise not_installed("TDMS files", "npTDMS", path, "series") from None
    log_manager.set_level(logging.ERROR)  # its warnings of a cut file are remarks of ours
    missing, longest = _segments(path)
    if missing:
        report.known.append(missing)
    columns: list[Column] = []
    clocks: dict[str, Clock] = {}
    try:
        file = _OpenFile(path)
        channels = _Channels(path, in_order=not file.whole and longest * _LARGEST_SCALING <= _MOST_WAITING_BYTES)
        for group in file.tdms.groups():
            for channel in group.channels():
                name = f"{group.name}/{channel.name}"
                if not len(channel) or channel.dtype is None or channel.dtype.kind not in "fiubM":
                    report.skipped[name] = "no numbers"
                    continue
                unit = next((str(channel.properties[key]) for key in _UNIT_KEYS if key in channel.properties), "")
                clock = _clock(channel.properties)
                time = ""
                if clock is not None:
                    time = group.name if clocks.setdefault(group.name, clock) == clock else name
                    clocks.setdefault(time, clock)
                cells = channels.cells(group.name, channel.name, len(channel))
                columns.append(Column(name, unit, len(channel), cells, time))
    except Exception as error:  # noqa: BLE001  # npTDMS raises whatever it meets in a damaged file
        raise RecordingError.of("the TDMS file cannot be read", path, str(error)) from None
    _OPEN_FILES.keep(state_of(path), file)
    series = series_of(_of_equal_length(columns, clocks), layout, report, clocks)
    channels.forget(report.skipped)
    return series


def _segments(path: Path) -> tuple[str, int]:
    """Return what is missing of a file at its end, and the bytes of the longest segment: each states where it ends."""
    size, at, longest = path.stat().st_size, 0, 0
    with path.open("rb", buffering=0) as file:
        while at < size:
            file.seek(at)
            head = file.read(_LEAD_IN.size)
            if len(head) < _LEAD_IN.size:
                return f"the file is cut off: the segment at byte {at:,} ends within its header", longest
            tag, contents, length = _LEAD_IN.unpack(head)
            if tag != b"TDSm":
                return f"no segment begins at byte {at:,}: what is behind it is not read", longest
            if contents & _BIG_ENDIAN:
                length = int.from_bytes(head[12:20], "big")
            longest = max(longest, min(length, size - at))
            if length == _OPEN:
                return f"the segment at byte {at:,} was never closed: its last samples may be missing", longest
            at += _LEAD_IN.size + length
    return ("" if at == size else f"the file is cut off: {size:,} of {at:,} bytes are there"), longest


def _clock(properties: Any) -> Clock | None:
    """Return start and rate of a waveform; None where the channel is none."""
    step_s = properties.get("wf_increment")
    if not isinstance(step_s, (int, float)) or not step_s > 0:
        return None
    start = properties.get("wf_start_time")
    start_ns = int(np.datetime64(start, "ns").astype(np.int64)) if start is not None else 0
    return Clock(start_ns + round(1e9 * float(properties.get("wf_start_offset", 0.0))), 1.0 / float(step_s))


def _of_equal_length(columns: list[Column], clocks: dict[str, Clock]) -> list[Column]:
    """Give a channel whose waveform is longer or shorter than the others of its group a clock of its own."""
    lengths: dict[str, int] = {}
    settled = []
    for column in columns:
        if column.time and lengths.setdefault(column.time, column.length) != column.length:
            clocks[column.name] = clocks[column.time]
            column = Column(column.name, column.unit, column.length, column.cells, column.name)
        settled.append(column)
    return settled


class _OpenFile:
    """A file that npTDMS has open: a small one with its data, which it reads fastest at once."""

    def __init__(self, path: Path) -> None:
        import nptdms

        self._file, self.whole = path.open("rb"), False
        try:
            if path.stat().st_size * _LARGEST_SCALING <= _MOST_WAITING_BYTES:
                with suppress(Exception):  # a part of a damaged file may be readable
                    self.tdms, self.whole = nptdms.TdmsFile.read(self._file), True
            if not self.whole:
                self._file.seek(0)
                self.tdms = nptdms.TdmsFile.open(self._file)
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self.tdms.close()
        self._file.close()


_OPEN_FILES: Held[_OpenFile] = Held(_OpenFile.close)


class _Channels:
    """The channels of a file, which is read from its beginning to its end for each reading of their rows.

    Values that come before their turn wait; when more than `_MOST_WAITING_BYTES` do, each channel is read by itself. So
    it is from the beginning where not `in_order`: a segment is read as a whole.
    """

    def __init__(self, path: Path, *, in_order: bool) -> None:
        self._path, self._in_order = path, in_order
        self._lengths: dict[_Name, int] = {}
        self._given: dict[_Name, int] = {}
        self._come: dict[_Name, int] = {}
        self._waiting: dict[_Name, list[Any]] = {}
        self._waiting_bytes = 0
        self._file: _OpenFile | None = None
        self._chunks: Iterator[Any] | None = None

    def cells(self, group: str, channel: str, length: int) -> Cells:
        """Return the values of a channel; its rows are asked for in order."""
        name = group, channel
        self._lengths[name] = length

        def read(start: int, end: int) -> Any:
            if self._file is None or self._given[name] != start:
                self._begin()
            assert self._file is not None
            values = self._next(name, start, end)
            if values is None:
                values = self._file.tdms[group][channel][start:end]
            self._given[name] = end
            if self._given == self._lengths:
                self._close()
            return values

        return read

    def forget(self, names: Container[str]) -> None:
        """Take out channels whose values nobody asks for."""
        self._lengths = {name: length for name, length in self._lengths.items() if "/".join(name) not in names}

    def _begin(self) -> None:
        self._close()
        self._file = _OPEN_FILES.take(state_of(self._path)) or _OpenFile(self._path)
        self._chunks = self._file.tdms.data_chunks() if self._in_order else None
        self._given, self._come = dict.fromkeys(self._lengths, 0), dict.fromkeys(self._lengths, 0)
        self._waiting = {name: [] for name in self._lengths}
        self._waiting_bytes = 0

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file, self._chunks = None, None

    def _next(self, name: _Name, start: int, end: int) -> Any:
        """Return the next values of a channel, None where they do not come in the order of the file."""
        while self._come[name] < end:
            if self._chunks is None or not self._take_chunk(self._chunks):
                return None
        if not self._waiting[name]:
            return None
        [*pieces] = self._waiting[name]
        values = np.concatenate(pieces) if len(pieces) > 1 else pieces[0]
        taken, left = values[: end - start], values[end - start :]
        self._waiting[name] = [left] if len(left) else []
        self._waiting_bytes -= taken.nbytes
        return taken

    def _take_chunk(self, chunks: Iterator[Any]) -> bool:
        """Keep the values of the next chunk; return whether there was one, and room for it."""
        chunk = next(chunks, None)
        if chunk is None or self._waiting_bytes > _MOST_WAITING_BYTES:
            self._chunks, self._waiting = None, {name: [] for name in self._lengths}
            return False
        for group in chunk.groups():
            for part in group.channels():
                name = group.name, part.name
                if name in self._lengths and len(part):
                    values = part[:]
                    self._waiting[name].append(values)
                    self._come[name] += len(values)
                    self._waiting_bytes += values.nbytes
        return True
