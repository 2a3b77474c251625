"""Text logs read as columns: lines that look alike are taken apart together.

A grammar matches one line and says which of its characters may vary, and within which digits. All lines of the same
length that have the same characters in the other places, and such digits in these, are taken apart as columns. A log
has a few dozen such shapes. Every line is accounted for: it is a frame, or known to be none, or counted as unreadable.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Sequence
from string import hexdigits
from typing import BinaryIO, NamedTuple, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from daq.arrays import BoolArray, IndexArray, IntArray
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch
from daq.gunzip import Gunzip
from daq.logs.report import EMPTY, HEADERS, LogReport

BLOCK_BYTES = 4 << 20
LONGEST_LINE = 1024
"""A longer line is no frame."""
_LONGEST_CARRY = 1 << 20
_SHAPES_A_LENGTH = 16
_WORD = 8
_LOW_NIBBLES = np.uint64(0x0F0F_0F0F_0F0F_0F0F)
_SHOWN = 80
_LOOKED_AT = 256
"""How many bytes of a line that is no frame name its kind."""

_WORDS = re.compile(rb"\S+")

FREE = 255
"""Of a character that may be anything."""

_NIBBLES = bytes(int(chr(code), 16) if chr(code) in hexdigits else 0xFF for code in range(256))
"""Value of each hexadecimal digit."""

Rows = IndexArray
"""Line numbers within a block, ascending."""
Nibbles = NDArray[np.uint8]
"""The value of each character that is a hexadecimal digit, shape (lines, length or more)."""
Span = tuple[int, int]


class Varying(NamedTuple):
    """Characters that may vary from line to line: digits up to `largest`, or (`FREE`) anything."""

    start: int
    end: int
    largest: int


class Grammar(Protocol):
    """What lines are frames, and how they are taken apart."""

    def match(self, line: bytes) -> re.Match[bytes] | None:
        """Match one frame."""

    def varying(self, match: re.Match[bytes]) -> Sequence[Varying]:
        """Return what may vary in lines that look like this one."""

    def frames(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
        """Return the frames of lines that look alike, and which of them are possible."""

    def buses(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[str, IntArray | None]:
        """Return the name of the bus, or what it begins with and its number in each line."""

    def kind_of(self, line: bytes) -> str | None:
        """Return what a line is that is no frame: "" for a comment, header or the like, None for nothing known."""


class _Part(NamedTuple):
    """Frames of one shape: the rows they come from, their bus, and themselves."""

    rows: Rows
    bus: str
    frames: FrameArray


def text_blocks(file: BinaryIO, report: LogReport) -> Iterator[bytes]:
    """Yield whole lines, a few megabytes at a time; the last one ends in a line feed, too.

    A line within which a damaged file ends is lost.
    """
    carry = b""
    while block := file.read(BLOCK_BYTES):
        block = carry + block
        end = block.rfind(b"\n") + 1
        if not end and len(block) < _LONGEST_CARRY:
            carry = block
            continue
        end = end or len(block)  # this is no text; it is not gathered for ever
        carry = block[end:]
        yield block[:end]
    if not carry:
        return
    raw = getattr(file, "raw", None)
    if isinstance(raw, Gunzip) and raw.damage:
        report.balance.come("lines", 1)
        report.balance.lose("that the file ends within")
    else:
        yield carry + b"\n"


def read_lines(file: BinaryIO, grammar: Grammar, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a text log, a few megabytes of text at a time."""
    first_line = 1
    for block in text_blocks(file, report):
        first_line = yield from frames_of(block, first_line, grammar, report)


def frames_of(block: bytes, first_line: int, grammar: Grammar, report: LogReport) -> Generator[FrameBatch, None, int]:
    """Yield the frames of whole lines; return the number of the line after them."""
    lines = Lines(block)
    report.balance.come("lines", len(lines.start))
    parts: list[_Part] = []
    unread: list[Rows] = []
    for rows in _by_length(lines.length):
        found, left = _read_equally_long(lines, rows, grammar)
        parts.extend(found)
        unread.append(left)
    report.balance.put_aside(EMPTY, int(np.count_nonzero(lines.length == 0)))
    _note_unread(lines, unread, first_line, grammar, report)
    if any(len(part.rows) for part in parts):
        yield _join(parts, lines, first_line, report)
    return first_line + len(lines.start)


class Lines:
    """The lines of a block: where they start, how long they are, and the value of each hexadecimal digit."""

    def __init__(self, block: bytes) -> None:
        spare = bytes(LONGEST_LINE + _WORD)
        self.text = np.frombuffer(block + spare, np.uint8)
        self.nibbles = np.frombuffer(block.translate(_NIBBLES) + spare, np.uint8)
        ends = np.flatnonzero(self.text[: len(block)] == ord("\n"))
        if not len(ends) or ends[-1] != len(block) - 1:
            ends = np.append(ends, len(block))
        self.start = np.concatenate(([0], ends[:-1] + 1))
        self.length = ends - self.start

    def line(self, row: int, most: int = LONGEST_LINE) -> bytes:
        """Return a line, or its beginning."""
        start = self.start[row]
        return self.text[start : start + min(self.length[row], most)].tobytes()


def _by_length(length: Rows) -> Iterator[Rows]:
    order = np.argsort(length, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(length[order])) + 1):
        if length[rows[0]]:
            yield rows


def _read_equally_long(lines: Lines, rows: Rows, grammar: Grammar) -> tuple[list[_Part], Rows]:
    """Return the frames of lines of one length, and the rows that are no frames."""
    parts: list[_Part] = []
    if lines.length[rows[0]] > LONGEST_LINE:
        return parts, rows
    unread: list[int] = []
    for _ in range(_SHAPES_A_LENGTH):
        middle = len(rows) // 2  # numbers have more digits there than at the begin: most lines look like it
        match = grammar.match(lines.line(int(rows[middle])))
        found, refused, others = _read_shape(lines, rows, match, grammar) if match else ([], rows, rows)
        if match is None or not any(len(part.rows) for part in found):
            unread.append(int(rows[middle]))  # of an impossible line what looks like it may be read otherwise
            rows = np.delete(rows, middle)
        else:
            parts.extend(found)
            unread.extend(refused.tolist())
            rows = others
        if not len(rows):
            return parts, np.array(unread, np.intp)
    shapes: dict[object, tuple[re.Match[bytes], list[int]]] = {}
    for row in rows.tolist():  # unusual lines: each is matched by itself
        match = grammar.match(lines.line(row))
        if match is None:
            unread.append(row)
        else:
            shapes.setdefault((match.regs, _fixed(match, grammar)), (match, []))[1].append(row)
    for match, alike in shapes.values():
        found, refused, others = _read_shape(lines, np.array(alike), match, grammar)
        parts.extend(found)
        unread.extend(np.concatenate((refused, others)).tolist())
    return parts, np.array(unread, np.intp)


def _fixed(match: re.Match[bytes], grammar: Grammar) -> bytes:
    """Return the characters of a line that may not vary."""
    line = bytearray(match.string)
    for start, end, _ in grammar.varying(match):
        line[start:end] = bytes(end - start)
    return bytes(line)


def _read_shape(lines: Lines, rows: Rows, match: re.Match[bytes], grammar: Grammar) -> tuple[list[_Part], Rows, Rows]:
    """Return the frames of the rows that look like `match`, those of them that are impossible, and the other rows.

    Eight characters are compared at once. A digit d is too large where d + (127 - largest) reaches the eighth bit.
    """
    width = -(-len(match.string) // _WORD) * _WORD
    fixed, digit, excess = (np.zeros(width, np.uint8) for _ in range(3))
    fixed[: len(match.string)] = 0xFF
    for start, end, largest in grammar.varying(match):
        fixed[start:end] = 0
        if largest != FREE:
            digit[start:end], excess[start:end] = 0x80, 0x7F - largest
    template = np.frombuffer(match.string.ljust(width, b"\0"), np.uint8)
    starts = lines.start[rows]
    nibbles = sliding_window_view(lines.nibbles, width)[starts]
    words = nibbles.view(np.uint64)
    differs = sliding_window_view(lines.text, width)[starts].view(np.uint64)
    differs ^= template.view(np.uint64)
    differs &= fixed.view(np.uint64)
    wrong = words & _LOW_NIBBLES
    wrong += excess.view(np.uint64)
    wrong |= words
    wrong &= digit.view(np.uint64)
    differs |= wrong
    alike = np.bitwise_or.reduce(differs, axis=1) == 0
    whole = bool(alike.all())
    values, chosen, others = (nibbles, rows, rows[:0]) if whole else (nibbles[alike], rows[alike], rows[~alike])
    frames, sane = grammar.frames(values, match)
    name, numbers = grammar.buses(values, match)
    if not sane.all():
        refused, chosen, frames = chosen[~sane], chosen[sane], frames[sane]
        numbers = None if numbers is None else numbers[sane]
    else:
        refused = rows[:0]
    if numbers is None:
        return [_Part(chosen, name, frames)], refused, others
    found = np.unique(numbers).tolist()
    if len(found) == 1:
        return [_Part(chosen, f"{name}{found[0]}", frames)], refused, others
    parts = [_Part(chosen[numbers == bus], f"{name}{bus}", frames[numbers == bus]) for bus in found]
    return parts, refused, others


def number(nibbles: Nibbles, span: Span, base: int) -> IntArray:
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


def byte_spans(match: re.Match[bytes]) -> list[Span]:
    """Return where each word of the group "data" lies; none where a line has no data."""
    start, end = match.span("data")
    return [word.span() for word in _WORDS.finditer(match.string, start, end)] if start >= 0 else []


def data_bytes(nibbles: Nibbles, spans: Sequence[Span]) -> NDArray[np.uint8]:
    """Return the bytes whose two digits lie at each span, shape (lines, spans)."""
    first = np.array([start for start, _ in spans], np.intp)
    step = int(first[1] - first[0]) if len(first) > 1 else 1
    if len(first) and (np.diff(first) == step).all():
        columns = slice(int(first[0]), int(first[-1]) + 1, step)
        return np.asarray(nibbles[:, columns] << 4 | nibbles[:, columns.start + 1 : columns.stop + 1 : step])
    return np.asarray(nibbles[:, first] << 4 | nibbles[:, first + 1])


def _join(parts: list[_Part], lines: Lines, first_line: int, report: LogReport) -> FrameBatch:
    """Put the frames of all shapes back into the order of their lines."""
    taken = np.zeros(len(lines.start), bool)
    for part in parts:
        taken[part.rows] = True
    position = np.cumsum(taken) - 1
    wide = any(part.frames.dtype == FD_DTYPE for part in parts)
    joined = np.empty(int(taken.sum()), FD_DTYPE if wide else CLASSIC_DTYPE)
    for rows, bus, frames in sorted(parts, key=lambda part: int(part.rows[0]) if len(part.rows) else 0):
        if len(rows):
            frames["bus"] = report.bus(bus)
            joined[position[rows]] = FrameBatch(frames, ()).widened().frames if wide else frames
    numbers = np.flatnonzero(taken)
    report.note_frames(joined, lambda i: f"line {first_line + numbers[i]}")
    return FrameBatch(joined, tuple(report.buses))


def _note_unread(lines: Lines, unread: list[Rows], first_line: int, grammar: Grammar, report: LogReport) -> None:
    for row in np.sort(np.concatenate([*unread, np.zeros(0, np.intp)])).tolist():
        line = lines.line(row, _LOOKED_AT).strip()
        kind = grammar.kind_of(line) if line else ""
        if kind is None:
            report.note_bad(f"line {first_line + row}", line[:_SHOWN].decode("ascii", "backslashreplace"))
        else:
            report.note_skipped(kind or (HEADERS if line else EMPTY))
