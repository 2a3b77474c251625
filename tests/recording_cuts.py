"""A recording with everything in it, cut off anywhere: what must still be read."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from recording_support import START_NS, random_frames

from daq import RecordingError, RunInfo
from daq.can import FrameBatch
from daq.recording import DiagnosticStatus, Event, Recording, RecordingWriter
from daq.recording.contents import MAGIC

BUSES = ("can0", "can1")
TAIL_BYTES = 64 << 10
_FLUSHES = 14
_MOST_FRAMES = 240
_THOROUGH_EVERY = 16


@dataclass(frozen=True)
class Truth:
    """What a whole recording holds, and where its chunks end.

    Attributes
    ----------
    ends : chunk ends in the file
    frames : per bus, the bytes of all frames
    frame_bytes : per bus, how many of these bytes lie in the first 0, 1, 2, ... chunks
    events : all events
    event_counts : how many lie in the first 0, 1, 2, ... chunks
    metadata_ends : name -> ends of its records in the file
    """

    ends: list[int]
    frames: dict[str, bytes]
    frame_bytes: dict[str, list[int]]
    events: tuple[Event, ...]
    event_counts: list[int]
    metadata_ends: list[int]


def write_everything(path: Path) -> None:
    """Write about 80 KiB: frames of two buses, decoded topics, events, diagnostics, clock offsets and metadata."""
    rng = np.random.default_rng(5)
    with RecordingWriter(
        path, run=RunInfo(id="7"), attachments={"a.dbc": b"VERSION"}, flush_every_s=None, sync_every_s=None
    ) as writer:
        for number in range(_FLUSHES):
            time_ns = START_NS + number * 200_000_000
            for bus, name in enumerate(BUSES):
                frames = random_frames(2 * number + bus, int(rng.integers(1, _MOST_FRAMES)))
                frames["time_ns"] += time_ns - START_NS
                writer.write_frames(FrameBatch(frames, (name,)))
                writer.host.write_clock(time_ns, name, number * 2_000_000, -number)
            stamps = time_ns + np.arange(4) * 10_000_000
            writer.decoded.write("Speed", "can0", stamps, {"V": rng.normal(size=4)}, {"V": "km/h"})
            writer.decoded.write_position("can0", stamps, rng.normal(size=4), rng.normal(size=4))
            writer.host.write_event(Event(time_ns, "mark", f"mark {number}"))
            if number % 2 == 0:
                writer.host.write_diagnostics(
                    time_ns, [DiagnosticStatus(0, "bus/can0", "ok", values={"n": str(number)})]
                )
                writer.add_metadata("losses", {"kernel.can0": str(number)})
            writer.flush()


def truth_of(path: Path) -> Truth:
    """Read a whole recording chunk by chunk."""
    recording = Recording.open(path)
    chunks = recording.contents.chunks
    frames = dict.fromkeys(BUSES, b"")
    frame_bytes = {bus: [0] for bus in BUSES}
    events: tuple[Event, ...] = ()
    event_counts = [0]
    for chunk in chunks:
        recording.contents.chunks = [chunk]
        for bus in BUSES:
            frames[bus] += recording.frames(bus).frames.tobytes()
            frame_bytes[bus].append(len(frames[bus]))
        events += recording.events()
        event_counts.append(len(events))
    ends = [chunk.offset + chunk.size for chunk in chunks]
    metadata_ends = [offset + size for offset, size in recording.contents.metadata]
    return Truth(ends, frames, frame_bytes, events, event_counts, metadata_ends)


def check_cut(path: Path, size: int, truth: Truth, *, thorough: bool = True) -> None:
    """Read a file that ends after `size` bytes: every whole chunk is there, and the loss is told.

    `thorough` also asks for what takes a reading of its own.
    """
    whole = sum(end <= size for end in truth.ends)
    try:
        recording = Recording.open(path)
        expected = {bus: truth.frames[bus][: counts[whole]] for bus, counts in truth.frame_bytes.items()}
        assert len(recording.contents.chunks) == whole, size
        assert _frames(recording) == expected, size
        assert recording.events() == truth.events[: truth.event_counts[whole]], size
        assert len(recording.contents.metadata) == sum(end <= size for end in truth.metadata_ends), size
        assert len(recording.metadata) == len(recording.metadata.keys() & {"run_start", "losses", "run_end"}), size
        assert recording.attachments.keys() <= {"a.dbc"}, size
        assert recording.loss, size
        if thorough:
            assert sum(recording.frame_counts.values()) * 24 == sum(map(len, expected.values())), size
            assert (recording.time_range_ns is not None) == bool(whole), size
            assert all(topic.message_count >= 0 for topic in recording.topics), size
    except RecordingError:
        assert size < len(MAGIC), size


def _frames(recording: Recording) -> dict[str, bytes]:
    """Return the bytes of each bus's frames."""
    found = dict.fromkeys(BUSES, b"")
    for batch in recording.frame_batches() if recording.has_raw_frames else ():
        for bus in batch.buses:
            found[bus] += batch.on_bus(bus).frames.tobytes()
    return found


def check_cuts(source: Path, folder: Path, truth: Truth, sizes: range) -> int:
    """Cut a copy shorter and shorter; return how many cuts were checked."""
    copy = Path(shutil.copy(source, folder / f"{sizes.start}.mcap"))
    for size in sorted(sizes, reverse=True):
        os.truncate(copy, size)
        check_cut(copy, size, truth, thorough=size % _THOROUGH_EVERY == 0)
    copy.unlink()
    return len(sizes)
