"""Topics of decoded series in a recording: here the topics are the source, there are no raw frames behind them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from daq.recording.chunks import RECORD, ChunkEntry, DamagedError, read_chunk
from daq.recording.contents import Contents, opened
from daq.recording.decoded_topics import layout_of
from daq.recording.format import MESSAGE_OPCODE, PACKAGE, SERIES_BUS
from daq.series.blocks import BLOCK_ROWS, Blocks, SeriesBlock


@dataclass(frozen=True)
class SeriesTopic:
    """A topic of decoded series.

    Attributes
    ----------
    name : str
        As the file had it: a table, a time column, a ROS topic.
    units : mapping column -> unit
        In the order of the fields.
    dtype : structured dtype
        Of a whole MCAP message record.
    """

    name: str
    units: Mapping[str, str]
    dtype: np.dtype[np.void]

    def block(self, records: Sequence[NDArray[np.void]]) -> SeriesBlock:
        """Return the rows of message records."""
        rows = np.concatenate(records)
        time_ns = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        names = [name for name in rows.dtype.names or () if name.startswith("field_")]
        return SeriesBlock(self.name, time_ns, {c: rows[n].copy() for c, n in zip(self.units, names, strict=True)})


def series_topics(contents: Contents) -> dict[int, SeriesTopic]:
    """Return the topics of decoded series by channel id."""
    found: dict[int, SeriesTopic] = {}
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        described = channel.metadata.get("signals")
        if schema and schema.name.startswith(PACKAGE) and described and channel.metadata.get("bus") == SERIES_BUS:
            fields = json.loads(described)
            units = {field["name"]: field["unit"] for field in fields.values()}
            found[channel.id] = SeriesTopic(channel.metadata["message"], units, layout_of(tuple(fields)))
    return found


def series_blocks(
    path: Path,
    chunks: Sequence[ChunkEntry],
    topics: Mapping[int, SeriesTopic],
    damaged: Callable[[ChunkEntry, str], None],
) -> Iterator[Blocks]:
    """Yield the rows of topics from chunks; `damaged` is called with each that cannot be read, and the reason."""
    gathered: dict[int, list[NDArray[np.void]]] = {}
    count = 0
    with opened(path) as file:
        for entry in chunks:
            count += _gather(file, entry, topics, gathered, damaged)
            if count >= BLOCK_ROWS:
                yield tuple(topics[key].block(records) for key, records in gathered.items())
                gathered, count = {}, 0
        if count:
            yield tuple(topics[key].block(records) for key, records in gathered.items())


def _gather(
    file: BinaryIO,
    entry: ChunkEntry,
    topics: Mapping[int, SeriesTopic],
    gathered: dict[int, list[NDArray[np.void]]],
    damaged: Callable[[ChunkEntry, str], None],
) -> int:
    """Add the records of one chunk; those of one topic that lie behind each other are taken at once."""
    count = 0
    try:
        content = read_chunk(file, entry)
        at = 0
        while at < len(content):
            if at + RECORD.size > len(content):
                raise DamagedError("a record is cut off")
            opcode, length = RECORD.unpack_from(content, at)
            topic = (
                topics.get(int.from_bytes(content[at + 9 : at + 11], "little")) if opcode == MESSAGE_OPCODE else None
            )
            if topic is None:
                at = _past(content, at, length)
                continue
            if 9 + length != topic.dtype.itemsize:
                raise DamagedError(f"a message of {length} bytes is none of topic {topic.name!r}")
            rows = np.frombuffer(content, topic.dtype, (len(content) - at) // topic.dtype.itemsize, at)
            head = rows[["opcode", "record_length", "channel_id"]]
            other = np.flatnonzero(head != head[:1]) if len(rows) else np.zeros(0, np.intp)
            rows = rows[: int(other[0])] if len(other) else rows
            if not len(rows):
                raise DamagedError("a record is cut off")
            gathered.setdefault(int(rows["channel_id"][0]), []).append(rows)
            count += len(rows)
            at += rows.nbytes
    except (DamagedError, ValueError) as error:
        damaged(entry, str(error))
    return count


def _past(content: bytes, at: int, length: int) -> int:
    end = at + 9 + length
    if end > len(content):
        raise DamagedError("a record is cut off")
    return end
