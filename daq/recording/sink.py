"""An MCAP file being written, a whole chunk at a time.

The records themselves are the ``mcap`` package's; what its ``Writer`` lacks is here: chunks built from arrays,
chunks copied as they are, fsync, and a file that stays well-formed when the disk is full: it grows by whole records,
and a failed or interrupted write leaves no partial record (docs/decisions/mcap-package.md).
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from daq import HardwareError, IntArray, RecordingError
from daq.recording.chunks import Compression, PackedChunk, compressor
from daq.recording.contents import MAGIC
from daq.recording.format import MESSAGE_ENCODING, PROFILE, SCHEMA_ENCODING

INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
"""A message in the index of a chunk: its time, and where it begins in the uncompressed chunk."""
_FOOTER_LENGTH = 8 + 8 + 4

_TEXT_SUFFIXES = (".dbc", ".toml", ".txt", ".csv", ".json")


class DiskFile:
    """A new file that is written from beginning to end, unbuffered; `overwrite` replaces one that is there.

    `position` counts the bytes written. Once a write has `failed`, nothing is written any more. `sync_took_s` is how
    long the last fsync took, by `clock`.

    `RecordingError` if the file is there already, or cannot be made; `HardwareError` from `write`, `sync` and
    `begin_sync`, if the disk fails or is full.
    """

    def __init__(self, path: Path, *, overwrite: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.position = 0
        self.failed = False
        self.sync_took_s = 0.0
        self._path = path
        self._clock = clock
        self._syncing: threading.Thread | None = None
        self._sync_error: OSError | None = None
        self._file = _create(path, overwrite)
        sync_folder(path)

    def write(self, *parts: bytes | memoryview) -> None:
        """Append all of `parts`, or nothing."""
        if self.failed:
            raise HardwareError.of("the recording was given up after a failed write", self._path)
        self._raise_sync_error()
        end = self.position + sum(map(len, parts))
        try:
            for part in parts:
                rest = memoryview(part)
                while rest:
                    rest = rest[self._file.write(rest) :]
            self.position = end
        except OSError as error:
            raise self._given_up(error) from None
        finally:
            if self.position != end:  # Ctrl-C comes through here too
                self._cut_back()

    def sync(self) -> None:
        """Have the operating system write all that it still holds of the file to the disk (fsync), and wait."""
        self._join()
        self._fsync()
        self._raise_sync_error()

    @property
    def syncing(self) -> bool:
        """Whether an fsync of `begin_sync` is under way."""
        return self._syncing is not None and self._syncing.is_alive()

    def begin_sync(self) -> None:
        """Begin what `sync` does, in a thread: a slow disk does not delay writes. The next call raises a failure."""
        self._join()
        self._raise_sync_error()
        self._syncing = threading.Thread(target=self._fsync, name="fsync", daemon=True)
        self._syncing.start()

    def close(self) -> None:
        """Close the file."""
        self._join()
        self._file.close()

    def _join(self) -> None:
        if self._syncing is not None:
            self._syncing.join()

    def _fsync(self) -> None:
        began_at = self._clock()
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._sync_error = error
        self.sync_took_s = self._clock() - began_at

    def _raise_sync_error(self) -> None:
        if self._sync_error is not None:
            raise self._given_up(self._sync_error) from None

    def _given_up(self, error: OSError) -> HardwareError:
        self.failed = True
        what = "the recording cannot be written on"
        step = "free or change the disk; what was written before stays readable"
        return HardwareError.of(what, self._path, error.strerror or str(error), next_step=step)

    def _cut_back(self) -> None:
        """Take off a half-written record, so that only whole ones stay."""
        with contextlib.suppress(OSError):
            self._file.truncate(self.position)
            self._file.seek(self.position)


def _create(path: Path, overwrite: bool) -> FileIO:
    try:
        return FileIO(path, "w" if overwrite else "x")
    except FileExistsError:
        step = "choose another name, or say that it may be replaced"
        raise RecordingError.of("there is a file already", path, next_step=step) from None
    except OSError as error:
        what, found = "the recording cannot be made", error.strerror or str(error)
        step = "check the folder, and whether another program holds the file"
        raise RecordingError.of(what, path, found, next_step=step) from None


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, so that their names survive a power cut.

    Raises OSError if it cannot be made.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync_folder(path)


def sync_folder(path: Path) -> None:
    """Sync the folder of a new file or folder, so that its name survives a power cut; a failure is ignored."""
    with contextlib.suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def serialized(*records: McapRecord) -> bytes:
    """Return MCAP records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def index_entries(log_time_ns: NDArray[Any], offsets: IntArray) -> NDArray[np.void]:
    """Return an index of messages, an array of `INDEX_ENTRY`; times before 1970 become 0."""
    entries = np.empty(len(offsets), INDEX_ENTRY)
    entries["log_time"] = np.maximum(log_time_ns, 0)
    entries["offset"] = offsets
    return entries


def message_index(channel_id: int, entries: NDArray[np.void]) -> bytes:
    """Return the message index record of one channel of a chunk; `entries` are of `INDEX_ENTRY`."""
    size = entries.nbytes
    head = bytes([Opcode.MESSAGE_INDEX]) + (6 + size).to_bytes(8, "little")
    return head + channel_id.to_bytes(2, "little") + size.to_bytes(4, "little") + entries.tobytes()


def footer(summary: bytes, offsets: bytes, start: int) -> bytes:
    """Return the footer behind a summary and its offsets; `start` is where the summary begins in the file."""
    offset_start = start + len(summary)
    head = bytes([Opcode.FOOTER]) + _FOOTER_LENGTH.to_bytes(8, "little")
    fields = head + start.to_bytes(8, "little") + offset_start.to_bytes(8, "little")
    return serialized(Footer(start, offset_start, zlib.crc32(summary + offsets + fields)))


@cache
def library() -> str:
    """Return what a file says that it was written by."""
    try:
        return f"wheelsoil {version('wheelsoil')}"
    except PackageNotFoundError:
        return "wheelsoil unknown"


@dataclass(frozen=True)
class MessageGroup:
    """Messages of one channel that go into a chunk together.

    Attributes
    ----------
    records : sequence of bytes-like
        Whole MCAP message records; joined they are what is written.
    index : structured array of `INDEX_ENTRY`
        Of the messages; offsets are counted from the beginning of the joined `records`.
    """

    channel_id: int
    records: Sequence[bytes | memoryview]
    index: NDArray[np.void]


class McapSink:
    """An MCAP file with one writer; records of the data section as they come, the summary at `finish`.

    `schemas` and `channels` are those defined so far, by id. Raises as `DiskFile`, HardwareError from any method.
    """

    def __init__(
        self,
        path: Path,
        *,
        compression: Compression = "zstd",
        overwrite: bool = False,
        profile: str = PROFILE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = path
        self._compression = "" if compression == "none" else compression
        self._compress = compressor(compression)
        self.file = DiskFile(path, overwrite=overwrite, clock=clock)
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._defined: set[int] = set()
        self._chunk_indexes = RecordBuilder()
        self._chunk_count = 0
        self._attachment_indexes: list[AttachmentIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._message_counts: dict[int, int] = {}
        self._times: tuple[int, int] | None = None
        try:
            self.file.write(MAGIC + serialized(Header(profile, library())))
        except BaseException:
            self.give_up()
            raise
        self._noted = self.file.position
        """Bytes written of records that the summary knows."""

    def add_schema(self, name: str, text: str) -> int:
        """Add a ros2msg schema, or return the id of the one that is there."""
        data = text.encode()
        for known in self.schemas.values():
            if known.name == name and known.data == data:
                return known.id
        schema = Schema(id=len(self.schemas) + 1, name=name, encoding=SCHEMA_ENCODING, data=data)
        self.schemas[schema.id] = schema
        return schema.id

    def add_channel(self, topic: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Add a cdr channel and return its id."""
        channel = Channel(len(self.channels) + 1, topic, MESSAGE_ENCODING, dict(metadata), schema_id)
        self.channels[channel.id] = channel
        return channel.id

    def put_definitions(self, schemas: Mapping[int, Schema], channels: Mapping[int, Channel]) -> None:
        """Write definitions of another file, under the ids they have there, ahead of its chunks."""
        self.schemas.update(schemas)
        self.channels.update(channels)
        self.file.write(serialized(*schemas.values(), *channels.values()))
        self._noted = self.file.position

    def write_chunk(self, groups: Iterable[MessageGroup]) -> None:
        """Write messages as one chunk, which begins with those of their definitions that no chunk has yet."""
        groups = list(groups)
        if not groups:
            return
        new = [self.channels[group.channel_id] for group in groups if group.channel_id not in self._defined]
        schemas = [self.schemas[schema_id] for schema_id in dict.fromkeys(channel.schema_id for channel in new)]
        parts: list[bytes | memoryview] = [serialized(*schemas, *new)]
        size = len(parts[0])
        index: dict[int, NDArray[np.void]] = {}
        for group in groups:
            index[group.channel_id] = group.index
            group.index["offset"] += size
            parts += group.records
            size += sum(map(len, group.records))
        content = b"".join(parts)
        chunk = PackedChunk(self._compress(content), self._compression, size, zlib.crc32(content))
        self.put_chunk(chunk, index)
        self._defined.update(index)

    def put_chunk(self, chunk: PackedChunk, index: Mapping[int, NDArray[np.void]]) -> None:
        """Write a chunk that is already compressed; `index` has the messages of each channel id, as `INDEX_ENTRY`."""
        times = [entries["log_time"] for entries in index.values() if len(entries)]
        start = min((int(own.min()) for own in times), default=0)
        end = max((int(own.max()) for own in times), default=0)
        head = chunk.head(start, end)
        size = len(head) + len(chunk.data)
        offsets: dict[int, int] = {}
        messages = b""
        for channel_id, entries in index.items():
            offsets[channel_id] = self.file.position + size + len(messages)
            messages += message_index(channel_id, entries)
        chunk_index = ChunkIndex(
            chunk_length=size,
            chunk_start_offset=self.file.position,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            message_end_time=end,
            message_index_length=len(messages),
            message_index_offsets=offsets,
            message_start_time=start,
            uncompressed_size=chunk.unpacked_size,
        )
        with self._written_and_noted(head, chunk.data, messages):
            chunk_index.write(self._chunk_indexes)
            self._chunk_count += 1
            for channel_id, entries in index.items():
                self._message_counts[channel_id] = self._message_counts.get(channel_id, 0) + len(entries)
            if times:
                first, last = self._times or (start, end)
                self._times = (min(first, start), max(last, end))

    def attach(self, name: str, data: bytes) -> None:
        """Write an attachment."""
        time_ns = time.time_ns()
        media_type = "text/plain" if name.endswith(_TEXT_SUFFIXES) else "application/octet-stream"
        record = serialized(Attachment(0, time_ns, name, media_type, data))
        index = AttachmentIndex(self.file.position, len(record), time_ns, 0, len(data), name, media_type)
        with self._written_and_noted(record):
            self._attachment_indexes.append(index)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        record = serialized(Metadata(name=name, metadata=dict(values)))
        index = MetadataIndex(self.file.position, len(record), name)
        with self._written_and_noted(record):
            self._metadata_indexes.append(index)

    def finish(self) -> None:
        """Write the summary and close the file.

        Without a summary it is closed when a write failed, or when an interrupt came between a record and its
        index: readers then go by the records themselves.
        """
        try:
            if not self.file.failed and self.file.position == self._noted:
                self.file.write(self._summary())
                self.file.sync()
        finally:
            self.file.close()

    def give_up(self) -> None:
        """Close and delete the file: for one that could not even be begun."""
        self.file.close()
        self.path.unlink(missing_ok=True)

    @contextmanager
    def _written_and_noted(self, *record: bytes | memoryview) -> Iterator[None]:
        """Write a record in parts; the block notes it for the summary. If Ctrl-C prevents that, `finish` sees it."""
        not_noted = self.file.position - self._noted
        self.file.write(*record)
        yield
        self._noted = self.file.position - not_noted

    def _summary(self) -> bytes:
        data_end = serialized(DataEnd(0))
        start = self.file.position + len(data_end)
        chunk_indexes: bytes = self._chunk_indexes.end()  # type: ignore[no-untyped-call]
        groups = (
            (Opcode.SCHEMA, serialized(*self.schemas.values())),
            (Opcode.CHANNEL, serialized(*self.channels.values())),
            (Opcode.STATISTICS, serialized(self._statistics())),
            (Opcode.CHUNK_INDEX, chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, serialized(*self._attachment_indexes)),
            (Opcode.METADATA_INDEX, serialized(*self._metadata_indexes)),
        )
        body, offsets = b"", b""
        for opcode, group in groups:
            if group:
                offsets += serialized(SummaryOffset(opcode, start + len(body), len(group)))
            body += group
        return data_end + body + offsets + footer(body, offsets, start) + MAGIC

    def _statistics(self) -> Statistics:
        start, end = self._times or (0, 0)
        return Statistics(
            attachment_count=len(self._attachment_indexes),
            channel_count=len(self.channels),
            channel_message_counts=self._message_counts,
            chunk_count=self._chunk_count,
            message_count=sum(self._message_counts.values()),
            message_end_time=end,
            message_start_time=start,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self.schemas),
        )
