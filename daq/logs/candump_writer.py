"""Frames -> candump -L text, all lines of one shape at a time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault, RecordingError
from daq.frames import FrameArray, FrameBatch, FrameFlag

_HEX = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_ERROR_BIT = 0x2000_0000
_SECOND_DIGITS = 10
_LINES = 65_536
Characters = NDArray[np.uint8]


def write_candump(batches: Iterable[FrameBatch], path: str | Path) -> int:
    """Write frames as ``candump -L`` does: UTC seconds to the microsecond, bus, identifier, data.

    Nanoseconds are rounded; the direction of a frame is not written. Columns: ``(seconds.micros) bus id#data``.

    Parameters
    ----------
    batches : iterable of FrameBatch
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
        raise RecordingError(Fault("the log cannot be written", str(path), error.strerror or str(error))) from None
    return written


def candump_text(batch: FrameBatch) -> bytes:
    """Return the lines of a batch; see `write_candump`."""
    frames = batch.frames
    if len(frames) and frames["time_ns"].min() < 0:
        raise DataError(Fault("candump text has no times before 1970", found=f"{frames['time_ns'].min()} ns"))
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


def _lines(frames: FrameArray, buses: tuple[str, ...]) -> Characters:
    """Return frames of one bus, kind and length as characters, shape (n, width)."""
    flags, length = int(frames["flags"][0]), int(frames["length"][0])
    extended, error = bool(flags & FrameFlag.EXTENDED), bool(flags & FrameFlag.ERROR)
    seconds, micros = np.divmod((frames["time_ns"] + 500) // 1000, 10**6)
    can_id = frames["can_id"].astype(np.int64) | (_ERROR_BIT if error else 0)
    pieces: list[str | Characters] = [
        "(",
        _digits(seconds, _SECOND_DIGITS),
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


def _digits(values: NDArray[np.int64], count: int) -> Characters:
    powers = 10 ** np.arange(count - 1, -1, -1)
    return (values[:, None] // powers % 10 + ord("0")).astype(np.uint8)


def _hexadecimal(values: NDArray[np.int64], count: int) -> Characters:
    characters: Characters = _HEX[values[:, None] >> 4 * np.arange(count - 1, -1, -1) & 15]
    return characters


def _broadcast(piece: str | Characters, rows: int) -> Characters:
    if isinstance(piece, str):
        return np.broadcast_to(np.frombuffer(piece.encode(), np.uint8), (rows, len(piece.encode())))
    return piece
