"""Cut, flipped, killed, full disk, foreign: whole records are read, losses are reported, no other error is raised."""

from __future__ import annotations

import itertools
import resource
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.writer import Writer
from property_settings import examples
from recording_support import START_NS, by_topic, random_frames, write_recording
from support import data_dir
from zstandard import ZstdDecompressor

from daq import HardwareError, RecordingError, RunInfo
from daq.can import FrameBatch, concatenate
from daq.recording import Recording, RecordingWriter, recover
from daq.recording.chunks import ChunkEntry
from daq.recording.contents import read_contents
from daq.recording.decoded_topics import layout_of
from daq.recording.series_topics import SeriesTopic, series_blocks

FILES = {"wft.dbc": bytes(range(256)) * 2, "vehicle.toml": b"[wheel]\n"}
RUN = RunInfo(id="7", direction="back")
BATCHES = [FrameBatch(random_frames(seed, 12, bus_count=2), ("can0", "can1")) for seed in range(6)]
BATCHES.insert(2, FrameBatch(random_frames(99, 5, fd=True), ("can0",)))
for number, part in enumerate(BATCHES):
    part.frames["time_ns"] += number * 1_000_000_000
TIMES = np.arange(8) * 100_000_000 + START_NS


@pytest.fixture(scope="module", params=["zstd", "none"])
def whole(request, tmp_path_factory):
    """Return a small recording with everything in it: its path, bytes, and frames per topic."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    with RecordingWriter(
        path, run=RUN, attachments=FILES, compression=request.param, flush_every_s=None, sync_every_s=None
    ) as writer:
        for batch in BATCHES:
            writer.write_frames(batch)
            writer.decoded.write("Speed", "can0", TIMES, {"V": np.arange(8.0)}, {"V": "km/h"})
            writer.flush()
    return path, path.read_bytes(), by_topic(path)


def reading(path: Path):
    """Read everything there is to read."""
    recording = Recording.open(path)
    frames = by_topic(path) if recording.has_raw_frames else {}
    if recording.has_raw_frames:
        recording.frames()
    facts = (recording.attachments, recording.metadata, recording.topics, recording.time_range_ns)
    return recording, frames, facts, recording.frame_counts


def is_part_of(found, expected) -> bool:
    """Say whether `found` is `expected` with some whole frames left out, in order."""
    rest = iter([row.tobytes() for row in expected])
    return all(row.tobytes() in rest for row in found)


def check_damaged(path: Path, expected) -> Recording:
    """Everything that is read is right, and what is missing is listed."""
    recording, frames, (attachments, metadata, _, _), _ = reading(path)
    lost = False
    for key, rows in expected.items():
        got = frames.get(key, rows[:0])
        assert is_part_of(got, rows)
        lost |= len(got) < len(rows)
    assert attachments.items() <= FILES.items()
    if "run" in metadata.get("run_start", {}):
        assert recording.run == RUN
    lost |= len(attachments) < len(FILES) or not {"run_start", "run_end"} <= metadata.keys()
    assert recording.loss or not lost
    return recording


def test_every_cut_keeps_all_whole_chunks(whole, tmp_path):
    path, data, expected = whole
    chunks = Recording.open(path).contents.chunks
    ends = [chunk.offset + chunk.size for chunk in chunks]
    cuts = sorted({*range(0, len(data), 61), *ends, *(end - 1 for end in ends), len(data) - 1})
    cut_path = tmp_path / "cut.mcap"
    for cut in cuts:
        cut_path.write_bytes(data[:cut])
        if cut < 8:
            with pytest.raises(RecordingError, match="is empty" if cut == 0 else "not an MCAP file"):
                Recording.open(cut_path)
            continue
        recording = check_damaged(cut_path, expected)
        assert len(recording.contents.chunks) == sum(end <= cut for end in ends)
        assert recording.loss
        kept = sum(len(frames) for frames in by_topic(cut_path).values())
        assert kept == whole_frames(path, sum(end <= cut for end in ends))


def test_a_summary_that_breaks_off_is_a_loss(whole, tmp_path):
    """It has no checksum that would tell."""
    _, data, expected = whole
    start = int.from_bytes(data[-28:-20], "little")
    broken = data[: start + 1] + (1 << 40).to_bytes(8, "little") + data[start + 9 : -12] + bytes(4) + data[-8:]
    (tmp_path / "run.mcap").write_bytes(broken)
    [loss] = read_contents(tmp_path / "run.mcap").losses
    assert loss.what == "the summary is damaged: a record is cut off"
    assert (loss.at_byte, loss.byte_count) == (start, len(data) - 37 - start)
    check_damaged(tmp_path / "run.mcap", expected)


def whole_frames(path: Path, chunk_count: int) -> int:
    """Count the frames in the first chunks of a whole file."""
    recording = Recording.open(path)
    recording.contents.chunks = recording.contents.chunks[:chunk_count]
    return len(recording.frames())


@pytest.mark.hypothesis  # the property is within
@pytest.mark.parametrize("kept", [1.0, 0.8], ids=["whole", "cut"])
def test_a_flipped_byte_is_never_believed(whole, kept, tmp_path_factory):
    _, data, expected = whole
    data = data[: int(len(data) * kept)]
    flipped_path = tmp_path_factory.mktemp("flipped") / "run.mcap"

    @examples(200)
    @given(st.integers(8, len(data) - 1), st.integers(1, 255))
    @example(len(data) - 1, 1)
    @example(len(data) - 20, 1)
    def flip(position, change):
        flipped = bytearray(data)
        flipped[position] ^= change
        flipped_path.write_bytes(flipped)
        check_damaged(flipped_path, expected)

    flip()


@examples(150)
@given(st.binary(max_size=400), st.sampled_from(["magic", "header", "half"]))
def test_garbage_behind_a_beginning(garbage_folder, garbage, beginning):
    path, data = garbage_folder
    start = {"magic": 8, "header": data.index(b"wheelsoil") + 12, "half": len(data) // 2}[beginning]
    broken = path.with_name("garbage.mcap")
    broken.write_bytes(data[:start] + garbage)
    reading(broken)


def test_a_damaged_header_is_a_loss_without_a_size(whole, tmp_path):
    _, data, _ = whole
    (tmp_path / "run.mcap").write_bytes(data[:9] + b"\xff" * 8 + data[17:])
    loss = read_contents(tmp_path / "run.mcap").losses[0]
    assert loss.what.startswith("the header: ") and (loss.at_byte, loss.byte_count) == (8, 0)


def test_messages_in_no_chunk_are_taken_run_by_run(tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        schema = writer.register_schema("Fz", "jsonschema", b"{}")
        channel = writer.register_channel("/fz", "json", schema)
        for i, data in enumerate((b"{}", b"", b"{}", b"", b"{}")):
            writer.add_message(channel, log_time=i, publish_time=i, data=data)
    contents = read_contents(path)  # without its end, as after a power cut
    assert contents.message_counts == {channel: 5}
    assert [(chunk.bare, chunk.start_ns, chunk.end_ns) for chunk in contents.chunks] == [(True, 0, 4)]


@pytest.fixture(scope="module")
def garbage_folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("garbage") / "run.mcap"
    write_recording(path, BATCHES, attachments=FILES)
    return path, path.read_bytes()


def test_zeros_behind_the_last_fsync_are_reported(whole, tmp_path):
    """A power cut leaves the file at its new size with nothing in it."""
    path, data, _ = whole
    last = Recording.open(path).contents.chunks[-1]
    (tmp_path / "zeros.mcap").write_bytes(data[: last.offset] + bytes(5000))
    recording = Recording.open(tmp_path / "zeros.mcap")
    assert len(recording.frames()) == sum(map(len, BATCHES))
    assert any(loss.byte_count == 5000 for loss in recording.loss)


def test_one_damaged_chunk_in_the_middle_costs_only_itself(whole, tmp_path):
    path, data, _ = whole
    chunk = [entry for entry in Recording.open(path).contents.chunks if entry.size > 200][2]
    broken = bytearray(data)
    broken[chunk.offset + 120] ^= 0xFF
    (tmp_path / "broken.mcap").write_bytes(broken)
    recording = Recording.open(tmp_path / "broken.mcap")
    assert 0 < sum(map(len, BATCHES)) - len(recording.frames()) <= 12
    assert [loss.at_byte for loss in recording.loss] == [chunk.offset]


def test_the_index_of_a_recovered_file_points_at_its_messages(whole, tmp_path):
    from mcap.opcode import Opcode
    from mcap.records import Chunk, MessageIndex
    from mcap.stream_reader import StreamReader

    _, data, _ = whole
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    recover(tmp_path / "cut.mcap", tmp_path / "clean.mcap")
    with (tmp_path / "clean.mcap").open("rb") as file:
        records = list(StreamReader(file, emit_chunks=True).records)
    checked, content = 0, b""
    for record in records:
        if isinstance(record, Chunk):
            content = ZstdDecompressor().decompress(record.data) if record.compression == "zstd" else record.data
        elif isinstance(record, MessageIndex):
            for log_time_ns, at in record.records:
                assert content[at] == Opcode.MESSAGE
                assert int.from_bytes(content[at + 15 : at + 23], "little") == log_time_ns
                checked += 1
    assert checked > 10


def test_recovered_files_are_whole_to_everyone(whole, tmp_path):
    from mcap.reader import make_reader

    _, data, expected = whole
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    result = recover(tmp_path / "cut.mcap", tmp_path / "clean.mcap")
    assert result.loss
    cut, clean = by_topic(tmp_path / "cut.mcap"), by_topic(tmp_path / "clean.mcap")
    assert all(np.array_equal(cut[key], clean[key]) for key in cut | clean)
    assert all(is_part_of(rows, expected[key]) for key, rows in clean.items())
    recording = Recording.open(tmp_path / "clean.mcap")
    assert recording.loss == ()
    assert recording.contents.has_summary
    assert recording.metadata["recovered"]["source"] == "cut.mcap"
    assert recording.attachments == FILES
    assert recording.run == RUN
    with (tmp_path / "clean.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert len(summary.chunk_indexes) == result.chunk_count
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
    with pytest.raises(RecordingError, match="onto itself"):
        recover(tmp_path / "cut.mcap", tmp_path / "cut.mcap", overwrite=True)
    with pytest.raises(RecordingError, match="there is a file already"):
        recover(tmp_path / "cut.mcap", tmp_path / "clean.mcap")


WRITER = """
import sys, time
sys.path.insert(0, sys.argv[2])
from recording_support import random_frames
from daq.can.frames import FrameBatch
from daq.recording import RecordingWriter
writer = RecordingWriter(sys.argv[1], flush_every_s=0.02)
for seed in range(10_000):
    writer.write_frames(FrameBatch(random_frames(seed, 10), ("can0",)))
    print(seed, flush=True)
    time.sleep(0.001)
"""


def test_a_kill_takes_only_what_was_not_flushed(tmp_path):
    path = tmp_path / "killed.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, path, str(Path(__file__).parents[1])], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    lines = [int(line) for line in itertools.islice(process.stdout, 400)]
    process.send_signal(signal.SIGKILL)
    lines += [int(line) for line in process.stdout.read().split()]
    process.wait()
    process.stdout.close()
    frames = Recording.open(path).frames()
    expected = concatenate([FrameBatch(random_frames(seed, 10), ("can0",)) for seed in lines])
    kept = min(len(frames), len(expected))
    assert np.array_equal(frames.frames[:kept], expected.frames[:kept])
    assert len(frames) >= 10 * len(lines) - 10 * 25  # 20 ms, at most one batch a millisecond
    with pytest.raises(RecordingError, match="there is a file already"):
        RecordingWriter(path)
    recover(path, tmp_path / "clean.mcap")
    assert Recording.open(tmp_path / "clean.mcap").contents.has_summary


def test_a_full_disk_leaves_whole_chunks(tmp_path):
    """RLIMIT_FSIZE makes the kernel refuse to write on, as a full disk does."""
    path = tmp_path / "full.mcap"
    batch = FrameBatch(random_frames(1, 4000), ("can0",))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (250_000, hard))
        with (
            pytest.raises(HardwareError, match="cannot be written on"),
            RecordingWriter(path, compression="none") as writer,
        ):
            for _ in range(20):
                writer.write_frames(batch)
                writer.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    recording = Recording.open(path)
    assert len(recording.frames()) == 8000
    assert [str(loss) for loss in recording.loss] == [
        f"the end of the file is missing: no footer, no summary (byte {path.stat().st_size}, 0 bytes)"
    ]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_exception_leaves_a_closed_recording(tmp_path, error):
    with pytest.raises(error), RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.write_frames(BATCHES[0])
        raise error
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.loss == ()
    assert len(recording.frames()) == len(BATCHES[0])
    statuses = {KeyboardInterrupt: "interrupted", ValueError: "error: ValueError"}
    assert recording.metadata["run_end"]["exit_status"] == statuses[error]


class InterruptedTestError(Exception):
    pass


def interrupt(*_):
    raise InterruptedTestError


def test_an_interrupt_anywhere_leaves_a_readable_recording(tmp_path):
    """A timer's signal stands for Ctrl-C: it raises wherever the writer happens to be."""
    rng = np.random.default_rng(0)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for trial in range(25):
            path = tmp_path / f"{trial}.mcap"
            given_frames = 0
            with (
                pytest.raises(InterruptedTestError),
                RecordingWriter(path, flush_every_s=0.0, sync_every_s=None) as writer,
            ):
                signal.setitimer(signal.ITIMER_REAL, float(rng.uniform(0.001, 0.02)))
                while True:
                    writer.write_frames(BATCHES[given_frames % 2])
                    given_frames += 1
                    if signal.getitimer(signal.ITIMER_REAL)[0] == 0.0:  # it fell into a destructor, which swallows it
                        signal.setitimer(signal.ITIMER_REAL, 0.001)
            frames = by_topic(path)
            expected = concatenate([BATCHES[i % 2] for i in range(given_frames + 1)]).frames
            for number, bus in enumerate(("can0", "can1")):
                assert is_part_of(frames[bus, False], expected[expected["bus"] == number])
            counts = {bus: len(frames[bus, False]) for bus in ("can0", "can1")}
            assert Recording.open(path).frame_counts == counts
            assert sum(counts.values()) >= 12 * (given_frames - 1)
    finally:
        signal.signal(signal.SIGALRM, before)


def test_series_in_a_chunk_that_ends_within_a_record_are_damaged(tmp_path, monkeypatch):
    topic = SeriesTopic("wheel", {"Fz": "N"}, layout_of(("Fz",)))
    row = np.zeros(1, topic.dtype)
    row["opcode"], row["record_length"], row["channel_id"] = 5, row.itemsize - 9, 3
    (tmp_path / "any.mcap").touch()
    for record in (struct.pack("<BQ3s", 0x80, 3, b"abc"), row.tobytes()):
        said = []
        for end in range(1, len(record)):
            monkeypatch.setattr("daq.recording.series_topics.read_chunk", lambda *_, cut=record + record[:end]: cut)
            chunks = [ChunkEntry(0, 0, 0, 0)]
            list(series_blocks(tmp_path / "any.mcap", chunks, {3: topic}, lambda _, why, said=said: said.append(why)))
        assert said == ["a record is cut off"] * (len(record) - 1)


def test_run_information_that_is_none_is_reported(whole):
    recording = Recording.open(whole[0])
    recording.metadata["run_start"]["run"] = "{"
    with pytest.raises(RecordingError, match="the run information cannot be read"):
        _ = recording.run


def test_what_is_no_recording_is_reported(tmp_path):
    (tmp_path / "log.mcap").write_bytes(b"(1.0) can0 123#00\n")
    (tmp_path / "empty.mcap").touch()
    cases = {"nowhere.mcap": "no such file", "": "a folder", "log.mcap": "not an MCAP file", "empty.mcap": "is empty"}
    for name, message in cases.items():
        with pytest.raises(RecordingError, match=message):
            Recording.open(tmp_path / name)


def foreign_files() -> list[Path]:
    return sorted(data_dir("mcap-samples", "rosbag2").glob("*.mcap"))


def test_foreign_files_open_for_info_and_recover(tmp_path):
    from mcap.reader import make_reader

    for path in foreign_files():
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        recording = Recording.open(path)
        counts = {topic.name: topic.message_count for topic in recording.topics}
        expected = summary.statistics.channel_message_counts
        assert counts == {channel.topic: expected.get(channel.id, 0) for channel in summary.channels.values()}
        statistics = summary.statistics
        if statistics.message_count:
            assert recording.time_range_ns == (statistics.message_start_time, statistics.message_end_time)
        with pytest.raises(RecordingError, match="holds no wheelsoil raw topics"):
            recording.frames()
        cut = tmp_path / path.name
        cut.write_bytes(path.read_bytes()[:-100])
        recover(cut, tmp_path / f"clean_{path.name}")
        again = Recording.open(tmp_path / f"clean_{path.name}")
        assert {topic.name: topic.message_count for topic in again.topics if topic.message_count} == {
            name: count for name, count in counts.items() if count
        }
