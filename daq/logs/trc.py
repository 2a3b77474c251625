"""PEAK TRC (1.0 to 2.1), read a block of lines at a time, see `daq.logs.shapes`.

The start time is local time of the computer that recorded; it is taken for UTC.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from daq import BoolArray, IntArray, RecordingError
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FD_LENGTHS, FrameArray, FrameBatch, FrameFlag
from daq.logs.report import LogReport
from daq.logs.shapes import FREE, Nibbles, Varying, byte_spans, data_bytes, frames_of, number, text_blocks

_BYTE = rb"[0-9A-Fa-f]{2}"
_NUMBER = rb"\s*(?P<number>\d+)\)?\s+"
_TIME = rb"(?P<ms>\d{1,12})(?:[.,](?P<fraction>\d{1,6}))?"
_ID = rb"(?P<id>[0-9A-Fa-f]{3,8})"
_LENGTH = rb"(?P<length>\d{1,2})"
_DATA = rb"(?:\s+(?:(?P<remote>RTR)|(?P<data>" + _BYTE + rb"(?:\s+" + _BYTE + rb"(?=\s|\Z))*)))?(?P<rest>\s.*)?\s*\Z"
_OF_VERSION = {
    "1.0": (_NUMBER, _TIME, rb"\s+", _ID, rb"\s+", _LENGTH, _DATA),
    "1.1": (_NUMBER, _TIME, rb"\s+(?P<direction>Rx|Tx)\s+", _ID, rb"\s+", _LENGTH, _DATA),
    "1.3": (_NUMBER, _TIME, rb"\s+(?P<bus>\d+)\s+(?P<direction>Rx|Tx)\s+", _ID, rb"\s+\S+\s+", _LENGTH, _DATA),
}
_OF_COLUMN = {
    "N": rb"(?P<number>\d+)",
    "O": _TIME,
    "T": rb"(?P<type>DT|FD|FB|FE|BI|RR)",
    "B": rb"(?P<bus>\d+)",
    "I": _ID,
    "d": rb"(?P<direction>Rx|Tx)",
    "R": rb"\S+",
    "l": _LENGTH,
    "L": _LENGTH,
    "S": rb"\S+",
    "A": rb"\S+",
    "D": b"",
}
_EVENT = re.compile(rb"\s*\d+\)?\s+\d+(?:[.,]\d+)?\s+(?:\d+\s+)?(?P<kind>Warng|Error|ST|EC|ER|EV|FFFFFFFF)\b")
_BUS_STATE = b"FFFFFFFF"
_FLAGS = {
    b"FD": FrameFlag.FD,
    b"FB": FrameFlag.FD | FrameFlag.BITRATE_SWITCH,
    b"FE": FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.ERROR_STATE,
    b"BI": FrameFlag.FD | FrameFlag.ERROR_STATE,
    b"RR": FrameFlag.REMOTE,
}
_DAYS_TO_1970 = 25_569
"""Days from 1899-12-30, from which PEAK counts."""
_LAST_DAY = 120_000
_LONGEST_HEADER = 64 << 10


@dataclass(frozen=True)
class _Trc:
    """The grammar of a TRC file behind its header."""

    pattern: re.Pattern[bytes]
    start_ns: int
    is_code: bool
    """Whether the length is a data length code."""

    def match(self, line: bytes) -> re.Match[bytes] | None:
        match = self.pattern.match(line)
        return None if match is None or match["id"] == _BUS_STATE else match

    def varying(self, match: re.Match[bytes]) -> list[Varying]:
        numbers = [name for name in ("number", "ms", "fraction", "bus") if match.re.groupindex.get(name)]
        found = [Varying(*match.span(name), 9) for name in numbers if match[name] is not None]
        found += [Varying(*match.span("id"), 15), *(Varying(*span, 15) for span in byte_spans(match))]
        return [*found, Varying(*match.span("rest"), FREE)] if match["rest"] is not None else found

    def buses(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[str, IntArray | None]:
        if "bus" not in match.re.groupindex:
            return "can0", None
        return "can", np.maximum(number(nibbles, match.span("bus"), 10) - 1, 0)

    def kind_of(self, line: bytes) -> str | None:
        if line.startswith(b";"):
            return ""
        event = _EVENT.match(line)
        if event is None:
            return None
        return "bus state" if event["kind"] == _BUS_STATE else f"event {event['kind'].decode()}"

    def frames(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
        named = match.re.groupindex
        flags = _FLAGS.get(match["type"], FrameFlag(0)) if "type" in named else FrameFlag(0)
        frames = np.zeros(len(nibbles), FD_DTYPE if flags & FrameFlag.FD else CLASSIC_DTYPE)
        frames["time_ns"] = self.start_ns + number(nibbles, match.span("ms"), 10) * 10**6
        if match["fraction"] is not None:
            frames["time_ns"] += number(nibbles, match.span("fraction"), 10) * 10 ** (6 - len(match["fraction"]))
        can_id = number(nibbles, match.span("id"), 16)
        extended = len(match["id"]) > 4
        frames["can_id"] = can_id & 0x1FFF_FFFF
        flags |= FrameFlag.EXTENDED if extended else FrameFlag(0)
        flags |= FrameFlag.REMOTE if match["remote"] is not None else FrameFlag(0)
        flags |= FrameFlag.TRANSMITTED if "direction" in named and match["direction"] == b"Tx" else FrameFlag(0)
        frames["flags"] = np.uint8(flags)
        sane = can_id <= (0x1FFF_FFFF if extended else 0x7FF)
        length = int(match["length"])
        if self.is_code:
            length = FD_LENGTHS[length] if length < len(FD_LENGTHS) else 255
        most = frames["data"].shape[1]
        if not flags & FrameFlag.FD:
            length = min(length, most) if length <= 64 else 255
        spans = byte_spans(match)[:length]
        remote = bool(flags & FrameFlag.REMOTE)
        if length > most or (len(spans) < length and not remote):
            return frames, np.zeros(len(frames), np.bool_)
        frames["length"] = length
        if spans and not remote:
            frames["data"][:, :length] = data_bytes(nibbles, spans)
        return frames, sane


def read_trc(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a PEAK TRC file; the bus that it calls 1 is can0.

    Raises RecordingError for a version that nobody has described to us.
    """
    grammar: _Trc | None = None
    first_line = 1
    for block in text_blocks(file, report):
        if grammar is None:
            grammar = _of_header(block, report)
        first_line = yield from frames_of(block, first_line, grammar, report)


def _of_header(block: bytes, report: LogReport) -> _Trc:
    """Return the grammar that the comments at the beginning of a file tell."""
    stated: dict[str, str] = {}
    for line in block[:_LONGEST_HEADER].splitlines():
        text = line.decode("ascii", "replace").strip().removeprefix("\ufffd" * 3)
        if text and not text.startswith(";"):
            break
        key, sign, value = text.partition("=")
        if sign and key.startswith(";$"):
            stated[key.removeprefix(";$")] = value.strip()
    version = stated.get("FILEVERSION", "1.0")
    start_ns = _start_ns(stated.get("STARTTIME"), report)
    if version in _OF_VERSION:
        return _Trc(re.compile(b"".join(_OF_VERSION[version])), start_ns, is_code=False)
    columns = stated.get("COLUMNS", "").split(",")
    unknown = [column for column in columns if column not in _OF_COLUMN]
    needed = {"O", "T", "I", "D"} - set(columns)
    if version not in ("2.0", "2.1") or unknown or needed or columns[-1] != "D":
        what, expected = "this version of TRC cannot be read", "FILEVERSION 1.0, 1.1, 1.3, 2.0 or 2.1 with COLUMNS"
        found = f"FILEVERSION {version}, COLUMNS {stated.get('COLUMNS', 'none')}"
        raise RecordingError.of(what, report.path, found, expected, "convert it with PEAK-Converter")
    middle = rb"\s+".join(_OF_COLUMN[column] for column in columns[:-1])
    return _Trc(re.compile(rb"\s*" + middle + _DATA), start_ns, is_code="L" in columns)


def _start_ns(days: str | None, report: LogReport) -> int:
    if days is None:
        return 0
    try:
        since = float(days) - _DAYS_TO_1970
    except ValueError:
        since = -1.0
    if not 0 <= since < _LAST_DAY:
        report.faults.append(f"the header: a start time that is none: {days[:40]}")
        return 0
    report.local_time = True
    return round(since * 86_400e6) * 1000
