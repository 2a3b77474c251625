"""Bytes of the MCAP records that a sink writes."""

from __future__ import annotations

import zlib
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Footer, McapRecord
from numpy.typing import NDArray

_INDEX_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
_FOOTER_LENGTH = 8 + 8 + 4


def serialized(*records: McapRecord) -> bytes:
    """Return MCAP records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def index_entries(log_time_ns: NDArray[np.int64], offsets: NDArray[np.int64]) -> NDArray[np.void]:
    """Return a message index as the array `McapSink.put_chunk` takes.

    Parameters
    ----------
    log_time_ns, offsets : int64 arrays, shape (n,)
        Not negative; bytes from the beginning of the uncompressed chunk.
    """
    entries = np.empty(len(offsets), _INDEX_ENTRY)
    entries["log_time"] = log_time_ns
    entries["offset"] = offsets
    return entries


def message_index(channel_id: int, entries: NDArray[np.void]) -> bytes:
    """Return the message index record of one channel of a chunk; `entries` as `index_entries` makes them."""
    size = entries.nbytes
    head = bytes([Opcode.MESSAGE_INDEX]) + (6 + size).to_bytes(8, "little")
    return head + channel_id.to_bytes(2, "little") + size.to_bytes(4, "little") + entries.tobytes()


def footer(summary: bytes, offsets: bytes, start: int) -> bytes:
    """Return the footer behind a summary and its offsets; `start` is where the summary begins in the file."""
    offset_start = start + len(summary)
    head = bytes([Opcode.FOOTER]) + _FOOTER_LENGTH.to_bytes(8, "little")
    told = head + start.to_bytes(8, "little") + offset_start.to_bytes(8, "little")
    return serialized(Footer(start, offset_start, zlib.crc32(summary + offsets + told)))


def library() -> str:
    """Return what a file says that it was written by."""
    try:
        return f"wheelsoil {version('wheelsoil')}"
    except PackageNotFoundError:
        return "wheelsoil unknown"
