"""What is written comes back bit for bit, however it was batched."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from recording_support import START_NS, by_topic, expected_by_topic, plain_bytes, random_frames, write_recording

from daq import ConfigError, DataError, RecordingError, RunInfo
from daq.can import CLASSIC_DTYPE, FrameBatch, concatenate, split
from daq.can.frames import FD_DTYPE
from daq.recording import RAW_PREFIX_SIZE, Recording, RecordingWriter, raw_message_head
from daq.recording.chunks import ChunkEntry
from daq.recording.format import raw_frames
from daq.recording.reader import chunks_between

BUSES = ("can0", "can-0", "vehicle bus", "9")


@st.composite
def batches(draw: st.DrawFn) -> FrameBatch:
    """Any bytes at all as frames, times out of order and beyond what ROS can hold included."""
    dtype = FD_DTYPE if draw(st.booleans()) else CLASSIC_DTYPE
    buses = tuple(draw(st.lists(st.sampled_from(BUSES), min_size=1, max_size=3, unique=True)))
    count = draw(st.integers(0, 12))
    size = count * dtype.itemsize
    frames = np.frombuffer(draw(st.binary(min_size=size, max_size=size)), dtype).copy()
    frames["bus"] %= len(buses)
    return FrameBatch(frames, buses)


@examples(80)
@given(
    st.lists(st.tuples(batches(), st.booleans()), max_size=6),
    st.sampled_from(["zstd", "lz4", "none"]),
    st.sampled_from([1, 100, 1 << 20]),
)
def test_any_frames_come_back_bit_for_bit(written, compression, chunk_bytes):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.mcap")
        with RecordingWriter(path, compression=compression, chunk_bytes=chunk_bytes, sync_every_s=None) as writer:
            for batch, flush in written:
                writer.write_frames(batch)
                if flush:
                    writer.flush()
        expected = expected_by_topic([batch for batch, _ in written])
        found = by_topic(path)
        assert {key: plain_bytes(frames) for key, frames in found.items()} == expected
        recording = Recording.open(path)
        assert recording.loss == ()
        if not expected:
            return
        everything = recording.frames()
        assert len(everything) == sum(map(len, expected.values())) == sum(recording.frame_counts.values())
        for bus in recording.buses:
            on_bus = recording.frames(bus)
            assert set(on_bus.frames["bus"].tolist()) <= {recording.buses.index(bus)}
            assert len(on_bus) == sum(len(rows) for (name, _), rows in expected.items() if name == bus)


def test_frames_of_several_buses_are_merged_by_time(tmp_path):
    batch = FrameBatch(random_frames(1, 5000, bus_count=3), ("a", "b", "c"))
    write_recording(tmp_path / "run.mcap", list(split(batch, 700)))
    assert np.array_equal(Recording.open(tmp_path / "run.mcap").frames().frames, batch.frames)


def test_a_clock_that_steps_back_does_not_reorder_a_bus(tmp_path):
    frames = random_frames(2, 1000, bus_count=2)
    frames["time_ns"][500:] -= 50_000_000
    write_recording(tmp_path / "run.mcap", [FrameBatch(frames, ("a", "b"))])
    recording = Recording.open(tmp_path / "run.mcap")
    for number, bus in enumerate(("a", "b")):
        assert np.array_equal(recording.frames(bus).frames, frames[frames["bus"] == number])
    assert int(recording.metadata["run_end"]["time_steps_back"]) == 2


def test_more_frames_than_a_message_or_a_batch_holds(tmp_path):
    batch = FrameBatch(random_frames(3, 200_000), ("can0",))
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.write_frames(batch)
    pieces = list(Recording.open(tmp_path / "run.mcap").frame_batches())
    assert max(map(len, pieces)) < 150_000
    assert np.array_equal(concatenate(pieces).frames, batch.frames)


def test_the_caller_may_reuse_the_buffer(tmp_path):
    buffer = random_frames(4, 100)
    expected = buffer.copy()
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.write_frames(FrameBatch(buffer, ("can0",)))
        buffer["data"] = 0
    assert np.array_equal(Recording.open(tmp_path / "run.mcap").frames().frames, expected)


def test_attachments_metadata_and_run_come_back(tmp_path):
    run = RunInfo(file="run.log", id="run 3", direction="back", pass_number=2, added_load_kg=300.0)
    files = {"wft.dbc": "Ü\n".encode("cp1252") * 5000, "vehicle.toml": b"", "data/terrain.toml": b"[soil]"}
    with RecordingWriter(tmp_path / "run.mcap", run=run, attachments=files, metadata={"driver": "Zoë"}) as writer:
        writer.write_frames(FrameBatch(random_frames(5, 10, bus_count=2), ("can0", "can1")))
        writer.attach("late.txt", b"late")
        writer.add_metadata("clock_fit", {"offset_s": "0.16"})
        writer.close("interrupted", {"can1": 7})
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.run == run
    assert recording.attachments == {**files, "late.txt": b"late"}
    assert recording.metadata["run_start"]["driver"] == "Zoë"
    assert recording.metadata["clock_fit"] == {"offset_s": "0.16"}
    ended = recording.metadata["run_end"]
    assert (ended["exit_status"], ended["drops.can1"]) == ("interrupted", "7")
    assert sum(recording.frame_counts.values()) == 10
    assert recording.buses == ("can0", "can1")
    assert recording.library.startswith("wheelsoil ")


def test_a_silent_bus_and_an_empty_run_are_reported(tmp_path):
    with RecordingWriter(tmp_path / "silent.mcap") as writer:
        writer.write_frames(FrameBatch(random_frames(6, 10), ("can0", "can1")))
    assert Recording.open(tmp_path / "silent.mcap").frame_counts == {"can0": 10, "can1": 0}
    assert len(Recording.open(tmp_path / "silent.mcap").frames("can1")) == 0
    with RecordingWriter(tmp_path / "empty.mcap") as writer:
        writer.write_frames(FrameBatch.empty(("can0",)))
    empty = Recording.open(tmp_path / "empty.mcap")
    assert (empty.frame_counts, len(empty.frames()), empty.time_range_ns) == ({"can0": 0}, 0, None)
    with RecordingWriter(tmp_path / "nothing.mcap", attachments={"a.dbc": b"x"}):
        pass
    nothing = Recording.open(tmp_path / "nothing.mcap")
    assert (nothing.buses, len(nothing.frames()), nothing.loss) == ((), 0, ())


@examples(40)
@given(st.integers(0, 2_000_000_000), st.integers(0, 2_000_000_000))
def test_a_time_span_gives_exactly_its_frames(spanned_recording, low, length):
    path, frames = spanned_recording
    start, end = START_NS + low, START_NS + low + length
    found = [b.frames for b in Recording.open(path).frame_batches(start_ns=start, end_ns=end)]
    expected = frames[(frames["time_ns"] >= start) & (frames["time_ns"] < end)]
    assert np.array_equal(np.concatenate([frames[:0], *found]), expected)


@pytest.fixture(scope="module")
def spanned_recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("spanned") / "run.mcap"
    frames = random_frames(7, 5000)
    write_recording(path, list(split(FrameBatch(frames, ("can0",)), 97)))
    recording = Recording.open(path)
    assert recording.time_range_ns == (frames["time_ns"][0], frames["time_ns"][-1])
    return path, frames


def test_a_raw_message_without_frames_is_whole():
    body = raw_message_head(1, 0, 5, 0, CLASSIC_DTYPE.itemsize)[-RAW_PREFIX_SIZE:]
    assert len(raw_frames(body, 0, len(body), CLASSIC_DTYPE)) == 0
    with pytest.raises(ValueError, match="too short"):
        raw_frames(body, 0, len(body) - 1, CLASSIC_DTYPE)


def test_chunks_of_other_channels_bound_no_search_by_time():
    """Decoded topics may be written before raw frames of the same time."""
    second = 10**9
    contents = ((10, {1}), (90, {2}), (30, {1, 2}), (60, {1}))
    entries = [ChunkEntry(i, 1, 0, end * second, frozenset(of)) for i, (end, of) in enumerate(contents)]
    for span, expected in (((12, 15), [1, 2]), ((40, 50), [1, 3]), ((0, 1), [0, 1, 2])):
        found = chunks_between(entries, {1}, *(end * second for end in span))
        assert [entry.offset for entry in found] == expected


def test_faults_of_the_caller_are_reported(tmp_path):
    path = tmp_path / "run.mcap"
    write_recording(path, [FrameBatch(random_frames(8, 3), ("can0",))])
    with pytest.raises(RecordingError, match="there is a file already"):
        RecordingWriter(path)
    write_recording(path, [FrameBatch(random_frames(9, 5), ("can0",))], overwrite=True)
    assert len(Recording.open(path).frames()) == 5
    with pytest.raises(RecordingError, match="cannot be made"):
        RecordingWriter(tmp_path / "nowhere" / "run.mcap")
    with pytest.raises(ConfigError, match="unknown compression"):
        RecordingWriter(tmp_path / "other.mcap", compression="gzip")  # type: ignore[arg-type]
    assert not (tmp_path / "other.mcap").exists()
    with pytest.raises(DataError, match="nearest: can0"):
        Recording.open(path).frame_batches("can1")
    with RecordingWriter(tmp_path / "bus.mcap") as writer, pytest.raises(DataError, match="a frame is of bus 2"):
        writer.write_frames(FrameBatch(random_frames(10, 50, bus_count=3), ("can0", "can1")))
