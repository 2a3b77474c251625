"""BLF (Vector's binary log): zlib containers taken apart as columns.

Layout after Toby Lorenz' vector_blf, as python-can uses it. This file finds the objects; `daq.logs.blf_objects`
turns them into frames.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from daq.errors import Fault, RecordingError
from daq.frames import FrameBatch
from daq.logs.blf_objects import HEADER, frames_of, structures
from daq.logs.report import LogReport

MAGIC = b"LOBJ"
_MAGIC_NUMBER = int.from_bytes(MAGIC, "little")
_FILE_HEADER = struct.Struct("<4sL8xQQLL8H16x")
_CONTAINER_HEADER = struct.Struct("<4sHHLLH6xL4x")
_CONTAINER = 10
_UNCOMPRESSED, _ZLIB = 0, 2
_GROUP_BYTES = 1 << 20
_LARGEST_BYTES = 64 << 20
_PADDING = 4

Places = NDArray[np.intp]


def read_blf(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a BLF file, a megabyte of objects at a time."""
    start_ns = _start_ns(file, report)
    carry, done = b"", 0
    room = np.empty(2 * _GROUP_BYTES, np.uint8)
    for after_a_gap, pieces in _grouped(_containers(file, report), report):
        carry = b"" if after_a_gap else carry
        text, room = _joined([carry, *pieces], room)
        starts, end = _object_starts(text, done, report)
        yield from frames_of(text, starts, start_ns, done, report)
        carry, done = text[end:].tobytes(), done + end
        if len(carry) > _LARGEST_BYTES:
            report.note_bad(_where(done), f"no object ends within {len(carry)} bytes")
            carry, done = b"", done + len(carry)
    if MAGIC in carry:
        report.note_bad(_where(done), "the file ends within this object")


def _start_ns(file: BinaryIO, report: LogReport) -> int:
    """Read the file header; return the start of the measurement (python-can, too, takes it for UTC)."""
    head = file.read(_FILE_HEADER.size)
    if len(head) < _FILE_HEADER.size:
        raise RecordingError(
            Fault("the BLF file ends within its header", report.path, f"{len(head)} bytes", next_step="copy it again")
        )
    fields = _FILE_HEADER.unpack(head)
    file.read(min(max(fields[1] - len(head), 0), _LARGEST_BYTES))
    year, month, _, day, hour, minute, second, millisecond = (int(field) for field in fields[6:14])
    try:
        start = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return 0
    return int(start.timestamp()) * 10**9 + millisecond * 10**6


def _containers(file: BinaryIO, report: LogReport) -> Iterator[tuple[str, int, bytes]]:
    """Yield where each container is, its compression method and its content."""
    while True:
        where = f"byte {file.tell()} of the file"
        head = file.read(_CONTAINER_HEADER.size)
        if not head.strip(b"\0"):
            return
        if len(head) < _CONTAINER_HEADER.size or not head.startswith(MAGIC):
            report.note_bad(where, "no container starts here; the rest of the file is left out")
            return
        _, _, _, size, kind, method, _ = _CONTAINER_HEADER.unpack(head)
        if not len(head) <= size <= _LARGEST_BYTES:
            report.note_bad(where, f"the length of this container is {size}; the rest of the file is left out")
            return
        body = file.read(size - len(head))
        missing = size - len(head) - len(body)
        file.read(size % _PADDING)
        if missing > 0:
            report.note_bad(where, f"the file ends within this container: {missing} bytes are missing")
        if kind == _CONTAINER:
            yield where, method, body
        else:
            report.note_skipped(f"object of type {kind} outside of a container")


def _unpack(method: int, body: bytes) -> bytes | str:
    """Return what is in a container, or why it is lost."""
    if method == _UNCOMPRESSED:
        return body
    if method != _ZLIB:
        return f"this container has an unknown compression method, {method}"
    try:
        return zlib.decompressobj().decompress(body, _LARGEST_BYTES)
    except zlib.error as error:
        return f"this container cannot be decompressed ({error})"


def _grouped(containers: Iterator[tuple[str, int, bytes]], report: LogReport) -> Iterator[tuple[bool, list[bytes]]]:
    """Yield the contents of containers together, so that the price of a numpy call is paid for thousands of objects.

    The flag says whether a container just before them is lost.
    """
    pending: list[bytes] = []
    after_a_gap = False
    for where, method, body in containers:
        piece = _unpack(method, body)
        if isinstance(piece, bytes):
            pending.append(piece)
            if sum(map(len, pending)) < _GROUP_BYTES:
                continue
        else:
            report.note_bad(where, piece)
        yield after_a_gap, pending
        pending, after_a_gap = [], isinstance(piece, str)
    yield after_a_gap, pending


def _joined(pieces: list[bytes], room: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Join into memory that is used again each time, which spares the system half of the work."""
    size = sum(map(len, pieces))
    if size > len(room):
        room = np.empty(2 * size, np.uint8)
    at = 0
    for piece in pieces:
        room[at : at + len(piece)] = np.frombuffer(piece, np.uint8)
        at += len(piece)
    return room[:size], room


def _object_starts(text: NDArray[np.uint8], done: int, report: LogReport) -> tuple[Places, int]:
    """Return where the complete objects start, and up to where the bytes have been used."""
    alike = _alike(text)
    used = int(alike[1]) * len(alike) if len(alike) > 1 else 0
    others, end = _search(text[used:], done + used, report)
    return np.concatenate((alike if used else alike[:0], others + used)), end + used


def _alike(text: NDArray[np.uint8]) -> Places:
    """Return where the objects start that all have the length of the first one, as most logs' have."""
    if len(text) < HEADER.itemsize:
        return np.zeros(0, np.intp)
    size = int(structures(text, np.zeros(1, np.intp), HEADER)["size"][0])
    if size < HEADER.itemsize or size % _PADDING:
        return np.zeros(0, np.intp)
    starts = np.arange(0, len(text) - size + 1, size)
    head = structures(text, starts, HEADER)
    same = (head["magic"] == _MAGIC_NUMBER) & (head["size"] == size)
    return starts if same.all() else starts[: int(np.argmin(same))]


def _search(text: NDArray[np.uint8], done: int, report: LogReport) -> tuple[Places, int]:
    """Look for the magic bytes that an object starts with; see `_object_starts`."""
    found = np.flatnonzero(text[: max(len(text) - HEADER.itemsize + 1, 0)] == MAGIC[0])
    for offset in range(1, len(MAGIC)):
        found = found[text[found + offset] == MAGIC[offset]]
    if not len(found):
        return found, 0
    ends = found + structures(text, found, HEADER)["size"].astype(np.intp)
    gaps = found - np.concatenate(([0], ends[:-1]))
    if gaps.min() < 0 or gaps.max() > _PADDING or (ends - found).min() < HEADER.itemsize:
        found, ends = _walk(found, ends, done, report)
        if not len(found):
            return found, len(text)
    if ends[-1] > len(text):
        return found[:-1], int(found[-1])
    return found, int(ends[-1])


def _walk(found: Places, ends: Places, done: int, report: LogReport) -> tuple[Places, Places]:
    """Go from object to object: a payload may hold the magic bytes, and a damaged object has no right length."""
    chain: list[int] = []
    i, expected = 0, 0
    while i < len(found):
        size = int(ends[i] - found[i])
        if found[i] - expected > _PADDING:
            report.note_bad(_where(done + expected), "no object starts here")
        if HEADER.itemsize <= size <= _LARGEST_BYTES:
            chain.append(i)
            expected = int(ends[i])
            i = int(np.searchsorted(found, expected))
        else:
            report.note_bad(_where(done + int(found[i])), f"the length of this object is {size}")
            i += 1
            expected = int(found[i]) if i < len(found) else expected
    return found[chain], ends[chain]


def _where(byte: int) -> str:
    return f"byte {byte} of the uncompressed data"
