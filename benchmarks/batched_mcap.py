"""mcap and foxglove-sdk that write the raw frames in batches as we do; runs in the environment of the peers.

``python -m benchmarks.batched_mcap FRAMES REPEATS COMPRESSION...`` prints, for each compression, the processor times of
writing and reading by each library, the sizes in MB and the frames in a message, as JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from benchmarks.can_log import BUS, wft_frames
from benchmarks.timing import side_by_side
from daq.can import CLASSIC_DTYPE, FrameArray, FrameBatch, split
from daq.recording import (
    CLASSIC_SCHEMA,
    FRAMES_PER_MESSAGE,
    MESSAGE_ENCODING,
    PROFILE,
    RAW_PREFIX_SIZE,
    SCHEMA_ENCODING,
    Recording,
    RecordingWriter,
    raw_message_head,
    raw_schema_text,
)

CHUNK_BYTES = 1 << 20
TOPIC = f"/can/{BUS}/raw"
METADATA = {"bus": BUS, "bus_index": "0"}


def main(count: int, repeats: int, compressions: list[str]) -> dict[str, Any]:
    """Return times, sizes and batch of each compression, once all files hold the same frames."""
    frames = wft_frames(count)
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for compression in compressions:
            writers = {"ours": _write_ours, "mcap": _write_mcap, "foxglove-sdk": _write_foxglove}
            paths = {name: Path(folder) / f"{name}-{compression}.mcap" for name in writers}
            write_s = side_by_side(
                {name: partial(write, paths[name], frames, compression) for name, write in writers.items()}, repeats
            )
            for path in paths.values():
                assert np.array_equal(Recording.open(path).frames().frames, frames), path.name
            readers: dict[str, Callable[[Path], int]] = {"ours": _read_ours, "mcap": _read_mcap}
            read_s = side_by_side({name: partial(read, paths["ours"]) for name, read in readers.items()}, repeats)
            size_mb = {name: path.stat().st_size / 1e6 for name, path in paths.items()}
            found[compression] = (write_s, read_s, size_mb, FRAMES_PER_MESSAGE)
    return found


def _write_ours(path: Path, frames: FrameArray, compression: str) -> None:
    with RecordingWriter(path, compression=compression, chunk_bytes=CHUNK_BYTES, overwrite=True) as writer:  # type: ignore[arg-type]
        for batch in split(FrameBatch(frames, (BUS,)), FRAMES_PER_MESSAGE):
            writer.write_frames(batch)


def _messages(frames: FrameArray) -> Iterator[tuple[int, bytes]]:
    """Yield the log time and the CDR bytes of each batch."""
    for start in range(0, len(frames), FRAMES_PER_MESSAGE):
        piece = frames[start : start + FRAMES_PER_MESSAGE]
        time_ns = int(piece["time_ns"][-1])
        head = raw_message_head(0, 0, time_ns, len(piece), piece.dtype.itemsize)[-RAW_PREFIX_SIZE:]
        yield time_ns, head + piece.tobytes()


def _write_mcap(path: Path, frames: FrameArray, compression: str) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType[compression.upper()])
        writer.start(profile=PROFILE)
        schema = writer.register_schema(CLASSIC_SCHEMA, SCHEMA_ENCODING, raw_schema_text(CLASSIC_SCHEMA).encode())
        channel = writer.register_channel(TOPIC, MESSAGE_ENCODING, schema, METADATA)
        for time_ns, data in _messages(frames):
            writer.add_message(channel, time_ns, data, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]


def _write_foxglove(path: Path, frames: FrameArray, compression: str) -> None:
    packing = None if compression == "none" else getattr(MCAPCompression, compression.capitalize())
    options = MCAPWriteOptions(compression=packing, chunk_size=CHUNK_BYTES, profile=PROFILE)
    context = foxglove.Context()
    with foxglove.open_mcap(str(path), allow_overwrite=True, writer_options=options, context=context):
        schema = foxglove.Schema(
            name=CLASSIC_SCHEMA, encoding=SCHEMA_ENCODING, data=raw_schema_text(CLASSIC_SCHEMA).encode()
        )
        channel = foxglove.Channel(
            TOPIC, schema=schema, message_encoding=MESSAGE_ENCODING, metadata=METADATA, context=context
        )
        for time_ns, data in _messages(frames):
            channel.log(data, log_time=time_ns)


def _read_ours(path: Path) -> int:
    return sum(len(batch) for batch in Recording.open(path).frame_batches())


def _read_mcap(path: Path) -> int:
    """Read our file with the peer, each message as a view of its frames."""
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        pieces = [np.frombuffer(message.data, CLASSIC_DTYPE, offset=RAW_PREFIX_SIZE) for _, _, message in messages]
    return len(np.concatenate(pieces))


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])))
