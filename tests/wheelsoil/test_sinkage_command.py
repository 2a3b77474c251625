"""`wheelsoil sinkage`: runs, bench tables, a sinkage sensor end to end, bad input."""

from __future__ import annotations

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cli_support import invoke, ok
from stressed_wheel import StressedWheel

from daq.can import encode, load_database, merge
from daq.logs import write_candump
from daq.runs import open_runs
from processing import ProcessOptions
from processing.pipeline import process
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.against_slip import sinkage
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import simulated_run
from wheelsoil.simulation.vehicle import virtual_frames
from wheelsoil.workflows import fit_runs, process_runs
from wheelsoil.workflows.fit import FitChoices

RIDE_DBC = """VERSION ""
NS_ :
BS_:
BU_: Ride
BO_ 1280 RideHeight: 4 Ride
 SG_ Depth : 7|16@0+ (0.05,-500) [-500|2776.75] "mm" Vector__XXX
 SG_ Rest : 23|16@0+ (1,0) [0|65535] "" Vector__XXX
"""
OPTIONS = SimulationOptions(soil="sandy", effects={"vasilev": {"H_m": 0.08}}, runs=2, duration_s=40.0, seed=2)
WHEEL = "[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n"


def with_sensor(folder: Path) -> Path:
    """Write a campaign with a sinkage sensor on the bus, in another vendor's DBC, in millimetres."""
    files = "--runs 2 --duration 40 --seed 2 --soil sandy --effect vasilev:H_m=0.08 --format candump"
    ok("simulate", *files.split(), "-o", folder)
    (folder / "ride.dbc").write_text(RIDE_DBC)
    (message,) = load_database(folder / "ride.dbc").messages
    for index in range(2):
        run = simulated_run(OPTIONS, index)
        stamps = run.start_ns + np.rint((run.truth.time_s[::10] + 0.25) * 1e9).astype(np.int64)
        depth = {"Depth": 1e3 * run.truth.sinkage_m[::10], "Rest": np.zeros(len(stamps))}
        log = folder / f"run-{index + 1}.log"
        write_candump([merge([virtual_frames(run), encode(message, depth, stamps, "can0").frames])], log)
    vehicle = tomllib.loads((folder / "vehicle.toml").read_text())
    vehicle["bus"][0]["dbc"].append("ride.dbc")
    vehicle["signals"]["sinkage"] = "RideHeight.Depth"
    (folder / "vehicle.toml").write_text(tomli_w.dumps(vehicle))
    return folder


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_sensor(tmp_path_factory.mktemp("sensor") / "campaign")


def test_a_sinkage_sensor_works_end_to_end(measured: Path) -> None:
    """DBC, channel, processed run."""
    run = open_runs([measured])[0]
    channel = run.channels()["sinkage"]
    truth = simulated_run(OPTIONS, 0).truth
    np.testing.assert_allclose(channel.values, truth.sinkage_m[::10], atol=3e-5)
    processed = process(run.channels(), run.vehicle, run.info)
    known = processed.used & np.isfinite(processed.sinkage_m)
    assert known.sum() > 0.9 * processed.used.sum()
    at = (processed.start_ns - simulated_run(OPTIONS, 0).start_ns) * 1e-9 - 0.25 + processed.time_s
    error = processed.sinkage_m - np.interp(at, truth.time_s, truth.sinkage_m)
    assert np.sqrt(np.mean(error[known] ** 2)) < 0.006
    assert (processed.sinkage_sigma_m[known] > 0).all()


def test_measured_sinkage_stands_beside(measured: Path) -> None:
    printed = ok("sinkage", measured)
    assert "measured mm" in printed.out
    assert "satisfied in all" in printed.out
    assert "95 % band holds" in printed.err
    found = ok("sinkage", measured, "--json").json
    assert found["schema"] == "wheelsoil/sinkage/1"
    for one in found["bins"]:
        assert one["interval95_m"][0] < one["measured_m"] < one["interval95_m"][1]
        assert one["if_peak_stays_m"] == pytest.approx(one["measured_m"], rel=0.3)  # a bow wave, and a deep wheel
    growth = found["growth"]
    assert growth["measured"]["value"] == pytest.approx(0.08, abs=0.015)
    low, high = growth["if_peak_stays"]["interval95"]
    assert low < growth["measured"]["value"] < high
    assert found["bound"]["inconsistent"] == []
    assert found["bound"]["rows"] > 1000


def test_a_broken_bound_names_the_channel(measured: Path, tmp_path: Path) -> None:
    """A DBC whose scale is wrong by fifty."""
    folder = tmp_path / "wrong"
    shutil.copytree(measured, folder)
    (folder / "ride.dbc").write_text(RIDE_DBC.replace("(0.05,-500) [-500|2776.75]", "(0.001,-10) [-10|55.535]"))
    printed = ok("sinkage", folder)
    assert "violated, suspect sinkage" in printed.out
    (item,) = ok("sinkage", folder, "--json").json["bound"]["inconsistent"]
    assert item["channel"] == "sinkage"
    assert item["rows"] > 500


def test_runs_without_a_sensor(campaign: Path) -> None:
    printed = ok("sinkage", campaign)
    assert "measured" not in printed.out
    assert "cannot be checked" in printed.err
    assert "growth from no slip to full slip" in printed.out
    found = ok("sinkage", campaign, "--json").json
    assert found["growth"]["measured"]["value"] is None
    assert all(one["measured_m"] is None for one in found["bins"])
    assert ok("sinkage", campaign, "--json").json == found


def bench(path: Path, *, torque: bool = True, sinkage: bool = True) -> Path:
    """Write a table of a wheel that digs in with slip."""
    lines = ["i,W,Dp,T,z_mm"]
    for slip in np.linspace(0.05, 0.85, 9):
        wheel = StressedWheel(entry=float(np.arccos(1 - (0.1 + 0.05 * slip) / 0.47)), slip=slip, exponent=1.0)
        load, pull, moment = wheel.forces()
        lines.append(f"{slip},{load},{pull},{moment},{1e3 * wheel.sinkage}")
    head, *rows = (line.split(",") for line in lines)
    keep = [name for name in head if (torque or name != "T") and (sinkage or name != "z_mm")]
    path.write_text("\n".join(",".join(row[head.index(name)] for name in keep) for row in [head, *rows]))
    return path


RENAME = "slip=i,vertical_load_n=W,drawbar_pull_n=Dp,driving_torque_nm=T,sinkage_m=z_mm*0.001"


def test_a_foreign_bench_table(tmp_path: Path) -> None:
    (tmp_path / "wheel.toml").write_text(WHEEL)
    args = ["--table", bench(tmp_path / "t.csv"), "--rename", RENAME, "--vehicle", tmp_path / "wheel.toml"]
    printed = ok("sinkage", *args)
    assert "states no sigma" in printed.err
    assert "satisfied in all 9" in printed.out
    found = ok("sinkage", *args, "--json").json
    assert len(found["bins"]) == 9
    for one in found["bins"]:
        assert one["interval95_m"][0] < one["measured_m"] < one["interval95_m"][1]
    low, high = found["growth"]["if_peak_stays"]["interval95"]
    assert low < 0.05 < high
    assert found["growth"]["measured"]["value"] == pytest.approx(0.05, abs=1e-6)


def test_a_table_of_two_wheels_takes_the_file_of_each(tmp_path: Path) -> None:
    (tmp_path / "wheel.toml").write_text(WHEEL)
    rows = bench(tmp_path / "t.csv").read_text().splitlines()
    both = [f"{row},{wheel}" for wheel, part in (("smooth", rows[1:6]), ("lugged", rows[6:])) for row in part]
    (tmp_path / "two.csv").write_text("\n".join([f"{rows[0]},wheel", *both]))
    files = [part for name in ("smooth", "lugged") for part in ("--vehicle", f"{name}={tmp_path / 'wheel.toml'}")]
    found = ok("sinkage", "--table", tmp_path / "two.csv", "--rename", RENAME, *files, "--json").json
    assert [len(each["bins"]) for each in found] == [5, 4]


def test_rows_are_chosen(tmp_path: Path) -> None:
    (tmp_path / "wheel.toml").write_text(WHEEL)
    table = bench(tmp_path / "t.csv")
    args = ["--table", table, "--rename", RENAME, "--vehicle", tmp_path / "wheel.toml", "--where", "i=0.05"]
    found = ok("sinkage", *args, "--json").json
    assert len(found["bins"]) == 1
    assert "three points" in found["growth"]["reason"]
    assert "three points" in ok("sinkage", *args).out


def test_lugs_are_reported(tmp_path: Path) -> None:
    (tmp_path / "wheel.toml").write_text(WHEEL + 'tyre = "lugged"\n')
    args = ["--table", bench(tmp_path / "t.csv"), "--rename", RENAME, "--vehicle", tmp_path / "wheel.toml"]
    assert "the tyre has lugs" in ok("sinkage", *args).err


def no_torque(folder: Path, campaign: Path) -> Path:
    vehicle = tomllib.loads((campaign / "vehicle.toml").read_text())
    del vehicle["signals"]["driving_torque"], vehicle["sensors"]["driving_torque"]
    path = folder / "no_torque.toml"
    path.write_text(tomli_w.dumps(vehicle))
    return path


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ("", "no run is given"),
        ("CAMPAIGN --table T", "exclude each other"),
        ("CAMPAIGN --rename a=b", "choose from a table"),
        ("CAMPAIGN --min-speed 50", "nowhere is the wheel driven"),
        ("--table T", "the wheel is not known"),
        ("--table T --vehicle NOWHEEL", "the wheel is not described"),
        ("--table T --vehicle WHEEL", "vertical_load_n"),
        ("--table NOTORQUE --vehicle WHEEL --rename slip=i,vertical_load_n=W,drawbar_pull_n=Dp", "has no torque"),
        ("--table BRAKED --vehicle WHEEL", "no row is driven"),
        ("missing.mcap", "missing.mcap"),
    ],
)
def test_bad_input_gets_one_message(words: str, printed: str, tmp_path: Path, campaign: Path) -> None:
    (tmp_path / "wheel.toml").write_text(WHEEL)
    (tmp_path / "nowheel.toml").write_text('[vehicle]\nname = "bare"\n')
    braked = "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm\n-0.2,800,-100,-30\n-0.4,800,-200,-50\n"
    (tmp_path / "braked.csv").write_text(braked)
    places = {
        "CAMPAIGN": campaign,
        "NOTORQUE": bench(tmp_path / "nt.csv", torque=False, sinkage=False),
        "NOWHEEL": tmp_path / "nowheel.toml",
        "WHEEL": tmp_path / "wheel.toml",
        "BRAKED": tmp_path / "braked.csv",
        "T": bench(tmp_path / "t.csv"),
    }
    result = invoke("sinkage", *(places.get(word, word) for word in words.split()))
    assert result.code in (1, 2, 3)
    assert printed in result.err
    assert "Traceback" not in result.err
    assert not result.out


def test_several_faults_are_reported_at_once(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("slip,vertical_load_n,drawbar_pull_n\n-0.1,800,1\n")
    (tmp_path / "wheel.toml").write_text(WHEEL)
    both = invoke("sinkage", "--table", tmp_path / "t.csv", "--vehicle", tmp_path / "wheel.toml")
    assert "has no torque" in both.err
    assert "no row is driven" in both.err
    other = invoke("sinkage", "--table", tmp_path / "none.csv", "--vehicle", tmp_path / "none.toml")
    assert "none.csv" in other.err
    assert "none.toml" in other.err


def test_runs_without_torque_say_which_role_is_missing(tmp_path: Path, campaign: Path) -> None:
    result = invoke("sinkage", campaign, "--vehicle", no_torque(tmp_path, campaign))
    assert result.code == 2
    assert "'driving_torque'" in result.err
    assert "add driving_torque" in result.err


def test_runs_of_two_wheels_are_refused(tmp_path: Path, campaign: Path) -> None:
    ok("simulate", "--runs", 1, "--duration", 20, "--radius", 0.5, "-o", tmp_path / "other")
    result = invoke("sinkage", campaign, tmp_path / "other")
    assert result.code == 2
    assert "different wheels" in result.err


def test_the_report_draws_it(measured: Path) -> None:
    processed = process_runs(open_runs([measured]), ProcessOptions())
    fit = fit_runs(processed, FitChoices(), None)
    runs = tuple(run for _, run in processed)
    material = ReportInputs(runs, fit, "", processed[0][0].vehicle, fit.soil.name)
    section = sinkage.build(material)
    figure = section.blocks[0].figures[0]  # type: ignore[union-attr]
    assert [trace["name"] for trace in figure.data][:4] == [
        "from forces, 95 %",
        "from forces, 95 %",
        "from forces, peak at the bottom",
        "from forces, peak ahead",
    ]
    assert "median of measured" in [trace["name"] for trace in figure.data]
    assert section.numbers["from_forces"]["bound"]["inconsistent"] == []
    bare = replace(material, runs=tuple(replace(r, driving_torque_nm=np.full(len(r), np.nan)) for r in runs))
    without = sinkage.build(bare)
    assert "from_forces" not in without.numbers
    assert any("No sinkage from forces" in getattr(block, "text", "") for block in without.blocks)


def test_a_column_of_radii_that_is_not_read_is_several_wheels(tmp_path: Path) -> None:
    head = "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm,wheel_radius_m,grouser"
    lines = [f"{s},80,10,4,{r},{g}" for s in (0.1, 0.3) for r, g in ((0.15, 0), (0.16, 10))]
    (tmp_path / "t.csv").write_text("\n".join([head, *lines]))
    (tmp_path / "v.toml").write_text("[wheel]\nradius_m = 0.15\nwidth_m = 0.1\n")
    result = invoke("sinkage", "--table", tmp_path / "t.csv", "--vehicle", tmp_path / "v.toml")
    assert result.code == 2
    said = " ".join(result.err.split())
    assert "several wheels" in said
    assert "--rename radius_m=wheel_radius_m" in said


def test_numbers_that_the_measured_sinkage_contradicts_are_withdrawn(tmp_path: Path) -> None:
    """In the text and in the JSON alike: ten times the sinkage that the forces give."""
    wheels = [StressedWheel(entry=0.4, slip=s, peak=0.3, exponent=1.0) for s in (0.1, 0.2, 0.4, 0.6, 0.8)]
    rows = [(w.slip, *w.forces(), 10 * 0.47 * (1 - np.cos(0.4))) for w in wheels]
    head = "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm,sinkage_m"
    (tmp_path / "t.csv").write_text("\n".join([head, *(",".join(f"{x:.6g}" for x in row) for row in rows)]))
    (tmp_path / "v.toml").write_text(WHEEL)
    given = ("sinkage", "--table", tmp_path / "t.csv", "--vehicle", tmp_path / "v.toml")
    text, found = ok(*given).out, json.loads(ok(*given, "--json").out)
    assert "withdrawn" in text
    assert "no number is given" in text
    assert found["withdrawn"]
    assert all(one["sinkage_m"] is None and one["interval95_m"] is None for one in found["bins"])
