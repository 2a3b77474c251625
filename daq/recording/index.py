"""What lies where in an MCAP file: from its summary, or, when that is lost, by walking the records.

Nothing here trusts the file: every length is checked against what surrounds it, so that a cut or a flipped byte
becomes a `Loss` and not an exception.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from daq.errors import Fault, RecordingError
from daq.recording.chunks import ChunkEntry, DamagedError, content_records, read_at, read_chunk

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_SIZE = 9 + 20
_RECORD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")
_SCAN_BLOCK = 1 << 20
_CHUNK_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_OFFSET = 9 + 28
"""Where the compression stands in a chunk record."""


@dataclass(frozen=True)
class Loss:
    """Something of a file that cannot be read.

    Attributes
    ----------
    what : str
    at_byte, byte_count : int
    """

    what: str
    at_byte: int
    byte_count: int

    def __str__(self) -> str:
        return f"{self.what} (byte {self.at_byte}, {self.byte_count} bytes)"


@dataclass
class FileIndex:
    """What lies where. Offsets are bytes from the beginning of the file."""

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
    message_counts: dict[int, int] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)

    def define(self, record: Schema | Channel) -> None:
        """Remember a definition."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        else:
            self.channels[record.id] = record


RecordT = TypeVar("RecordT")


def parsed(reader: Callable[[ReadDataStream], RecordT], body: bytes) -> RecordT:
    """Parse a record's body with the ``mcap`` package.

    Raises
    ------
    DamagedError
        If the body is not such a record, to the last byte.
    """
    stream = ReadDataStream(BytesIO(body))
    try:
        record = reader(stream)
    except (McapError, UnicodeDecodeError, struct.error, OverflowError) as error:
        raise DamagedError(f"not a whole record ({error or type(error).__name__})") from None
    if stream.count != len(body):
        raise DamagedError(f"a record of {stream.count} bytes in a frame of {len(body)}")
    return record


def read_index(path: Path) -> FileIndex:
    """Find out what lies where in an MCAP file, whole or cut.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            index = FileIndex(path, file.seek(0, 2))
            _check_magic(file, index)
            if not _from_summary(file, index):
                _from_walk(file, index)
            _define_channels(file, index)
            return index
    except FileNotFoundError:
        raise RecordingError(Fault("no such file", str(path), next_step="check the path")) from None
    except IsADirectoryError:
        raise RecordingError(Fault("a folder, not a recording", str(path), expected="an .mcap file")) from None
    except OSError as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(Fault("the recording cannot be read", str(path), error.strerror or str(error))) from None


def _check_magic(file: BinaryIO, index: FileIndex) -> None:
    head = read_at(file, 0, len(MAGIC))
    if not head:
        raise RecordingError(
            Fault("the file is empty", str(index.path), next_step="nothing was recorded; look for another file")
        )
    if head != MAGIC:
        raise RecordingError(
            Fault(
                "not an MCAP file",
                str(index.path),
                found=f"it begins with {head!r}",
                expected=repr(MAGIC),
                next_step="a log of another format goes through `wheelsoil import`",
            )
        )


def _from_summary(file: BinaryIO, index: FileIndex) -> bool:
    """Fill the index from the summary; say whether there is a whole one."""
    footer_start = index.size - _FOOTER_SIZE - len(MAGIC)
    tail = read_at(file, max(footer_start, 0), _FOOTER_SIZE + len(MAGIC))
    if footer_start < len(MAGIC) or tail[_FOOTER_SIZE:] != MAGIC:
        index.losses.append(Loss("the end of the file is missing: no footer, no summary", index.size, 0))
        return False
    opcode, length, start, _, crc = _FOOTER.unpack(tail[:_FOOTER_SIZE])
    if (opcode, length) == (Opcode.FOOTER, 20) and start == 0:
        return False
    summary = read_at(file, start, footer_start - start) if len(MAGIC) <= start <= footer_start else b""
    if not summary or (opcode, length) != (Opcode.FOOTER, 20):
        index.losses.append(Loss("the footer is damaged", footer_start, _FOOTER_SIZE))
        return False
    if crc and zlib.crc32(summary + tail[: _FOOTER_SIZE - 4]) != crc:
        index.losses.append(Loss("the summary is damaged", start, len(summary)))
        return False
    found = FileIndex(index.path, index.size, has_summary=True)
    try:
        whole = _take_summary(found, summary)
        header = read_record(file, len(MAGIC), None, Opcode.HEADER)
        _take_header(found, header)
    except DamagedError as damage:
        index.losses.append(Loss(f"the summary is damaged: {damage}", start, len(summary)))
        return False
    if whole:
        vars(index).update(vars(found))
    return whole


def _take_summary(index: FileIndex, summary: bytes) -> bool:
    """Fill the index from the summary's bytes; say whether it lists the chunks of all messages."""
    statistics: Statistics | None = None
    for opcode, start, length in content_records(summary):
        body = summary[start : start + length]
        if opcode == Opcode.SCHEMA:
            index.define(parsed(Schema.read, body))
        elif opcode == Opcode.CHANNEL:
            index.define(parsed(Channel.read, body))
        elif opcode == Opcode.STATISTICS:
            statistics = parsed(Statistics.read, body)
            index.message_counts = dict(statistics.channel_message_counts)
        elif opcode == Opcode.CHUNK_INDEX:
            index.chunks.append(_entry(parsed(ChunkIndex.read, body)))
        elif opcode == Opcode.ATTACHMENT_INDEX:
            attachment = parsed(AttachmentIndex.read, body)
            index.attachments.append((attachment.offset, attachment.length))
        elif opcode == Opcode.METADATA_INDEX:
            metadata = parsed(MetadataIndex.read, body)
            index.metadata.append((metadata.offset, metadata.length))
    if statistics is None:
        return False
    return (
        len(index.chunks) == statistics.chunk_count
        and len(index.attachments) == statistics.attachment_count
        and len(index.metadata) == statistics.metadata_count
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


def _take_header(index: FileIndex, body: bytes) -> None:
    header = parsed(Header.read, body)
    index.profile, index.library = header.profile, header.library


def read_record(file: BinaryIO, offset: int, size: int | None, opcode: int) -> bytes:
    """Return the body of the record at `offset`; `size` is that of the whole record where it is known.

    Raises
    ------
    DamagedError
        If another record, or none, is there.
    """
    found, length = _RECORD.unpack(read_at(file, offset, 9).ljust(9, b"\0"))
    if found != opcode or (size is not None and length != size - 9):
        raise DamagedError("another record is where the summary says")
    body = read_at(file, offset + 9, length)
    if len(body) != length:
        raise DamagedError("the record is cut off")
    return body


def _from_walk(file: BinaryIO, index: FileIndex) -> None:
    """Fill the index by walking the records from the first to the last whole one."""
    position = len(MAGIC)
    while position < index.size:
        head = read_at(file, position, 9)
        opcode, length = _RECORD.unpack(head.ljust(9, b"\0"))
        end = position + 9 + length
        try:
            if len(head) < 9 or end > index.size:
                raise DamagedError("the last record is cut off")
            if not _take_record(file, index, opcode, position, length):
                return
            position = end
        except DamagedError as damage:
            resumed = _next_chunk(file, index, position + 1)
            index.losses.append(Loss(str(damage), position, resumed - position))
            position = resumed


def _take_record(file: BinaryIO, index: FileIndex, opcode: int, position: int, length: int) -> bool:
    """Note one record of the data section; say whether to walk on."""
    size = 9 + length
    if opcode == Opcode.CHUNK:
        index.chunks.append(ChunkEntry.at(file, position, size))
    elif opcode == Opcode.MESSAGE_INDEX:
        record = parsed(MessageIndex.read, read_at(file, position + 9, length))
        if index.chunks:
            last = index.chunks[-1]
            index.chunks[-1] = last.with_channel(record.channel_id)
        counted = index.message_counts.get(record.channel_id, 0)
        index.message_counts[record.channel_id] = counted + len(record.records)
    elif opcode == Opcode.ATTACHMENT:
        parsed(Attachment.read, read_at(file, position + 9, length))
        index.attachments.append((position, size))
    elif opcode == Opcode.METADATA:
        parsed(Metadata.read, read_at(file, position + 9, length))
        index.metadata.append((position, size))
    elif opcode == Opcode.HEADER and position == len(MAGIC):
        _take_header(index, read_at(file, position + 9, length))
    elif opcode == Opcode.SCHEMA:
        index.define(parsed(Schema.read, read_at(file, position + 9, length)))
    elif opcode == Opcode.CHANNEL:
        index.define(parsed(Channel.read, read_at(file, position + 9, length)))
    elif opcode == Opcode.MESSAGE and length >= 22:
        _take_bare_message(file, index, position, size)
    elif opcode == Opcode.DATA_END and length == 4:
        return False
    else:
        raise DamagedError("bytes that are no record")
    return True


def _take_bare_message(file: BinaryIO, index: FileIndex, position: int, size: int) -> None:
    """Take messages that lie in no chunk as if they were one, run by run."""
    channel_id, _, time_ns = struct.unpack("<HIQ", read_at(file, position + 9, 14))
    if channel_id not in index.channels:
        raise DamagedError("a message of an unknown channel")
    index.message_counts[channel_id] = index.message_counts.get(channel_id, 0) + 1
    last = index.chunks[-1] if index.chunks else None
    if last is not None and last.bare and last.offset + last.size == position and last.size < _SCAN_BLOCK:
        index.chunks[-1] = last.grown(size, time_ns, channel_id)
    else:
        index.chunks.append(ChunkEntry(position, size, time_ns, time_ns, frozenset([channel_id]), bare=True))


def _next_chunk(file: BinaryIO, index: FileIndex, position: int) -> int:
    """Return where the next believable chunk begins, or the end of the file."""
    while position < index.size:
        block = read_at(file, position, _SCAN_BLOCK + _MARK_OFFSET + 8)
        for start in _marked(block):
            offset = position + start
            try:
                opcode, length = _RECORD.unpack_from(block, start)
                if opcode == Opcode.CHUNK and offset + 9 + length <= index.size:
                    ChunkEntry.at(file, offset, 9 + length)
                    return offset
            except DamagedError:
                continue
        position += _SCAN_BLOCK
    return index.size


def _marked(block: bytes) -> Iterator[int]:
    """Yield where in `block` a chunk could begin, by the name of its compression."""
    found = []
    for mark in _CHUNK_MARKS:
        at = block.find(mark, _MARK_OFFSET)
        while at >= 0:
            found.append(at - _MARK_OFFSET)
            at = block.find(mark, at + 1)
    yield from sorted(found)


def _define_channels(file: BinaryIO, index: FileIndex) -> None:
    """Read those chunks that use channels which nothing read so far defines."""
    for entry in index.chunks:
        if entry.bare or (entry.channel_ids is not None and entry.channel_ids <= index.channels.keys()):
            continue
        try:
            content = read_chunk(file, entry)
            for opcode, start, length in content_records(content):
                if opcode == Opcode.SCHEMA:
                    index.define(parsed(Schema.read, content[start : start + length]))
                elif opcode == Opcode.CHANNEL:
                    index.define(parsed(Channel.read, content[start : start + length]))
        except DamagedError:
            continue  # told where its frames are read
