"""Every command does with a run in parts what it does with the same run in one file."""

from __future__ import annotations

import uuid
from pathlib import Path

import numpy as np
import pytest
from cli_support import ok, small_campaign

from daq import BusSection
from daq.can import concatenate, split
from daq.recording import Event, PartWriter, Recording, part_path
from daq.recording.part_writer import parts_on_disk
from daq.runs import open_runs
from daq.sources import open_source, replay

_BATCH = 997


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_campaign(tmp_path_factory.mktemp("whole") / "campaign")


@pytest.fixture(scope="module")
def rotated(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the same campaign, each run in five parts, the first one's second part cut off behind its last frame."""
    folder = tmp_path_factory.mktemp("rotated") / "campaign"
    folder.mkdir()
    for path in sorted(whole.iterdir()):
        if path.suffix != ".mcap":
            (folder / path.name).write_bytes(path.read_bytes())
            continue
        recording = Recording.open(path)
        frames = recording.frames()
        assert recording.run is not None
        with PartWriter(
            folder / path.name, run=recording.run, session_id="s", attachments=recording.attachments
        ) as parts:
            for batch in split(frames, _BATCH):
                if sum(parts.frame_counts.values()) >= parts.part * len(frames) / 5:
                    parts.host.write_event(Event(int(batch.frames["time_ns"][0]), "mark", f"end of {parts.part}\nhere"))
                    parts.rotate()
                parts.write_frames(batch)
            parts.note_losses({"can0": 3, "can1": 0}, {"kernel.can0": 2, "queue.can0": 1, "counter.can0.WFT_Wheel": 3})
            parts.add_metadata("clock", {"offset_s": "0.0123456", "offset_sigma_s": "0.0001", "drift_ppm": "12.0"})
        assert len(parts_on_disk(folder / path.name)) == 5
    second = part_path(folder / "run-1.mcap", 2)
    data = second.read_bytes()
    second.write_bytes(data[: data.index(b"run_end") - 20])
    return folder


def test_channels_are_the_same(whole, rotated):
    for one, other in zip(open_runs([whole]), open_runs([rotated]), strict=True):
        assert (one.id, one.info, one.vehicle) == (other.id, other.info, other.vehicle)
        channels = other.channels()
        for role, channel in one.channels().items():
            np.testing.assert_array_equal(channel.time_ns, channels[role].time_ns)
            np.testing.assert_array_equal(channel.values, channels[role].values)


def test_info(whole, rotated):
    (one,), (other,) = (ok("info", folder / "run-1.mcap", "--json").json for folder in (whole, rotated))
    same = ("run_id", "frames", "coverage", "start_ns", "end_ns", "duration_s", "databases", "attachments", "vehicle")
    assert {key: one[key] for key in same} == {key: other[key] for key in same}
    assert [Path(part["file"]).name for part in other["parts"]] == [
        "run-1.mcap",
        *(f"run-1.part{n}.mcap" for n in (2, 3, 4, 5)),
    ]
    assert sum(part["frames"] for part in other["parts"]) == sum(one["frames"].values())
    assert [part["exit_status"] for part in other["parts"]] == ["rotated", "", "rotated", "rotated", "ok"]
    assert (other["drops"], one["exit_status"], other["exit_status"]) == ({"can0": 3, "can1": 0}, "ok", "ok")
    assert other["losses"] == {"kernel.can0": 2, "queue.can0": 1, "counter.can0.WFT_Wheel": 3}
    assert [event["text"] for event in other["events"]] == [f"end of {n}\nhere" for n in (1, 2, 3, 4)]
    assert other["loss"] and all("run-1.part2.mcap" in text for text in other["loss"])
    assert (len(one["parts"]), one["events"], one["losses"], one["loss"]) == (1, [], {}, [])


def test_info_as_people_read_it(rotated):
    shown = " ".join(ok("info", rotated / "run-1.mcap").out.split())  # long lines are folded
    for text in (
        "run-1.part5.mcap",
        "cut off",
        "3 lost before recording",
        "not read in time",
        "can0.WFT_Wheel",
        "end of 4 here",
        "offset 0.01235 ± 0.0001 s, drift 12 ppm",
    ):
        assert text in shown


def test_process(whole, rotated, tmp_path):
    made = []
    for folder in (whole, rotated):
        made.append(tmp_path / f"{folder.parent.name}.csv")
        ok("process", folder, "-o", made[-1])
    assert made[0].read_bytes() == made[1].read_bytes() != b""


@pytest.mark.parametrize("options", [[], ["--decode"]], ids=["tables", "recordings"])
def test_export(whole, rotated, tmp_path, options):
    made = []
    for folder in (whole, rotated):
        made.append(tmp_path / folder.parent.name)
        ok("export", folder, "-o", made[-1], *options)
    names = [sorted(path.name for path in folder.iterdir()) for folder in made]
    assert names[0] == names[1] != []
    for name in names[0]:
        one, other = (folder / name for folder in made)
        if name.endswith(".mcap"):
            assert Recording.open(one).frames().frames.tobytes() == Recording.open(other).frames().frames.tobytes()
            counts = [{t.name: t.message_count for t in Recording.open(path).topics} for path in (one, other)]
            raw = [{name: count.pop(name) for name in list(count) if name.endswith("/raw")} for count in counts]
            assert counts[0] == counts[1]
            assert raw[0].keys() == raw[1].keys()
        else:
            assert one.read_bytes() == other.read_bytes(), name


@pytest.mark.slow
def test_fit_and_report(whole, rotated, tmp_path):
    one, other = (ok("fit", folder, "--json").json for folder in (whole, rotated))
    assert one == other
    ok("report", rotated, "-o", tmp_path / "report.html", "--no-diagnosis")
    page = (tmp_path / "report.html").read_text()
    assert "run-1.mcap" in page


def test_replay(whole, rotated):
    heard = []
    for folder in (whole, rotated):
        source = open_source(BusSection(channel=f"bus-{uuid.uuid4().hex}", interface="virtual", fd=True))
        sent = replay(folder / "run-1.mcap", "virtual", channels={"can0": source.name}, speed=None, to_s=0.5)
        batches = []
        while len(batch := source.read(0.05)):
            batches.append(batch)
        source.close()
        frames = concatenate(batches).frames
        heard.append((list(sent.frames.values()), frames["can_id"].tolist(), frames["data"].tobytes()))
    assert heard[0] == heard[1]
    assert len(heard[0][1]) > 100


def test_recover_part_by_part(rotated, tmp_path):
    clean = tmp_path / "clean"
    clean.mkdir()
    for path in parts_on_disk(rotated / "run-1.mcap").values():
        (clean / path.name).write_bytes(path.read_bytes())
        ok("recover", clean / path.name)
        (clean / path.name).unlink()
    (run,) = open_runs([clean])
    assert [path.name for path in run.files] == ["run-1-recovered.mcap"] + [
        f"run-1-recovered.part{n}.mcap" for n in (2, 3, 4, 5)
    ]
    assert run.recording is not None and run.recording.loss == ()
    truth = concatenate(list(open_runs([rotated / "run-1.mcap"])[0].frame_batches()))
    assert concatenate(list(run.frame_batches())).frames.tobytes() == truth.frames.tobytes()
