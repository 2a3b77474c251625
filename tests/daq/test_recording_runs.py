"""The parts of a run are one run: whatever is named, whatever is cut off, unreadable or missing."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_support import START_NS, plain_bytes, random_frames

from daq import ConfigError, DataError, RecordingError, RunInfo
from daq.can import FrameBatch, concatenate
from daq.recording import Event, PartWriter, RecordingWriter, RunRecording, part_path, recover
from daq.recording.part_writer import next_part, parts_on_disk
from daq.runs import open_runs
from wheelsoil.wording.notes import note_text

RUN = RunInfo(id="7", direction="back")
BATCHES = [FrameBatch(random_frames(number, 40 + 7 * number, bus_count=2), ("can0", "can1")) for number in range(4)]
for number, part in enumerate(BATCHES):
    part.frames["time_ns"] += number * 1_000_000_000


def rotated(first: Path, *, drops: tuple[int, ...] = (0, 1, 4, 4)) -> Path:
    """Write a part for each batch, with a mark in it."""
    parts = PartWriter(first, run=RUN, session_id="a", attachments={"x.txt": b"x"})
    for number, batch in enumerate(BATCHES):
        parts.write_frames(batch)
        parts.host.write_event(Event(int(batch.frames["time_ns"][0]), "mark", str(number)))
        parts.note_losses({"can0": drops[number]}, {"kernel.can0": drops[number]})
        if number < len(BATCHES) - 1:
            parts.rotate()
    parts.close("interrupted")
    return first


def per_bus(batches) -> dict[str, list[bytes]]:
    whole = concatenate(list(batches))
    return {bus: plain_bytes(whole.on_bus(bus).frames) for bus in ("can0", "can1")}


def of(*numbers: int) -> dict[str, list[bytes]]:
    return per_bus(BATCHES[number - 1] for number in numbers)


@pytest.mark.parametrize("named", [1, 2, 4])
def test_any_part_stands_for_the_whole_run(tmp_path, named):
    first = rotated(tmp_path / "r.mcap")
    recording = RunRecording.open(part_path(first, named))
    assert recording.files == tuple(part_path(first, number) for number in (1, 2, 3, 4))
    assert per_bus(recording.frame_batches()) == of(1, 2, 3, 4)
    assert recording.frame_counts == {bus: len(rows) for bus, rows in of(1, 2, 3, 4).items()}
    times = np.concatenate([batch.frames["time_ns"] for batch in BATCHES])
    assert recording.time_range_ns == (times.min(), times.max())
    assert [event.text for event in recording.events()] == ["0", "1", "2", "3"]
    assert (recording.loss, recording.exit_status) == ((), "interrupted")
    assert (recording.drops, recording.losses) == ({"can0": 4}, {"kernel.can0": 4})
    assert recording.metadata["run_start"]["part"] == "1"
    assert recording.metadata["run_end"]["drops.can0"] == "4"
    assert "frames.can0" not in recording.metadata["run_end"]
    assert recording.attachments == {"x.txt": b"x"}
    events = next(topic for topic in recording.topics if topic.name == "/events")
    assert events.message_count == 4
    assert recording.run is not None and recording.run.id == "7"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 4_100_000_000), st.integers(0, 4_100_000_000), st.sampled_from([None, "can0", "can1"]))
def test_a_time_range_may_lie_anywhere(tmp_path_factory, low, high, bus):
    first = tmp_path_factory.mktemp("range") / "r.mcap"
    recording = RunRecording.open(rotated(first))
    found = list(recording.frame_batches(bus, START_NS + low, START_NS + high))
    expected = {
        name: plain_bytes(frames[(frames["time_ns"] >= START_NS + low) & (frames["time_ns"] < START_NS + high)])
        for name in ("can0", "can1")
        if bus in (None, name)
        for frames in [concatenate(BATCHES).on_bus(name).frames]
    }
    got = per_bus(found) if found else {"can0": [], "can1": []}
    assert {name: got[name] for name in expected} == expected


def test_a_bus_that_comes_later_keeps_its_name(tmp_path):
    first = tmp_path / "r.mcap"
    parts = PartWriter(first, run=RUN, session_id="a")
    for number, bus in enumerate(("x", "y", "x")):
        frames = random_frames(number, 20, fd=number == 1)
        parts.write_frames(FrameBatch(frames, (bus,)))
        parts.rotate()
    parts.close()
    recording = RunRecording.open(first)
    assert recording.buses == ("x", "y")
    assert [len(recording.frames(bus)) for bus in recording.buses] == [40, 20]
    assert [tuple(batch.buses) for batch in recording.frame_batches()] == [("x", "y")] * 3
    assert recording.frames().on_bus("y").is_fd
    with pytest.raises(DataError, match="no bus is called 'z'"):
        recording.frame_batches("z")


def test_a_part_that_was_cut_off_is_followed_by_the_next(tmp_path):
    first = rotated(tmp_path / "r.mcap")
    second = part_path(first, 2)
    second.write_bytes(second.read_bytes()[:-200])
    recording = RunRecording.open(first)
    assert per_bus(recording.frame_batches()) == of(1, 2, 3, 4)
    assert [loss.what.partition(":")[0] for loss in recording.loss] == ["r.part2.mcap"]
    assert recording.exit_status == "interrupted"
    second.write_bytes(second.read_bytes()[:900])
    assert per_bus(RunRecording.open(first).frame_batches()) == of(1, 3, 4)


def test_a_part_under_another_name_says_what_it_continues(tmp_path):
    second = part_path(rotated(tmp_path / "r.mcap"), 2)
    renamed = second.rename(tmp_path / "alone.mcap")
    assert "r.mcap is missing, which alone.mcap continues" in [str(loss) for loss in RunRecording.open(renamed).loss]


@pytest.mark.parametrize("content", [b"", b"what is this"])
def test_a_part_that_is_no_recording_costs_only_itself(tmp_path, content):
    first = rotated(tmp_path / "r.mcap")
    part_path(first, 3).write_bytes(content)
    for named in (1, 3):
        recording = RunRecording.open(part_path(first, named))
        assert per_bus(recording.frame_batches()) == of(1, 2, 4)
        assert [str(loss).partition(":")[0] for loss in recording.loss] == ["r.part3.mcap"]
    (run,) = open_runs([tmp_path])
    assert len(run.files) == 3
    for path in parts_on_disk(first).values():
        path.write_bytes(content)
    with pytest.raises(RecordingError, match="is empty" if not content else "not an MCAP"):
        RunRecording.open(first)


@pytest.mark.parametrize("gone", [1, 2, 4])
def test_a_missing_part_is_reported(tmp_path, gone):
    first = rotated(tmp_path / "r.mcap")
    part_path(first, gone).unlink()
    (run,) = open_runs([first] if gone > 1 else [part_path(first, 2)])
    assert per_bus(run.frame_batches()) == of(*{1, 2, 3, 4} - {gone})
    assert run.recording is not None
    (loss,) = run.recording.loss
    assert str(loss).startswith(f"{part_path(first, gone).name} is missing")
    (again,) = open_runs([tmp_path])
    assert (again.id, again.files) == ("7", run.files)


def test_a_killed_logger_counts_from_the_start_again(tmp_path):
    first = tmp_path / "r.mcap"
    for number, session in enumerate("ab"):
        path, part = next_part(first)
        parts = PartWriter(first, run=RUN, session_id=session, first_part=part)
        parts.write_frames(BATCHES[2 * number])
        parts.note_losses({"can0": 1}, {"kernel.can0": 1})
        parts.rotate()
        parts.write_frames(BATCHES[2 * number + 1])
        parts.close("ok", {"can0": 5, "can1": 2}, {"kernel.can0": 3, "queue.can0": 2, "queue.can1": 2})
    last = parts_on_disk(first)[2]
    last.write_bytes(last.read_bytes()[: last.read_bytes().rindex(b"run_end") - 20])
    recording = RunRecording.open(path)
    assert per_bus(recording.frame_batches()) == of(1, 2, 3, 4)
    assert recording.drops == {"can0": 10, "can1": 4}
    assert recording.losses == {"kernel.can0": 6, "queue.can0": 4, "queue.can1": 4}
    assert recording.metadata["losses"]["queue.can1"] == "4"
    assert all("r.part2.mcap" in loss.what for loss in recording.loss)
    assert recording.loss


def test_other_runs_are_not_drawn_in(tmp_path):
    first = rotated(tmp_path / "r.mcap")
    stranger = RUN.model_copy(update={"id": "8"})
    with PartWriter(tmp_path / "s.mcap", run=stranger, session_id="b") as other:
        other.write_frames(BATCHES[0])
        other.rotate()
    shutil.move(tmp_path / "s.part2.mcap", tmp_path / "r.part5.mcap")
    with RecordingWriter(tmp_path / "old.part2.mcap", run=RunInfo(id="old")) as writer:
        writer.write_frames(BATCHES[1])
    recover(tmp_path / "old.part2.mcap", tmp_path / "q.mcap")
    runs = {run.files: run for run in open_runs([tmp_path])}
    names = {tuple(file.name for file in files) for files in runs}
    whole = tuple(part_path(first, number).name for number in (1, 2, 3, 4))
    assert names == {whole, ("old.part2.mcap",), ("r.part5.mcap",), ("s.mcap",)}
    losses = {run.path.name: [str(loss) for loss in run.recording.loss] for run in runs.values() if run.recording}
    assert losses.pop("s.mcap") == ["s.part2.mcap is missing, in which the run continues"]
    assert losses.pop("r.part5.mcap") == ["s.mcap is missing, which r.part5.mcap continues"]
    assert not any(losses.values())


def test_recovered_parts_are_one_run_again(tmp_path):
    first = rotated(tmp_path / "r.mcap")
    for number in (1, 2, 3, 4):
        path = part_path(first, number)
        path.write_bytes(path.read_bytes()[:-100])
    (tmp_path / "clean").mkdir()
    for number in (1, 2, 3, 4):
        recover(part_path(first, number), part_path(tmp_path / "clean" / "c.mcap", number))
    (run,) = open_runs([tmp_path / "clean"])
    assert len(run.files) == 4
    assert per_bus(run.frame_batches()) == of(1, 2, 3, 4)
    assert run.recording is not None and run.recording.loss == ()
    assert [event.text for event in run.recording.events()] == ["0", "1", "2", "3"]


def test_every_door_opens_one_run(tmp_path):
    (tmp_path / "camp" / "between").mkdir(parents=True)
    first = rotated(tmp_path / "camp" / "r.mcap")
    rotated(tmp_path / "camp" / "between" / "b.mcap")
    every = [part_path(first, number) for number in (1, 2, 3, 4)]
    for paths in ([first.parent], [first], every[2:3], every, [first.parent, first], every[::-1]):
        (run,) = open_runs(paths)
        assert run.files == tuple(every)
        assert (run.id, run.path, run.info.file) == ("7", first, "r.mcap")
    for named in ("r.mcap", "r.part3.mcap"):
        (first.parent / "runs.toml").write_text(f'[[run]]\nfile = "{named}"\nid = "seven"\npass_number = 3\n')
        (run,) = open_runs([first.parent])
        assert (run.id, run.info.pass_number, len(run.files)) == ("seven", 3, 4)
    (first.parent / "runs.toml").unlink()
    with pytest.raises(ConfigError, match="is given"):
        open_runs([])


def test_what_was_not_recorded_between_two_parts_is_reported(tmp_path):
    """A part that a rotation closed goes over without a gap; one that was cut off does not."""
    first = rotated(tmp_path / "r.mcap")
    assert RunRecording.open(first).gaps == ()
    second = part_path(first, 2)
    data = second.read_bytes()
    second.write_bytes(data[: data.index(b"run_end") - 20])
    (gap,) = RunRecording.open(first).gaps
    assert (gap.before, gap.after) == (2, 3)
    assert (gap.from_ns, gap.to_ns) == (BATCHES[1].frames["time_ns"].max(), BATCHES[2].frames["time_ns"].min())
    length_s = (gap.to_ns - gap.from_ns) * 1e-9
    backwards = f"part 3 begins {-length_s:.2f} s before the last frame of part 2"
    assert note_text(gap.note()) == (
        f"{length_s:.2f} s between part 2 and part 3 were not recorded" if length_s >= 0 else backwards
    )
