"""The summary of an MCAP file, taken only when its checksum holds."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, MetadataIndex, Statistics

from daq.recording.chunks import ChunkEntry, DamagedError, content_records, read_at
from daq.recording.contents import MAGIC, Contents, Loss, parsed

_FOOTER = struct.Struct("<BQQQI")
_FOOTER_BODY_SIZE = 20


def take_summary(file: BinaryIO, contents: Contents) -> bool:
    """Take what the summary says, and say whether there was a whole one."""
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
