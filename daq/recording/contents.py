"""Contents of an MCAP file: from its summary or, where that is lost, by reading all records over damaged places.

Nothing here trusts the file: a summary is taken only when its checksum holds, a cut or a flipped byte becomes a
`DamagedError`, and that a `Loss`.
"""

from __future__ import annotations

import contextlib
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from daq.errors import RecordingError, WheelsoilError
from daq.recording.chunks import RECORD, ChunkEntry, DamagedError, content_records, message_head, read_at, read_chunk

MAGIC = b"\x89MCAP0\r\n"

RecordT = TypeVar("RecordT")

_FOOTER = struct.Struct("<BQQQI")
_FOOTER_BODY_SIZE = 20

_MESSAGE_INDEX_HEAD = struct.Struct("<HI")
_SCAN_BLOCK = 1 << 20
_CHUNK_MARK = re.compile(rb"\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4")
_MARK_OFFSET = 9 + 28
"""Where the compression stands in a chunk record."""


@dataclass(frozen=True)
class Loss:
    """Something of a file that cannot be read.

    Attributes
    ----------
    at_byte, byte_count : int
        Where; both 0 for what is no place in the file.
    """

    what: str
    at_byte: int
    byte_count: int

    def __str__(self) -> str:
        if not (self.at_byte or self.byte_count):
            return self.what
        return f"{self.what} (byte {self.at_byte}, {self.byte_count} bytes)"


@dataclass
class Contents:
    """Index of the records of a file. Offsets are bytes from the beginning of the file."""

    path: Path
    size: int
    profile: str = ""
    library: str = ""
    has_summary: bool = False
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkEntry] = field(default_factory=list)
    attachments: list[tuple[int, int]] = field(default_factory=list)
    metadata: list[tuple[int, int]] = field(default_factory=list)
    log_time_range_ns: tuple[int, int] | None = None
    message_counts: dict[int, int] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)

    def is_defined(self, channel_id: int) -> bool:
        """Return whether a channel and its schema, where it has one, are known."""
        channel = self.channels.get(channel_id)
        return channel is not None and (channel.schema_id == 0 or channel.schema_id in self.schemas)

    def define(self, opcode: int, body: bytes) -> None:
        """Remember a schema or channel; other records are passed over."""
        if opcode == Opcode.SCHEMA:
            schema = parsed(Schema.read, body)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parsed(Channel.read, body)
            self.channels[channel.id] = channel


class _ExactStream(ReadDataStream):
    """A stream that does not give less than it is asked for, as the one of ``mcap`` does."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def parsed(reader: Callable[[ReadDataStream], RecordT], body: bytes) -> RecordT:
    """Parse a record's body with the ``mcap`` package.

    Raises DamagedError if the body is not such a record. Bytes behind it are allowed, as MCAP demands.
    """
    try:
        return reader(_ExactStream(BytesIO(body)))
    except (McapError, UnicodeDecodeError, struct.error, OverflowError) as error:
        raise DamagedError(f"not a whole record ({error or type(error).__name__})") from None


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a recording to be read in here; RecordingError if it is not there, or the disk fails."""
    try:
        with path.open("rb") as file:
            yield file
    except WheelsoilError:
        raise
    except FileNotFoundError:
        raise RecordingError.of("no such file", path, next_step="check the path") from None
    except IsADirectoryError:
        raise RecordingError.of("a folder, not a recording", path, expected="an .mcap file") from None
    except OSError as error:
        found, step = error.strerror or str(error), "check the path and its permissions"
        raise RecordingError.of("the recording cannot be read", path, found, next_step=step) from None


def read_record(file: BinaryIO, offset: int, size: int | None, opcode: int) -> bytes:
    """Return the body of the record at `offset`; `size` is that of the whole record where it is known.

    Raises DamagedError if another record, or none, is there.
    """
    found, length = RECORD.unpack(read_at(file, offset, 9).ljust(9, b"\0"))
    if found != opcode or (size is not None and length != size - 9):
        raise DamagedError("another record is where it should be")
    body = read_at(file, offset + 9, length)
    if len(body) != length:
        raise DamagedError("the record is cut off")
    return body


def take_summary(file: BinaryIO, contents: Contents) -> bool:
    """Read the summary; return whether it was complete."""
    footer_start = contents.size - _FOOTER.size - len(MAGIC)
    tail = read_at(file, max(footer_start, 0), _FOOTER.size + len(MAGIC))
    if footer_start < len(MAGIC) or tail[_FOOTER.size :] != MAGIC:
        contents.losses.append(Loss("the end of the file is missing: no footer, no summary", contents.size, 0))
        return False
    opcode, length, start, _, crc = _FOOTER.unpack(tail[: _FOOTER.size])
    if (opcode, length) == (Opcode.FOOTER, _FOOTER_BODY_SIZE) and start == 0:
        return False
    summary = read_at(file, start, footer_start - start) if len(MAGIC) <= start <= footer_start else b""
    if not summary or (opcode, length) != (Opcode.FOOTER, _FOOTER_BODY_SIZE):
        contents.losses.append(Loss("the footer is damaged", footer_start, _FOOTER.size))
        return False
    if crc and zlib.crc32(summary + tail[: _FOOTER.size - 4]) != crc:
        contents.losses.append(Loss("the summary is damaged", start, len(summary)))
        return False
    found = Contents(contents.path, contents.size, contents.profile, contents.library, has_summary=True)
    try:
        whole = _take_records(found, summary)
    except DamagedError as damage:
        contents.losses.append(Loss(f"the summary is damaged: {damage}", start, len(summary)))
        return False
    if whole:
        found.losses = contents.losses
        vars(contents).update(vars(found))
    return whole


def _take_records(contents: Contents, summary: bytes) -> bool:
    """Note what the summary lists, and say whether that is all there is."""
    statistics: Statistics | None = None
    for opcode, start, length in content_records(summary):
        body = summary[start : start + length]
        contents.define(opcode, body)
        if opcode == Opcode.STATISTICS:
            statistics = parsed(Statistics.read, body)
            contents.message_counts = dict(statistics.channel_message_counts)
            if statistics.message_count:
                contents.log_time_range_ns = statistics.message_start_time, statistics.message_end_time
        elif opcode == Opcode.CHUNK_INDEX:
            contents.chunks.append(_entry(parsed(ChunkIndex.read, body)))
        elif opcode == Opcode.ATTACHMENT_INDEX:
            attachment = parsed(AttachmentIndex.read, body)
            contents.attachments.append((attachment.offset, attachment.length))
        elif opcode == Opcode.METADATA_INDEX:
            metadata = parsed(MetadataIndex.read, body)
            contents.metadata.append((metadata.offset, metadata.length))
    if statistics is None:
        return False
    return (
        len(contents.chunks) == statistics.chunk_count
        and len(contents.attachments) == statistics.attachment_count
        and len(contents.metadata) == statistics.metadata_count
        and (statistics.chunk_count > 0 or statistics.message_count == 0)
    )


def _entry(record: ChunkIndex) -> ChunkEntry:
    return ChunkEntry(
        record.chunk_start_offset,
        record.chunk_length,
        record.message_start_time,
        record.message_end_time,
        frozenset(record.message_index_offsets) or None,
    )


def walk(file: BinaryIO, contents: Contents) -> None:
    """Note every whole record from the first to the last.

    Where the next record is none, the length of the one before may be what is damaged: the search for the next
    chunk goes on from there.
    """
    position = before = len(MAGIC)
    while position < contents.size:
        head = read_at(file, position, 9)
        opcode, length = RECORD.unpack(head.ljust(9, b"\0"))
        end = position + 9 + length
        try:
            if len(head) < 9 or end > contents.size:
                raise DamagedError("a record is cut off")
            if not _take_record(file, contents, opcode, position, length):
                return
            before, position = position, end
        except DamagedError as damage:
            _doubt_channels(contents)
            resumed = _next_chunk(file, contents, before + 1)
            contents.losses.append(Loss(str(damage), position, max(resumed - position, 0)))
            before = position = resumed
    _doubt_channels(contents)


def _doubt_channels(contents: Contents) -> None:
    """Take it that the last chunk may hold more channels than those whose index came before the damage."""
    if contents.chunks and not contents.chunks[-1].bare:
        contents.chunks[-1] = replace(contents.chunks[-1], channel_ids=None)


def _take_record(file: BinaryIO, contents: Contents, opcode: int, position: int, length: int) -> bool:
    """Note one record of the data section; say whether to walk on."""
    size = 9 + length
    if opcode == Opcode.CHUNK:
        contents.chunks.append(ChunkEntry.at(file, position, size))
    elif opcode == Opcode.MESSAGE_INDEX:
        _take_message_index(file, contents, position, length)
    elif opcode == Opcode.ATTACHMENT:
        parsed(Attachment.read, read_at(file, position + 9, length))
        contents.attachments.append((position, size))
    elif opcode == Opcode.METADATA:
        parsed(Metadata.read, read_at(file, position + 9, length))
        contents.metadata.append((position, size))
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        contents.define(opcode, read_at(file, position + 9, length))
    elif opcode == Opcode.MESSAGE and length >= 22:
        _take_bare_message(file, contents, position, size)
    elif opcode == Opcode.DATA_END and length == 4:
        return False
    elif opcode != Opcode.HEADER or position != len(MAGIC):
        raise DamagedError("bytes that are no record")
    return True


def _take_message_index(file: BinaryIO, contents: Contents, position: int, length: int) -> None:
    """Note which channel the chunk before holds, and how many messages of it."""
    channel_id, size = _MESSAGE_INDEX_HEAD.unpack(read_at(file, position + 9, 6).ljust(6, b"\xff"))
    if size != length - 6 or size % 16:
        raise DamagedError("a message index contradicts itself about its length")
    if contents.chunks:
        contents.chunks[-1] = contents.chunks[-1].with_channel(channel_id)
    contents.message_counts[channel_id] = contents.message_counts.get(channel_id, 0) + size // 16


def _take_bare_message(file: BinaryIO, contents: Contents, position: int, size: int) -> None:
    """Take messages that lie in no chunk as if they were one, run by run."""
    channel_id, _, time_ns = struct.unpack("<HIQ", read_at(file, position + 9, 14))
    if channel_id not in contents.channels:
        raise DamagedError("a message of an unknown channel")
    contents.message_counts[channel_id] = contents.message_counts.get(channel_id, 0) + 1
    last = contents.chunks[-1] if contents.chunks else None
    if last is not None and last.bare and last.offset + last.size == position and last.size < _SCAN_BLOCK:
        contents.chunks[-1] = last.grown(size, time_ns, channel_id)
    else:
        contents.chunks.append(ChunkEntry(position, size, time_ns, time_ns, frozenset([channel_id]), bare=True))


def _next_chunk(file: BinaryIO, contents: Contents, position: int) -> int:
    """Return where the next believable chunk begins, or the end of the file."""
    while position < contents.size:
        block = read_at(file, position, _SCAN_BLOCK + _MARK_OFFSET + 8)
        for mark in _CHUNK_MARK.finditer(block, _MARK_OFFSET):  # the name of its compression
            start = mark.start() - _MARK_OFFSET
            offset = position + start
            try:
                opcode, length = RECORD.unpack_from(block, start)
                if opcode == Opcode.CHUNK and offset + 9 + length <= contents.size:
                    ChunkEntry.at(file, offset, 9 + length)
                    return offset
            except DamagedError:
                continue
        position += _SCAN_BLOCK
    return contents.size


def read_contents(path: Path) -> Contents:
    """Index the records of an MCAP file, complete or cut off.

    Raises RecordingError if there is no such file, or it is no MCAP file.
    """
    with opened(path) as file:
        contents = Contents(path, file.seek(0, 2))
        _check_magic(file, contents)
        try:
            header = parsed(Header.read, read_record(file, len(MAGIC), None, Opcode.HEADER))
            contents.profile, contents.library = header.profile, header.library
        except DamagedError as damage:
            contents.losses.append(Loss(f"the header: {damage}", len(MAGIC), 0))
        if not take_summary(file, contents):
            walk(file, contents)
        _define_channels(file, contents)
    return contents


def _check_magic(file: BinaryIO, contents: Contents) -> None:
    head = read_at(file, 0, len(MAGIC))
    if not head:
        step = "nothing was recorded; look for another file"
        raise RecordingError.of("the file is empty", contents.path, next_step=step)
    if head != MAGIC:
        found, step = f"it begins with {head!r}", "a log of another format goes through `wheelsoil import`"
        raise RecordingError.of("not an MCAP file", contents.path, found, repr(MAGIC), step)


def _define_channels(file: BinaryIO, contents: Contents) -> None:
    """Read chunks until every channel that one uses is defined, as far as any of them does.

    A chunk may use what an earlier one defines that has no message of it: the nearest is looked into first.
    """
    looked_into: set[int] = set()
    all_up_to = -1
    for i, entry in enumerate(contents.chunks):
        used = entry.channel_ids
        if used is None:
            looked_into.add(i)
            used = _define_from(file, contents, entry)
        for earlier in range(i, all_up_to, -1):
            if all(map(contents.is_defined, used)):
                break
            if earlier not in looked_into:
                looked_into.add(earlier)
                _define_from(file, contents, contents.chunks[earlier])
        else:
            all_up_to = i


def _define_from(file: BinaryIO, contents: Contents, entry: ChunkEntry) -> frozenset[int]:
    """Take what a chunk defines, and return the channels of its messages."""
    used: set[int] = set()
    with contextlib.suppress(DamagedError):  # reported where its frames are read
        for opcode, start, length in content_records(content := read_chunk(file, entry)):
            if opcode == Opcode.MESSAGE:
                used.add(message_head(content, start, length)[0])
            else:
                contents.define(opcode, content[start : start + length])
    return frozenset(used)
