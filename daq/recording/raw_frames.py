"""Raw frames out of chunks: views of the records, merged by time between buses."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode

from daq.frames import FrameArray, FrameBatch
from daq.recording.chunks import (
    MESSAGE_HEAD_SIZE,
    ChunkEntry,
    DamagedError,
    content_records,
    message_head,
    read_chunk,
)
from daq.recording.contents import Contents, unreadable
from daq.recording.format import MESSAGE_ENCODING, RAW_DTYPES, raw_frames

BATCH_FRAMES = 1 << 16
"""Chunks are joined until they hold so many frames: what a live logger writes every 0.2 s is small."""

_CLOCK_SLACK_NS = 10_000_000_000
"""How far a host clock may step back between two chunks before a search by time would pass over frames."""


@dataclass(frozen=True)
class RawChannel:
    """A raw topic.

    Attributes
    ----------
    bus : str
    bus_index : int
        What the ``bus`` column of its records holds.
    dtype : CLASSIC_DTYPE or FD_DTYPE
    """

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
    """Yield the frames of `channels` from `chunks`.

    Parameters
    ----------
    path : Path
    chunks : sequence of ChunkEntry
    channels : dict
        Raw channels that are wanted, by id.
    buses : tuple of str
        What the ``bus`` column of the result counts.
    damaged : callable
        Is told of each chunk that cannot be read, and why.
    """
    gathered: dict[int, list[FrameArray]] = {}
    count = 0
    try:
        with path.open("rb") as file:
            for entry in chunks:
                count += _gather(file, entry, channels, gathered, damaged)
                if count >= BATCH_FRAMES:
                    yield _merged(gathered, channels, buses)
                    gathered, count = {}, 0
            if count:
                yield _merged(gathered, channels, buses)
    except OSError as error:
        raise unreadable(path, error) from None


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
) -> int:
    """Add the frames of one chunk to `gathered`; return how many there were."""
    count = 0
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
    return count


def _merged(
    gathered: dict[int, list[FrameArray]], channels: dict[int, RawChannel], buses: tuple[str, ...]
) -> FrameBatch:
    """Join what was gathered: each topic in its own order, between topics by time."""
    streams = []
    for channel_id in sorted(gathered):
        channel = channels[channel_id]
        frames = np.concatenate(gathered[channel_id])
        number = buses.index(channel.bus)
        if number != channel.bus_index:
            frames["bus"] = number
        streams.append(FrameBatch(frames, buses))
    if len(streams) == 1:
        return streams[0]
    if any(stream.is_fd for stream in streams):
        streams = [stream.widened() for stream in streams]
    # A clock that steps back must not reorder the frames of one topic: they are sorted by the latest time so far.
    latest = np.concatenate([np.maximum.accumulate(stream.frames["time_ns"]) for stream in streams])
    order = np.argsort(latest, kind="stable")
    return FrameBatch(np.concatenate([stream.frames for stream in streams]).take(order), buses)
