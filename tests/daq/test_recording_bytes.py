"""What stands in a recording, read by others' code or byte by byte."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest
from mcap.reader import make_reader
from recording_support import random_frames, write_recording

from daq.can import FrameBatch
from daq.recording import Recording, raw_message_head, recover
from daq.recording.chunks import ChunkEntry, DamagedError, PackedChunk, unpacked
from daq.recording.format import checked_metadata, with_checksum
from daq.recording.reader import chunks_between

STAMP_NS = 1_700_000_000_123_456_789


def test_a_chunk_whose_bytes_changed_or_end_is_refused(tmp_path: Path) -> None:
    whole = PackedChunk(b"frames", "", 6, zlib.crc32(b"frames"))
    assert unpacked(whole) == b"frames"
    with pytest.raises(DamagedError, match="checksum"):
        unpacked(PackedChunk(b"framez", "", 6, whole.crc))
    record = whole.head(1, 2) + whole.data
    for end in range(len(record)):
        (tmp_path / "cut").write_bytes(record[:end])
        with (tmp_path / "cut").open("rb") as file, pytest.raises(DamagedError, match="cut off"):
            ChunkEntry.at(file, 0, len(record))


def test_metadata_that_changed_are_refused() -> None:
    written = with_checksum("losses", {"can0": "0"})
    assert checked_metadata("losses", written) == {"can0": "0"}
    assert checked_metadata("losses", written | {"can0": "7"}) is None
    assert checked_metadata("run_end", written) is None


def test_the_stamp_of_a_raw_message_is_seconds_and_nanoseconds() -> None:
    """MCAP message record: opcode, length, channel, sequence, log and publish time; then CDR with a ROS time."""
    head = raw_message_head(3, 5, STAMP_NS, 2, 24)
    assert struct.unpack_from("<BQHIQQ", head) == (5, len(head) - 9 + 48, 3, 5, STAMP_NS, STAMP_NS)
    assert struct.unpack_from("<iI", head, 31 + 4) == (1_700_000_000, 123_456_789)


def test_messages_are_counted_and_logged_at_their_last_frame(tmp_path: Path) -> None:
    frames = random_frames(1, 30)
    batches = [FrameBatch(frames[start : start + 10], ("can0",)) for start in (0, 10, 20)]
    write_recording(tmp_path / "run.mcap", batches)
    with (tmp_path / "run.mcap").open("rb") as file:
        found = [
            (message.sequence, message.log_time)
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic.endswith("/raw")
        ]
    assert found == [(i, int(batch.frames["time_ns"].max())) for i, batch in enumerate(batches)]


def test_a_chunk_that_ends_where_a_range_begins_belongs_to_it() -> None:
    chunks = [ChunkEntry(100 * i, 100, 0, end * 10**11, frozenset([1])) for i, end in enumerate((1, 2, 3))]
    found = chunks_between(chunks, {1}, 2 * 10**11, 2 * 10**11 + 1)
    assert [entry.offset for entry in found] == [100, 200]
    assert chunks_between(chunks, {1}, 4 * 10**11, 5 * 10**11) == []


@pytest.fixture
def three(tmp_path: Path) -> tuple[Path, bytearray, list[ChunkEntry]]:
    """Return a recording of three chunks of ten frames, its bytes up to the end of the last one, and the chunks."""
    frames = random_frames(2, 30)
    path = tmp_path / "run.mcap"
    batches = [FrameBatch(frames[start : start + 10], ("can0",)) for start in (0, 10, 20)]
    write_recording(path, batches, compression="zstd")
    chunks = [entry for entry in Recording.open(path).contents.chunks if entry.size > 200]
    assert len(chunks) == 3
    return path, bytearray(path.read_bytes()[: chunks[-1].offset + chunks[-1].size]), chunks


def test_behind_a_damaged_record_the_next_chunk_is_found(three: tuple[Path, bytearray, list[ChunkEntry]]) -> None:
    path, content, chunks = three
    whole = Recording.open(path).frames().frames
    content[chunks[1].offset + 1] ^= 0x01  # length of the record
    path.write_bytes(content)
    found = Recording.open(path)
    assert found.frames().frames["time_ns"].tolist() == [*whole["time_ns"][:10], *whole["time_ns"][20:]]
    assert len(found.loss) >= 1


def test_a_chunk_that_cannot_be_recovered_is_reported(three: tuple[Path, bytearray, list[ChunkEntry]]) -> None:
    path, content, chunks = three
    content[chunks[1].offset + 120] ^= 0x01  # of the packed frames
    path.write_bytes(content)
    result = recover(path, path.with_name("clean.mcap"))
    assert [loss.at_byte for loss in result.loss if loss.at_byte == chunks[1].offset] == [chunks[1].offset]
    assert len(Recording.open(result.path).frames()) == 20
