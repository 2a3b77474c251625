"""Walking the records of an MCAP file that has no summary, over damaged places."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from daq.recording.chunks import ChunkEntry, DamagedError, read_at
from daq.recording.contents import MAGIC, RECORD, Contents, Loss, parsed

_MESSAGE_INDEX_HEAD = struct.Struct("<HI")
_SCAN_BLOCK = 1 << 20
_CHUNK_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_OFFSET = 9 + 28
"""Where the compression stands in a chunk record."""


def walk(file: BinaryIO, contents: Contents) -> None:
    """Note every whole record from the first to the last.

    Where the next record is none, the length of the one before may be what is damaged: the search for the next
    chunk goes on from there.
    """
    position = before = len(MAGIC)
    while position < contents.size:
        head = read_at(file, position, 9)
        opcode, length = RECORD.unpack(head.ljust(9, b"\0"))
        end = position + 9 + length
        try:
            if len(head) < 9 or end > contents.size:
                raise DamagedError("a record is cut off")
            if not _take_record(file, contents, opcode, position, length):
                return
            before, position = position, end
        except DamagedError as damage:
            _doubt_channels(contents)
            resumed = _next_chunk(file, contents, before + 1)
            contents.losses.append(Loss(str(damage), position, max(resumed - position, 0)))
            before = position = resumed
    _doubt_channels(contents)


def _doubt_channels(contents: Contents) -> None:
    """Take it that the last chunk may hold more channels than those whose index came before the damage."""
    if contents.chunks and not contents.chunks[-1].bare:
        contents.chunks[-1] = replace(contents.chunks[-1], channel_ids=None)


def _take_record(file: BinaryIO, contents: Contents, opcode: int, position: int, length: int) -> bool:
    """Note one record of the data section; say whether to walk on."""
    size = 9 + length
    if opcode == Opcode.CHUNK:
        contents.chunks.append(ChunkEntry.at(file, position, size))
    elif opcode == Opcode.MESSAGE_INDEX:
        _take_message_index(file, contents, position, length)
    elif opcode == Opcode.ATTACHMENT:
        parsed(Attachment.read, read_at(file, position + 9, length))
        contents.attachments.append((position, size))
    elif opcode == Opcode.METADATA:
        parsed(Metadata.read, read_at(file, position + 9, length))
        contents.metadata.append((position, size))
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        contents.define(opcode, read_at(file, position + 9, length))
    elif opcode == Opcode.MESSAGE and length >= 22:
        _take_bare_message(file, contents, position, size)
    elif opcode == Opcode.DATA_END and length == 4:
        return False
    elif opcode != Opcode.HEADER or position != len(MAGIC):
        raise DamagedError("bytes that are no record")
    return True


def _take_message_index(file: BinaryIO, contents: Contents, position: int, length: int) -> None:
    """Note which channel the chunk before holds, and how many messages of it."""
    channel_id, size = _MESSAGE_INDEX_HEAD.unpack(read_at(file, position + 9, 6).ljust(6, b"\xff"))
    if size != length - 6 or size % 16:
        raise DamagedError("a message index contradicts itself about its length")
    if contents.chunks:
        contents.chunks[-1] = contents.chunks[-1].with_channel(channel_id)
    contents.message_counts[channel_id] = contents.message_counts.get(channel_id, 0) + size // 16


def _take_bare_message(file: BinaryIO, contents: Contents, position: int, size: int) -> None:
    """Take messages that lie in no chunk as if they were one, run by run."""
    channel_id, _, time_ns = struct.unpack("<HIQ", read_at(file, position + 9, 14))
    if channel_id not in contents.channels:
        raise DamagedError("a message of an unknown channel")
    contents.message_counts[channel_id] = contents.message_counts.get(channel_id, 0) + 1
    last = contents.chunks[-1] if contents.chunks else None
    if last is not None and last.bare and last.offset + last.size == position and last.size < _SCAN_BLOCK:
        contents.chunks[-1] = last.grown(size, time_ns, channel_id)
    else:
        contents.chunks.append(ChunkEntry(position, size, time_ns, time_ns, frozenset([channel_id]), bare=True))


def _next_chunk(file: BinaryIO, contents: Contents, position: int) -> int:
    """Return where the next believable chunk begins, or the end of the file."""
    while position < contents.size:
        block = read_at(file, position, _SCAN_BLOCK + _MARK_OFFSET + 8)
        for start in _marked(block):
            offset = position + start
            try:
                opcode, length = RECORD.unpack_from(block, start)
                if opcode == Opcode.CHUNK and offset + 9 + length <= contents.size:
                    ChunkEntry.at(file, offset, 9 + length)
                    return offset
            except DamagedError:
                continue
        position += _SCAN_BLOCK
    return contents.size


def _marked(block: bytes) -> Iterator[int]:
    """Yield where in `block` a chunk could begin, by the name of its compression."""
    found = []
    for mark in _CHUNK_MARKS:
        at = block.find(mark, _MARK_OFFSET)
        while at >= 0:
            found.append(at - _MARK_OFFSET)
            at = block.find(mark, at + 1)
    yield from sorted(found)
