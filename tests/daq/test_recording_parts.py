"""A run in parts: every frame once, in order, and each file says where it belongs."""

from __future__ import annotations

import resource

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logger_support import Clocks
from recording_support import START_NS, limited, random_frames

from daq import HardwareError, RecordingError, RunInfo
from daq.can import FrameBatch, split
from daq.recording import Event, PartWriter, Recording, part_number, part_path
from daq.recording.part_writer import next_part, parts_on_disk

RUN = RunInfo(id="7", direction="back")
FRAMES = FrameBatch(random_frames(3, 4000, bus_count=2), ("can0", "can1"))


def writer(path, **options) -> PartWriter:
    return PartWriter(path, run=RUN, session_id="abc", **({"attachments": {"a.dbc": b"VERSION"}} | options))


def all_frames(first):
    return np.concatenate([Recording.open(path).frames().frames for path in parts_on_disk(first).values()])


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.integers(1, 400), min_size=1, max_size=12),
    st.integers(1, 5000),
    st.sampled_from([None, 0.0]),
    st.booleans(),
)
def test_no_frame_is_lost_or_doubled(tmp_path_factory, sizes, rotate_bytes, flush_every_s, decode):
    first = tmp_path_factory.mktemp("parts") / "r.mcap"
    sent, start = [], 0
    with writer(first, rotate_bytes=rotate_bytes, flush_every_s=flush_every_s, sync_every_s=None) as parts:
        for size in sizes:
            batch = FRAMES[start : start + size]
            start += size
            sent.append(batch.frames)
            parts.write_frames(batch)
            if decode:
                parts.decoded.write("M", "can0", batch.frames["time_ns"], {"v": np.ones(len(batch))}, {"v": ""})
            parts.tick()
    found = {bus: [] for bus in FRAMES.buses}
    counts: dict[str, int] = {}
    paths = parts_on_disk(first)
    assert list(paths) == list(range(1, len(paths) + 1))
    for path in paths.values():
        recording = Recording.open(path)
        assert recording.loss == ()
        assert recording.attachments == {"a.dbc": b"VERSION"}
        for bus in recording.buses:
            found[bus].append(recording.frames(bus).frames)
            counts[bus] = counts.get(bus, 0) + recording.frame_counts[bus]
    everything = np.concatenate(sent)
    for number, bus in enumerate(FRAMES.buses):
        expected = everything[everything["bus"] == number]
        got = np.concatenate(found[bus]) if found[bus] else expected[:0]
        assert [row["data"].tobytes() for row in got] == [row["data"].tobytes() for row in expected]
        assert np.array_equal(got["time_ns"], expected["time_ns"])
        assert counts.get(bus, 0) == len(expected) == parts.frame_counts.get(bus, 0)
    if flush_every_s == 0.0 and rotate_bytes == 1:
        assert len(paths) >= len(sizes)


def test_parts_are_chained(tmp_path):
    first = tmp_path / "r.mcap"
    parts = writer(first, metadata={"x": "y"})
    for number, batch in enumerate(split(FRAMES, 1500), 1):
        parts.write_frames(batch)
        parts.note_losses({"can0": number, "can1": 0}, {"kernel.can0": number})
        parts.host.write_event(Event(START_NS, "mark", str(number)))
        if number < 3:
            parts.rotate()
    assert (parts.part, parts.path.name) == (3, "r.part3.mcap")
    parts.close("interrupted", {"can0": 10, "can1": 2}, {"kernel.can0": 10, "queue.can1": 2})
    parts.close()
    metadata = [Recording.open(path).metadata for path in parts_on_disk(first).values()]
    started, ended = [one["run_start"] for one in metadata], [one["run_end"] for one in metadata]
    assert [one["part"] for one in started] == ["1", "2", "3"]
    assert [one.get("continues") for one in started] == [None, "r.mcap", "r.part2.mcap"]
    assert {one["session"] for one in started} == {"abc"}
    assert {one["x"] for one in started} == {"y"}
    assert {RunInfo.model_validate_json(one["run"]) for one in started} == {RUN.model_copy(update={"file": "r.mcap"})}
    assert [one.get("continued_in") for one in ended] == ["r.part2.mcap", "r.part3.mcap", None]
    assert [one["exit_status"] for one in ended] == ["rotated", "rotated", "interrupted"]
    assert [(one["drops.can0"], one["drops.can1"]) for one in ended] == [("1", "0"), ("1", "0"), ("8", "2")]
    assert (ended[2]["total_drops.can0"], ended[2]["total_drops.can1"]) == ("10", "2")
    counts = np.bincount(FRAMES.frames["bus"])
    assert [ended[2][f"total_frames.{bus}"] for bus in FRAMES.buses] == [str(count) for count in counts]
    assert [one["losses"] for one in metadata] == [
        {"kernel.can0": "1"},
        {"kernel.can0": "2"},
        {"kernel.can0": "10", "queue.can1": "2"},
    ]


def test_losses_are_reported_while_recording(tmp_path):
    parts = writer(tmp_path / "r.mcap")
    parts.note_losses({"can0": 3}, {"kernel.can0": 3})
    parts.note_losses({"can0": 4}, {"kernel.can0": 4})
    assert Recording.open(tmp_path / "r.mcap").metadata["losses"] == {"kernel.can0": "3"}
    parts.close()
    assert Recording.open(tmp_path / "r.mcap").metadata["losses"] == {"kernel.can0": "4"}


def test_a_part_is_followed_after_its_time(tmp_path):
    clocks = Clocks()
    with writer(tmp_path / "r.mcap", rotate_s=60.0, clock=clocks.seconds) as parts:
        for part in (1, 2, 3):
            clocks.pass_s(59.9)
            parts.tick()
            assert parts.part == part
            clocks.pass_s(0.2)
            parts.tick()
            assert parts.part == part + 1


def test_what_a_part_may_grow_by_is_counted_from_what_it_begins_with(tmp_path):
    """Attachments that are larger than a part is to be begin no part after part."""
    with writer(tmp_path / "r.mcap", attachments={"a.dbc": bytes(50_000)}, rotate_bytes=20_000) as parts:
        parts.write_frames(FRAMES[:100])
        parts.flush()
        parts.tick()
        assert parts.part == 1


def test_a_part_that_cannot_be_begun_is_tried_again_after_a_while(tmp_path):
    clocks = Clocks()
    with writer(tmp_path / "r.mcap", rotate_bytes=1, flush_every_s=0.0, clock=clocks.seconds) as parts:
        with limited(resource.RLIMIT_NOFILE, 3):
            parts.write_frames(FRAMES[:100])
        for seconds, part in ((9.9, 1), (0.2, 2)):
            clocks.pass_s(seconds)
            parts.write_frames(FRAMES[100:200])
            assert parts.part == part


def test_a_part_that_is_begun_before_it_is_due_ends_the_fault(tmp_path):
    """As where the file was moved away."""
    with writer(tmp_path / "r.mcap", rotate_bytes=1, flush_every_s=0.0, clock=Clocks().seconds) as parts:
        with limited(resource.RLIMIT_NOFILE, 3):
            parts.write_frames(FRAMES[:100])
        assert parts.rotation_fault is not None
        parts.rotate()
        assert (parts.part, parts.rotation_fault) == (2, None)


def test_an_old_part_is_kept_when_the_next_cannot_be_opened(tmp_path, monkeypatch):
    first = tmp_path / "r.mcap"
    monkeypatch.setattr("daq.recording.part_writer._RETRY_AFTER_S", 0.0)
    with writer(first, rotate_bytes=1, flush_every_s=0.0) as parts:
        with limited(resource.RLIMIT_NOFILE, 3):
            parts.write_frames(FRAMES[:100])
            with pytest.raises(RecordingError):
                parts.rotate()
        assert parts.part == 1
        assert "Too many open files" in str(parts.rotation_fault)
        parts.write_frames(FRAMES[100:200])
        assert (parts.part, parts.rotation_fault) == (2, None)
    assert len(all_frames(first)) == 200


def test_a_file_that_could_not_be_begun_is_not_left_behind(tmp_path):
    first = tmp_path / "r.mcap"
    with writer(first, attachments={"a.dbc": bytes(range(256)) * 20}) as parts:
        parts.write_frames(FRAMES[:100])
        parts.flush()
        for limit in (10, 2000):
            with limited(resource.RLIMIT_FSIZE, limit), pytest.raises(HardwareError, match="File too large"):
                parts.rotate()
            assert list(parts_on_disk(first)) == [1]
        parts.write_frames(FRAMES[100:200])
    assert len(all_frames(first)) == 200


def test_a_full_disk_ends_a_run_with_everything_before_it(tmp_path):
    first = tmp_path / "r.mcap"
    parts = writer(first, rotate_bytes=20_000, flush_every_s=0.0, compression="none")
    taken = 0
    with limited(resource.RLIMIT_FSIZE, 15_000), pytest.raises(HardwareError, match="File too large"):
        for batch in split(FRAMES, 100):
            parts.write_frames(batch)
            taken += len(batch)
    assert parts.part == 1
    with pytest.raises(HardwareError, match="given up"):
        parts.close("failed", {"can0": 1})
    parts.close()
    assert taken > 300
    assert len(all_frames(first)) == taken


def test_the_next_part_is_numbered_by_what_is_there(tmp_path):
    first = tmp_path / "r.mcap"
    assert next_part(first) == (first, 1)
    for name in ("r.mcap", "r.part2.mcap", "r.part10.mcap", "r.part03.mcap", "rr.part20.mcap", "r.part11.txt"):
        (tmp_path / name).touch()
    assert next_part(first) == (tmp_path / "r.part11.mcap", 11)
    assert list(parts_on_disk(first)) == [1, 2, 10]
    for number in (1, 2, 37):
        assert part_number(part_path(first, number)) == (first, number)
    assert part_number(tmp_path / "r.part1.mcap") == (tmp_path / "r.part1.mcap", 1)


def test_a_run_goes_on_although_its_files_were_moved_away(tmp_path):
    first = tmp_path / "r.mcap"
    with writer(first) as parts:
        parts.write_frames(FRAMES[:100])
        first.rename(tmp_path / "copied.mcap")
        parts.rotate()
        parts.write_frames(FRAMES[100:200])
    assert list(parts_on_disk(first)) == [2]
    assert len(Recording.open(tmp_path / "copied.mcap").frames()) == len(all_frames(first)) == 100


@pytest.mark.parametrize("name", ["r.part2.mcap", "r.part12.mcap"])
def test_a_run_is_not_called_as_a_part(tmp_path, name):
    with pytest.raises(RecordingError, match="cannot be called as a part"):
        writer(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
    for fine in ("r.part.mcap", "r.part1.mcap", "r.part02.mcap", "part2.mcap"):
        with writer(tmp_path / fine) as parts:
            parts.rotate()
        assert list(parts_on_disk(tmp_path / fine)) == [1, 2]


def test_a_killed_run_goes_on_in_the_next_part(tmp_path):
    first = tmp_path / "r.mcap"
    killed = writer(first)
    killed.write_frames(FRAMES[:100])
    killed.flush()
    path, number = next_part(first)
    with PartWriter(first, run=RUN, session_id="def", first_part=number) as parts:
        parts.write_frames(FRAMES[100:200])
        assert parts.path == path
    killed.close()
    assert len(all_frames(first)) == 200
    assert Recording.open(path).metadata["run_start"]["continues"] == "r.mcap"
    with pytest.raises(RecordingError, match="there is a file already"):
        PartWriter(first, run=RUN, session_id="ghi", first_part=number)
