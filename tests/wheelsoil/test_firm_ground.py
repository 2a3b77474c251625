"""A run on firm ground in a campaign: no soil is fitted to it, and a diagnosis has its rolling as a static test."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import invoke, ok
from firm_road import road_run

from daq import ConfigError, Note
from daq.recording import RecordingWriter
from model import StepCode
from model.diagnosis import NextRun
from processing import LOOK, ProcessOptions, Reason
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.vehicle import virtual_frames
from wheelsoil.view.jobs import Member, fit_members, process_run
from wheelsoil.wording.notes import key_text
from wheelsoil.workflows import Files, campaigns_of, on_soil, process_runs
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.runs import say_set_aside


@pytest.fixture(scope="module")
def with_road(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the campaign with a run on a road."""
    folder = tmp_path_factory.mktemp("firm") / "clay"
    shutil.copytree(campaign, folder)
    carried = {name: (folder / name).read_bytes() for name in ("vehicle.toml", "terrain.toml", "wft.dbc")}
    with RecordingWriter(folder / "road.mcap", attachments=carried, flush_every_s=None, sync_every_s=None) as writer:
        writer.write_frames(virtual_frames(road_run(SimulationOptions())))
    with (folder / "runs.toml").open("a") as file:
        file.write('\n[[run]]\nfile = "road.mcap"\nid = "road"\nground = "firm"\n')
    return folder


def test_no_soil_is_fitted_to_firm_ground(campaign: Path, with_road: Path) -> None:
    alone, both = (ok("fit", folder, "--json") for folder in (campaign, with_road))
    assert both.json["models"] == alone.json["models"]
    assert "run road: on firm ground" in both.err


@pytest.mark.slow
def test_a_diagnosis_says_that_its_rolling_is_data(campaign: Path, with_road: Path) -> None:
    alone, both = (ok("diagnose", folder, "--json").json for folder in (campaign, with_road))
    [test] = both["static"]
    assert (test["test"], test["run"]) == ("coasting", "road") and "driving_torque_nm" not in test
    assert test["ground_speed_mps"] / test["wheel_speed_radps"] == pytest.approx(0.47, rel=0.005)
    assert "How the wheel coasts on firm ground is used as data: road." in both["sentence"]
    sizes = [found["minimum_detectable"]["wheel_radius"]["value"] for found in (alone, both)]
    assert sizes[1] < 0.8 * sizes[0] and "static" not in alone
    assert [c["name"] for c in both["causes"]] == [c["name"] for c in alone["causes"]]
    assert "coasting of road" in " ".join(ok("diagnose", with_road, "--verbose").out.split())


def test_the_files_of_a_report_have_the_run_on_firm_ground(with_road: Path, tmp_path: Path) -> None:
    ok("report", with_road, "-o", tmp_path / "r.html", "--no-diagnosis")
    numbers = json.loads((tmp_path / "r.json").read_text())
    names = [file["run_id"] for file in numbers["sections"]["provenance"]["files"]]
    assert names[-1] == "road" and len(names) == 3


def test_process_shows_it_and_nothing_else_goes_without_soil(with_road: Path, tmp_path: Path) -> None:
    assert [entry["run"]["id"] for entry in ok("process", with_road, "--json").json][-1] == "road"
    for name in ("vehicle.toml", "terrain.toml", "road.mcap", *(path.name for path in with_road.glob("*.dbc"))):
        shutil.copy(with_road / name, tmp_path / name)
    (tmp_path / "runs.toml").write_text('[[run]]\nfile = "road.mcap"\nground = "firm"\n')
    refused = invoke("fit", tmp_path)
    assert refused.code == 2 and "every run is on firm ground" in refused.err and "wheelsoil process" in refused.err


def test_it_counts_for_the_same_vehicle_in_another_folder_and_for_no_other(
    campaign: Path, with_road: Path, tmp_path: Path
) -> None:
    for name in ("vehicle.toml", "terrain.toml", "road.mcap", *(path.name for path in with_road.glob("*.dbc"))):
        shutil.copy(with_road / name, tmp_path / name)
    (tmp_path / "runs.toml").write_text('[[run]]\nfile = "road.mcap"\nid = "road"\nground = "firm"\n')
    assert "run road: on firm ground" in ok("fit", campaign, tmp_path).err
    soil = (tmp_path / "terrain.toml").read_text()
    (tmp_path / "terrain.toml").write_text(re.sub(r'(?m)^name = ".*"', 'name = "asphalt"', soil))
    assert "run road: on firm ground" in ok("fit", campaign, tmp_path).err, "it has no soil to differ by"
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(vehicle.read_text().replace("radius_m = 0.47", "radius_m = 0.49"))
    refused = invoke("diagnose", campaign, tmp_path)
    assert refused.code == 2 and "another vehicle or wheel than every run on soil" in refused.err


def test_speeds_need_no_transducer_in_vehicle_axes(with_road: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(with_road, tmp_path / "clay")
    vehicle = folder / "vehicle.toml"
    vehicle.write_text(vehicle.read_text().replace("[transducer]", '[transducer]\nframe = "wheel"'))
    assert "static tests of a transducer" not in invoke("diagnose", folder, "--accept-implausible").err


def test_a_run_that_hardly_coasts_is_set_aside_and_the_others_go_on(campaign: Path, tmp_path: Path) -> None:
    """A run on soil that is firm by mistake; its torque is said, as a zero of it would hide that it coasts."""
    folder = shutil.copytree(campaign, tmp_path / "clay")
    listed = (folder / "runs.toml").read_text().replace("[[run]]\n", '[[run]]\nground = "firm"\n', 1)
    (folder / "runs.toml").write_text(listed)
    for command in ("fit", "sinkage"):
        said = ok(command, folder).err
        assert "set aside: a run on firm ground that hardly coasts" in said and "check its zero" in said
        assert re.search(r"mean torque while it turned [\d.]+ N m", said)
    ok("report", folder, "-o", tmp_path / "r.html", "--no-diagnosis")
    [aside] = json.loads((tmp_path / "r.json").read_text())["runs_set_aside"]
    assert aside["cause"] == "hardly_coasted"


def test_the_page_shows_it_and_fits_no_soil_to_it(with_road: Path, tmp_path: Path) -> None:
    members = []
    for run in Files().open_runs([with_road], say_set_aside):
        members.append(Member(tmp_path / run.id, None))
        shown = process_run(run, ProcessOptions(purpose=LOOK), None, members[-1].file)
        whys = {Reason(why).name for why in shown.trace.reason}
        assert ("FIRM_GROUND" in whys, "USED" in whys) == ((True, False) if run.id == "road" else (False, True))
        assert (shown.medians["load_n"] is None) == (run.id == "road") and not shown.no_use
    both, alone = (fit_members(some, FitChoices(), None)["models"] for some in (members, members[:-1]))
    assert both == alone


def test_the_advice_to_coast_says_what_to_write() -> None:
    step = NextRun(Note(StepCode.HARD_GROUND, values={"duration_s": 120.0}), ("wheel_radius", "speed_bias"), 5.0)
    assert 'ground = "firm"' in key_text(step) and "runs.toml" in key_text(step)


def test_speeds_in_another_unit_are_refused_with_what_they_would_be(with_road: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(with_road, tmp_path / "clay")
    with (folder / "runs.toml").open("a") as file:
        file.write('\n[[static]]\ntest = "coasting"\nground_speed_mps = 10.8\nground_speed_sigma_mps = 0.05\n')
        file.write("wheel_speed_radps = 6.38\n")
    refused = invoke("diagnose", folder)
    assert refused.code == 2 and "is 1.69 m, that is 3.6 times 0.47 m" in refused.err
    assert "[[static]] 1 coasts on another radius" in refused.err and "check the units" in refused.err


def test_a_run_that_coasts_on_another_radius_is_named(with_road: Path) -> None:
    """It has no [[static]] to look for."""
    processed = process_runs(Files().open_runs([with_road], say_set_aside), ProcessOptions(purpose=LOOK))
    off = [
        (run, replace(done, ground_speed_mps=1.3 * done.ground_speed_mps) if done.run.ground == "firm" else done)
        for run, done in processed
    ]
    with pytest.raises(ConfigError) as refused:
        campaigns_of([with_road], on_soil(off))
    [fault] = refused.value.faults
    assert fault.what.startswith("run road coasts on another radius") and fault.where == "run road on firm ground"
    assert fault.found.startswith("ground speed / wheel speed is 0.61") and "[[static]]" not in str(fault)


def test_tests_that_roll_on_two_radii_are_named_as_in_their_files(with_road: Path, tmp_path: Path) -> None:
    """A run by its id; a [[static]] by its place in runs.toml, counted from 1 as in its other faults."""
    folder = shutil.copytree(with_road, tmp_path / "clay")
    with (folder / "runs.toml").open("a") as file:
        file.write('\n[[static]]\ntest = "lifted"\ndriving_torque_nm = 1.0\ndriving_torque_sigma_nm = 9.0\n')
        file.write('\n[[static]]\ntest = "coasting"\nground_speed_mps = 3.3\nground_speed_sigma_mps = 0.001\n')
        file.write("wheel_speed_radps = 6.38\n")
    refused = invoke("diagnose", folder)
    assert refused.code == 2 and "[[static]] 2 and run road contradict each other" in refused.err
