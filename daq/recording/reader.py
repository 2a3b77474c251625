"""Recording: an MCAP file read back as columns.

Raw frames are views of the records in the chunks, merged by time between buses.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, Self, TypeVar

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata
from pydantic import ValidationError

from daq import DataError, RecordingError, RunInfo, every_error_as, nearest
from daq.can.frames import FrameArray, FrameBatch, concatenate, frames_between, joined
from daq.limits import LARGEST_BATCH_BYTES
from daq.recording.chunks import MESSAGE_HEAD_SIZE, ChunkEntry, DamagedError, content_records, message_head, read_chunk
from daq.recording.contents import Contents, Loss, opened, parsed, read_contents, read_record
from daq.recording.events import Event, read_events
from daq.recording.format import MESSAGE_ENCODING, RAW_DTYPES, RUN_END, RUN_START, checked_metadata, raw_frames
from daq.recording.series_topics import series_blocks, series_topics
from daq.series.blocks import Blocks, Series, SeriesReport

BATCH_FRAMES = 1 << 16
"""Chunks are joined until they hold so many frames: what a live logger writes every 0.2 s is small."""

_CLOCK_SLACK_NS = 10_000_000_000
"""How far a host clock may step back between two chunks before a search by time would pass over frames."""

T = TypeVar("T")


@dataclass(frozen=True)
class RawChannel:
    """A raw topic; `bus_index` is what the ``bus`` column of its records holds."""

    bus: str
    bus_index: int
    dtype: np.dtype[np.void]


def raw_channels(contents: Contents) -> dict[int, RawChannel]:
    """Return the raw topics of wheelsoil by channel id."""
    found: dict[int, RawChannel] = {}
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        number = channel.metadata.get("bus_index", "")
        if schema and schema.name in RAW_DTYPES and channel.message_encoding == MESSAGE_ENCODING and number.isdecimal():
            bus = channel.metadata.get("bus", channel.topic)
            found[channel.id] = RawChannel(bus, int(number), RAW_DTYPES[schema.name])
    return found


def raw_batches(
    path: Path,
    chunks: Sequence[ChunkEntry],
    channels: dict[int, RawChannel],
    buses: tuple[str, ...],
    damaged: Callable[[ChunkEntry, str], None],
) -> Iterator[FrameBatch]:
    """Yield the frames of `channels`, by id, from `chunks`; the ``bus`` column of the result counts `buses`.

    `damaged` is called with each chunk that cannot be read, and the reason.
    """
    gathered: dict[int, list[FrameArray]] = {}
    count = held_bytes = 0
    with opened(path) as file:
        for entry in chunks:
            frames, content_bytes = _gather(file, entry, channels, gathered, damaged)
            count += frames
            held_bytes += content_bytes if frames else 0
            if count >= BATCH_FRAMES or held_bytes >= LARGEST_BATCH_BYTES:
                yield _merged(gathered, channels, buses)
                gathered, count, held_bytes = {}, 0, 0
        if count:
            yield _merged(gathered, channels, buses)


def chunks_between(
    chunks: Sequence[ChunkEntry], channels: Container[int], start_ns: int, end_ns: int
) -> list[ChunkEntry]:
    """Return the chunks that may hold frames of `channels` with ``start_ns <= time_ns < end_ns``.

    A chunk's log times are those of the last frame of each message, so that only its end is a bound. Its beginning
    is the end of the chunk before, less `_CLOCK_SLACK_NS`.
    """
    found: list[ChunkEntry] = []
    before_ns = -(2**63)
    for entry in chunks:
        if entry.end_ns >= start_ns and before_ns - _CLOCK_SLACK_NS < end_ns:
            found.append(entry)
        if any(channel_id in channels for channel_id in entry.channel_ids or ()):
            before_ns = entry.end_ns
    return found


def _gather(
    file: BinaryIO,
    entry: ChunkEntry,
    channels: dict[int, RawChannel],
    gathered: dict[int, list[FrameArray]],
    damaged: Callable[[ChunkEntry, str], None],
) -> tuple[int, int]:
    """Add the frames of one chunk to `gathered`; return how many there were, and the bytes that they keep in memory."""
    count, content = 0, b""
    try:
        content = read_chunk(file, entry)
        for opcode, start, length in content_records(content):
            if opcode != Opcode.MESSAGE:
                continue
            channel_id, _ = message_head(content, start, length)
            channel = channels.get(channel_id)
            if channel is not None:
                frames = raw_frames(content, start + MESSAGE_HEAD_SIZE, length - MESSAGE_HEAD_SIZE, channel.dtype)
                gathered.setdefault(channel_id, []).append(frames)
                count += len(frames)
    except (DamagedError, ValueError) as error:
        damaged(entry, str(error))
    return count, len(content)


def _merged(
    gathered: dict[int, list[FrameArray]], channels: dict[int, RawChannel], buses: tuple[str, ...]
) -> FrameBatch:
    """Join what was gathered: each topic in its own order, between topics by time."""
    streams = []
    for channel_id in sorted(gathered):
        channel = channels[channel_id]
        frames = joined(gathered[channel_id])
        number = buses.index(channel.bus)
        if number != channel.bus_index:
            frames["bus"] = number
        streams.append(FrameBatch(frames, buses))
    if len(streams) == 1:
        return streams[0]
    # A clock that steps back must not reorder the frames of one topic: they are sorted by the latest time so far.
    latest = np.concatenate([np.maximum.accumulate(stream.frames["time_ns"]) for stream in streams])
    order = np.argsort(latest, kind="stable")
    return FrameBatch(joined([stream.frames for stream in streams]).take(order), buses)


@dataclass(frozen=True)
class Topic:
    """A topic of a recording; the metadata of decoded ones are ``bus``, ``message`` and ``signals``."""

    name: str
    schema_name: str
    encoding: str
    message_count: int
    metadata: dict[str, str]


class Recording:
    """An MCAP recording, whole or cut off. Make one with `Recording.open`.

    It holds no file open; each reading opens the file anew.

    Attributes
    ----------
    contents : Contents
        What lies where in the file.
    """

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        self._raw = raw_channels(contents)
        self._damage: dict[int, Loss] = {}

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a recording.

        A file that was cut off is opened as it is: all whole chunks are read, and `loss` says what is missing.

        Raises
        ------
        RecordingError
            If there is no such file, or it is no MCAP file.
        """
        with every_error_as(RecordingError, "the recording cannot be read", lambda: path):
            return cls(read_contents(Path(path)))

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self.contents.path

    @property
    def library(self) -> str:
        """What wrote the file."""
        return self.contents.library

    @property
    def loss(self) -> tuple[Loss, ...]:
        """What cannot be read, in the order of the file.

        Damage to the frame of the file, to attachments and metadata is known at once; damage inside a chunk only
        after its frames were asked for.
        """
        _ = self.attachments, self.metadata
        return tuple(sorted([*self.contents.losses, *self._damage.values()], key=lambda loss: loss.at_byte))

    @property
    def has_raw_frames(self) -> bool:
        """Whether there are wheelsoil's raw topics."""
        return bool(self._raw)

    @cached_property
    def buses(self) -> tuple[str, ...]:
        """Names of the buses, in the order of the ``bus`` column."""
        ordered = sorted(self._raw.values(), key=lambda channel: channel.bus_index)
        return tuple(dict.fromkeys(channel.bus for channel in ordered))

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Every topic of the file, raw, decoded or foreign."""
        contents = self.contents
        return tuple(
            Topic(
                channel.topic,
                contents.schemas[channel.schema_id].name if channel.schema_id in contents.schemas else "",
                channel.message_encoding,
                contents.message_counts.get(channel.id, 0),
                dict(channel.metadata),
            )
            for channel in contents.channels.values()
        )

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """Attached files by name; damaged ones are left out and listed in `loss`."""
        found = (self._record(at, size, Opcode.ATTACHMENT, _attachment) for at, size in self.contents.attachments)
        return {attachment.name: attachment.data for attachment in found if attachment is not None}

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata records by name; of several with one name the later values win."""
        merged: dict[str, dict[str, str]] = {}
        for at, size in self.contents.metadata:
            record = self._record(at, size, Opcode.METADATA, _metadata)
            if record is not None:
                merged.setdefault(record.name, {}).update(record.metadata)
        return merged

    @cached_property
    def run(self) -> RunInfo | None:
        """What is known of the run; None where the recording does not say.

        Raises
        ------
        RecordingError
            If its value is not valid run information.
        """
        text = self.metadata.get(RUN_START, {}).get("run")
        try:
            return None if text is None else RunInfo.model_validate_json(text)
        except ValidationError:
            raise RecordingError.of("the run information cannot be read", self.path, found=str(text)) from None

    @cached_property
    def time_range_ns(self) -> tuple[int, int] | None:
        """Time of the first and the last frame (in a foreign file: message); None when there is none."""
        if not self._raw:
            chunks = self.contents.chunks
            spans = (min(c.start_ns for c in chunks), max(c.end_ns for c in chunks)) if chunks else None
            return self.contents.log_time_range_ns or spans
        first = next(self._batches(self._raw, self.contents.chunks), None)
        last = next(self._batches(self._raw, self.contents.chunks[::-1]), None)
        if first is None or last is None:
            return None
        return int(first.frames["time_ns"].min()), int(last.frames["time_ns"].max())

    @cached_property
    def frame_counts(self) -> dict[str, int]:
        """Frames per bus: from ``run_end`` where the file is whole, else counted."""
        ended = self.metadata.get(RUN_END, {})
        stated = [ended.get(f"frames.{bus}", "") for bus in self.buses]
        if not self.contents.losses and all(text.isdecimal() for text in stated):
            return dict(zip(self.buses, map(int, stated), strict=True))
        counts = np.zeros(len(self.buses), np.int64)
        for batch in self._batches(self._raw, self.contents.chunks):
            counts += np.bincount(batch.frames["bus"], minlength=len(counts))
        return dict(zip(self.buses, counts.tolist(), strict=True))

    def events(self) -> tuple[Event, ...]:
        """Return the events in the order of the file; what cannot be read is listed in `loss`."""
        return read_events(self.path, self.contents, self.note_damage)

    def frames(self, bus: str | None = None) -> FrameBatch:
        """Return all frames at once; see `frame_batches`."""
        batches = list(self.frame_batches(bus))
        return concatenate(batches) if batches else FrameBatch.empty(self.buses)

    def frame_batches(
        self, bus: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[FrameBatch]:
        """Return an iterator over the raw frames, in bounded memory.

        Frames of one topic come in the order they were received; between topics (buses, classical and FD) they are
        merged by time within a batch.

        Parameters
        ----------
        bus : str, optional
            Only this bus.
        start_ns, end_ns : int, optional
            Only frames with ``start_ns <= time_ns < end_ns``.

        Raises
        ------
        RecordingError
            If the file is not one of wheelsoil's. (A recording that ended before its first frame holds none.)
        DataError
            If there is no such bus.
        """
        if not self._raw and RUN_START not in self.metadata:
            raise self._no_raw_topics()
        if bus is not None and bus not in self.buses:
            raise DataError.of(
                f"no bus is called {bus!r}", self.path, "", nearest(bus, self.buses), "`wheelsoil info` lists the buses"
            )
        channels = {i: channel for i, channel in self._raw.items() if bus in (None, channel.bus)}
        low = -(2**63) if start_ns is None else start_ns
        high = 2**63 if end_ns is None else end_ns
        chunks = chunks_between(self.contents.chunks, channels, low, high)
        return frames_between(self._batches(channels, chunks), low, high)

    @cached_property
    def series(self) -> Series | None:
        """Decoded series, in the order they were written; None where the recording is of frames."""
        topics = series_topics(self.contents)
        if not topics or self._raw:
            return None
        report = SeriesReport(str(self.path), "recording")

        def read() -> Iterator[Blocks]:
            report.balance.come("rows", 0)
            chunks = self.contents.chunks
            for blocks in series_blocks(self.path, chunks, topics, self.note_damage):
                report.balance.come("rows", sum(map(len, blocks)))
                yield tuple(report.taken(block, np.ones(len(block), np.bool_)) for block in blocks)

        return Series({topic.name: topic.units for topic in topics.values()}, read, report)

    def _batches(self, channels: dict[int, RawChannel], chunks: list[ChunkEntry]) -> Iterator[FrameBatch]:
        if self.contents.has_summary:
            chunks = [c for c in chunks if c.channel_ids is None or not c.channel_ids.isdisjoint(channels)]
        return raw_batches(self.path, chunks, channels, self.buses, self.note_damage)

    def note_damage(self, entry: ChunkEntry, why: str) -> None:
        """Take a chunk that cannot be read into `loss`."""
        self._damage[entry.offset] = Loss(why, entry.offset, entry.size)

    def _record(self, at: int, size: int, opcode: int, reader: Callable[[bytes], T]) -> T | None:
        try:
            with opened(self.path) as file:
                return reader(read_record(file, at, size, opcode))
        except DamagedError as damage:
            self._damage[at] = Loss(str(damage), at, size)
        return None

    def _no_raw_topics(self) -> RecordingError:
        topics = [topic.name for topic in self.topics]
        shown = ", ".join(topics[:8]) + (", ..." if len(topics) > 8 else "")
        what = "this MCAP file holds no wheelsoil raw topics, so there are no CAN frames to read"
        found = f"topics {shown}" if topics else "no topics"
        step = "`wheelsoil info` shows what it holds; `wheelsoil import` makes recordings of CAN logs and of bags"
        return RecordingError.of(what, self.path, found, "topics /can/<bus>/raw", step)


def _attachment(body: bytes) -> Attachment:
    attachment: Attachment = parsed(Attachment.read, body)
    texts = len(attachment.name.encode()) + len(attachment.media_type.encode())
    end = 8 + 8 + 4 + 4 + texts + 8 + len(attachment.data)
    crc = int.from_bytes(body[end : end + 4], "little")
    if crc and zlib.crc32(body[:end]) != crc:
        raise DamagedError("an attachment fails its checksum")
    return attachment


def _metadata(body: bytes) -> Metadata:
    record = parsed(Metadata.read, body)
    values = checked_metadata(record.name, record.metadata)
    if values is None:
        raise DamagedError("a metadata record fails its checksum")
    return Metadata(record.name, values)
