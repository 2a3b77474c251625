"""What an MCAP file holds and where, and the parsing of its small records.

Nothing here trusts the file: a cut or a flipped byte becomes a `DamagedError`, and that a `Loss`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from daq.errors import Fault, RecordingError
from daq.recording.chunks import ChunkEntry, DamagedError, read_at

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
"""Opcode and length of a record's body."""


@dataclass(frozen=True)
class Loss:
    """Something of a file that cannot be read.

    Attributes
    ----------
    what : str
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


RecordT = TypeVar("RecordT")


def parsed(reader: Callable[[ReadDataStream], RecordT], body: bytes) -> RecordT:
    """Parse a record's body with the ``mcap`` package.

    Raises
    ------
    DamagedError
        If the body is not such a record. Bytes behind it are allowed, as MCAP demands.
    """
    try:
        return reader(_ExactStream(BytesIO(body)))
    except (McapError, UnicodeDecodeError, struct.error, OverflowError) as error:
        raise DamagedError(f"not a whole record ({error or type(error).__name__})") from None


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Return what to raise where the file is gone, or the disk fails."""
    return RecordingError(Fault("the recording cannot be read", str(path), error.strerror or str(error)))


def read_record(file: BinaryIO, offset: int, size: int | None, opcode: int) -> bytes:
    """Return the body of the record at `offset`; `size` is that of the whole record where it is known.

    Raises
    ------
    DamagedError
        If another record, or none, is there.
    """
    found, length = RECORD.unpack(read_at(file, offset, 9).ljust(9, b"\0"))
    if found != opcode or (size is not None and length != size - 9):
        raise DamagedError("another record is where it should be")
    body = read_at(file, offset + 9, length)
    if len(body) != length:
        raise DamagedError("the record is cut off")
    return body
