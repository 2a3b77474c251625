"""BLF (Vector's binary log): zlib containers and the CAN frames in them, as columns.

Layout after Toby Lorenz' vector_blf, as python-can uses it.
"""

from __future__ import annotations

import importlib
import re
import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import cache
from types import ModuleType
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from daq import IndexArray, RecordingError
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FD_LENGTHS, FrameArray, FrameBatch, FrameFlag
from daq.limits import LARGEST_BLF_CONTAINER_BYTES, MOST_DAMAGED_PARTS
from daq.logs.report import LogReport

MAGIC = b"LOBJ"
_MAGIC_NUMBER = int.from_bytes(MAGIC, "little")
_FILE_HEADER = struct.Struct("<4sL8xQQLL8H16x")
_CONTAINER_HEADER = struct.Struct("<4sHHLLH6xL4x")
_CONTAINER = 10
_UNCOMPRESSED, _ZLIB = 0, 2
_GROUP_BYTES = 1 << 20
_CONTAINER_BEGIN = re.compile(rb"LOBJ\x10\0..[\0-\xff]{4}\x0a\0\0\0[\0\x02]\0", re.DOTALL)
_SEARCHED_BYTES = 1 << 20
_PADDING = 4
_YEARS = (1970, 2261)
_LATEST_NS = (1 << 63) - 1
"""Times in nanoseconds end in the year 2262."""


def _layout(itemsize: int, /, **fields: tuple[int, str]) -> np.dtype[np.void]:
    offsets, formats = zip(*fields.values(), strict=True)
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": itemsize})


HEADER = _layout(
    32, magic=(0, "<u4"), version=(6, "<u2"), size=(8, "<u4"), type=(12, "<u4"), flags=(16, "<u4"), ticks=(24, "<u8")
)
"""Common to header versions 1 (32 bytes) and 2 (40 bytes)."""
_HEADER_SIZES = {1: 32, 2: 40}
_TICK_IS_TEN_US = 1

_MESSAGE = _layout(16, channel=(0, "<u2"), flags=(2, "u1"), dlc=(3, "u1"), id=(4, "<u4"), data=(8, "<u8"))
_ERROR = _layout(32, channel=(0, "<u2"), dlc=(10, "u1"), id=(16, "<u4"), data=(24, "<u8"))
_FD = _layout(
    84,
    channel=(0, "<u2"),
    flags=(2, "u1"),
    dlc=(3, "u1"),
    id=(4, "<u4"),
    fd_flags=(13, "u1"),
    valid=(14, "u1"),
    data=(20, "(64,)u1"),
)
_FD_64 = _layout(
    104,
    channel=(0, "u1"),
    dlc=(1, "u1"),
    valid=(2, "u1"),
    id=(4, "<u4"),
    fd_flags=(12, "<u4"),
    direction=(34, "u1"),
    extension_at=(35, "u1"),
    data=(40, "(64,)u1"),
)
_LAYOUTS = {1: _MESSAGE, 86: _MESSAGE, 73: _ERROR, 100: _FD, 101: _FD_64}
"""CAN_MESSAGE, CAN_MESSAGE2, CAN_ERROR_EXT, CAN_FD_MESSAGE, CAN_FD_MESSAGE_64."""
_FD_KINDS = (100, 101)
_FIRST_BYTES = np.array([(1 << 8 * count) - 1 for count in range(9)], np.uint64)
_LENGTH_OF_DLC = np.array(FD_LENGTHS, np.uint8)


def structures(text: NDArray[np.uint8], starts: IndexArray, layout: np.dtype[np.void]) -> FrameArray:
    """Return the structures at `starts`; what lies beyond the end of `text` is zero."""
    size = layout.itemsize
    if not len(starts):
        return np.zeros(0, layout)
    if starts[-1] + size > len(text):
        text = np.concatenate((text, np.zeros(size, np.uint8)))
    windows = sliding_window_view(text, size)
    step = int(starts[1] - starts[0]) if len(starts) > 1 else 1
    if step and (np.diff(starts) == step).all():
        return windows[starts[0] : starts[-1] + 1 : step].view(layout)[:, 0]
    return windows[starts].view(layout)[:, 0]


def frames_of(
    text: NDArray[np.uint8], starts: IndexArray, start_ns: int, done: int, report: LogReport
) -> Iterator[FrameBatch]:
    """Yield the objects that are CAN frames (at most one batch); `done` bytes came before `text`."""
    header = structures(text, starts, HEADER)
    report.balance.come("objects", len(starts))
    kinds = {kind: chosen for kind in _LAYOUTS if (chosen := header["type"] == kind).any()}
    if sum(map(np.count_nonzero, kinds.values())) < len(header):
        others, counts = np.unique(header["type"][~np.isin(header["type"], list(kinds))], return_counts=True)
        for kind, count in zip(others.tolist(), counts.tolist(), strict=True):
            report.note_skipped(f"object of type {kind}", count)
    head_size = _head_size(header["version"])
    room = header["size"].astype(np.intp) - head_size
    wide = any(kind in _FD_KINDS for kind in kinds)
    frames = np.zeros(len(starts), FD_DTYPE if wide else CLASSIC_DTYPE)
    channel = np.full(len(starts), -1, np.int32)
    for kind, chosen in kinds.items():
        short = chosen & ((room < _least_size(kind)) | (head_size == 0))
        if short.any():
            where = f"byte {done + int(starts[short][0])} of the uncompressed data"
            report.note_bad(where, f"too short for an object of type {kind}", int(short.sum()))
            chosen &= ~short
        at = slice(None) if chosen.all() else np.flatnonzero(chosen)
        rows = structures(text, starts[at] + head_size[at], _LAYOUTS[kind])
        columns = _columns(rows, kind, _data_bytes(rows, kind, room[at], head_size[at]))
        for name, column in columns.items():
            target = _first_eight_bytes(frames) if column.dtype == np.uint64 else frames[name]
            target[at] = column
        channel[at] = rows["channel"]
    frames["time_ns"] = header["ticks"]
    in_ten_us = header["flags"] == _TICK_IS_TEN_US
    if int(header["ticks"].max(initial=0)) > (_LATEST_NS - start_ns) // 10_000:  # else no time can be out of range
        latest = np.where(in_ten_us, (_LATEST_NS - start_ns) // 10_000, _LATEST_NS - start_ns).astype(np.uint64)
        late = (header["ticks"] > latest) & (channel >= 0)
        channel[late] = -1
        if late.any():
            where = f"byte {done + int(starts[late][0])} of the uncompressed data"
            report.note_bad(where, "the time of this object is beyond the year 2262", int(late.sum()))
    frames["time_ns"][in_ten_us] *= 10_000
    frames["time_ns"] += start_ns
    if channel.min(initial=0) < 0:
        frames, channel = frames[channel >= 0], channel[channel >= 0]
    if len(frames):
        for number in _different(channel):
            np.copyto(frames["bus"], report.bus(f"can{max(number - 1, 0)}"), where=channel == number)
        report.note_frames(frames, lambda i: f"frame {report.frames + i + 1}")
        yield FrameBatch(frames, tuple(report.buses))


def _different(column: NDArray[np.int32] | NDArray[np.uint32] | NDArray[np.uint16]) -> list[int]:
    """Return the values in a column, in the order of their first appearance."""
    found: list[int] = []
    while len(column):
        found.append(int(column[0]))
        column = column[column != column[0]]
    return found


def _head_size(version: NDArray[np.uint16]) -> IndexArray:
    """Return the size of object headers, 0 for a version that nobody has described."""
    different = _different(version)
    sizes = np.full(len(version), _HEADER_SIZES.get(different[0], 0) if different else 0, np.intp)
    for other in different[1:]:
        sizes[version == other] = _HEADER_SIZES.get(other, 0)
    return sizes


def _least_size(kind: int) -> int:
    """Return the bytes that an object has after its header, at least: those for CAN FD leave out unused data."""
    layout = _LAYOUTS[kind]
    assert layout.fields is not None
    return layout.fields["data"][1] if kind in _FD_KINDS else layout.itemsize


def _data_bytes(rows: FrameArray, kind: int, size: IndexArray, head_size: IndexArray) -> NDArray[np.uint8] | int:
    """Return how many bytes of data there are in objects with `size` bytes after the header.

    The valid bytes of a CAN_FD_MESSAGE_64 may be more than that; CANoe pads with zeros (python-can issue 1905).
    """
    if kind != 101:
        return 64
    end = np.where(rows["extension_at"], rows["extension_at"] - head_size, size)
    room: NDArray[np.uint8] = np.clip(end - 40, 0, 64).astype(np.uint8)
    return room


def _columns(rows: FrameArray, kind: int, data_bytes: NDArray[np.uint8] | int) -> dict[str, NDArray[np.generic]]:
    """Return the columns of `FrameArray` that objects of one type hold."""
    flags = _flag(rows["id"], 0x8000_0000, FrameFlag.EXTENDED)
    if kind == 73:
        flags |= np.uint8(FrameFlag.ERROR)
    elif kind == 101:
        flags |= _flag(rows["fd_flags"], 0x1000, FrameFlag.FD) | _flag(rows["fd_flags"], 0x10, FrameFlag.REMOTE)
        flags |= _flag(rows["fd_flags"], 0x2000, FrameFlag.BITRATE_SWITCH)
        flags |= _flag(rows["fd_flags"], 0x4000, FrameFlag.ERROR_STATE)
        flags |= _flag(rows["direction"], 0xFF, FrameFlag.TRANSMITTED)
    else:
        flags |= _flag(rows["flags"], 0x80, FrameFlag.REMOTE) | _flag(rows["flags"], 1, FrameFlag.TRANSMITTED)
    if kind == 100:
        flags |= _flag(rows["fd_flags"], 1, FrameFlag.FD) | _flag(rows["fd_flags"], 2, FrameFlag.BITRATE_SWITCH)
        flags |= _flag(rows["fd_flags"], 4, FrameFlag.ERROR_STATE)
    remote = (flags & FrameFlag.REMOTE) != 0
    if kind in _FD_KINDS:
        length = np.where(remote, _LENGTH_OF_DLC[np.minimum(rows["dlc"], 15)], rows["valid"])
        length = np.where((flags & FrameFlag.FD) != 0, np.minimum(length, 64), np.minimum(length, 8))
    else:
        length = np.minimum(rows["dlc"], 8)
    present = np.minimum(length, data_bytes) * ~remote
    if kind in _FD_KINDS:
        data = rows["data"] * (np.arange(64, dtype=np.uint8) < present[:, None])
    else:
        data = rows["data"] if present.min(initial=8) == 8 else rows["data"] & _FIRST_BYTES[present]
    return {"can_id": rows["id"] & 0x1FFF_FFFF, "flags": flags, "length": length, "data": data}


def _first_eight_bytes(frames: FrameArray) -> NDArray[np.uint64]:
    """Return the first eight data bytes as one number each, which are moved ten times as fast."""
    offset = CLASSIC_DTYPE.itemsize - 8
    return frames.view(_layout(frames.dtype.itemsize, first=(offset, "<u8")))["first"]


def _flag(column: NDArray[np.uint32], mask: int, flag: FrameFlag) -> NDArray[np.uint8]:
    flags: NDArray[np.uint8] = ((column & mask) != 0) * np.uint8(flag)
    return flags


def read_blf(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a BLF file, a megabyte of objects at a time.

    A container is dropped whole unless its stream ends where it should and has the stated size, and no object is put
    together from bytes before and after a container that is damaged, or missing where the rest does not fit by chance.
    """
    start_ns, stated_bytes = _file_header(file, report)
    damaged: list[_Damaged] = []
    carry, done = b"", 0
    room = np.empty(2 * _GROUP_BYTES, np.uint8)
    for after_a_gap, pieces in _grouped(_contents(file, report, damaged)):
        parts = pieces if after_a_gap else [carry, *pieces]
        done, carry = (done + len(carry), b"") if after_a_gap else (done, carry)
        while parts:
            text, room = _joined(parts, room)
            starts, end, faults = _object_starts(text, done)
            in_line = _parts_in_line(text, starts, parts)
            if in_line < len(parts):
                text = text[: sum(map(len, parts[:in_line]))]
                starts, end, faults = _object_starts(text, done)
            for fault in faults:
                _note_lost_object(*fault, report)
            yield from frames_of(text, starts, start_ns, done, report)
            carry, done, parts = text[end:].tobytes(), done + end, parts[in_line:]
            if parts:
                _note_lost_object(_where(done), "this object does not go on in the next container", report)
                carry, done = b"", done + len(carry)
        if len(carry) > LARGEST_BLF_CONTAINER_BYTES:
            _note_lost_object(_where(done), f"no object ends within {len(carry)} bytes", report)
            carry, done = b"", done + len(carry)
    if file.tell() < stated_bytes:
        report.damage = f"the file is cut off: {file.tell():,} of {stated_bytes:,} bytes are there"
    if MAGIC in carry:
        _note_lost_object(_where(done), "the file ends within this object", report)
    for container in damaged:
        report.note_lost(container.where, f"{container.why}; {container.amount(done, report.frames)}")


def _note_lost_object(where: str, why: str, report: LogReport) -> None:
    """Count an object that has a beginning or an end only."""
    report.balance.come("objects", 1)
    report.note_bad(where, why)


class _Damaged(NamedTuple):
    """A container that is dropped; `unpacked` is the size that it states, 0 if that cannot be."""

    where: str
    why: str
    packed: int
    unpacked: int

    def amount(self, data_bytes: int, frames: int) -> str:
        """Return how much is lost, from the bytes of data per frame elsewhere in the file."""
        if not self.unpacked or not frames:
            return f"its {self.packed:,} bytes are lost"
        return f"about {max(round(self.unpacked * frames / data_bytes), 1):,} frames are lost"


def _file_header(file: BinaryIO, report: LogReport) -> tuple[int, int]:
    """Return the start of the measurement (python-can, too, takes it for UTC) and the stated size of the file."""
    head = file.read(_FILE_HEADER.size)
    if len(head) < _FILE_HEADER.size:
        what, found = "the BLF file ends within its header", f"{len(head)} bytes"
        raise RecordingError.of(what, report.path, found, next_step="copy it again")
    fields = _FILE_HEADER.unpack(head)
    file.read(min(max(fields[1] - len(head), 0), LARGEST_BLF_CONTAINER_BYTES))
    year, month, _, day, hour, minute, second, millisecond = (int(field) for field in fields[6:14])
    if not any(fields[6:14]):
        return 0, fields[2]
    try:
        start = datetime(year, month, day, hour, minute, second, millisecond * 1000, tzinfo=UTC)
        if not _YEARS[0] <= year <= _YEARS[1]:
            raise ValueError
    except ValueError:
        report.faults.append(f"the file header begins at no date that can be: year {year}, month {month}, day {day}")
        return 0, fields[2]
    return int(start.timestamp()) * 10**9 + millisecond * 10**6, fields[2]


class _Source:
    """A file that takes back what was read too far; `at` is the place in it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._ahead = b""
        self.at = file.tell()

    def read(self, size: int) -> bytes:
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        if len(data) < size:
            data += self._file.read(size - len(data))
        self.at += len(data)
        return data

    def put_back(self, data: bytes) -> None:
        self._ahead = data + self._ahead
        self.at -= len(data)

    def find_container(self) -> bool:
        """Go on to where the next container seems to begin; return whether there is one."""
        while len(block := self.read(_SEARCHED_BYTES)) >= _CONTAINER_HEADER.size:
            found = _CONTAINER_BEGIN.search(block)
            if found or len(block) == _SEARCHED_BYTES:
                self.put_back(block[found.start() if found else -_CONTAINER_HEADER.size :])
            if found:
                return True
        return False


def _contents(file: BinaryIO, report: LogReport, damaged: list[_Damaged]) -> Iterator[bytes | None]:
    """Yield what is in each container, None for one that is lost, which goes into `damaged`."""
    source, balance = _Source(file), report.file_bytes
    balance.come("bytes", source.at)
    balance.out += source.at
    while len(damaged) <= MOST_DAMAGED_PARTS:
        begin = source.at
        where = f"byte {begin} of the file"
        head = source.read(_CONTAINER_HEADER.size)
        if not head:
            return
        is_blank = not head.strip(b"\0")
        why = "only zeros" if is_blank else "no container starts here"
        if len(head) == _CONTAINER_HEADER.size and head.startswith(MAGIC):
            _, _, _, size, kind, method, unpacked = _CONTAINER_HEADER.unpack(head)
            why = "" if len(head) <= size <= LARGEST_BLF_CONTAINER_BYTES else f"the length of this container is {size}"
        if why:
            source.put_back(head[1:])
            goes_on = source.find_container()
            balance.come("bytes", source.at - begin)
            if is_blank and not goes_on:
                balance.put_aside("behind the last container", source.at - begin)
                return
            balance.lose("skipped", source.at - begin)
            skipped = f"{source.at - begin:,} bytes are" if goes_on else "the rest of the file is"
            report.note_lost(where, f"{why}; {skipped} skipped")
            yield None
            continue
        body = source.read(size - len(head) + size % _PADDING)
        balance.come("bytes", source.at - begin)
        if kind != _CONTAINER:
            balance.put_aside(f"in an object of type {kind} outside of a container", source.at - begin)
            continue
        content = _unpack(method, body[: size - len(head)], unpacked)
        if (missing := size - len(head) - len(body)) > 0:
            content = f"the file ends within this container: {missing} bytes are missing"
        if isinstance(content, bytes):
            balance.out += source.at - begin
            yield content
            continue
        damaged.append(_Damaged(where, content, len(body), unpacked if unpacked <= LARGEST_BLF_CONTAINER_BYTES else 0))
        if another := _CONTAINER_BEGIN.search(body):  # its length is what is damaged
            source.put_back(body[another.start() :])
            balance.come("bytes", another.start() - len(body))
        balance.lose("in damaged containers", source.at - begin)
        yield None
    while rest := len(source.read(_SEARCHED_BYTES)):
        balance.come("bytes", rest)
        balance.lose(f"behind more than {MOST_DAMAGED_PARTS} damaged containers", rest)


@cache
def _inflate() -> ModuleType:
    """Return what unpacks: isal, an extra, is 1.7 times as fast as zlib."""
    try:
        return importlib.import_module("isal.isal_zlib")
    except ImportError:
        return zlib


def _unpack(method: int, body: bytes, size: int) -> bytes | str:
    """Return what is in a container that states this unpacked size, or why it is lost."""
    if method not in (_UNCOMPRESSED, _ZLIB):
        return f"this container has an unknown compression method, {method}"
    if size > LARGEST_BLF_CONTAINER_BYTES:
        return f"this container states that it holds {size} bytes"
    if method == _UNCOMPRESSED:
        content = body
        if _CONTAINER_BEGIN.search(body):
            return "this container holds the beginning of another one"
    else:
        inflate = _inflate()
        stream = inflate.decompressobj()
        try:
            content = stream.decompress(body, size + 1)
        except inflate.error as error:
            return f"this container cannot be decompressed ({error})"
        if not stream.eof and len(content) <= size:
            return f"this container breaks off after {len(content)} of {size} bytes"
    if len(content) != size:
        more = "more" if len(content) > size else f"{len(content)}"
        return f"this container states that it holds {size} bytes, and holds {more}"
    return content


def _grouped(contents: Iterator[bytes | None]) -> Iterator[tuple[bool, list[bytes]]]:
    """Yield the contents of containers together, so that the price of a numpy call is paid for thousands of objects.

    The flag says whether a container just before them is lost.
    """
    pending: list[bytes] = []
    after_a_gap = False
    for piece in contents:
        if piece is not None:
            pending.append(piece)
            if sum(map(len, pending)) < _GROUP_BYTES:
                continue
        yield after_a_gap, pending
        pending, after_a_gap = [], piece is None
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


def _parts_in_line(text: NDArray[np.uint8], starts: IndexArray, parts: list[bytes]) -> int:
    """Return how many parts follow on one another: an object over a seam must be followed by one, or by the end.

    Else what a part begins with is not the rest of the object that the part before ends with.
    """
    seams = np.cumsum([len(part) for part in parts])[:-1]
    over = np.searchsorted(starts, seams) - 1
    known = over >= 0
    ends = starts[over[known]] + structures(text, starts[over[known]], HEADER)["size"].astype(np.intp)
    for number, seam, end in zip(np.flatnonzero(known) + 1, seams[known], ends, strict=True):
        behind = text[end : end + _PADDING + len(MAGIC) - 1].tobytes()
        if end > seam and len(behind) >= len(MAGIC) and MAGIC not in behind:
            return int(number)
    return len(parts)


_Faults = list[tuple[str, str]]  # where in the data an object cannot be read, and why


def _object_starts(text: NDArray[np.uint8], done: int) -> tuple[IndexArray, int, _Faults]:
    """Return where the complete objects start, up to where the bytes have been used, and what is wrong."""
    equal = _equally_long(text)
    used = int(equal[1]) * len(equal) if len(equal) > 1 else 0
    faults: _Faults = []
    others, end = _search(text[used:], done + used, faults)
    return np.concatenate((equal if used else equal[:0], others + used)), end + used, faults


def _equally_long(text: NDArray[np.uint8]) -> IndexArray:
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


def _search(text: NDArray[np.uint8], done: int, faults: _Faults) -> tuple[IndexArray, int]:
    """Look for the magic bytes that an object starts with; see `_object_starts`."""
    found = np.flatnonzero(text[: max(len(text) - HEADER.itemsize + 1, 0)] == MAGIC[0])
    for offset in range(1, len(MAGIC)):
        found = found[text[found + offset] == MAGIC[offset]]
    if not len(found):
        return found, 0
    ends = found + structures(text, found, HEADER)["size"].astype(np.intp)
    gaps = found - np.concatenate(([0], ends[:-1]))
    if gaps.min() < 0 or gaps.max() > _PADDING or (ends - found).min() < HEADER.itemsize:
        found, ends = _walk(found, ends, done, faults)
        if not len(found):
            return found, len(text)
    if ends[-1] > len(text):
        return found[:-1], int(found[-1])
    return found, int(ends[-1])


def _walk(found: IndexArray, ends: IndexArray, done: int, faults: _Faults) -> tuple[IndexArray, IndexArray]:
    """Go from object to object: a payload may hold the magic bytes, and a damaged object has no right length."""
    chain: list[int] = []
    i, expected = 0, 0
    while i < len(found):
        size = int(ends[i] - found[i])
        if found[i] - expected > _PADDING:
            faults.append((_where(done + expected), "no object starts here"))
        if HEADER.itemsize <= size <= LARGEST_BLF_CONTAINER_BYTES:
            chain.append(i)
            expected = int(ends[i])
            i = int(np.searchsorted(found, expected))
        else:
            faults.append((_where(done + int(found[i])), f"the length of this object is {size}"))
            i += 1
            expected = int(found[i]) if i < len(found) else expected
    return found[chain], ends[chain]


def _where(byte: int) -> str:
    return f"byte {byte} of the uncompressed data"
