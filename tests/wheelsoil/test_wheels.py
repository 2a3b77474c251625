"""Several instrumented wheels in one recording: every command takes each in turn, or the one that is named."""

from __future__ import annotations

import csv
import re
import shutil
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from cli_support import busy, invoke, ok, silence
from diagnosis_samples import diagnosis
from shared_results import made_once

from daq import (
    OUTPUTS,
    ConfigError,
    Fault,
    InstrumentedWheel,
    Note,
    RunInfo,
    SensorSection,
    StaticTest,
    TransducerSection,
    VehicleConfig,
    WheelSection,
    load_toml,
)
from daq.runs import Run, open_runs
from model import DiagnosisCode, FitCode
from model.diagnosis import Campaign, Diagnosis
from model.diagnosis.findings.set_fit import fit_set
from model.diagnosis.time_series import linearise_campaigns
from model.fit.observations import observations_of
from model.simulation import whole
from processing import LOOK, ProcessedRun, ProcessOptions
from wheelsoil.cache import nothing_kept
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import simulated_stretches
from wheelsoil.view.campaigns import open_campaigns
from wheelsoil.view.messages import commands_of
from wheelsoil.wording.notes import texts_of
from wheelsoil.wording.verdict import sentence_of
from wheelsoil.workflows import (
    Files,
    campaigns_of,
    diagnose_campaigns,
    diagnosis_options,
    fit_runs,
    load_model,
    open_and_process,
    process_runs,
    vehicles_of,
)
from wheelsoil.workflows.diagnosis import with_advice
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.runs import wheel_id

IDS = ("FL", "RL")
QUICK = ("--effects", "torque_zero", "--most-causes", 1)
ZERO_NM = 150.0


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of one run with two wheels, the torque of the rear one with a zero. Not to be written to."""
    hidden = ("--effect", f"torque_zero:offset_nm={ZERO_NM}", "--faulty-wheel", "RL", "--noise", "0.5")
    length = ("--runs", 1, "--duration", 20, "--pass-number", 2)

    def simulate(folder: Path) -> None:
        ok("simulate", "-o", folder / "two", "--wheels", 2, *length, *hidden)

    return made_once(tmp_path_factory, "two_wheels", simulate) / "two"


@pytest.fixture(scope="module")
def runs(two: Path) -> dict[str, ProcessedRun]:
    return {wheel: open_and_process([two], ProcessOptions(), Files(wheel=wheel))[0][1] for wheel in IDS}


def test_a_simulated_vehicle_has_its_wheels_in_one_recording(two: Path, runs: dict[str, ProcessedRun]) -> None:
    assert load_toml(two / "vehicle.toml", VehicleConfig).wheel_ids == IDS
    assert tomllib.loads((two / "manifest.toml").read_text(encoding="utf-8"))["truth"]["wheels"] == list(IDS)
    front, rear = runs["FL"], runs["RL"]
    moving = slice(round(5 * front.rate_hz), round(14 * front.rate_hz))
    assert (front.start_ns - rear.start_ns) % round(1e9 / front.rate_hz) == 0, "all wheels are on one grid"
    common = [run.start_ns + np.round(run.time_s * 1e9).astype(np.int64) for run in (front, rear)]
    _, here, there = np.intersect1d(*common, return_indices=True)
    assert len(here) > 0.99 * len(front)
    np.testing.assert_array_equal(front.ground_speed_mps[here], rear.ground_speed_mps[there])
    at_rest = [float(np.nanmean(run.vertical_load_n[:200])) for run in (front, rear)]
    assert at_rest == pytest.approx([0.5 * 3600 * 9.80665 - 8000, 8000], abs=120)
    gained = [
        np.polyfit(run.ground_acceleration_mps2[moving], run.vertical_load_n[moving], 1)[0] for run in (front, rear)
    ]
    assert gained[0] < 0 < gained[1], "the rear wheel gains load when the vehicle accelerates, the front wheel loses it"
    swing = [run.vertical_load_n[moving] - np.mean(run.vertical_load_n[moving]) for run in (front, rear)]
    assert abs(np.corrcoef(*swing)[0, 1]) < 0.95, "each wheel has its own road"


def test_a_rear_wheel_counts_the_axle_before_it(runs: dict[str, ProcessedRun]) -> None:
    assert (runs["FL"].passage, runs["RL"].passage) == (3, 4), "pass 2 of a vehicle with two axles"


def test_process_takes_each_wheel_in_turn(two: Path, tmp_path: Path) -> None:
    table = tmp_path / "two.csv"
    result = ok("process", two, "--json", "-o", table)
    assert [entry["wheel"] for entry in result.json] == list(IDS)
    assert all(entry["run"]["id"] == "run-1" and next(iter(entry)) == "wheel" for entry in result.json)
    with table.open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    column = next(row for row in rows if "wheel" in row).index("wheel")
    assert set(IDS) <= {row[column] for row in rows}
    [alone] = ok("process", two, "--json", "--wheel", "RL").json
    assert alone == result.json[1]
    text = ok("process", two)
    assert [line.split() for line in text.out.splitlines() if line.startswith("wheel ")] == [["wheel", w] for w in IDS]


def test_info_lists_the_wheels(two: Path) -> None:
    [facts] = ok("info", two, "--json").json
    assert facts["wheels"] == list(IDS)
    assert invoke("info", two, "--wheel", "RR").code == 2


def test_a_fit_of_all_wheels_has_their_times_on_one_clock(runs: dict[str, ProcessedRun]) -> None:
    front, rear = (runs[wheel] for wheel in IDS)
    later = replace(rear, start_ns=rear.start_ns + 2_000_000_000)
    plain, moved = (observations_of((front, other), drives=(3, 3)).time_s for other in (rear, later))
    assert set(np.round(moved - plain, 6)) == {0.0, 2.0}


def test_wheels_of_one_axle_are_at_one_passage_whichever_pass_it_is(two: Path) -> None:
    [(run, done)] = open_and_process([two], ProcessOptions(), Files(wheel="FL"))
    later = replace(done, run=done.run.model_copy(update={"pass_number": 5}))
    of_drives = [*[(run, done)] * 2, *[(replace(run, path=two / "later.mcap"), later)] * 2]
    with nothing_kept():
        fit = fit_runs(of_drives, FitChoices(), None)
    assert FitCode.SEVERAL_PASSAGES not in [note.code for note in fit.notes]


def test_a_fit_notes_the_numbers_that_no_file_states(two: Path) -> None:
    [(run, done)] = open_and_process([two], ProcessOptions(), Files(wheel="FL"))
    wheel = run.vehicle.wheel
    assert wheel
    least = WheelSection(id="FL", radius_m=wheel.radius_m, width_m=wheel.width_m)
    bare = replace(run, vehicle=run.vehicle.model_copy(update={"wheel": least, "sensors": {}}))

    def defaults(run: Run, *effects: str, kpa: float | None = None) -> list[dict[str, float]]:
        driven = replace(done, run=done.run.model_copy(update={"inflation_kpa": kpa}))
        with nothing_kept():
            notes = fit_runs([(run, driven)], FitChoices(effects=effects), None).notes
        return [note.values["values"] for note in notes if note.code == FitCode.DEFAULTS_TAKEN]

    assert defaults(run) == [] and defaults(run, "tyre_flattening", kpa=250.0) == []
    assert defaults(run, "tyre_flattening") == [{"": {"[[run]] inflation_kpa": 340.0}}]
    unstated = defaults(bare)[0][""]
    assert list(unstated) == [
        "[wheel] outboard_mass_kg",
        "[wheel] outboard_inertia_kgm2",
        "[sensors.wheel_speed] latency_s",
        "[sensors.ground_speed] latency_s",
        "[sensors.vertical_load] latency_s",
        "[sensors.drawbar_pull] latency_s",
        "[sensors.driving_torque] latency_s",
    ]
    assert set(unstated.values()) == {0.0}
    turning = TransducerSection(frame="wheel", angle_offset_deg=0.0)
    for transducer, values in (
        (turning, {"side": "left", "angle_direction": 1}),
        (TransducerSection(side="right"), {"frame": "vehicle"}),
        (TransducerSection(zero="lifted"), {}),
    ):
        mounted = replace(run, vehicle=run.vehicle.model_copy(update={"transducer": transducer}))
        expected = {f"[transducer] {key}": value for key, value in values.items()}
        assert defaults(mounted) == ([{"": expected}] if expected else [])


def test_a_default_of_some_runs_or_wheels_is_noted_with_their_names(two: Path) -> None:
    [(run, done)] = open_and_process([two], ProcessOptions(), Files(wheel="FL"))
    silent = RunInfo.model_validate({"id": "run-2", "inflation_kpa": 250.0})
    vehicle = run.vehicle.model_copy(
        update={"sensors": {**run.vehicle.sensors, "wheel_speed": SensorSection(sigma=0.1)}}
    )
    rear = InstrumentedWheel.model_validate({"id": "RL", "radius_m": 0.47, "width_m": 0.318}).section
    second = vehicle.model_copy(update={"wheel": rear, "transducer": TransducerSection(frame="wheel")})
    pairs = [(run, done), (replace(run, vehicle=second, id="run-2", info=silent), replace(done, run=silent))]
    with nothing_kept():
        notes = fit_runs(pairs, FitChoices(effects=("slope",)), None).notes
        [text] = [text for text in texts_of(notes) if "by default" in text]
    assert text == (
        "taken by default, because no file states it: of RL [wheel] outboard_mass_kg = 0, "
        "[wheel] outboard_inertia_kgm2 = 0, [sensors.wheel_speed] latency_s = 0, "
        '[transducer] side = "left", [transducer] angle_offset_deg = 0, [transducer] angle_direction = 1; '
        'of run-2 [[run]] direction = "out"; state each, even if it is the same'
    )
    two_of_it = InstrumentedWheel.model_validate({"id": "FL", "radius_m": 0.47, "width_m": 0.3})
    assert "outboard_mass_kg" not in two_of_it.section.model_fields_set


def test_a_static_test_of_a_wheel_is_known_by_its_place_among_those_of_the_wheel(two: Path) -> None:
    [(run, done)] = open_and_process([two], ProcessOptions(), Files(wheel="RL"))
    speeds = {"wheel": "RL", "test": "coasting", "ground_speed_sigma_mps": 0.001, "wheel_speed_radps": 6.4}
    tests = (StaticTest.model_validate({**speeds, "ground_speed_mps": speed}) for speed in (3.0, 3.2))
    other = StaticTest(wheel="FL", test="lifted", driving_torque_nm=1.0, driving_torque_sigma_nm=0.5)
    of_both = replace(open_runs([two])[0], static=(other, *tests))
    with pytest.raises(
        ConfigError, match=r"^\[\[static\]\] 1 of those of wheel RL and .* 2 of those of wheel RL contra"
    ):
        campaigns_of([two], [(replace(run, static=of_both.for_wheel("RL").static), done)])


def test_fit_and_sinkage_take_each_wheel_in_turn(two: Path) -> None:
    *both, together = ok("fit", two, "--json").json
    assert [entry["wheel"] for entry in (*both, together)] == [*IDS, "all"]
    assert together["models"]["wong"]["samples"] == sum(entry["models"]["wong"]["samples"] for entry in both)
    blocks = [entry["models"]["vasilev"]["independent_blocks"] for entry in (*both, together)]
    assert blocks[2] < 1.3 * max(blocks[:2]), "blocks of the two wheels' time are one block each"
    [note] = together["notes"]
    assert "passages 3, 4" in note
    assert all(entry["wheel_size"] == {"radius_m": 0.47, "width_m": 0.318} for entry in both)
    assert ok("fit", two, "--json", "--wheel", "FL").json == both[0]
    shown = ok("fit", two)
    assert shown.out.startswith("wheel FL\n") and "\n\nwheel RL\n" in shown.out
    assert "\n\nall wheels together\n" in shown.out and "passages 3, 4" in shown.err
    assert "all wheels" not in ok("fit", two, "--apart").out
    assert [entry["wheel"] for entry in ok("sinkage", two, "--json").json] == list(IDS)


def test_wheels_of_two_sizes_share_no_law(two: Path, tmp_path: Path) -> None:
    text = (two / "vehicle.toml").read_text(encoding="utf-8")
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(text.replace("width_m = 0.318", "width_m = 0.3", 1), encoding="utf-8")
    found = ok("fit", two, "--vehicle", vehicle)
    assert "differ in radius or width" in found.err and "\n\nall wheels" not in found.out
    doubt = Fault("the speed of wheel RL comes 0.30 s later", next_step="check it")
    with patch("wheelsoil.workflows.vehicle.doubts_of_wheels", return_value=[doubt]):
        *both, of_all = ok("fit", two, "--vehicle", vehicle, "--json").json
        samples = ok("process", two, "--json").json
    assert (of_all["wheel"], of_all["models"]) == ("all", {}) and "differ in radius" in of_all["notes"][0]
    assert "doubts" not in both[0] and [each["what"] for each in of_all["doubts"]] == [doubt.what]
    assert [each["doubts"][0]["what"] for each in samples] == [doubt.what] * len(samples)


@pytest.fixture(scope="module")
def diagnosed(two: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict[str, Any]], Path]:
    model = tmp_path_factory.mktemp("models") / "model.toml"
    return ok("diagnose", two, *QUICK, "-o", model, "--json").json, model


@pytest.mark.slow
def test_an_average_with_a_late_speed_is_no_worse_than_the_soil_alone(tmp_path: Path) -> None:
    """A set of -0.3 s with 27 % made it 609 N at FL where Wong's model has 252, and 557 for 47 N at RL."""
    runs = ("--wheels", 2, "--runs", 3, "--duration", 20, "--added-load", 0, "--soil", "sandy", "--seed", 5)
    ok("simulate", "-o", tmp_path / "c", *runs, "--brakes", "held", "--effect", "drawbar_pull_zero@FL:offset_n=250")
    ok("diagnose", tmp_path / "c", "-o", tmp_path / "m.toml")
    late = [e for one in load_model(tmp_path / "m.toml").sets for e in one.effects if e.key == "speed_latency"]
    assert late and all(abs(e.values["speed_latency.extra_delay_s"]) > 0.2 for e in late)
    fits = ok("fit", tmp_path / "c", "--model", tmp_path / "m.toml", "--apart", "--json").json
    wong, extended = ([fit["models"][name]["criteria"]["dp"]["R0_N"] for fit in fits] for name in ("wong", "extended"))
    assert extended[0] < 0.3 * wong[0] and extended[1] < 1.05 * wong[1]


def test_a_run_in_which_a_wheel_is_silent_costs_no_other_run(tmp_path: Path) -> None:
    """Neither the diagnosis nor the report, which diagnose the same runs; where all are silent, the fault is raised."""
    folder, given = tmp_path / "c", list[tuple[tuple[str, tuple[str, ...]], ...]]()
    ok("simulate", "-o", folder, "--wheels", 2, "--runs", 2, "--duration", 15, "--format", "candump")
    silence(folder / "run-2.log", "can1")

    def by_hand(campaigns: Sequence[Campaign], _: object) -> Diagnosis:
        given.append(tuple((each.name, tuple(run.run.id for run in each.runs)) for each in campaigns))
        return diagnosis("nothing_detectable")

    def in_doubt(campaigns: Sequence[Campaign], _: object) -> Diagnosis:
        found, rear = diagnosis("one_of"), campaigns[0].runs[0].passage == 2
        return found if rear else replace(found, next_run=())

    with (
        patch("wheelsoil.workflows.report.diagnose_campaigns", in_doubt),  # first: its import takes the right one
        patch("wheelsoil.workflows.diagnosis.diagnose_campaigns", in_doubt),
    ):
        doubtful = ok("diagnose", folder, "--json")
        page = ok("report", folder, "-o", tmp_path / "doubt.html", "--json").json
    assert [step["campaign"] for step in doubtful.json[-1]["next_run"]] == ["wheel RL"]
    assert "wheelsoil diagnose FOLDER --wheel RL --next-run" in doubtful.err
    assert "wheel RL: " in (tmp_path / "doubt.html").read_text(encoding="utf-8") and page["wheels"]

    with (
        patch("wheelsoil.workflows.report.diagnose_campaigns", by_hand),  # first: its import takes the right one
        patch("wheelsoil.workflows.diagnosis.diagnose_campaigns", by_hand),
    ):
        both = ok("diagnose", folder, "--json", "--next-run")
        reported = ok("report", folder, "-o", tmp_path / "r.html")
        text = ok("diagnose", folder, "--wheel", "RL")
        silence(folder / "run-1.log", "can1")
        silent = invoke("diagnose", folder, "--json")
    found = both.json
    assert [entry["wheel"] for entry in found] == [*IDS, "all"]
    said = "next runs are ranked for one wheel at a time (FL, RL): wheelsoil diagnose FOLDER --wheel FL --next-run"
    assert said in both.err
    assert [[run["run"] for run in entry.get("runs_set_aside", [])] for entry in found] == [[], ["run-2"], []]
    assert found[1]["runs_set_aside"][0]["cause"] == "silent"
    assert given[:3] == given[3:6], "the report diagnoses the same"
    assert "Without run-2: a signal is missing." in " ".join(reported.out.split())
    assert re.search("set aside +run-2: vertical_load is missing", text.out)
    assert silent.code == 1 and "holds no sample of vertical_load" in silent.err
    assert [entry["wheel"] for entry in silent.json] == ["FL"]


def test_what_one_sensor_shows_stands_at_its_wheel_alone(two: Path) -> None:
    """Whichever command asks."""
    of_wheels = {wheel: open_and_process([two], ProcessOptions(), Files(wheel=wheel)) for wheel in IDS}
    values = {"channel": "dp", "size": 20.0}
    notes = (Note(DiagnosisCode.WHEEL_ORDER, values=values), Note(DiagnosisCode.TWO_RUNS))
    found = replace(diagnosis("nothing_detectable"), notes=notes)
    with nothing_kept(), patch("model.diagnosis.diagnose", return_value=found):
        alone, together = (
            {note.code for note in diagnose_campaigns(given, diagnosis_options("balanced")).notes}
            for given in (campaigns_of([two], of_wheels["FL"]), vehicles_of([two], of_wheels))
        )
    assert alone - together == {DiagnosisCode.WHEEL_ORDER} and DiagnosisCode.TWO_RUNS in together


def test_the_next_run_of_all_wheels_is_that_of_the_wheel_that_decides() -> None:
    """Of the wheel whose steps separate most of what is open of all, not of one whose own odds are larger."""
    found = diagnosis("one_of")
    cause, run = found.causes[0], found.next_run[0]
    open_ones = tuple(replace(cause, name=name, key=name) for name in ("torque_gain@FR", "grouser"))
    joint = replace(found, causes=open_ones, next_run=())
    wheels = {
        "FL": replace(found, next_run=(replace(run, separates=("torque_gain", "crosstalk")),)),
        "FR": replace(
            found,
            next_run=(
                replace(run, separates=("grouser", "torque_gain"), expected_log_bayes_factor=3.0, naming_chance=0.4),
                replace(run, separates=("slope",)),
            ),
        ),
        "RL": replace(found, next_run=(replace(run, separates=("grouser", "slope"), expected_log_bayes_factor=9.0),)),
        "RR": diagnosis("nothing_detectable"),
    }
    [step] = with_advice(joint, wheels).next_run
    assert (step.campaign, step.separates) == ("wheel FR", ("grouser", "torque_gain"))
    assert step.naming_chance is None, "what it is worth to the name of all is not known"
    assert sentence_of(with_advice(joint, wheels)).count("Next: wheel FR: ") == 1
    [step] = with_advice(joint, {name: wheels[name] for name in ("FL", "RL", "RR")}).next_run
    assert step.campaign == "wheel RL"
    assert not with_advice(joint, {name: wheels[name] for name in ("FL", "RR")}).next_run, "FL is not in doubt"
    for other in (replace(joint, verdict="named"), replace(joint, verdict="nothing_detectable")):
        assert not with_advice(other, wheels).next_run
    assert not with_advice(joint, {"RR": wheels["RR"]}).next_run


def test_fit_and_sinkage_go_on_without_the_run_in_which_a_wheel_is_silent(tmp_path: Path) -> None:
    """A torque that is missing costs those that need it; where a wheel has no whole run, the fault is raised."""
    folder = tmp_path / "c"
    ok("simulate", "-o", folder, "--wheels", 2, "--runs", 2, "--duration", 20, "--format", "candump")
    for lost, needed_by in (
        (" 101#", (("sinkage",), ("fit", "--channels", "dp,t"))),
        (" can1 ", (("sinkage",), ("fit",))),
    ):
        log = folder / "run-2.log"
        lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
        log.write_text("".join(line for line in lines if not (" can1 " in line and lost in line)), encoding="utf-8")
        for command in needed_by:
            result = ok(*command, folder, "--json")
            aside = {entry["wheel"]: entry.get("runs_set_aside", []) for entry in result.json}
            assert [(run["run"], run["cause"]) for run in aside["RL"]] == [("run-2", "silent")] and not aside["FL"]
            assert "set aside: run run-2, wheel RL: " in result.err
        if lost != " can1 ":
            assert "driving_torque is missing" in result.err and "set aside" not in ok("fit", folder).err
    silence(folder / "run-1.log", "can1")
    failed = invoke("fit", folder, "--json")
    assert failed.code != 0 and "WFT_Forces" in failed.err and [entry["wheel"] for entry in failed.json] == ["FL"]


def test_the_zero_of_one_transducer_is_found_at_its_wheel(diagnosed: tuple[list[dict[str, Any]], Path]) -> None:
    found, model = diagnosed
    front, rear, both = found
    assert (front["wheel"], rear["wheel"], both["wheel"]) == (*IDS, "all")
    assert rear["verdict"] in ("named", "one_of") and rear["candidates"][0]["name"] == "torque_zero"
    assert rear["causes"][0]["name"] == "torque_zero" and all(cause["wheel"] == "RL" for cause in rear["causes"])
    assert rear["causes"][0]["parameters"][0]["value"] == pytest.approx(ZERO_NM, rel=0.4)
    assert front["verdict"] == "nothing_detectable" and not front["causes"]
    assert [path.name for path in model.parent.iterdir()] == ["model.toml"], "one file of all wheels together"
    best = both["candidates"][0]
    assert (best["wheel"], best["name"]) == ("RL", "torque_zero"), "of all wheels together, at the wheel where it acts"
    assert [cause["wheel"] for cause in both["causes"][:1]] == ["RL"] and len(both["soils"]) == 1
    of_wheels = [finding for finding in both["what_is_wrong"] if finding["where"].startswith("wheel ")]
    assert of_wheels and all(f"wheel {finding['wheel']}: " in finding["where"] for finding in of_wheels)
    assert not any("wheel" in finding for finding in (*front["what_is_wrong"], *rear["what_is_wrong"]))


def test_the_model_file_of_a_vehicle_predicts_at_each_wheel_what_the_diagnosis_of_all_does(
    two: Path, diagnosed: tuple[list[dict[str, Any]], Path]
) -> None:
    """At the samples of the joint diagnosis, by the model of each wheel in the set that it fitted."""
    wheels = {wheel: open_and_process([two], ProcessOptions(purpose=LOOK), Files(wheel=wheel)) for wheel in IDS}
    options = diagnosis_options(effects=["torque_zero"], most_causes=1)
    linearised = linearise_campaigns(vehicles_of([two], wheels), options)
    fit = fit_set(linearised, ("torque_zero@RL",))
    read = load_model(diagnosed[1])
    assert tuple(read.wheels) == IDS and read.provenance["campaign"] == "two"
    at = [[effect.key for effect in each.effects] for each in read.sets].index(["torque_zero@RL"])
    only = replace(read, sets=(replace(read.sets[at], probability=1.0),))
    points = fit.problem.points(fit.estimate)
    for wheel, part, point, data in zip(IDS, fit.problem.parts, points, linearised.campaigns, strict=True):
        values = {**part.simulation.space.values(point.soil), **point.causes}
        expected = part.simulation.model(point.causes).predict(data.samples.conditions, values)
        said = only.of_wheel(wheel).predict(data.samples.conditions)
        for channel in OUTPUTS.values():
            np.testing.assert_allclose(getattr(said, channel.field), getattr(expected, channel.field), rtol=1e-9)
        zero = said.driving_torque_nm - only.of_wheel("FL").predict(data.samples.conditions).driving_torque_nm
        assert (np.abs(zero) > 100).all() == (wheel == "RL")


def test_commands_take_the_model_of_a_vehicle_at_each_wheel_or_refuse_it_by_name(
    two: Path, diagnosed: tuple[list[dict[str, Any]], Path], tmp_path: Path
) -> None:
    _, model = diagnosed
    front, rear, both = ok("fit", two, "--model", model, "--json").json
    assert [effect["name"] for effect in front["extended"].get("effect", ())] == []
    assert "torque_zero@RL" in str(rear["models"]["extended"]) and "torque_zero@RL" not in str(front["models"])
    assert "extended" not in both["models"], "no law of all wheels has a zero of one"
    assert "acts at one wheel alone" in ok("fit", two, "--model", model).err
    ok("simulate", "--model", model, "-o", tmp_path / "again", "--runs", 1, "--duration", 15, "--format", "candump")
    truth = tomllib.loads((tmp_path / "again" / "manifest.toml").read_text(encoding="utf-8"))["truth"]
    assert truth["wheels"] == list(IDS)
    refused = (
        (invoke("simulate", "--model", model, "-o", tmp_path / "four", "--wheels", 4), "FL 0.47 x 0.318 m, RL 0.47"),
        (invoke("fit", "recordings/clay", "--model", model), "a wheel without an id"),
        (invoke("diagnose", two, *QUICK, "-o", model), str(model)),
    )
    for result, words in refused:
        assert result.code == 2 and words in result.err and "next: " in result.err


def test_the_file_of_one_wheel_is_of_no_other(two: Path, tmp_path: Path) -> None:
    model, page = tmp_path / "rl.toml", ("--no-diagnosis", "-o", tmp_path / "r.html")
    ok("diagnose", two, "--wheel", "RL", *QUICK, "-o", model)
    read = load_model(model)
    assert (read.wheel_id, read.wheels) == ("RL", {})
    assert {wheel for wheel, _, _ in read.provenance["counted_from"]} == {""}
    for command in (("fit", two), ("fit", two, "--wheel", "FL"), ("report", two, "--wheel", "FL", *page)):
        result = invoke(*command, "--model", model)
        assert result.code == 2 and "the model is of another wheel" in result.err and str(model) in result.err
        assert "found: wheel FL" in result.err and "expected: RL" in result.err and "--wheel FL -o FILE" in result.err
    assert "extended" in ok("fit", two, "--wheel", "RL", "--model", model, "--json").json["models"]
    unnamed = invoke("fit", "recordings/clay", "--model", model)
    assert unnamed.code == 2 and "found: a wheel without an id" in unnamed.err and "remove `wheel`" in unnamed.err
    front = open_and_process([two], ProcessOptions(), Files(wheel="FL"))
    with pytest.raises(ConfigError, match="of another wheel"):
        fit_runs(front, FitChoices(extended=read), None)


def test_what_is_mended_at_one_wheel_is_held_against_its_errors_alone(
    two: Path, diagnosed: tuple[list[dict[str, Any]], Path], tmp_path: Path
) -> None:
    model, vehicle = diagnosed[1], tmp_path / "vehicle.toml"
    assert {wheel for wheel, _, _ in load_model(model).provenance["counted_from"]} == {"FL", "RL"}
    text = (two / "vehicle.toml").read_text(encoding="utf-8")
    for name in two.glob("*.dbc"):
        shutil.copy(name, tmp_path)
    front, own, rear = text.partition('id = "RL"')
    vehicle.write_text(front + own + rear.replace('zero = "lifted"', 'zero = "spin"'), encoding="utf-8")
    result = invoke("fit", two, "--vehicle", vehicle, "--wheel", "RL", "--model", model)
    assert result.code == 2 and "and [transducer] zero has changed" in result.err
    assert f"{vehicle}, wheel RL" in result.err and "found: spin" in result.err and "expected: lifted" in result.err
    assert (
        "extended" in ok("fit", two, "--vehicle", vehicle, "--wheel", "FL", "--model", model, "--json").json["models"]
    )


def test_an_effect_of_one_wheel_is_simulated_there() -> None:
    effects = {"torque_zero@RL": {"offset_nm": 300.0}, "drawbar_pull_zero": {"offset_n": 500.0}}
    options = SimulationOptions(runs=1, duration_s=15.0, wheels=2, effects=effects)
    at_wheels = [whole(simulated_stretches(options, 0, wheel)) for wheel in IDS]
    plain = [whole(simulated_stretches(replace(options, effects={}), 0, wheel)) for wheel in IDS]
    changes = [
        [
            float(np.median(run.sensors["transducer"][name].values - without.sensors["transducer"][name].values))
            for name in ("driving_torque", "drawbar_pull")
        ]
        for run, without in zip(at_wheels, plain, strict=True)
    ]
    assert changes == [pytest.approx([0.0, 500.0], abs=1.0), pytest.approx([300.0, 500.0], abs=1.0)]
    with pytest.raises(ConfigError, match="no wheel is called 'FR'"):
        replace(options, effects={"torque_zero@FR": {"offset_nm": 300.0}})


def test_a_diagnosis_names_the_wheel_above_it(two: Path) -> None:
    shown = ok("diagnose", two, *QUICK).out
    assert shown.startswith("wheel FL\n") and "\n\nwheel RL\n" in shown
    assert re.search(
        r"\n\nwheel FL +No cause is detected.*\nwheel RL +\S.*torque.*\nall wheels together +\S.*wheel RL.*\n$",
        shown,
        re.IGNORECASE | re.DOTALL,
    )
    assert "wheel rl" not in shown
    alone = ok("diagnose", two, *QUICK, "--wheel", "RL").out
    assert "all wheels together" not in alone


def test_a_command_of_one_wheel_asks_which(two: Path, tmp_path: Path) -> None:
    result = invoke("zero", two / "run-1.mcap", "-o", tmp_path / "z.toml")
    assert result.code == 2
    assert "FL, RL" in result.err and "--wheel FL" in result.err and "Traceback" not in result.err


def test_a_plan_asks_which(two: Path) -> None:
    result = invoke("diagnose", "--plan", two)
    assert result.code == 2 and "FL, RL" in result.err


@pytest.mark.skipif(sys.platform == "win32", reason="the logger needs a POSIX system")
def test_a_logged_recording_carries_all_wheels_and_their_zeros(two: Path, tmp_path: Path) -> None:
    text = (two / "vehicle.toml").read_text(encoding="utf-8")
    start, stop = text.index("[[bus]]"), text.index("[signals]")
    bus = '[[bus]]\nchannel = "wheels"\ninterface = "virtual"\n\n'
    front, rear = (
        (text[:start] + bus + text[stop:]).replace("can0:", "wheels:").replace("can1:", "wheels:").split('id = "RL"')
    )
    zeros = [
        part.replace('zero = "lifted"', f'zero_file = "zero-{name}.toml"')
        for part, name in ((front, "FL"), (rear, "RL"))
    ]
    own = zeros[1].replace("WFT_", "WFT2_")
    (tmp_path / "vehicle.toml").write_text('id = "RL"'.join([zeros[0], own]), encoding="utf-8")
    (tmp_path / "zero-RL.toml").write_text("", encoding="utf-8")
    with busy("wheels"):
        logged = ("log", tmp_path / "vehicle.toml", "--duration", 0.2, "-o", tmp_path / "run.mcap", "--no-page")
        result = ok(*logged)
    assert "zero-FL.toml does not exist yet" in result.err and "zero-RL.toml" not in result.err
    [run] = open_runs([tmp_path / "run.mcap"])
    assert run.vehicle.wheel_ids == IDS and "zero-RL.toml" in run.attachments


def test_python_asks_too(two: Path) -> None:
    with pytest.raises(ConfigError, match="--wheel FL"):
        process_runs(open_runs([two]), ProcessOptions())


def test_the_page_has_a_campaign_for_each_wheel(two: Path, tmp_path: Path) -> None:
    campaigns, remarks = open_campaigns([two], Files())
    assert [campaign.name for campaign in campaigns] == ["two, wheel FL", "two, wheel RL"] and not remarks
    [campaign], remarks = open_campaigns([two], Files(wheel="RL"))
    assert campaign.first.vehicle.transducer == campaign.first.for_wheel("RL").vehicle.transducer and not remarks
    _, rear = campaigns
    assert not rear.others, "the other wheel is in the same recording, which a saved choice must not switch off"
    rear.saved_at = tmp_path / "choice.toml"
    assert all("--wheel RL" in command for command in commands_of(rear, Files()))
    loose, _ = open_campaigns([two / "run-1.mcap"], Files())
    assert [wheel_id(campaign.first) for campaign in loose] == list(IDS)
    with pytest.raises(ConfigError, match="one zero file for several wheels"):
        open_campaigns([two], Files(zero=two / "zero.toml"))


def test_an_unknown_wheel_is_refused_with_the_known_ones(two: Path) -> None:
    for command in ("process", "fit", "sinkage", "diagnose"):
        result = invoke(command, two, "--wheel", "RX")
        assert result.code == 2
        assert "no wheel has the id 'RX'" in result.err and "RL" in result.err
    table = invoke("fit", "--table", "t.csv", "--wheel", "RL")
    assert table.code == 2 and "--where wheel=NAME" in table.err


def test_one_zero_file_is_not_for_several_wheels(two: Path, tmp_path: Path) -> None:
    (tmp_path / "zero.toml").write_text("", encoding="utf-8")
    result = invoke("process", two, "--zero", tmp_path / "zero.toml")
    assert result.code == 2 and "one zero file for several wheels" in result.err
    assert invoke("process", two, "--zero", tmp_path / "zero.toml", "--wheel", "FL", "--json").code == 0


def vehicle_beside(two: Path, folder: Path, before: str, after: str) -> Path:
    """Write a changed vehicle.toml with its DBCs."""
    for file in two.glob("*.dbc"):
        (folder / file.name).write_bytes(file.read_bytes())
    text = (two / "vehicle.toml").read_text(encoding="utf-8")
    assert before in text
    (folder / "vehicle.toml").write_text(text.replace(before, after), encoding="utf-8")
    return folder / "vehicle.toml"


def test_a_fault_of_one_wheel_leaves_the_others_their_result(two: Path, tmp_path: Path) -> None:
    vehicle = vehicle_beside(two, tmp_path, "can1:WFT_Moments.My", "can1:WFT_Moments.Mq")
    result = invoke("process", two, "--vehicle", vehicle, "--json")
    assert result.code == 2
    assert [entry["wheel"] for entry in result.json] == ["FL"]
    assert "no DBC has a signal 'WFT_Moments.Mq'" in result.err and "wheel RL" in result.err


def test_a_recording_of_one_wheel_is_not_taken_for_four(two: Path, campaign: Path) -> None:
    result = invoke("process", campaign / "run-1.mcap", "--vehicle", two / "vehicle.toml")
    assert result.code == 2
    assert "made with one [wheel]" in result.err and "--wheel FL" in result.err
    mixed = invoke("process", campaign, two)
    assert mixed.code == 2 and "different wheels" in mixed.err


def test_rut_readings_are_of_the_wheel_that_they_name(two: Path, tmp_path: Path) -> None:
    text = '[[run]]\nfile = "run-1.mcap"\nid = "run-1"\n'
    reading = "[[run.rut]]\ndepth_m = 0.05\nsigma_m = 0.005\ntime_s = 8.0\n"
    (tmp_path / "runs.toml").write_text(f'{text}\n{reading}wheel = "RL"\n', encoding="utf-8")
    files = Files(runs=tmp_path / "runs.toml")
    opened = files.runs_of_wheels([two], set_aside=lambda _: None)
    assert {wheel: len(run.info.rut) for wheel, [run] in opened.items()} == {"FL": 0, "RL": 1}
    (tmp_path / "runs.toml").write_text(f"{text}\n{reading}", encoding="utf-8")
    result = invoke("process", two, "--runs", tmp_path / "runs.toml")
    assert result.code == 2 and "does not say of which wheel" in result.err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"wheels": 3}, "number of instrumented wheels.*\n.*3"),
        ({"wheels": 2, "faulty_wheel": "RR"}, "no wheel is called 'RR'"),
        ({"faulty_wheel": "RL"}, "no wheel is called 'RL'(.|\n)*there is one wheel"),
        ({"wheels": 4, "rut": 3, "lifted": True}, "--rut and --lifted: simulated of one wheel only"),
        ({"wheels": 2, "faulty_wheel": "RL", "effects": {"lyasko": {}}}, "no error of measurement(.|\n)*torque_gain"),
        ({"wheels": 2, "faulty_wheel": "RL", "effects": {"body_pitch": {}}}, "body_pitch of one wheel.*and one body"),
    ],
)
def test_what_cannot_be_simulated_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        SimulationOptions(**given)


def test_the_command_of_a_simulation_has_its_wheels() -> None:
    command = SimulationOptions(wheels=4, faulty_wheel="FR", effects={"torque_gain": {"relative": 0.1}}).command
    assert "--wheels 4 --faulty-wheel FR" in command
    assert "--wheels" not in SimulationOptions().command
