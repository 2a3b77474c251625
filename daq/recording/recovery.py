"""Recovery of a cut-off or damaged recording into a new, complete file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from daq.errors import RecordingError
from daq.recording.chunks import ChunkEntry, DamagedError, content_records, message_head, read_packed, unpacked
from daq.recording.contents import Contents, Loss
from daq.recording.format import with_checksum
from daq.recording.reader import Recording
from daq.recording.sink import McapSink, index_entries

RECOVERED = "recovered"
"""Name of the metadata record that says what was lost."""


@dataclass(frozen=True)
class Recovery:
    """Result of `recover`.

    Attributes
    ----------
    path : Path
        The new file.
    chunk_count : int
        Chunks that were copied.
    loss : tuple of Loss
        What could not be.
    """

    path: Path
    chunk_count: int
    loss: tuple[Loss, ...]


def recover(source: str | Path, target: str | Path, *, overwrite: bool = False) -> Recovery:
    """Copy everything that is whole into a new file with summary and index.

    Chunks are copied as they are. Attachments, metadata and foreign topics come along; a metadata record
    ``recovered`` says what was lost.

    Raises
    ------
    RecordingError
        If `source` is no MCAP file or there is nothing in it, or `target` is there already or is `source`.
    HardwareError
        If the disk is full.
    """
    recording = Recording.open(source)
    path = Path(target)
    if path.exists() and path.samefile(recording.path):
        raise RecordingError.of("a recording cannot be recovered onto itself", path, next_step="choose another name")
    contents = recording.contents
    if not contents.chunks and not contents.has_summary:
        what = "there is nothing in it to save: it was cut off before anything was recorded"
        raise RecordingError.of(what, recording.path, f"{contents.size:,} bytes")
    sink = McapSink(path, overwrite=overwrite, profile=contents.profile)
    try:
        for name, data in recording.attachments.items():
            sink.attach(name, data)
        for name, values in recording.metadata.items():
            sink.add_metadata(name, with_checksum(name, values))
        sink.put_definitions(contents.schemas, contents.channels)
        count, damaged = _copy_chunks(contents, sink)
        loss = tuple(sorted([*recording.loss, *damaged], key=lambda item: item.at_byte))
        record = {"source": recording.path.name, **{f"loss.{i}": str(item) for i, item in enumerate(loss, 1)}}
        sink.add_metadata(RECOVERED, with_checksum(RECOVERED, record))
    finally:
        sink.finish()
    return Recovery(path, count, loss)


def _copy_chunks(contents: Contents, sink: McapSink) -> tuple[int, list[Loss]]:
    damaged: list[Loss] = []
    with contents.path.open("rb") as file:
        for entry in contents.chunks:
            try:
                packed = read_packed(file, entry)
                sink.put_chunk(packed, _messages(unpacked(packed), contents, entry))
            except DamagedError as damage:
                damaged.append(Loss(str(damage), entry.offset, entry.size))
    return len(contents.chunks) - len(damaged), damaged


def _messages(content: bytes, contents: Contents, entry: ChunkEntry) -> Mapping[int, NDArray[np.void]]:
    """Return the message index of a chunk, read from the messages themselves."""
    found: dict[int, tuple[list[int], list[int]]] = {}
    for opcode, start, length in content_records(content):
        if opcode == Opcode.MESSAGE:
            channel_id, log_time_ns = message_head(content, start, length)
            times, offsets = found.setdefault(channel_id, ([], []))
            times.append(log_time_ns)
            offsets.append(start - 9)
    unknown = found.keys() - contents.channels.keys()
    if unknown:
        raise DamagedError(f"a chunk of channels that nothing defines: {sorted(unknown)} at byte {entry.offset}")
    return {i: index_entries(np.array(times, np.uint64), np.array(offsets)) for i, (times, offsets) in found.items()}
