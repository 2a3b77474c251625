"""open_runs: recordings, logs and folders; what beats what; channels equal to the frames they come from."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from daq import ConfigError, RecordingError, RunInfo, VehicleConfig
from daq.can import FrameBatch, concatenate, encode, load_database, shipped_dbc
from daq.errors import DatabaseError
from daq.logs import write_candump
from daq.recording import RecordingWriter, recover
from daq.runs import SetAsideRun, misspelt_files, open_runs

START_NS = 1_700_000_000_000_000_000
VEHICLE = """
[wheel]
radius_m = 0.5
width_m = 0.3
[[bus]]
channel = "can0"
dbc = ["gnss.dbc", "wheel_speed.dbc"]
[signals]
ground_speed = "GNSS_2.Speed"
longitude = "GNSS_2.Longitude"
wheel_speed = "WheelSpeeds.RearLeft"
"""
SOIL = """
[soil]
name = "{name}"
cohesion_kpa = 1
friction_angle_deg = 25
shear_modulus_m = 0.025
sinkage_exponent = 1.04
cohesive_modulus_kn = 1
frictional_modulus_kn = 580
"""
ROLES = ("ground_speed", "longitude", "wheel_speed")


def frames(count: int = 100, speed_kt: float = 10.0) -> FrameBatch:
    messages = {m.name: m for f in ("gnss.dbc", "wheel_speed.dbc") for m in load_database(shipped_dbc(f)).messages}
    at = START_NS + np.arange(count) * 50_000_000
    gnss = encode(messages["GNSS_2"], {"Speed": speed_kt, "Longitude": -60 * 11.5}, at, "can0").frames
    wheel = encode(messages["WheelSpeeds"], {"RearLeft": 60.0}, at + 1_000_000, "can0").frames
    return concatenate([gnss, wheel])


def record(path: Path, batch: FrameBatch, run: RunInfo | None = None, **attachments: str) -> Path:
    carried = {f"{name}.toml": text.encode() for name, text in attachments.items()}
    carried |= {name: shipped_dbc(name).read_bytes() for name in ("gnss.dbc", "wheel_speed.dbc")}
    with RecordingWriter(path, run=run, attachments=carried) as writer:
        writer.write_frames(batch)
    return path


def folder_with(path: Path, **files: str) -> Path:
    path.mkdir(exist_ok=True)
    for name, text in files.items():
        (path / f"{name}.toml").write_text(text)
    return path


def test_a_recording_needs_no_other_file(tmp_path):
    path = record(tmp_path / "a.mcap", frames(), RunInfo(id="first", pass_number=2), vehicle=VEHICLE, terrain=SOIL)
    (run,) = open_runs([path])
    assert (run.id, run.info.pass_number, run.info.file) == ("first", 2, "a.mcap")
    assert run.vehicle.wheel is not None and run.vehicle.wheel.radius_m == 0.5
    assert run.terrain is not None and run.terrain.soil.cohesion_kpa == 1
    channels = run.channels(ROLES)
    np.testing.assert_allclose(channels["ground_speed"].values, 10 * 1852 / 3600)
    np.testing.assert_allclose(channels["wheel_speed"].values, 2 * np.pi)
    np.testing.assert_allclose(channels["longitude"].values, -11.5)
    assert (channels["ground_speed"].unit, channels["longitude"].unit) == ("m/s", "deg")


def test_a_log_and_a_recording_of_the_same_frames_are_the_same_run(tmp_path):
    folder = folder_with(tmp_path / "campaign", vehicle=VEHICLE)
    record(folder / "a.mcap", frames())
    write_candump([frames()], folder / "b.log")
    recording, log = open_runs([folder])
    assert recording.recording is not None and log.recording is None
    for role, channel in recording.channels().items():
        np.testing.assert_array_equal(channel.values, log.channels()[role].values)
        np.testing.assert_array_equal(channel.time_ns, log.channels()[role].time_ns)


def test_options_beat_the_folder_and_the_folder_beats_the_recording(tmp_path):
    def soil(paths: list[Path], **options: Path) -> str:
        (run,) = open_runs(paths, **options)
        assert run.terrain is not None
        return run.terrain.soil.name

    alone = record(tmp_path / "a.mcap", frames(), vehicle=VEHICLE, terrain=SOIL.format(name="carried"))
    folder = folder_with(tmp_path / "campaign", terrain=SOIL.format(name="of the folder"))
    shutil.copy(alone, folder / "a.mcap")
    given_file = tmp_path / "other.toml"
    given_file.write_text(SOIL.format(name="given"))
    assert soil([alone]) == "carried"
    assert soil([folder]) == "of the folder"
    assert soil([folder], terrain=given_file) == "given"
    (run,) = open_runs([folder], terrain=given_file)
    assert run.vehicle.wheel is not None, "what is not overridden stays"
    assert b"given" in run.attachments["terrain.toml"]


def test_a_run_named_as_a_file_takes_what_lies_in_its_folder(tmp_path, monkeypatch):
    listed = '[[run]]\nfile = "run1.log"\nid = "first"\ndirection = "back"\nadded_load_kg = 300\n'
    folder = folder_with(tmp_path / "camp", vehicle=VEHICLE, terrain=SOIL.format(name="of the folder"), runs=listed)
    write_candump([frames()], folder / "run1.log")
    record(folder / "run2.mcap", frames(), vehicle=VEHICLE, terrain=SOIL.format(name="carried"))
    other = tmp_path / "other.toml"
    other.write_text(SOIL.format(name="given"))
    (by_folder,) = open_runs([folder])
    (by_file,) = open_runs([folder / "run1.log"])
    assert by_file == by_folder
    assert (by_file.id, by_file.info.direction, by_file.info.added_load_kg) == ("first", "back", 300)
    assert len(by_file.channels()["wheel_speed"]) == 100
    monkeypatch.chdir(folder)
    log, recording = open_runs(["run1.log", "run2.mcap"])
    assert log.terrain == recording.terrain == by_folder.terrain
    (run,) = open_runs(["run1.log"], terrain=other)
    assert run.terrain is not None and run.terrain.soil.name == "given"
    assert run.vehicle == by_folder.vehicle
    (folder / "vehicle.toml").write_text("bogus = 1\n")
    with pytest.raises(ConfigError, match="bogus") as caught:
        open_runs(["run1.log", "run2.mcap"])
    assert len(caught.value.faults) == 1, "a folder's fault is reported once"


def test_a_lenient_recording_opens_beside_the_files_it_was_made_with(tmp_path):
    folder = folder_with(tmp_path / "camp", vehicle=VEHICLE.replace('"gnss.dbc", ', '"bad.dbc", '))
    wrong = 'VAL_ 2024 Nothing 0 "no" 1 "yes" ;\n'
    (folder / "bad.dbc").write_text(shipped_dbc("gnss.dbc").read_text(encoding="utf-8") + wrong, encoding="utf-8")
    shutil.copy(shipped_dbc("wheel_speed.dbc"), folder)
    for name, metadata in (("strict", {}), ("lenient", {"lenient_dbc": "yes"})):
        with RecordingWriter(folder / f"{name}.mcap", metadata=metadata) as writer:
            writer.write_frames(frames())
    with pytest.raises(DatabaseError, match="lenient"):
        open_runs([folder / "strict.mcap"])
    (run,) = open_runs([folder / "lenient.mcap"])
    assert run.lenient and len(run.channels()["ground_speed"]) == 100


def test_runs_toml_names_the_runs_and_what_is_known_of_them(tmp_path):
    folder = folder_with(
        tmp_path / "campaign",
        vehicle=VEHICLE,
        runs='[[run]]\nfile = "b.mcap"\nid = "second"\ndirection = "back"\n'
        '[[run]]\nfile = "a.mcap"\nadded_load_kg = 300\n',
    )
    for name in ("a", "b", "c"):
        record(folder / f"{name}.mcap", frames(), RunInfo(id="from the recording"))
    first, second = open_runs([folder])
    assert (first.id, first.info.direction) == ("second", "back")
    assert (second.id, second.info.added_load_kg) == ("a", 300)


def test_runs_of_one_name_are_numbered(tmp_path):
    paths = [record(tmp_path / f"{i}.mcap", frames(), RunInfo(id="run"), vehicle=VEHICLE) for i in range(3)]
    assert [run.id for run in open_runs(paths)] == ["run", "run-2", "run-3"]
    assert [run.info.id for run in open_runs(paths)] == ["run", "run-2", "run-3"]


@pytest.mark.parametrize("copy", ["a-recovered.mcap", "A.mcap"])
def test_a_recovered_copy_beside_its_source_is_no_second_run(tmp_path, copy):
    path = record(tmp_path / "a.mcap", frames(), RunInfo(id="a"), vehicle=VEHICLE)
    path.write_bytes(path.read_bytes()[:-40])
    recover(path, tmp_path / copy)
    (run,) = open_runs([tmp_path])
    assert run.path == path
    assert [run.path.name for run in open_runs([tmp_path / copy])] == [copy]
    path.unlink()
    (run,) = open_runs([tmp_path])
    assert run.path.name == copy
    assert sum(len(batch) for batch in run.frame_batches()) == 200


COLUMNS = '[signals]\nvertical_load = "FZ [kN]"\nground_speed = "v [m/s]"\n'


def table(path: Path, head: str = "time [s],FZ [kN],v [m/s]\n") -> Path:
    path.write_text(head + "".join(f"0.{i},8.0,1.{i}\n" for i in range(9)))
    return path


def aside(*paths: Path) -> list[SetAsideRun]:
    """Return what is not used of some paths, of which some is."""
    found: list[SetAsideRun] = []
    assert open_runs(paths, left_out=found.append)
    return found


def test_tables_beside_a_recording_are_not_dropped_without_a_word(tmp_path):
    folder = folder_with(tmp_path / "campaign", vehicle=COLUMNS)
    for number in (1, 2, 3):
        table(folder / f"run{number}.csv")
    assert aside(folder) == []
    record(folder / "run1.mcap", frames())
    table(folder / "processed.csv", "time_s,vertical_load_n,ground_speed_mps\n")
    (folder / "README.txt").write_text("FZ [kN]")
    second, third = aside(folder)
    assert second.message == (
        "run2.csv, run3.csv: not read, because the folder has recordings; next: import them too, or give them by name"
    )
    assert (third.run, third.cause, third.message) == ("run3", "not_read", "")
    assert (third.reason, third.next_step) == (
        "not read, because the folder has recordings",
        "import it too, or give it by name",
    )
    assert [run.run for run in aside(folder, folder / "run2.csv")] == ["run3"], "what is given by name is read"
    record(folder / "2026.11.27 a.mcap", frames())
    assert [run.run for run in aside(folder)] == ["run2", "run3"]
    table(folder / "2026.11.27 b.csv")
    assert len(aside(folder)) == 3, "a point in a name ends no name"
    (folder / "2026.11.27 b.csv").unlink()
    for number in range(4, 8):
        table(folder / f"run{number}.csv")
    assert aside(folder)[0].message.startswith("run2.csv, run3.csv, run4.csv, run5.csv, 2 more: not read")


def test_a_table_that_cannot_be_read_beside_others_is_set_aside_with_the_reason(tmp_path):
    folder = folder_with(tmp_path / "campaign", vehicle=COLUMNS)
    table(folder / "run1.csv")
    table(folder / "run2.csv", "")
    table(folder / "braked.csv", "count,FZ [kN],v [m/s]\n").write_text("count,FZ [kN],v [m/s]\n1,8,1\n2,8,1\n")
    (folder / "soil.csv").write_text("a,b\n1,2\n")
    (folder / "README.txt").write_text("of the first day")
    braked, second = aside(folder)
    assert (braked.run, second.run, second.cause) == ("braked", "run2", "not_read")
    assert second.reason == "not read: no column looks like a time" and "[series] time" in second.next_step
    assert second.message == f"{folder / 'run2.csv'}: {second.reason}; next: {second.next_step}"


def test_runs_toml_leaves_no_recording_without_a_word(tmp_path):
    listed = "".join(f'[[run]]\nfile = "run-{i}.mcap"\nid = "day-{i}"\n' for i in (1, 22))
    folder = folder_with(tmp_path / "campaign", vehicle=VEHICLE, runs=listed)
    path = record(folder / "run-1.mcap", frames())
    recover(path, folder / "again.mcap")
    for name in ("run-7", "lifted-before"):
        record(folder / f"{name}.mcap", frames())
    write_candump([frames()], folder / "run-1.log")
    missing, unnamed = aside(folder)
    step = "copy it there, or correct runs.toml"
    assert (missing.run, missing.cause, missing.next_step) == ("day-22", "missing", step)
    assert missing.reason == "runs.toml names run-22.mcap, and there is no such file" and not missing.drive_again
    assert missing.message == f"{folder / 'run-22.mcap'}: skipped: no such file; next: {step}"
    assert (unnamed.run, unnamed.message) == (
        "run-7",
        "run-7.mcap: not used, because runs.toml does not name it; next: name it in runs.toml, or take it out of the "
        "folder",
    )
    chosen: list[SetAsideRun] = []
    open_runs([folder], runs=folder / "runs.toml", left_out=chosen.append)
    assert [run.run for run in chosen] == ["day-22"], "who gives runs.toml by hand has chosen"


def test_a_file_of_nearly_a_known_name_is_found():
    said = misspelt_files(
        ["vehcile.toml", "Terrain.toml", "runs.toml", "run.toml", "tyre.toml", "choice.toml", "a.csv"]
    )
    assert said == [
        "Terrain.toml is not read: is it terrain.toml?",
        "vehcile.toml is not read: is it vehicle.toml?",
    ]
    assert misspelt_files(["vehicle.toml", "vehicle2.toml"]) == [], "another one beside the one that is read"
    assert misspelt_files(["vehicle2.toml"], given=["vehicle.toml"]) == []


def test_all_faults_are_reported_at_once(tmp_path):
    folder = folder_with(tmp_path / "campaign", vehicle=VEHICLE + "\nbogus = 1\n", terrain="[soil]\nname = 3\n")
    with pytest.raises(ConfigError) as caught:
        open_runs([folder, tmp_path / "nowhere.mcap"])
    text = str(caught.value)
    assert all(word in text for word in ("bogus", "cohesion_kpa", "nowhere.mcap"))
    with pytest.raises(ConfigError, match="no run is given"):
        open_runs([])
    with pytest.raises(RecordingError, match="no such file"):
        open_runs([tmp_path / "nowhere.log"])


def test_a_dbc_that_is_not_attached_is_named(tmp_path):
    path = record(tmp_path / "a.mcap", frames(), vehicle=VEHICLE.replace("gnss.dbc", "other/gps.dbc"))
    with pytest.raises(DatabaseError, match=r"does not carry the DBC 'other/gps.dbc'"):
        open_runs([path])


def test_nothing_is_asked_of_a_run_that_nobody_described(tmp_path):
    with RecordingWriter(tmp_path / "bare.mcap") as writer:
        writer.write_frames(frames())
    (run,) = open_runs([tmp_path / "bare.mcap"])
    assert run.vehicle == VehicleConfig()
    assert run.id == "bare"
    assert sum(len(batch) for batch in run.frame_batches()) == 200
    assert run.channels(ROLES) == {}


def test_a_role_without_a_frame_is_an_empty_channel(tmp_path):
    with RecordingWriter(
        tmp_path / "a.mcap",
        attachments={"vehicle.toml": VEHICLE.encode()}
        | {name: shipped_dbc(name).read_bytes() for name in ("gnss.dbc", "wheel_speed.dbc")},
    ) as writer:
        writer.write_frames(frames()[:0])
    (run,) = open_runs([tmp_path / "a.mcap"])
    assert {role: len(channel) for role, channel in run.channels().items()} == dict.fromkeys(ROLES, 0)


def test_channels_come_in_pieces_that_make_up_the_whole(tmp_path):
    count = 150_000
    path = record(tmp_path / "a.mcap", frames(count), vehicle=VEHICLE)
    (run,) = open_runs([path])
    batches = list(run.channel_batches(("ground_speed",)))
    assert len(batches) > 3
    channels = run.channels(("ground_speed",))
    assert list(channels) == ["ground_speed"]
    joined = np.concatenate([batch["ground_speed"].time_ns for batch in batches])
    np.testing.assert_array_equal(channels["ground_speed"].time_ns, joined)
    np.testing.assert_array_equal(joined, START_NS + np.arange(count) * 50_000_000)
