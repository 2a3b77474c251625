"""What the commands do with good input: import, info, process, export, recover, fit, demo."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from cli_support import SHORT, busy, invoke, kept_demo, ok
from recording_support import with_mcap_ros2
from support import data_dir
from typer import Context

import model
from daq import VehicleConfig, load_toml
from daq.can import concatenate
from daq.recording import Recording
from daq.runs import open_runs
from model.wheel_soil import SOILS
from processing.pipeline import process
from wheelsoil.cli.options import use_cores

MESSAGES = ("WFT_Forces", "WFT_Moments", "WFT_Wheel", "WheelSpeeds", "GNSS_1", "GNSS_2", "GNSS_3")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign folder of candump logs."""
    folder = tmp_path_factory.mktemp("logs") / "clay"
    ok("simulate", "-o", folder, "--runs", 1, "--duration", 15, "--format", "candump")
    return folder


@pytest.fixture(scope="module")
def imported(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("imported") / "run.mcap"
    options = ("--vehicle", logs / "vehicle.toml", "--terrain", logs / "terrain.toml")
    about = ("--run-id", "seven", "--direction", "back", "--pass-number", 3, "--added-load", 250, "--inflation", 340)
    ok("import", logs / "run-1.log", "-o", target, *options, *about)
    return target


def frames_of(path: Path, bus: str | None = None) -> np.ndarray:
    (run,) = open_runs([path])
    batch = concatenate(list(run.frame_batches()))
    if bus is None:
        return batch.frames
    frames = batch.on_bus(bus).frames.copy()
    frames["bus"] = 0
    return frames


def test_import_keeps_every_frame_and_needs_no_other_file(logs, imported):
    np.testing.assert_array_equal(frames_of(imported), frames_of(logs / "run-1.log"))
    (run,) = open_runs([imported])
    assert (run.id, run.info.direction, run.info.pass_number, run.info.added_load_kg) == ("seven", "back", 3, 250)
    assert run.vehicle == load_toml(logs / "vehicle.toml", VehicleConfig)
    assert run.terrain is not None


def test_import_takes_what_lies_beside_the_log_and_options_override_it(logs, tmp_path):
    folder = tmp_path / "camp"
    folder.mkdir()
    for path in (logs / "run-1.log", logs / "vehicle.toml", logs / "terrain.toml"):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "runs.toml").write_text('[[run]]\nfile = "run-1.log"\nid = "a"\ndirection = "back"\npass_number = 2\n')
    ok("import", folder / "run-1.log", "-o", tmp_path / "one.mcap")
    ok("import", folder / "run-1.log", "-o", tmp_path / "two.mcap", "--direction", "out", "--added-load", 300)
    one, two = open_runs([tmp_path / "one.mcap", tmp_path / "two.mcap"])
    assert one.vehicle == load_toml(logs / "vehicle.toml", VehicleConfig)
    assert one.terrain is not None and one.databases
    assert (one.id, one.info.direction, one.info.pass_number, one.info.added_load_kg) == ("a", "back", 2, 0)
    assert (two.info.direction, two.info.pass_number, two.info.added_load_kg) == ("out", 2, 300)


def test_the_view_is_what_the_raw_frames_say(imported):
    """Decoded topics, read by somebody else's reader, hold decoded raw frames at no more than 100 Hz."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    (run,) = open_runs([imported])
    truth = run.channels(("vertical_load", "latitude", "longitude"))
    load, position = [], []
    with imported.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            if channel.topic == "/can/can0/wft_forces":
                load.append((message.log_time, decoded.fz))
            elif channel.topic == "/can/can0/position":
                position.append((message.log_time, decoded.latitude, decoded.longitude, decoded.status.status))
    times, values = np.array([t for t, _ in load]), np.array([v for _, v in load])
    channel = truth["vertical_load"]
    rows = np.searchsorted(channel.time_ns, times)
    np.testing.assert_array_equal(channel.values[rows], values)
    assert 90 < len(times) / (np.ptp(times) * 1e-9) < 101
    assert len(position) > 250
    assert {status for *_, status in position} == {0}
    latitude = np.interp([p[0] for p in position], truth["latitude"].time_ns, truth["latitude"].values)
    np.testing.assert_allclose([p[1] for p in position], latitude, atol=1e-9)
    longitude = np.array([p[2] for p in position])
    np.testing.assert_allclose(longitude, np.median(truth["longitude"].values), atol=1e-3)


def test_raw_frames_alone_are_smaller(logs, imported, tmp_path):
    bare = tmp_path / "bare.mcap"
    ok("import", logs / "run-1.log", "-o", bare, "--vehicle", logs / "vehicle.toml", "--view-rate", 0)
    assert [topic.name for topic in Recording.open(bare).topics] == ["/can/can0/raw"]
    assert bare.stat().st_size < imported.stat().st_size
    np.testing.assert_array_equal(frames_of(bare), frames_of(imported))


def test_import_without_a_vehicle_takes_dbcs_by_bus(logs, tmp_path):
    target = tmp_path / "run.mcap"
    given = ("--bus", "can0=wheel", "--dbc", f"wheel={logs / 'wft.dbc'}")
    result = ok("import", logs / "run-1.log", "-o", target, *given, "--json")
    assert result.json["frames"] == {"wheel": len(frames_of(logs / "run-1.log"))}
    assert result.json["unknown_frames"] > 0
    (facts,) = ok("info", target, "--json").json
    assert facts["databases"] == {"wheel": ["wft.dbc"]}
    assert facts["known_frames"] == result.json["known_frames"]
    assert str(logs) not in Recording.open(target).attachments["vehicle.toml"].decode()


def test_parts_of_one_run_become_one_recording(logs, imported, tmp_path):
    lines = (logs / "run-1.log").read_text().splitlines(keepends=True)
    parts = [tmp_path / "part-1.log", tmp_path / "part-2.log"]
    parts[0].write_text("".join(lines[:9000]))
    parts[1].write_text("".join(lines[9000:]))
    ok("import", *parts, "-o", tmp_path / "joined.mcap", "--view-rate", 0)
    np.testing.assert_array_equal(frames_of(tmp_path / "joined.mcap"), frames_of(imported))


def test_an_import_that_fails_leaves_nothing_behind(logs, tmp_path):
    target = tmp_path / "run.mcap"
    broken = tmp_path / "broken.log"
    broken.write_bytes(b"\x00\x01nothing here\n")
    assert invoke("import", logs / "run-1.log", broken, "-o", target).code == 3
    assert not target.exists()


def test_a_lenient_import_is_opened_again_without_asking(tmp_path):
    folder = data_dir("comma2k19-example1")
    (tmp_path / "vehicle.toml").write_text(
        '[[bus]]\nchannel = "can0"\ndbc = ["toyota.dbc"]\n[wheel]\nradius_m = 0.33\nwidth_m = 0.2\n'
        '[signals]\nwheel_speed = "WHEEL_SPEEDS.WHEEL_SPEED_RL"\n'
    )
    (tmp_path / "toyota.dbc").write_bytes((folder / "toyota_rav4_2019.dbc").read_bytes())
    args = ("import", folder / "candump.log.gz", "--vehicle", tmp_path / "vehicle.toml", "-o", tmp_path / "rav4.mcap")
    refused = invoke(*args)
    assert refused.code == 2
    assert "line 753" in refused.err and "--lenient-dbc" in refused.err
    allowed = ok(*args, "--lenient-dbc")
    assert "excluded line 753" in allowed.err
    (run,) = open_runs([tmp_path / "rav4.mcap"])
    key = np.load(folder / "processed_log" / "CAN" / "wheel_speed" / "value.npy")[:, 2]
    channel = run.channels(("wheel_speed",))["wheel_speed"]
    np.testing.assert_allclose(channel.values * 0.33, key, rtol=0, atol=1e-12)
    assert len(channel) == 4974
    (facts,) = ok("info", tmp_path / "rav4.mcap", "--json").json
    assert facts["frames"] == {"can0": 53800, "can1": 45000}
    assert any("line 753" in remark for remark in facts["remarks"])


@pytest.mark.parametrize("drive", ["165_2", pytest.param("165_4", marks=pytest.mark.slow)])
def test_a_real_drive_goes_through_import_info_process_and_report(drive, tmp_path):
    source = data_dir("css-canedge")
    (tmp_path / "obd2.dbc").write_text(OBD2)
    (tmp_path / "gps.dbc").write_bytes((source / "canmod-gps.dbc").read_bytes())
    (tmp_path / "vehicle.toml").write_text(CANEDGE)
    target = tmp_path / "drive.mcap"
    log = source / f"car_3BA199E2_{drive}.candump.log.gz"
    ok("import", log, "--vehicle", tmp_path / "vehicle.toml", "-o", target)
    for bus in ("can1", "can2"):  # frames of two buses with one stamp may change places
        np.testing.assert_array_equal(frames_of(target, bus), frames_of(log, bus))
    (done,) = ok("process", target, "-o", tmp_path / "drive.parquet", "--json").json
    assert 0.3 < done["used"] / done["samples"] < 1
    shares = done["quality"]["shares"]
    assert shares.get("GAP", 0) > 0, "GNSS has missing seconds"
    page = tmp_path / "drive.html"
    result = invoke("report", target, "-o", page, "--soil", "sandy", "--json")
    assert result.code == 1, "the page is written, without a fit: there is no force"
    assert {"coefficients", "torque"} <= set(result.json["left_out"])
    assert page.read_text(encoding="utf-8").count('id="data-') > 1, "figures of what was measured"


def test_process_writes_what_the_pipeline_gives(campaign, tmp_path):
    import pandas as pd

    table = pd.read_parquet(ok_output("process", campaign, "-o", tmp_path / "runs.parquet"))
    assert list(table["run"].unique()) == ["run-1", "run-2"]
    (run,) = open_runs([campaign / "run-1.mcap"])
    truth = process(run.channels(), run.vehicle, run.info)
    part = table[table["run"] == "run-1"]
    for name in ("slip", "vertical_load_n", "drawbar_pull_n", "time_s"):
        np.testing.assert_allclose(part[name], getattr(truth, name), rtol=1e-12, equal_nan=True)
    assert (part["reason"] == "used").sum() == truth.used.sum()
    text = pd.read_csv(ok_output("process", campaign / "run-1.mcap", "-o", tmp_path / "run.csv"))
    np.testing.assert_allclose(text["slip [1]"], truth.slip, rtol=1e-12)


def ok_output(*args: object) -> object:
    ok(*args)
    return args[-1]


def test_export_writes_each_message_with_units(campaign, tmp_path):
    import pyarrow.parquet as parquet
    from scipy.io import loadmat

    first = campaign / "run-1.mcap"
    files = ok("export", first, "-o", tmp_path / "t", "--json").json["files"]
    assert {Path(name).name for name in files} == {f"run-1.can0.{message}.parquet" for message in MESSAGES}
    table = parquet.read_table(tmp_path / "t" / "run-1.can0.WFT_Forces.parquet")
    assert table.schema.field("Fz").metadata[b"unit"] == b"N"
    (run,) = open_runs([first])
    channel = run.channels(("vertical_load",))["vertical_load"]
    np.testing.assert_array_equal(table["Fz"].to_numpy(), channel.values)
    np.testing.assert_array_equal(table["time_ns"].to_numpy(), channel.time_ns)
    ok("export", first, "-o", tmp_path / "m", "--format", "mat", "--signal", "GNSS_2.Speed")
    (mat,) = (tmp_path / "m").iterdir()
    assert loadmat(mat)["Speed"].size == 400
    again = invoke("export", first, "-o", tmp_path / "m", "--format", "mat", "--signal", "GNSS_2.Speed")
    assert again.code == 2 and "--force" in again.err
    wrong = invoke("export", first, "-o", tmp_path / "m", "--signal", "GNSS_2.Sped")
    assert wrong.code == 2 and "nearest: GNSS_2.Speed" in wrong.err


def test_export_gives_each_bus_a_file_of_its_own(tmp_path):
    """Two buses whose names are the same in a file's name, in two runs with the same id."""
    for folder, first in (("a", 0), ("b", 100)):
        (tmp_path / folder).mkdir()
        lines = "".join(
            f"({1_700_000_000 + i}.000000) {bus} 01#{first + number + i:02X}\n"
            for i in range(3)
            for number, bus in enumerate(("can.0", "CAN.0", "can/0", "can-0"), 1)
        )
        (tmp_path / folder / "run.log").write_text(lines.replace(" 01#", " 001#"))
    (tmp_path / "m.dbc").write_text('VERSION ""\n\nBU_: A\n\nBO_ 1 M: 1 A\n SG_ x : 0|8@1+ (1,0) [0|0] "" A\n')
    buses = "".join(f'[[bus]]\nchannel = "{bus}"\ndbc = ["m.dbc"]\n' for bus in ("can.0", "CAN.0", "can/0", "can-0"))
    (tmp_path / "vehicle.toml").write_text(f"[wheel]\nradius_m = 0.5\nwidth_m = 0.2\n{buses}")
    logs = [tmp_path / "a" / "run.log", tmp_path / "b" / "run.log"]
    given = (*logs, "--vehicle", tmp_path / "vehicle.toml", "-o", tmp_path / "out", "--format", "csv")
    files = ok("export", *given, "--force", "--json").json["files"]
    firsts = [int(Path(name).read_text().splitlines()[1].split(",")[1]) for name in files]
    assert sorted(firsts) == [1, 2, 3, 4, 101, 102, 103, 104]
    assert len({Path(name).name.casefold() for name in files}) == 8
    assert ok("export", *given, "--force", "--json").json["files"] == files


@pytest.mark.parametrize("decode", [(), ("--decode",)])
def test_an_export_leaves_empty_what_has_no_value(tmp_path, decode):
    """32767 is declared "Not available"; another bus without that label keeps it as a number."""
    value = 'VAL_ 1 x 32767 "Not available" ;\n'
    text = 'VERSION ""\n\nBU_: A\n\nBO_ 1 M: 2 A\n SG_ x : 0|16@1+ (0.02,0) [0|1400] "rpm" A\n'
    (tmp_path / "said.dbc").write_text(text + value)
    (tmp_path / "plain.dbc").write_text(text)
    lines = [f"({1_700_000_000 + i}.000000) {bus} 001#{raw}" for i, raw in enumerate(("0100", "FF7F")) for bus in "ab"]
    (tmp_path / "run.log").write_text("\n".join(lines) + "\n")
    buses = "".join(f'[[bus]]\nchannel = "{a}"\ndbc = ["{b}.dbc"]\n' for a, b in (("a", "said"), ("b", "plain")))
    (tmp_path / "vehicle.toml").write_text(buses)
    done = ok("export", tmp_path / "run.log", "-o", tmp_path / "out", *decode, *([] if decode else ["--format", "csv"]))
    assert done.err.splitlines()[-1] == "run run: M.x on a: 1 without a value (Not available) left empty"
    if decode:
        messages = list(with_mcap_ros2(tmp_path / "out" / "run.mcap"))
        found = [[message.x for topic, _, message in messages if topic == f"/can/{bus}/m"] for bus in "ab"]
    else:
        tables = [(tmp_path / "out" / f"run.{bus}.M.csv").read_text() for bus in "ab"]
        found = [[float(line.split(",")[1] or "nan") for line in table.splitlines()[1:]] for table in tables]
    np.testing.assert_allclose(found, [[0.02, np.nan], [0.02, 655.34]])


def test_an_export_that_is_interrupted_leaves_no_file(campaign, tmp_path, monkeypatch):
    from daq.recording import RecordingWriter

    def interrupted(_self, _batch):
        raise KeyboardInterrupt

    monkeypatch.setattr(RecordingWriter, "write_frames", interrupted)
    done = invoke("export", campaign / "run-1.mcap", "-o", tmp_path / "out", "--decode")
    assert done.code == 130
    assert list((tmp_path / "out").iterdir()) == []


def test_export_decode_keeps_every_sample_as_a_topic(campaign, tmp_path):
    ok("export", campaign / "run-1.mcap", "-o", tmp_path / "out", "--decode")
    target = tmp_path / "out" / "run-1.mcap"
    counts = {topic.name: topic.message_count for topic in Recording.open(target).topics}
    assert counts["/can/can0/wft_forces"] == 20_000
    np.testing.assert_array_equal(frames_of(target), frames_of(campaign / "run-1.mcap"))
    onto_itself = invoke("export", target, "-o", tmp_path / "out", "--decode", "--force")
    assert onto_itself.code == 2 and "the run itself" in onto_itself.err


def test_recover_makes_a_whole_file(campaign, tmp_path):
    from daq.recording import RecordingWriter

    whole = Recording.open(campaign / "run-1.mcap")
    cut = tmp_path / "cut.mcap"
    with RecordingWriter(cut, run=whole.run, attachments=whole.attachments, chunk_bytes=50_000) as writer:
        writer.write_frames(whole.frames())
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    result = ok("recover", cut, "--json")
    saved = Recording.open(result.json["recording"])
    assert not saved.loss and result.json["loss"]
    kept = saved.frames().frames
    np.testing.assert_array_equal(kept, whole.frames().frames[: len(kept)])
    assert 0.3 < len(kept) / len(whole.frames()) < 0.7
    (facts,) = ok("info", cut, "--json").json
    assert facts["loss"] and sum(facts["frames"].values()) == len(kept)


def test_a_logger_with_a_lenient_dbc_makes_a_recording_that_opens(tmp_path):
    (tmp_path / "bad.dbc").write_text(OBD2 + 'VAL_ 2024 Nothing 0 "no" 1 "yes" ;\n')
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[[bus]]\nchannel = "lenient"\ninterface = "virtual"\ndbc = ["bad.dbc"]\n')
    target = tmp_path / "runs" / "seven.mcap"
    assert invoke("log", vehicle, "-o", target, "--duration", 0.1).code == 2
    with busy("lenient"):
        ok("log", vehicle, "-o", target.parent, "--duration", 0.3, "--run-id", "seven", "--lenient-dbc")
    (facts,) = ok("info", target, "--json").json
    assert (facts["run_id"], facts["databases"]) == ("seven", {"lenient": ["bad.dbc"]})
    assert facts["exit_status"] == "ok"


def test_a_logger_that_names_the_run_itself_keeps_its_options(tmp_path):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[vehicle]\nname = "Test car 1"\n[[bus]]\nchannel = "unnamed"\ninterface = "virtual"\n')
    options = ("--direction", "back", "--pass-number", 2, "--added-load", 300)
    with busy("unnamed"):
        done = ok("log", vehicle, "-o", tmp_path / "runs", "--duration", 0.3, *options, "--json").json
    (facts,) = ok("info", done["path"], "--json").json
    assert facts["run_id"] == Path(done["path"]).stem
    assert facts["run_id"].startswith("Test-car-1_")
    assert [facts["info"][key] for key in ("direction", "pass_number", "added_load_kg")] == ["back", 2, 300]


def test_a_silent_bus_is_reported_and_fails_the_check_but_the_recording_is_whole(tmp_path):
    vehicle, target = tmp_path / "vehicle.toml", tmp_path / "run.mcap"
    vehicle.write_text(
        '[[bus]]\nchannel = "loud"\ninterface = "virtual"\n'
        '[[bus]]\nchannel = "silent"\ninterface = "virtual"\nbitrate = 500000\n'
    )
    with busy("loud"):
        result = invoke("log", vehicle, "-o", target, "--duration", 0.3)
    assert result.code == 1
    assert "bus silent 0 frames" in " ".join(result.out.split())
    assert "no frame was received on silent" in result.err and "500000 bit/s" in result.err
    assert "next: check that the interface is up" in result.err and "on loud" not in result.err
    (facts,) = ok("info", target, "--json").json
    assert facts["exit_status"] == "ok" and not facts["loss"] and facts["frames"]["loud"] > 5


@pytest.mark.slow
def test_demo_finds_what_it_hid(tmp_path):
    result = ok("demo", "-o", tmp_path / "demo", "--runs", 3, "--duration", 25, "--json").json
    assert result["hidden"]["family"] == "slip_sinkage"
    assert result["outcome"] in ("found", "in the set")


@pytest.mark.slow
def test_demo_compares_its_diagnosis_with_what_it_hid(tmp_path, tmp_path_factory, monkeypatch):
    made = kept_demo(tmp_path_factory)
    monkeypatch.setenv("WHEELSOIL_CACHE", str(made / "kept"))
    shutil.copytree(made / "demo", tmp_path / "demo")
    result = ok("demo", "-o", tmp_path / "demo", *SHORT, "--json").json
    assert Path(result["report"]).is_file() and Path(result["numbers"]).is_file()
    assert result["hidden"]["family"] == "slip_sinkage"
    assert result["outcome"] in ("found", "in the set", "not named")
    page = unescape(Path(result["report"]).read_text(encoding="utf-8"))
    assert json.loads(Path(result["numbers"]).read_text())["sections"]["glance"]["headline"] in page
    assert json.dumps(result["result"], ensure_ascii=False) in Path(result["numbers"]).read_text(encoding="utf-8")
    again = ok("demo", "-o", tmp_path / "demo", *SHORT)
    assert "Hidden effect." in again.err and "share their physics" in again.err
    own = tmp_path / "own" / "clay"
    own.mkdir(parents=True)
    (own / "run-1.mcap").write_text("mine")
    assert invoke("demo", "-o", tmp_path / "own").code == 2
    assert (own / "run-1.mcap").read_text() == "mine"


def test_fit_of_a_table_says_which_rows_it_left_out(tmp_path):
    (tmp_path / "wheel.toml").write_text("[wheel]\nradius_m = 0.47\nwidth_m = 0.318\n")
    slips = [-0.1, 0.0, *np.linspace(0.05, 0.6, 12)]
    rows = [f"{s:.3f},{8000 + 10 * i},{700 * s:.1f},{0.02 + 0.03 * abs(s):.4f}" for i, s in enumerate(slips)]
    args = ("fit", "--vehicle", tmp_path / "wheel.toml", "--soil", "sandy", "--table", tmp_path / "t.csv")
    head = "slip,vertical_load_n,drawbar_pull_n,sinkage_m"
    (tmp_path / "t.csv").write_text("\n".join([head, *rows]))
    text = ok(*args)
    assert "12 of 14 rows used: 2 with slip <= 0 excluded" in text.err
    assert "sinkage mm at slip" in text.out
    assert any("12 of 14 rows used" in note for note in ok(*args, "--json").json["notes"])
    (tmp_path / "t.csv").write_text("\n".join([head, *rows[2:]]))
    assert "rows used" not in ok(*args).err


@pytest.mark.parametrize("command", ["fit", pytest.param("report", marks=pytest.mark.slow), "simulate"])
def test_help_and_errors_list_every_soil(command, campaign, tmp_path):
    options = " ".join(ok(command, "--help").out.split())
    assert ", ".join(SOILS) in options
    where = [campaign] if command != "simulate" else ["-o", tmp_path / "out"]
    where += ["-o", tmp_path / "r.html"] if command == "report" else []
    assert f"nearest: clay; presets: {', '.join(SOILS)}" in invoke(command, *where, "--soil", "clai").err
    assert all(name in invoke(command, *where, "--soil", "x").err for name in SOILS)


def test_fit_on_a_measured_single_wheel(tmp_path):
    """The smooth wheel of the CMU test bed, straight ahead and driving; soil from its plates."""
    table = data_dir("cmu-terramech-testbed", "wheel_trials.csv")
    (tmp_path / "vehicle.toml").write_text("[wheel]\nradius_m = 0.058\nwidth_m = 0.050\n")
    (tmp_path / "terrain.toml").write_text(CMU_SAND)
    args = ("fit", "--table", table, "--vehicle", tmp_path / "vehicle.toml", "--terrain", tmp_path / "terrain.toml")
    names = "vertical_load_n=load_N,drawbar_pull_n=drawbar_pull_N,sinkage_m=sinkage_mm*0.001"
    chosen = ("--rename", names, "--where", "wheel=smooth,beta_deg=0", "--slip-threshold", 0)
    fit = ok(*args, *chosen, "--json").json
    errors = {name: model["criteria"]["dp"]["R0_N"] for name, model in fit["models"].items()}
    assert max(errors, key=errors.__getitem__) == "wong"
    sinkage = fit["sinkage"]
    assert len(sinkage["measured_m"]) == len(sinkage["predicted_m"]["lyasko"]) >= 12
    assert np.ptp(sinkage["predicted_m"]["wong"]) < 0.003, "Wong's sinkage does not grow with slip"
    assert np.ptp(sinkage["measured_m"]) > 0.008, "the measured one does"


@pytest.mark.slow
def test_an_import_streams(logs, tmp_path):
    """Twenty times the frames take hardly more memory."""
    text = (logs / "run-1.log").read_text()
    (tmp_path / "long.log").write_text(text * 20)
    peaks = [
        _peak_mb("import", path, "-o", tmp_path / f"{path.stem}.mcap")
        for path in (logs / "run-1.log", tmp_path / "long.log")
    ]
    assert peaks[1] < peaks[0] + 60, peaks
    assert peaks[1] < 300, peaks


def _peak_mb(*args: object) -> float:
    code = (
        "import re, sys\n"
        "from wheelsoil.cli.app import run\n"
        "code = run(sys.argv[1:])\n"
        "status = open('/proc/self/status').read()\n"  # ru_maxrss would hold the parent's peak, too
        "print(int(re.search(r'VmHWM:\\s+(\\d+) kB', status)[1]) / 1024, file=sys.stderr)\n"
        "sys.exit(code)"
    )
    command = [sys.executable, "-c", code, *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stderr.splitlines()[-1])


CMU_SAND = """
[soil]
name = "CMU sand"
cohesion_kpa = 0.5
friction_angle_deg = 29
shear_modulus_m = 0.010
sinkage_exponent = 1.44
cohesive_modulus_kn = 0
frictional_modulus_kn = 9600
"""
OBD2 = """VERSION ""
BS_:
BU_: Car
BO_ 2024 OBD2: 8 Car
 SG_ Length : 0|8@1+ (1,0) [0|255] "" Car
 SG_ Service M : 8|8@1+ (1,0) [0|255] "" Car
 SG_ Parameter m65M : 16|8@1+ (1,0) [0|255] "" Car
 SG_ VehicleSpeed m13 : 24|8@1+ (1,0) [0|255] "km/h" Car
 SG_ EngineSpeed m12 : 31|16@0+ (0.25,0) [0|16383] "rpm" Car
SG_MUL_VAL_ 2024 Parameter Service 65-65;
SG_MUL_VAL_ 2024 VehicleSpeed Parameter 13-13;
SG_MUL_VAL_ 2024 EngineSpeed Parameter 12-12;
"""
CANEDGE = """
[wheel]
radius_m = 0.33
width_m = 0.2
[[bus]]
channel = "can1"
dbc = ["obd2.dbc"]
[[bus]]
channel = "can2"
dbc = ["gps.dbc"]
[signals]
wheel_speed = "OBD2.VehicleSpeed"
ground_speed = "gnss_speed.Speed"
ground_speed_valid = "gnss_speed.SpeedValid"
latitude = "gnss_pos.Latitude"
longitude = "gnss_pos.Longitude"
gnss_time = "gnss_time.Epoch"
"""


def test_without_a_number_a_command_takes_all_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model, "processes", lambda count: count)
    asked: list[int] = []
    for jobs in (None, 7):
        use_cores(cast(Context, SimpleNamespace(with_resource=asked.append)), jobs)
    assert asked == [model.available_cores(), 7]


STARTED = """
import gc, os, sys
from wheelsoil.cli import app

usual = gc.get_threshold()

def run():
    print(*(os.environ[name] for name in ("OPENBLAS_NUM_THREADS", "PYDANTIC_DISABLE_PLUGINS")))
    print(gc.get_threshold()[0], *sys.modules.keys() & {"numpy", "pydantic"})
    gc.collect()
    print(gc.get_threshold() == usual)
    gc.set_threshold(900)
    gc.collect()
    print(gc.get_threshold()[0])

app.run = run
app.main()
"""


def test_a_command_sets_libraries_before_they_are_there_and_searches_for_cycles_late() -> None:
    """And only once: what a command sets itself stays."""
    env = {name: value for name, value in os.environ.items() if not name.startswith(("OPENBLAS_", "PYDANTIC_"))}
    done = subprocess.run([sys.executable, "-c", STARTED], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["1 __all__", "200000", "True", "900"]
