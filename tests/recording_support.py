"""Frames and recordings for the tests of `daq.recording`."""

from __future__ import annotations

import resource
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from daq import FloatArray, IntArray
from daq.can import CLASSIC_DTYPE, FrameArray, FrameBatch, encode, load_database, merge
from daq.can.frames import FD_DTYPE
from daq.recording import Recording, RecordingWriter
from daq.recording.reader import raw_batches, raw_channels
from daq.runs import Run

START_NS = 1_700_000_000_000_000_000


def random_frames(seed: int, count: int, *, fd: bool = False, bus_count: int = 1) -> FrameArray:
    """Return frames whose every byte is random but for a time that goes forward and a bus that exists."""
    rng = np.random.default_rng(seed)
    dtype = FD_DTYPE if fd else CLASSIC_DTYPE
    frames = np.frombuffer(rng.bytes(count * dtype.itemsize), dtype).copy()
    frames["time_ns"] = START_NS + np.cumsum(rng.integers(0, 600_000, count))
    frames["bus"] = rng.integers(0, bus_count, count)
    return frames


@contextmanager
def limited(what: int, soft: int) -> Iterator[None]:
    """Hold the process to a limit of its resources: the operating system then refuses, as it does in earnest."""
    before = resource.getrlimit(what)
    resource.setrlimit(what, (soft, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(what, before)


def write_recording(path: Path, batches: Sequence[FrameBatch], **options: object) -> None:
    """Write batches, each into a chunk of its own."""
    with RecordingWriter(path, flush_every_s=None, sync_every_s=None, **options) as writer:  # type: ignore[arg-type]
        for batch in batches:
            writer.write_frames(batch)
            writer.flush()


def write_with_message(
    path: Path, run: Run, dbc: tuple[str, str], values: FloatArray, at_ns: IntArray, role: str
) -> None:
    """Write a run with one message more, of one signal that is the role; `dbc` is name and text of its database."""
    name, text = dbc
    (message,) = load_database(text.encode(), name).messages
    (signal,) = message.signals
    frames = encode(message, {signal.name: values}, at_ns, "can0").frames
    vehicle = run.attachments["vehicle.toml"].decode().replace("dbc = [", f'dbc = ["{name}", ', 1)
    vehicle = vehicle.replace("[signals]", f'[signals]\n{role} = "{message.name}.{signal.name}"', 1)
    carried = dict(run.attachments) | {"vehicle.toml": vehicle.encode(), name: text.encode()}
    with RecordingWriter(path, run=run.info, attachments=carried) as writer:
        writer.write_frames(merge([*run.frame_batches(), frames]))


def by_topic(path: Path) -> dict[tuple[str, bool], FrameArray]:
    """Return the frames of each topic as they lie there: (bus, is FD) -> frames."""
    recording = Recording.open(path)
    found: dict[tuple[str, bool], FrameArray] = {}
    for channel_id, channel in raw_channels(recording.contents).items():
        batches = raw_batches(
            path, recording.contents.chunks, {channel_id: channel}, recording.buses, recording.note_damage
        )
        parts = [batch.frames for batch in batches]
        found[channel.bus, channel.dtype == FD_DTYPE] = np.concatenate([np.zeros(0, channel.dtype), *parts])
    return found


def expected_by_topic(batches: Sequence[FrameBatch]) -> dict[tuple[str, bool], list[bytes]]:
    """Return what should lie in each topic, frame by frame, without the bus column."""
    expected: dict[tuple[str, bool], list[bytes]] = {}
    for batch in batches:
        for number, bus in enumerate(batch.buses):
            rows = batch.frames[batch.frames["bus"] == number]
            expected.setdefault((bus, batch.is_fd), []).extend(plain_bytes(rows))
    return expected


def plain_bytes(frames: FrameArray) -> list[bytes]:
    """Return each frame's bytes with the bus column put to 0."""
    plain = frames.copy()
    plain["bus"] = 0
    return [row.tobytes() for row in plain]


def with_mcap_ros2(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, log time and decoded message of a recording, as mcap-ros2-support reads them."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            yield channel.topic, message.log_time, decoded
