"""candump -L text, read and written a block of lines at a time (see `daq.logs.shapes`)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from daq import BoolArray, DataError, IntArray, RecordingError
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch, FrameFlag
from daq.logs.report import LogReport
from daq.logs.shapes import Nibbles, Varying, data_bytes, number, read_lines

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

_ERROR_BIT = 0x2000_0000
_LAST_SECOND = 9_000_000_000
_HEX = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_LINES = 65_536
_LARGEST = {"seconds": 9, "fraction": 9, "remote": 8, "id": 15, "fd": 15, "data": 15, "fd_data": 15}


class _Candump:
    """The grammar of ``candump -L``."""

    match = staticmethod(LINE.match)

    def varying(self, match: re.Match[bytes]) -> list[Varying]:
        return [Varying(*match.span(name), largest) for name, largest in _LARGEST.items()]

    def buses(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[str, None]:
        return match["bus"].decode("utf-8", "replace"), None

    def kind_of(self, line: bytes) -> str | None:
        return "" if line.startswith((b"#", b";", b"//")) else None

    def frames(self, nibbles: Nibbles, match: re.Match[bytes]) -> tuple[FrameArray, BoolArray]:
        is_fd, is_remote = match["fd"] is not None, match["remote"] is not None
        frames = np.zeros(len(nibbles), FD_DTYPE if is_fd else CLASSIC_DTYPE)
        seconds, can_id = number(nibbles, match.span("seconds"), 10), number(nibbles, match.span("id"), 16)
        fraction = number(nibbles, match.span("fraction"), 10)
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
            frames["length"] = number(nibbles, match.span("remote"), 10)
        else:
            start, end = match.span("fd_data" if is_fd else "data")
            spans = [(at, at + 2) for at in range(start, end, 2)]
            frames["length"] = len(spans)
            frames["data"][:, : len(spans)] = data_bytes(nibbles, spans)
        return frames, (seconds < _LAST_SECOND) & (can_id < 2 * _ERROR_BIT if extended else can_id <= 0x7FF)


def read_candump(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a candump log, a few megabytes of text at a time."""
    return read_lines(file, _Candump(), report)


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
