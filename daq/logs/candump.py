"""candump -L text, read and written a block of lines at a time.

One regular expression is the grammar. It is matched against one line; all lines of the same length that have the
same characters in its fixed places, digits where it has digits and hexadecimal digits where it has those, are then
taken apart as columns. A log has a few dozen such shapes at most. Writing goes the same way back.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from string import hexdigits
from typing import BinaryIO

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from daq.arrays import BoolArray, IndexArray, IntArray
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch, FrameFlag
from daq.errors import DataError, RecordingError
from daq.logs.report import LogReport

LINE = re.compile(
    rb"\s*\((?P<seconds>\d{1,10})\.(?P<fraction>\d{1,9})\)"
    rb"\s+(?P<bus>[^\s#]+)"
    rb"\s+(?P<id>[0-9A-Fa-f]{1,8})#"
    rb"(?:[Rr](?P<remote>[0-8]?)"
    rb"|\#(?P<fd>[0-9A-Fa-f])(?P<fd_data>(?:[0-9A-Fa-f]{2}){0,64})"
    rb"|(?P<data>(?:[0-9A-Fa-f]{2}){0,8}))"
    rb"(?:_[0-9A-Fa-f])?"
    rb"(?:\s+(?P<direction>[RTrt]))?\s*\Z"
)
"""One frame: ``(seconds) bus id#data``, ``id##flags data`` for CAN FD, ``id#R`` and a length for a remote frame."""

BLOCK_BYTES = 4 << 20
_LONGEST_LINE = 1024
_LONGEST_CARRY = 1 << 20
_ERROR_BIT = 0x2000_0000
_LAST_SECOND = 9_000_000_000
_SHAPES_A_LENGTH = 8

Rows = IndexArray
"""Line numbers within a block, ascending."""
Part = tuple[Rows, str, FrameArray]
"""Frames of one shape: the rows they come from, their bus, and themselves."""

_NIBBLES = bytes(int(chr(code), 16) if chr(code) in hexdigits else 0xFF for code in range(256))
"""Value of each hexadecimal digit."""

_HEX = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_LINES = 65_536


def read_candump(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a candump log, a few megabytes of text at a time."""
    carry = b""
    first_line = 1
    while block := file.read(BLOCK_BYTES):
        block = carry + block
        end = block.rfind(b"\n") + 1
        if not end and len(block) < _LONGEST_CARRY:
            carry = block
            continue
        end = end or len(block)  # this is no text; it is not gathered for ever
        carry = block[end:]
        first_line = yield from _frames_of(block[:end], first_line, report)
    if carry:
        yield from _frames_of(carry + b"\n", first_line, report)


def _frames_of(block: bytes, first_line: int, report: LogReport) -> Generator[FrameBatch, None, int]:
    """Yield the frames of whole lines; return the number of the line after them."""
    lines = _Lines(block)
    parts: list[Part] = []
    unread: list[Rows] = []
    for rows in _by_length(lines.length):
        found, left = _read_equally_long(lines, rows)
        parts.extend(found)
        unread.append(left)
    _note_unread(lines, unread, first_line, report)
    if parts:
        yield _join(parts, lines, first_line, report)
    return first_line + len(lines.start)


class _Lines:
    """The lines of a block: where they start, how long they are, and the value of each hexadecimal digit."""

    def __init__(self, block: bytes) -> None:
        self.text = np.frombuffer(block, np.uint8)
        self.nibbles = np.frombuffer(block.translate(_NIBBLES), np.uint8)
        ends = np.flatnonzero(self.text == ord("\n"))
        if not len(ends) or ends[-1] != len(block) - 1:
            ends = np.append(ends, len(block))
        self.start = np.concatenate(([0], ends[:-1] + 1))
        self.length = ends - self.start

    def line(self, row: int) -> bytes:
        start = self.start[row]
        return self.text[start : start + self.length[row]].tobytes()


def _by_length(length: Rows) -> Iterator[Rows]:
    order = np.argsort(length, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(length[order])) + 1):
        if length[rows[0]]:
            yield rows


def _read_equally_long(lines: _Lines, rows: Rows) -> tuple[list[Part], Rows]:
    """Return the frames of lines of one length, and the rows that are no frames."""
    parts: list[Part] = []
    if lines.length[rows[0]] > _LONGEST_LINE:
        return parts, rows
    for _ in range(_SHAPES_A_LENGTH):
        match = LINE.match(lines.line(int(rows[0])))
        if match is None:
            break
        part, rows = _read_shape(lines, rows, match)
        parts.append(part)
        if not len(rows):
            return parts, rows
    shapes: dict[object, tuple[re.Match[bytes], list[int]]] = {}
    unread: list[int] = []
    for row in rows.tolist():  # unusual lines: each is matched by itself
        match = LINE.match(lines.line(row))
        if match is None:
            unread.append(row)
        else:
            shapes.setdefault((match.regs, match["bus"], match["direction"]), (match, []))[1].append(row)
    for match, alike in shapes.values():
        part, refused = _read_shape(lines, np.array(alike), match)
        parts.append(part)
        unread.extend(refused.tolist())
    return parts, np.array(unread, np.intp)


def _read_shape(lines: _Lines, rows: Rows, match: re.Match[bytes]) -> tuple[Part, Rows]:
    """Return the frames of the rows that look like `match`, and the other rows."""
    template = np.frombuffer(match.string, np.uint8)
    largest = _largest_nibbles(match)
    fixed = largest == 255
    text = sliding_window_view(lines.text, len(template))[lines.start[rows]]
    nibbles = sliding_window_view(lines.nibbles, len(template))[lines.start[rows]]
    differs = (nibbles > largest) | ((text != template) & fixed)
    alike = ~differs.any(axis=1) if differs.any() else np.ones(len(rows), bool)  # the second is rare, and slow
    frames, sane = _columns(nibbles if alike.all() else nibbles[alike], match)
    chosen = rows[alike]
    bad = np.sort(np.concatenate((rows[~alike], chosen[~sane])))
    return (chosen[sane], match["bus"].decode("utf-8", "replace"), frames[sane]), bad


def _largest_nibbles(match: re.Match[bytes]) -> NDArray[np.uint8]:
    """Return what each column may hold: a digit, a hexadecimal digit, or (255) just the template's character."""
    largest = np.full(len(match.string), 255, np.uint8)
    limits = {"seconds": 9, "fraction": 9, "remote": 8, "id": 15, "fd": 15, "data": 15, "fd_data": 15}
    for name, limit in limits.items():
        largest[slice(*match.span(name))] = limit
    return largest


def _columns(nibbles: NDArray[np.uint8], match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
    """Return the frames of equally shaped lines, and which of them are possible."""
    is_fd, is_remote = match["fd"] is not None, match["remote"] is not None
    frames = np.zeros(len(nibbles), FD_DTYPE if is_fd else CLASSIC_DTYPE)
    seconds, can_id = _number(nibbles, match.span("seconds"), 10), _number(nibbles, match.span("id"), 16)
    fraction = _number(nibbles, match.span("fraction"), 10)
    frames["time_ns"] = seconds * 10**9 + fraction * 10 ** (9 - len(match["fraction"]))
    frames["can_id"] = can_id & 0x1FFF_FFFF
    if (match["direction"] or b"r").lower() == b"t":
        frames["flags"] |= np.uint8(FrameFlag.TRANSMITTED)
    extended = len(match["id"]) > 3
    if extended:
        frames["flags"] |= np.where(can_id & _ERROR_BIT, FrameFlag.ERROR, FrameFlag.EXTENDED).astype(np.uint8)
    if is_fd:
        fd_flags = nibbles[:, match.start("fd")]
        frames["flags"] |= np.uint8(FrameFlag.FD) | (fd_flags & 1) * np.uint8(FrameFlag.BITRATE_SWITCH)
        frames["flags"] |= (fd_flags >> 1 & 1) * np.uint8(FrameFlag.ERROR_STATE)
    if is_remote:
        frames["flags"] |= np.uint8(FrameFlag.REMOTE)
        frames["length"] = _number(nibbles, match.span("remote"), 10)
    else:
        start, end = match.span("fd_data" if is_fd else "data")
        data = nibbles[:, start:end:2] << 4 | nibbles[:, start + 1 : end : 2]
        frames["length"] = data.shape[1]
        frames["data"][:, : data.shape[1]] = data
    return frames, (seconds < _LAST_SECOND) & (can_id < 2 * _ERROR_BIT if extended else can_id <= 0x7FF)


def _number(nibbles: NDArray[np.uint8], span: tuple[int, int], base: int) -> IntArray:
    """Return the numbers in some columns; four digits at a time fit 16 bits, which is quicker."""
    total = np.zeros(len(nibbles), np.int64)
    for start in range(span[0], span[1], 4):
        end = min(start + 4, span[1])
        four = nibbles[:, start].astype(np.uint16)
        for column in range(start + 1, end):
            four *= np.uint16(base)
            four += nibbles[:, column]
        total *= base ** (end - start)
        total += four
    return total


def _join(parts: list[Part], lines: _Lines, first_line: int, report: LogReport) -> FrameBatch:
    """Put the frames of all shapes back into the order of their lines."""
    taken = np.zeros(len(lines.start), bool)
    for rows, _, _ in parts:
        taken[rows] = True
    position = np.cumsum(taken) - 1
    wide = any(frames.dtype == FD_DTYPE for _, _, frames in parts)
    joined = np.empty(int(taken.sum()), FD_DTYPE if wide else CLASSIC_DTYPE)
    for rows, bus, frames in sorted(parts, key=lambda part: int(part[0][0]) if len(part[0]) else 0):
        if len(rows):
            frames["bus"] = report.bus(bus)
            joined[position[rows]] = FrameBatch(frames, ()).widened().frames if wide else frames
    numbers = np.flatnonzero(taken)
    report.note_frames(joined, lambda i: f"line {first_line + numbers[i]}")
    return FrameBatch(joined, tuple(report.buses))


def _note_unread(lines: _Lines, unread: list[Rows], first_line: int, report: LogReport) -> None:
    for row in np.sort(np.concatenate([*unread, np.zeros(0, np.intp)])).tolist():
        line = lines.line(row).strip()
        if line and not line.startswith((b"#", b";", b"//")):
            shown = line[:80].decode("ascii", "backslashreplace")
            report.note_bad(f"line {first_line + row}", shown)


def write_candump(batches: Iterable[FrameBatch], path: str | Path) -> int:
    """Write frames as ``candump -L`` does: UTC seconds to the microsecond, bus, identifier, data.

    Nanoseconds are rounded; the direction of a frame is not written. Columns: ``(seconds.micros) bus id#data``.

    Parameters
    ----------
    path : str or Path
        A file that is there is replaced.

    Returns
    -------
    int
        Frames written.

    Raises
    ------
    RecordingError
        If the file cannot be written.
    DataError
        If a time is before 1970.
    """
    written = 0
    try:
        with Path(path).open("wb") as file:
            for batch in batches:
                for start in range(0, len(batch), _LINES):
                    file.write(candump_text(batch[start : start + _LINES]))
                written += len(batch)
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError.of("the log cannot be written", path, error.strerror or str(error)) from None
    return written


def candump_text(batch: FrameBatch) -> bytes:
    """Return the lines of a batch; see `write_candump`."""
    frames = batch.frames
    if len(frames) and frames["time_ns"].min() < 0:
        raise DataError.of("candump text has no times before 1970", found=f"{frames['time_ns'].min()} ns")
    flags = frames["flags"] & ~np.uint8(FrameFlag.TRANSMITTED)
    shape = frames["bus"].astype(np.uint32) << 16 | flags.astype(np.uint32) << 8 | frames["length"]
    shapes, shape_of = np.unique(shape, return_inverse=True)
    texts = [_lines(frames[shape_of == i], batch.buses) for i in range(len(shapes))]
    widths = np.array([text.shape[1] for text in texts], np.intp)[shape_of]
    ends = np.cumsum(widths)
    out = np.empty(int(ends[-1]) if len(ends) else 0, np.uint8)
    for i, text in enumerate(texts):
        starts = (ends - widths)[shape_of == i]
        out[starts[:, None] + np.arange(text.shape[1])] = text
    return out.tobytes()


def _lines(frames: FrameArray, buses: tuple[str, ...]) -> NDArray[np.uint8]:
    """Return frames of one bus, kind and length as characters, shape (n, width)."""
    flags, length = int(frames["flags"][0]), int(frames["length"][0])
    extended, error = bool(flags & FrameFlag.EXTENDED), bool(flags & FrameFlag.ERROR)
    seconds, micros = np.divmod((frames["time_ns"] + 500) // 1000, 10**6)
    can_id = frames["can_id"].astype(np.int64) | (_ERROR_BIT if error else 0)
    pieces: list[str | NDArray[np.uint8]] = [
        "(",
        _digits(seconds, 10),
        ".",
        _digits(micros, 6),
        f") {buses[int(frames['bus'][0])]} ",
    ]
    pieces += [_hexadecimal(can_id, 8 if extended or error else 3), "#"]
    if flags & FrameFlag.REMOTE:
        pieces.append(f"R{length}" if length else "R")
    else:
        if flags & FrameFlag.FD:
            brs, esi = bool(flags & FrameFlag.BITRATE_SWITCH), bool(flags & FrameFlag.ERROR_STATE)
            pieces.append(f"#{brs + 2 * esi}")
        data = frames["data"][:, :length]
        pieces.append(_HEX[np.stack([data >> 4, data & 15], axis=2)].reshape(len(frames), -1))
    pieces.append("\n")
    return np.concatenate([_broadcast(piece, len(frames)) for piece in pieces], axis=1)


def _digits(values: IntArray, count: int) -> NDArray[np.uint8]:
    powers = 10 ** np.arange(count - 1, -1, -1)
    return (values[:, None] // powers % 10 + ord("0")).astype(np.uint8)


def _hexadecimal(values: IntArray, count: int) -> NDArray[np.uint8]:
    characters: NDArray[np.uint8] = _HEX[values[:, None] >> 4 * np.arange(count - 1, -1, -1) & 15]
    return characters


def _broadcast(piece: str | NDArray[np.uint8], rows: int) -> NDArray[np.uint8]:
    if isinstance(piece, str):
        return np.broadcast_to(np.frombuffer(piece.encode(), np.uint8), (rows, len(piece.encode())))
    return piece
