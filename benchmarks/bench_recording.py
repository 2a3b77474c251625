"""Recordings against python mcap with a message a frame: the same frames, the same compression."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.row import Row, median_seconds
from daq.frames import CLASSIC_DTYPE, FrameArray, FrameBatch, split
from daq.recording import Recording, RecordingWriter

FRAME_COUNT = 200_000
BATCH = 640
"""Frames a batch: what 0.2 s bring at 3.2 kframes/s."""
REPEATS = 3
COMPRESSIONS = ("zstd", "lz4", "none")


def rows() -> list[Row]:
    frames = wft_frames(FRAME_COUNT)
    with tempfile.TemporaryDirectory() as folder:
        return [row for name in COMPRESSIONS for row in _against_mcap(frames, Path(folder), name)]


def wft_frames(count: int) -> FrameArray:
    """Return frames as a wheel force transducer sends them: three messages at 1 kHz, four 16-bit signals each."""
    rng = np.random.default_rng(0)
    number = np.arange(count)
    signals = 8000 * np.sin(number[:, None] * [1e-4, 2e-4, 3e-4, 5e-5]) + rng.normal(scale=20, size=(count, 4))
    frames = np.zeros(count, CLASSIC_DTYPE)
    frames["time_ns"] = 1_700_000_000_000_000_000 + number // 3 * 1_000_000 + rng.integers(0, 90_000, count)
    frames["can_id"] = 0x100 + number % 3
    frames["length"] = 8
    frames["data"] = signals.astype("<i2").view(np.uint8)
    return frames


def _against_mcap(frames: FrameArray, folder: Path, compression: str) -> list[Row]:
    ours, theirs = folder / f"ours_{compression}.mcap", folder / f"theirs_{compression}.mcap"
    write_peer_s = median_seconds(lambda: _write_mcap(theirs, frames, compression), REPEATS)
    write_s = median_seconds(lambda: _write(ours, frames, compression), REPEATS)
    assert np.array_equal(Recording.open(ours).frames().frames, frames)
    assert np.array_equal(_read_mcap(theirs, "time_ns"), frames["time_ns"])
    read_peer_s = median_seconds(lambda: _read_mcap(theirs, "time_ns"), REPEATS)
    read_s = median_seconds(lambda: _read(ours), REPEATS * 3)
    size, size_peer = ours.stat().st_size, theirs.stat().st_size
    return [
        _speed_row(f"MCAP write, {compression}", write_s, write_peer_s, 5),
        _speed_row(f"MCAP read to numpy, {compression}", read_s, read_peer_s, 40),
        Row(
            f"MCAP size of {FRAME_COUNT} frames, {compression}",
            f"{size / 1e6:.2f} MB",
            f"{size_peer / 1e6:.2f} MB",
            f"{size / size_peer:.2f}",
            "smaller",
            size < size_peer,
        ),
    ]


def _speed_row(what: str, ours_s: float, peer_s: float, to_reach: float) -> Row:
    def rate(seconds: float) -> str:
        return f"{FRAME_COUNT / seconds / 1e6:.3g} Mframes/s"

    ratio = peer_s / ours_s
    return Row(
        what,
        rate(ours_s),
        f"mcap, a message a frame: {rate(peer_s)}",
        f"{ratio:.1f}x",
        f">= {to_reach}x",
        ratio >= to_reach,
    )


def _write(path: Path, frames: FrameArray, compression: str) -> None:
    with RecordingWriter(path, compression=compression, overwrite=True) as writer:  # type: ignore[arg-type]
        for batch in split(FrameBatch(frames, ("can0",)), BATCH):
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
