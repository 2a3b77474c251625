"""TDMS files (National Instruments) of decoded series, through npTDMS, which is an extra."""

from __future__ import annotations

import logging
import struct
from pathlib import Path
from typing import Any

import numpy as np

from daq.config import SeriesSection
from daq.errors import RecordingError, not_installed
from daq.series.blocks import Series, SeriesReport
from daq.series.readers.groups import Clock, Column, series_of

_LEAD_IN = struct.Struct("<4sL4xQ8x")
_BIG_ENDIAN, _OPEN = 1 << 6, (1 << 64) - 1
_UNIT_KEYS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_tdms(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a TDMS file: columns are ``group/channel``, timed by their waveform properties or by a time channel.

    Raises
    ------
    ConfigError
        npTDMS is not installed.
    RecordingError
        The file cannot be read.
    DataError
        No channel has a time.
    """
    try:
        import nptdms
        from nptdms.log import log_manager
    except ImportError:
        raise not_installed("TDMS files", "npTDMS", path, "series") from None
    log_manager.set_level(logging.ERROR)  # its warnings of a cut file are remarks of ours
    missing = _missing_bytes(path)
    if missing:
        report.known.append(missing)
    columns: list[Column] = []
    clocks: dict[str, Clock] = {}
    try:
        with path.open("rb") as opened, nptdms.TdmsFile.open(opened) as file:
            for group in file.groups():
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
                    columns.append(Column(name, unit, len(channel), _cells(path, group.name, channel.name), time))
    except Exception as error:  # noqa: BLE001  # npTDMS raises whatever it meets in a damaged file
        raise RecordingError.of("the TDMS file cannot be read", path, str(error)) from None
    return series_of(_of_equal_length(columns, clocks), layout, report, clocks)


def _missing_bytes(path: Path) -> str:
    """Return what is missing of a file at its end: a segment states where the next one begins."""
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            head = file.read(_LEAD_IN.size)
            if len(head) < _LEAD_IN.size:
                return f"the file is cut off: the segment at byte {at:,} ends within its header"
            tag, contents, length = _LEAD_IN.unpack(head)
            if tag != b"TDSm":
                return f"no segment begins at byte {at:,}: what is behind it is not read"
            if contents & _BIG_ENDIAN:
                length = int.from_bytes(head[12:20], "big")
            if length == _OPEN:
                return f"the segment at byte {at:,} was never closed: its last samples may be missing"
            at += _LEAD_IN.size + length
    return "" if at == size else f"the file is cut off: {size:,} of {at:,} bytes are there"


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
    for one in columns:
        if one.time and lengths.setdefault(one.time, one.length) != one.length:
            clocks[one.name] = clocks[one.time]
            one = Column(one.name, one.unit, one.length, one.cells, one.name)
        settled.append(one)
    return settled


def _cells(path: Path, group: str, channel: str) -> Any:
    def read(start: int, end: int) -> Any:
        import nptdms

        with path.open("rb") as opened, nptdms.TdmsFile.open(opened) as file:
            return file[group][channel][start:end]

    return read
