"""Chunks of an MCAP file: packing, and unpacking with a check of every length and checksum."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO, Literal, NamedTuple, Self, get_args

from mcap.opcode import Opcode

from daq.errors import ConfigError, nearest
from daq.limits import LARGEST_CHUNK_BYTES

Compression = Literal["zstd", "lz4", "none"]

RECORD = struct.Struct("<BQ")
"""Opcode and length of a record's body."""
_CHUNK_HEAD = struct.Struct("<BQQQQII")
_LONGEST_NAME = 32
_LONGEST_HEAD = _CHUNK_HEAD.size + _LONGEST_NAME + 8
_MESSAGE_HEAD = struct.Struct("<HIQ")
MESSAGE_HEAD_SIZE = 22
"""Bytes of a message record's body before its data."""


class DamagedError(Exception):
    """Damaged bytes. Caught inside this package and reported as a `Loss`."""


@dataclass(frozen=True)
class ChunkEntry:
    """Where a chunk lies and what it holds.

    Attributes
    ----------
    offset, size : int
        Of the whole record.
    start_ns, end_ns : int
        First and last log time of its messages.
    channel_ids : frozenset of int, optional
        Channels of its messages; None when that is not known.
    bare : bool
        Whether it is a run of messages that lie in no chunk.
    """

    offset: int
    size: int
    start_ns: int
    end_ns: int
    channel_ids: frozenset[int] | None = None
    bare: bool = False

    @classmethod
    def at(cls, file: BinaryIO, offset: int, size: int) -> Self:
        """Read the entry from the head of the chunk itself; DamagedError if its lengths contradict each other."""
        head = _head(read_at(file, offset, min(size, _LONGEST_HEAD)), size)
        return cls(offset, size, head.start_ns, head.end_ns)

    def with_channel(self, channel_id: int) -> Self:
        """Return the entry with one more channel."""
        return replace(self, channel_ids=(self.channel_ids or frozenset()) | {channel_id})

    def grown(self, size: int, time_ns: int, channel_id: int) -> Self:
        """Return the entry of a run that is one message longer."""
        return replace(
            self.with_channel(channel_id),
            size=self.size + size,
            start_ns=min(self.start_ns, time_ns),
            end_ns=max(self.end_ns, time_ns),
        )


class _Head(NamedTuple):
    """What a chunk record says ahead of its data, and where in the record they begin."""

    start_ns: int
    end_ns: int
    unpacked_size: int
    crc: int
    compression: str
    data_offset: int


def _head(record: bytes, size: int) -> _Head:
    """Parse the head of a chunk record of `size` bytes, of which at least the first `_LONGEST_HEAD` are given."""
    if len(record) < min(size, _LONGEST_HEAD):
        raise DamagedError("a chunk is cut off")
    opcode, length, start_ns, end_ns, unpacked_size, crc, name_size = _CHUNK_HEAD.unpack_from(
        record.ljust(_CHUNK_HEAD.size, b"\0")
    )
    if opcode != Opcode.CHUNK or length != size - 9 or name_size > _LONGEST_NAME:
        raise DamagedError("no chunk where one should be")
    name_end = _CHUNK_HEAD.size + name_size
    data_offset = name_end + 8
    if data_offset + int.from_bytes(record[name_end:data_offset], "little") != size:
        raise DamagedError("a chunk whose lengths contradict each other")
    name = record[_CHUNK_HEAD.size : name_end].decode("ascii", "replace")
    return _Head(start_ns, end_ns, unpacked_size, crc, name, data_offset)


@dataclass(frozen=True)
class PackedChunk:
    """A chunk as it lies in the file: what copying it takes."""

    data: bytes
    compression: str
    unpacked_size: int
    crc: int

    def head(self, start_ns: int, end_ns: int) -> bytes:
        """Return what goes before the data in the record of a chunk of messages with these log times."""
        name = self.compression.encode()
        length = _CHUNK_HEAD.size - 9 + len(name) + 8 + len(self.data)
        numbers = (length, start_ns, end_ns, self.unpacked_size, self.crc, len(name))
        return _CHUNK_HEAD.pack(Opcode.CHUNK, *numbers) + name + len(self.data).to_bytes(8, "little")


def read_at(file: BinaryIO, offset: int, size: int) -> bytes:
    """Return up to `size` bytes at `offset`; a damaged size costs no memory."""
    there = os.fstat(file.fileno()).st_size - offset
    if offset < 0 or there <= 0:
        return b""
    file.seek(offset)
    return file.read(min(size, there))


def read_packed(file: BinaryIO, entry: ChunkEntry) -> PackedChunk:
    """Return a chunk without unpacking it; DamagedError if it is cut off or its lengths contradict each other."""
    record = read_at(file, entry.offset, entry.size)
    if entry.bare:
        return PackedChunk(record, "", entry.size, zlib.crc32(record))
    head = _head(record, entry.size)
    return PackedChunk(record[head.data_offset :], head.compression, head.unpacked_size, head.crc)


def read_chunk(file: BinaryIO, entry: ChunkEntry) -> bytes:
    """Return a chunk's records, unpacked and checked.

    Raises DamagedError if it is cut off, cannot be unpacked or fails its checksum.
    """
    return unpacked(read_packed(file, entry))


def unpacked(chunk: PackedChunk) -> bytes:
    """Unpack and check a chunk; see `read_chunk`."""
    if chunk.unpacked_size > LARGEST_CHUNK_BYTES:
        raise DamagedError(f"a chunk states {chunk.unpacked_size} bytes; at most {LARGEST_CHUNK_BYTES} are read")
    content = _decompressed(chunk)
    if len(content) != chunk.unpacked_size:
        raise DamagedError("a chunk has another size than it says")
    if chunk.crc and zlib.crc32(content) != chunk.crc:
        raise DamagedError("a chunk fails its checksum")
    return content


def _decompressed(chunk: PackedChunk) -> bytes:
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "zstd":
        import zstandard

        try:
            if zstandard.frame_content_size(chunk.data) not in (-1, chunk.unpacked_size):
                raise DamagedError("a chunk contradicts itself about its size")
            return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.unpacked_size)
        except zstandard.ZstdError as error:
            raise DamagedError(f"a chunk cannot be unpacked: {error}") from None
    if chunk.compression == "lz4":
        import lz4.frame

        try:
            if lz4.frame.get_frame_info(chunk.data)["content_size"] not in (0, chunk.unpacked_size):
                raise DamagedError("a chunk contradicts itself about its size")
            stream = lz4.frame.LZ4FrameDecompressor()
            content = bytes(stream.decompress(chunk.data, max_length=chunk.unpacked_size + 1))
            if not stream.eof:
                raise DamagedError("a chunk has another size than it says")
            return content
        except (RuntimeError, ValueError, MemoryError, EOFError) as error:
            raise DamagedError(f"a chunk cannot be unpacked: {error}") from None
    raise DamagedError(f"a chunk is packed as {chunk.compression!r}, which we do not know")


def compressor(compression: Compression) -> Callable[[bytes], bytes]:
    """Return what packs a chunk's content; ConfigError if there is no such compression."""
    if compression == "zstd":
        import zstandard

        return zstandard.ZstdCompressor().compress
    if compression == "lz4":
        import lz4.frame

        return lambda data: bytes(lz4.frame.compress(data))
    if compression == "none":
        return lambda data: data
    known = get_args(Compression)
    raise ConfigError.of(f"unknown compression {compression!r}", expected=nearest(compression, known))


def message_head(content: bytes, start: int, length: int) -> tuple[int, int]:
    """Return channel id and log time of the message whose record body is at `start`.

    Raises DamagedError if it is too short to be a message.
    """
    if length < MESSAGE_HEAD_SIZE:
        raise DamagedError("a message is too short")
    channel_id, _, log_time_ns = _MESSAGE_HEAD.unpack_from(content, start)
    return channel_id, log_time_ns


def content_records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield ``(opcode, start, length)`` of each record's body in a chunk or summary.

    Raises DamagedError if a record reaches over the end.
    """
    position, end = 0, len(content)
    while position < end:
        if position + 9 > end:
            raise DamagedError("a record is cut off")
        opcode, length = RECORD.unpack_from(content, position)
        position += 9
        if position + length > end:
            raise DamagedError("a record is cut off")
        yield opcode, position, length
        position += length
