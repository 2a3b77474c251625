"""BusMaster's text log, read a block of lines at a time, see `daq.logs.shapes`; its dates are local time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import BinaryIO

import numpy as np

from daq import BoolArray, IntArray, RecordingError
from daq.can.frames import CLASSIC_DTYPE, FrameArray, FrameBatch, FrameFlag
from daq.logs.report import LogReport
from daq.logs.shapes import Nibbles, Varying, byte_spans, data_bytes, frames_of, number, text_blocks

MARK = re.compile(rb"\*\*\*BUSMASTER Ver")
_LINE = re.compile(
    rb"\s*(?P<hour>\d{1,3}):(?P<minute>\d{2}):(?P<second>\d{2}):(?P<fraction>\d{4})\s+(?P<direction>[RT]x)\s+"
    rb"(?P<channel>\d{1,2})\s+(?:0x)?(?P<id>[0-9A-Fa-f]{1,8})\s+(?P<type>s|x|sr|xr)\s+(?P<length>[0-8])"
    rb"(?P<data>(?:\s+[0-9A-Fa-f]{2}(?=\s|\Z)){0,8})\s*\Z"
)
_START = re.compile(rb"\*\*\*START DATE AND TIME (\d+):(\d+):(\d+) (\d+):(\d+):(\d+):(\d+)\s*\*\*\*")
_HEADER_BYTES = 64 << 10


@dataclass(frozen=True)
class _BusMaster:
    """The grammar of a log behind its header."""

    start_ns: int

    match = staticmethod(_LINE.match)

    def varying(self, match: re.Match[bytes]) -> list[Varying]:
        found = [Varying(*match.span(n), 9) for n in ("hour", "minute", "second", "fraction", "channel")]
        return [*found, Varying(*match.span("id"), 15), *(Varying(*span, 15) for span in byte_spans(match))]

    def buses(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[str, IntArray]:
        return "can", np.maximum(number(nibbles, match.span("channel"), 10) - 1, 0)

    def kind_of(self, line: bytes) -> str | None:
        return "" if line.startswith(b"***") else None

    def frames(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
        frames = np.zeros(len(nibbles), CLASSIC_DTYPE)
        hour, minute, second = (number(nibbles, match.span(name), 10) for name in ("hour", "minute", "second"))
        frames["time_ns"] = self.start_ns + ((hour * 60 + minute) * 60 + second) * 10**9
        frames["time_ns"] += number(nibbles, match.span("fraction"), 10) * 100_000
        can_id = number(nibbles, match.span("id"), 16)
        frames["can_id"] = can_id & 0x1FFF_FFFF
        extended, remote = match["type"].startswith(b"x"), match["type"].endswith(b"r")
        flags = FrameFlag.EXTENDED if extended else FrameFlag(0)
        flags |= FrameFlag.REMOTE if remote else FrameFlag(0)
        flags |= FrameFlag.TRANSMITTED if match["direction"] == b"Tx" else FrameFlag(0)
        frames["flags"] = np.uint8(flags)
        length = frames["length"][:] = int(match["length"])
        spans = byte_spans(match)[:length]
        sane = (can_id <= (0x1FFF_FFFF if extended else 0x7FF)) & (minute < 60) & (second < 60)
        if remote:
            return frames, sane
        if len(spans) < length:
            return frames, np.zeros(len(frames), np.bool_)
        if spans:
            frames["data"][:, :length] = data_bytes(nibbles, spans)
        return frames, sane


def read_busmaster(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a BusMaster log.

    Raises RecordingError for one in decimals, or with times relative to the frame before.
    """
    grammar: _BusMaster | None = None
    first_line = 1
    for block in text_blocks(file, report):
        if grammar is None:
            grammar = _of_header(block[:_HEADER_BYTES], report)
        first_line = yield from frames_of(block, first_line, grammar, report)


def _of_header(head: bytes, report: LogReport) -> _BusMaster:
    if b"***DEC***" in head or b"***RELATIVE MODE***" in head:
        what = "a BusMaster log in decimals, or with relative times"
        step = "log in HEX, in system or absolute mode"
        raise RecordingError.of(what, report.path, expected="***HEX*** and ***SYSTEM MODE***", next_step=step)
    match = _START.search(head)
    if match is None:
        return _BusMaster(0)
    day, month, year, hour, minute, second, _ = (int(text) for text in match.groups())
    try:
        start = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        report.faults.append(f"the header: a date that is none: {match[0].decode()[:60]}")
        return _BusMaster(0)
    if b"***SYSTEM MODE***" in head:  # the lines have the time of the day
        start = start.replace(hour=0, minute=0, second=0)
    report.local_time = True
    return _BusMaster(int(start.timestamp()) * 10**9)
