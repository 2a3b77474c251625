"""Events out of a recording's chunks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mcap.opcode import Opcode

from daq.recording.chunks import (
    MESSAGE_HEAD_SIZE,
    ChunkEntry,
    DamagedError,
    content_records,
    message_head,
    read_chunk,
)
from daq.recording.contents import Contents, unreadable
from daq.recording.events import EVENT_SCHEMA, EVENT_TOPIC, Event, decode_event
from daq.recording.format import MESSAGE_ENCODING


def read_events(path: Path, contents: Contents, damaged: Callable[[ChunkEntry, str], None]) -> tuple[Event, ...]:
    """Return the events of a file, in its order.

    Parameters
    ----------
    path : Path
    contents : Contents
    damaged : callable
        Is told of each chunk that cannot be read, and why.

    Raises
    ------
    RecordingError
        If the file is gone, or the disk fails.
    """
    channels = {
        channel.id
        for channel in contents.channels.values()
        if channel.topic == EVENT_TOPIC
        and channel.message_encoding == MESSAGE_ENCODING
        and channel.schema_id in contents.schemas
        and contents.schemas[channel.schema_id].name == EVENT_SCHEMA
    }
    found: list[Event] = []
    try:
        with path.open("rb") as file:
            for entry in contents.chunks if channels else ():
                # only a summary is sure to name all channels of a chunk
                if contents.has_summary and entry.channel_ids is not None and entry.channel_ids.isdisjoint(channels):
                    continue
                try:
                    found += _events(read_chunk(file, entry), channels)
                except DamagedError as damage:
                    damaged(entry, str(damage))
    except OSError as error:
        raise unreadable(path, error) from None
    return tuple(found)


def _events(content: bytes, channels: set[int]) -> list[Event]:
    found = []
    for opcode, start, length in content_records(content):
        if opcode == Opcode.MESSAGE:
            channel_id, log_time_ns = message_head(content, start, length)
            if channel_id in channels:
                found.append(decode_event(content[start + MESSAGE_HEAD_SIZE : start + length], log_time_ns))
    return found
