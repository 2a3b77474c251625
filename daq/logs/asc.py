"""Vector ASC, read a block of lines at a time, see `daq.logs.shapes`.

Header lines (date, base, begin of a trigger block) hold for the lines after them. Dates have no time zone and are taken
for UTC.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import BinaryIO

import numpy as np

from daq import BoolArray, IntArray, RecordingError
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FD_LENGTHS, FrameArray, FrameBatch, FrameFlag
from daq.logs.report import LogReport
from daq.logs.shapes import FREE, Nibbles, Varying, byte_spans, data_bytes, frames_of, number, text_blocks

_HEAD = rb"\s*(?P<seconds>\d{1,10})\.(?P<fraction>\d{1,9})\s+"
_TAIL = rb"(?P<rest>\s.*)?\s*\Z"
_NEXT = rb"(?=\s|\Z)"


def _patterns(digit: bytes, byte: bytes) -> tuple[re.Pattern[bytes], re.Pattern[bytes]]:
    """Return the grammar of classical and of FD frames for a base; `byte` is one of the data."""
    identifier = rb"(?P<id>" + digit + rb"{1,10})(?P<extended>[xX]?)"
    data = rb"(?P<data>(?:\s+" + byte + _NEXT + rb"){0,%d})"
    classic = (
        rb"(?P<channel>\d{1,3})\s+(?:(?P<error>[Ee]rror[Ff]rame)|"
        + identifier
        + rb"\s+(?P<direction>Rx|Tx|TxRq)\s+(?:(?P<remote>[rR])(?:\s+(?P<length>[0-9A-Fa-f])"
        + _NEXT
        + rb")?|[dD]\s+(?P<dlc>[0-9A-Fa-f]{1,2})"
        + data % 8
        + rb"))"
    )
    fd = (
        rb"CANFD\s+(?P<channel>\d{1,3})\s+(?P<direction>Rx|Tx|TxRq)\s+(?:(?P<error>[Ee]rror[Ff]rame)|"
        + identifier
        + rb"\s+(?P<name>(?!\d+\s)\S+\s+)?(?P<brs>[01])\s+(?P<esi>[01])\s+(?P<dlc>[0-9A-Fa-f]|1[0-5])\s+"
        + rb"(?P<length>\d{1,2})"
        + data % 64
        + rb")"
    )
    return re.compile(_HEAD + classic + _TAIL), re.compile(_HEAD + fd + _TAIL)


_GRAMMARS = {16: _patterns(rb"[0-9A-Fa-f]", rb"[0-9A-Fa-f]{2}"), 10: _patterns(rb"\d", rb"\d{1,3}")}
_LETTER = re.compile(rb"[ \t]*[A-Za-z]")
_BASE = re.compile(rb"\s*base\s+(?P<base>hex|dec)\b(?:\s+timestamps\s+(?P<stamps>absolute|relative))?", re.IGNORECASE)
_DATE = re.compile(
    r"\s*(?:date|begin\s+triggerblock)\s+\S+\s+(?P<month>\S+)\s+(?P<day>\d{1,2})\s+"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{1,2}):(?P<second>\d{1,2})(?:\.(?P<fraction>\d{1,9})\d*)?"
    r"\s*(?P<half>[ap]m)?\s+(?P<year>\d{4})",
    re.IGNORECASE,
)
_HEADER = re.compile(
    rb"//|date\s|base\s|(?:no\s+)?internal\s+events|(?:begin|end)\s+trigger ?block|"
    rb"\d+\.\d+\s+(?:start|stop)\s+of\s+measurement",
    re.IGNORECASE,
)
_EVENT = re.compile(
    rb"\d+\.\d+\s+(?:CANFD\s+|CAN\s+)?(?:\d+\s+)?(?P<kind>Statistic|Status|J1939TP|SV|LIN\w*|Li\d*|FlexRay|Fr|MOST|M\d+|"
    rb"ETH|AFDX|A429|GPS|TPEvent|TriggerEvent|log|Comment|GlobalMarker|TestStructure|WaterMark|OverloadFrame|Trigger)\b",
    re.IGNORECASE,
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_GERMAN_MONTHS = {"mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_LAST_SECOND = 9_000_000_000
_ERROR = np.uint8(FrameFlag.ERROR | FrameFlag.EXTENDED)
"""An error frame has no identifier, which python-can takes for an extended one."""


@dataclass(frozen=True)
class _Asc:
    """The grammar of ASC behind some header lines."""

    base: int = 16
    start_ns: int = 0

    def match(self, line: bytes) -> re.Match[bytes] | None:
        classic, fd = _GRAMMARS[self.base]
        return classic.match(line) or fd.match(line)

    def varying(self, match: re.Match[bytes]) -> list[Varying]:
        found = [Varying(*match.span(name), 9) for name in ("seconds", "fraction", "channel")]
        if match["rest"] is not None:
            found.append(Varying(*match.span("rest"), FREE))
        if match["error"] is None:
            found.append(Varying(*match.span("id"), self.base - 1))
            found += [Varying(*span, self.base - 1) for span in byte_spans(match)]
            if "name" in match.re.groupindex and match["name"]:
                found.append(Varying(*match.span("name"), FREE))
        return found

    def buses(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[str, IntArray]:
        return "can", np.maximum(number(nibbles, match.span("channel"), 10) - 1, 0)

    def kind_of(self, line: bytes) -> str | None:
        if _HEADER.match(line):
            return ""
        event = _EVENT.match(line)
        return f"event {event['kind'].decode()}" if event else None

    def frames(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
        is_fd = "brs" in match.re.groupindex
        frames = np.zeros(len(nibbles), FD_DTYPE if is_fd else CLASSIC_DTYPE)
        seconds, fraction = number(nibbles, match.span("seconds"), 10), number(nibbles, match.span("fraction"), 10)
        frames["time_ns"] = self.start_ns + seconds * 10**9 + fraction * 10 ** (9 - len(match["fraction"]))
        sane = seconds < _LAST_SECOND
        if is_fd:
            frames["flags"] |= np.uint8(FrameFlag.FD)
        if (match["direction"] or b"Rx") != b"Rx":
            frames["flags"] |= np.uint8(FrameFlag.TRANSMITTED)
        if match["error"] is not None:
            frames["flags"] |= _ERROR
            return frames, sane
        can_id = number(nibbles, match.span("id"), self.base)
        frames["can_id"] = can_id & 0x1FFF_FFFF
        if match["extended"]:
            frames["flags"] |= np.uint8(FrameFlag.EXTENDED)
        sane &= can_id <= (0x1FFF_FFFF if match["extended"] else 0x7FF)
        return frames, sane & (self._fd(frames, nibbles, match) if is_fd else self._classic(frames, nibbles, match))

    def _classic(self, frames: FrameArray, nibbles: Nibbles, match: re.Match[bytes]) -> BoolArray:
        if match["remote"] is not None:
            frames["flags"] |= np.uint8(FrameFlag.REMOTE)
            length = int(match["length"] or b"0", 16)
            frames["length"] = min(length, 8)
            return np.full(len(frames), length <= 15)
        length = min(int(match["dlc"], self.base), 8)
        return self._data(frames, nibbles, match, length)

    def _fd(self, frames: FrameArray, nibbles: Nibbles, match: re.Match[bytes]) -> BoolArray:
        frames["flags"] |= np.uint8(FrameFlag.BITRATE_SWITCH if match["brs"] == b"1" else 0)
        frames["flags"] |= np.uint8(FrameFlag.ERROR_STATE if match["esi"] == b"1" else 0)
        length, dlc = int(match["length"]), int(match["dlc"], self.base)
        if length == 0 and dlc:
            frames["flags"] |= np.uint8(FrameFlag.REMOTE)
            frames["length"] = FD_LENGTHS[min(dlc, 15)]
            return np.full(len(frames), dlc <= 15)
        return self._data(frames, nibbles, match, length)

    def _data(self, frames: FrameArray, nibbles: Nibbles, match: re.Match[bytes], length: int) -> BoolArray:
        """Fill in the data; a line with fewer bytes than it says is impossible."""
        spans = byte_spans(match)[:length]
        if len(spans) < length or length > frames["data"].shape[1]:
            return np.zeros(len(frames), np.bool_)
        frames["length"] = length
        if not spans:
            return np.ones(len(frames), np.bool_)
        if self.base == 16:
            frames["data"][:, :length] = data_bytes(nibbles, spans)
            return np.ones(len(frames), np.bool_)
        values = np.stack([number(nibbles, span, 10) for span in spans], axis=1)
        frames["data"][:, :length] = values
        return np.asarray((values <= 255).all(axis=1))


def read_asc(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a Vector ASC file.

    Raises RecordingError for one whose times are relative to the line before.
    """
    grammar, first_line = _Asc(), 1
    for block in text_blocks(file, report):
        for piece in _between_headers(block):
            grammar = _after_header(piece, grammar, first_line, report)
            first_line = yield from frames_of(piece, first_line, grammar, report)


def _between_headers(block: bytes) -> Iterator[bytes]:
    """Part a block in front of every line that begins with a letter, or with a byte order mark."""
    text = np.frombuffer(block, np.uint8)
    starts = np.concatenate(([0], np.flatnonzero(text == ord("\n")) + 1))[:-1]
    first = text[starts] | 0x20
    cuts = starts[((first >= ord("a")) & (first <= ord("z"))) | (text[starts] == 0xEF)].tolist()
    for start, end in zip([0, *cuts], [*cuts, len(block)], strict=True):
        if end > start:
            yield block[start:end]


def _after_header(piece: bytes, before: _Asc, number_of_line: int, report: LogReport) -> _Asc:
    """Return the grammar after the first line of a piece, where that is a header."""
    line = piece[: piece.find(b"\n")].removeprefix(b"\xef\xbb\xbf")
    base = _BASE.match(line)
    if base:
        if (base["stamps"] or b"").lower() == b"relative":
            what = "an ASC file whose times are relative to the line before"
            where, found = f"{report.path}, line {number_of_line}", line.decode("ascii", "backslashreplace").strip()
            step = "export it again with absolute time stamps"
            raise RecordingError.of(what, where, found, "timestamps absolute", step)
        return replace(before, base=16 if base["base"].lower() == b"hex" else 10)
    date = _DATE.match(line.decode("utf-8", "replace"))
    if date is None:
        return before
    start_ns = _utc_ns(date)
    if not start_ns:
        report.faults.append(f"line {number_of_line}: a date that is none: {date[0].strip()[:60]}")
    return replace(before, start_ns=start_ns)


def _utc_ns(match: re.Match[str]) -> int:
    """Return the date in nanoseconds; 0 where there is no such date."""
    name = match["month"].lower()
    month = _GERMAN_MONTHS.get(name, 0)
    if not month:
        # March is Mär in any encoding
        month = 3 if name[0] == "m" and name[-1] == "r" else _MONTHS.index(name[:3]) + 1 if name[:3] in _MONTHS else 0
    hour = int(match["hour"])
    if match["half"]:
        hour = hour % 12 + (12 if match["half"].lower() == "pm" else 0)
    day, minute, second = (int(match[key]) for key in ("day", "minute", "second"))
    try:
        start = datetime(int(match["year"]), month, day, hour, minute, second, tzinfo=UTC)
    except (ValueError, OverflowError):
        return 0
    if not 1970 <= start.year < 2250:  # nanoseconds reach to 2262
        return 0
    return int(start.timestamp()) * 10**9 + int((match["fraction"] or "0").ljust(9, "0"))
