"""Recordings against python mcap and foxglove-sdk: the same frames, compression and chunk size.

Beside peers that write batches as we do, and beside the usual way, a message a frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.can_log import wft_frames
from benchmarks.peer_environment import PeersMissingError, run_beside_peers
from benchmarks.table import Row, at_least, at_most, compared, judged, rate_of
from benchmarks.timing import side_by_side
from daq.can import CLASSIC_DTYPE, FrameArray, FrameBatch, split
from daq.recording import Recording, RecordingWriter

FRAME_COUNT, BATCHED_COUNT = 200_000, 1_000_000
ARRIVING = 640
"""Frames that come together: what 0.2 s bring at 3.2 kframes/s."""
REPEATS, BATCHED_REPEATS = 3, 7
COMPRESSIONS = ("zstd", "lz4", "none")


def rows() -> list[Row]:
    frames = wft_frames(FRAME_COUNT)
    with tempfile.TemporaryDirectory() as folder:
        single = [row for name in COMPRESSIONS for row in _message_a_frame(frames, Path(folder), name)]
    return [*_equal_batches(), *single]


def _equal_batches() -> list[Row]:
    what = "MCAP in equal batches"
    try:
        found = run_beside_peers("batched_mcap", str(BATCHED_COUNT), str(BATCHED_REPEATS), *COMPRESSIONS)
    except PeersMissingError as error:
        return [Row(what, "-", str(error))]
    as_text = rate_of(BATCHED_COUNT)
    table = []
    for compression, (write_s, read_s, size_mb, batch) in found.items():
        how = f"equal batches ({batch} frames a message), {compression}"
        for peer in ("mcap", "foxglove-sdk"):
            remark = ", with time check and fsync"
            table.append(
                compared(f"MCAP write, {how}", write_s["ours"], peer, write_s[peer], as_text, at_least(1, "x"), remark)
            )
        table.append(
            compared(
                f"MCAP read to numpy, {how}",
                read_s["ours"],
                "mcap",
                read_s["mcap"],
                as_text,
                at_least(1, "x"),
                ", with checksums verified",
            )
        )
        table.append(_size_row(f"MCAP size of {BATCHED_COUNT:,} frames, {how}", size_mb["ours"], size_mb["mcap"], 1.02))
    return table


def _message_a_frame(frames: FrameArray, folder: Path, compression: str) -> list[Row]:
    ours, theirs = folder / f"ours_{compression}.mcap", folder / f"theirs_{compression}.mcap"
    write_s = _in_turns(partial(_write, ours, frames, compression), partial(_write_mcap, theirs, frames, compression))
    assert np.array_equal(Recording.open(ours).frames().frames, frames)
    assert np.array_equal(_read_mcap(theirs, "time_ns"), frames["time_ns"])
    read_s = _in_turns(partial(_read, ours), partial(_read_mcap, theirs, "time_ns"))
    how, peer, as_text = f"ours in batches, {compression}", "mcap, a message a frame", rate_of(len(frames))
    size, peer_size = (path.stat().st_size / 1e6 for path in (ours, theirs))
    return [
        compared(f"MCAP write, {how}", write_s["ours"], peer, write_s["peer"], as_text, at_least(5, "x")),
        compared(f"MCAP read to numpy, {how}", read_s["ours"], peer, read_s["peer"], as_text, at_least(40, "x")),
        _size_row(f"MCAP size of {len(frames):,} frames, {how}", size, peer_size, 1, peer),
    ]


def _in_turns(ours: Callable[[], object], peer: Callable[[], object]) -> dict[str, list[float]]:
    return side_by_side({"ours": ours, "peer": peer}, REPEATS)


def _size_row(what: str, mb: float, peer_mb: float, most: float, peer: str = "mcap") -> Row:
    ratio = mb / peer_mb
    return judged(what, f"{mb:.2f} MB", ratio, at_most(most, "x"), f"{peer}: {peer_mb:.2f} MB", f"{ratio:.2f}x")


def _write(path: Path, frames: FrameArray, compression: str) -> None:
    with RecordingWriter(path, compression=compression, overwrite=True) as writer:  # type: ignore[arg-type]
        for batch in split(FrameBatch(frames, ("can0",)), ARRIVING):
            writer.write_frames(batch)


def _read(path: Path) -> int:
    return sum(len(batch) for batch in Recording.open(path).frame_batches())


def _write_mcap(path: Path, frames: FrameArray, compression: str) -> None:
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[compression.upper()])
        writer.start()
        channel = writer.register_channel("/can/can0/raw", "cdr", writer.register_schema("frame", "ros2msg", b""))
        size, data, add = frames.dtype.itemsize, frames.tobytes(), writer.add_message
        for number, time_ns in enumerate(frames["time_ns"].tolist()):
            add(channel, time_ns, data[number * size : (number + 1) * size], time_ns, number)
        writer.finish()  # type: ignore[no-untyped-call]


def _read_mcap(path: Path, column: str) -> np.ndarray:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        return np.frombuffer(b"".join(message.data for _, _, message in messages), CLASSIC_DTYPE)[column]
