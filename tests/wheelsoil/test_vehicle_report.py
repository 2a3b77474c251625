"""The vehicle's page: sums, efficiency, load transfer and slip of all wheels, and a verdict with a report of each."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from cli_support import Result, invoke, ok
from diagnosis_samples import diagnosis
from report_support import diagnosed_by_hand
from shared_results import made_once

from daq import ConfigError, DataError, Fault, FloatArray, Note
from model import LackCode
from model.simulation import whole
from processing import LOOK, ProcessedRun, ProcessOptions, Reason
from wheelsoil.cli.per_wheel import PerWheel
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.vehicle import verdict_of_all
from wheelsoil.simulation import SimulationOptions, simulate_campaign
from wheelsoil.simulation.campaign import setup_of_wheel, simulated_stretches
from wheelsoil.wording.figures import figure_value
from wheelsoil.wording.verdict import headline_of
from wheelsoil.workflows import Diagnosed, Files, process_runs
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.last_report import load_last
from wheelsoil.workflows.report import WheelReport
from wheelsoil.workflows.traction import highest
from wheelsoil.workflows.vehicle import Place, Vehicle, doubts_of_wheels, figures_of_vehicle, vehicle_of

IDS = ("FL", "FR", "RL", "RR")
OPTIONS = SimulationOptions(
    soil="sandy", runs=2, duration_s=30.0, wheels=4, noise=0.5, added_load_kg=(0.0, 300.0), seed=3
)


@pytest.fixture(scope="module")
def four(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of two runs with four wheels. Not to be written to."""
    return (
        made_once(tmp_path_factory, "four_wheels", lambda folder: simulate_campaign(folder / "four", OPTIONS)) / "four"
    )


@pytest.fixture(scope="module")
def processed(four: Path) -> dict[str, Processed]:
    opened = Files().runs_of_wheels([four], set_aside=lambda _: None)
    return {wheel: process_runs(runs, ProcessOptions(purpose=LOOK)) for wheel, runs in opened.items()}


@pytest.fixture(scope="module")
def vehicle(processed: dict[str, Processed]) -> Vehicle:
    return vehicle_of(processed)


def changed(runs: Processed, change: Callable[[ProcessedRun], ProcessedRun]) -> Processed:
    return [(run, change(done)) for run, done in runs]


@pytest.mark.parametrize(("late_s", "said"), [(0.3, "0.30 s later"), (-0.2, "0.20 s earlier")])
def test_a_wheel_on_another_clock_is_said(processed: dict[str, Processed], late_s: float, said: str) -> None:
    assert doubts_of_wheels(processed) == [], "sound wheels"
    late = changed(processed["RL"], lambda run: replace(run, start_ns=run.start_ns + round(late_s * 1e9)))
    [doubt] = doubts_of_wheels(processed | {"RL": late})
    assert f"the speed of wheel RL comes {said} than that of wheel FL" in doubt.what and "--apart" in doubt.next_step


def test_a_transducer_on_another_clock_is_said(processed: dict[str, Processed]) -> None:
    """Its bus has a clock of its own, the wheel speeds have one."""
    late = changed(processed["RL"], lambda run: replace(run, driving_torque_nm=np.roll(run.driving_torque_nm, 30)))
    [doubt] = doubts_of_wheels(processed | {"RL": late})
    assert re.fullmatch(r"the torque of wheel RL comes 0\.(29|30|31) s later than that of wheel FL", doubt.what)
    assert "latency_s of driving_torque" in doubt.next_step
    nothing = changed(late, lambda run: replace(run, driving_torque_nm=np.full(len(run), np.nan)))
    assert doubts_of_wheels(processed | {"RL": nothing}) == [], "a torque that is not measured has no time"


def test_fit_and_process_say_the_doubts_too(
    processed: dict[str, Processed], capsys: pytest.CaptureFixture[str]
) -> None:
    per_wheel = PerWheel({"FL": [], "RL": []}, json=False)
    late = changed(processed["RL"], lambda run: replace(run, start_ns=run.start_ns + 300_000_000))
    per_wheel.doubt({"FL": processed["FL"], "RL": late, "RR": []})
    assert "the speed of wheel RL comes 0.30 s later" in capsys.readouterr().err and len(per_wheel.doubts) == 1
    per_wheel.doubt({"FL": processed["FL"], "RR": []})
    assert per_wheel.doubts == (), "one wheel alone is not late"


def test_a_doubt_stands_in_the_json_of_all_wheels_together(capsys: pytest.CaptureFixture[str]) -> None:
    per_wheel = PerWheel({"FL": [], "FR": []}, json=True)

    def together() -> None:
        per_wheel.doubts = [Fault("FL is late", expected="one clock", next_step="check it")]
        per_wheel.show(dict, lambda: None)

    per_wheel.each(lambda _: per_wheel.show(dict, lambda: None), together)
    *own, of_all = json.loads(capsys.readouterr().out)
    assert own == [{"wheel": "FL"}, {"wheel": "FR"}] and of_all["doubts"][0]["what"] == "FL is late"


def test_the_texts_of_wheels_stand_apart(capsys: pytest.CaptureFixture[str]) -> None:
    per_wheel = PerWheel({"FL": [], "FR": []}, json=False)
    per_wheel.each(lambda _: per_wheel.show(dict, lambda: print("text"), "sentence"))
    assert capsys.readouterr().out.startswith("wheel FL\ntext\n\nwheel FR\ntext\n\n")


def test_wheels_that_are_exchanged_are_said(processed: dict[str, Processed]) -> None:
    """In a curve to the left, half a metre inside and outside of it."""
    rng = np.random.default_rng(2)
    curves = {run.id: 0.2 * np.sin(0.5 * done.time_s) for run, done in processed["FL"]}

    def in_curves(wheel: str, side_m: float) -> Processed:
        found = []
        for run, done in processed[wheel]:
            curve = np.resize(curves[run.id], len(done))
            speed = done.wheel_speed_radps - curve * side_m / 0.47 + 0.02 * rng.standard_normal(len(done))
            found.append((run, replace(done, wheel_speed_radps=speed, extras={"yaw_rate_radps": curve})))
        return found

    left, right = (in_curves("FL", side_m) for side_m in (0.5, -0.5))
    others = {"RL": processed["RL"], "RR": processed["RR"]}
    config = dict(zip(("FL", "FR"), ([run for run, _ in processed[wheel]] for wheel in ("FL", "FR")), strict=True))

    def as_wheel(name: str, runs: Processed) -> Processed:
        return [(run, done) for run, (_, done) in zip(config[name], runs, strict=True)]

    sound = {"FL": as_wheel("FL", left), "FR": as_wheel("FR", right)} | others
    assert doubts_of_wheels(sound) == []
    wrong = {"FL": as_wheel("FL", right), "FR": as_wheel("FR", left)} | others
    [doubt] = doubts_of_wheels(wrong)
    assert doubt.what == "in curves to the left wheel FL rolls faster than wheel FR"

    def mostly_excluded(run: Any, done: ProcessedRun) -> tuple[Any, ProcessedRun]:
        out = np.arange(len(done)) % 8 != 0
        speed = done.wheel_speed_radps - np.where(out, 5.0 * done.extras["yaw_rate_radps"], 0.0)
        return run, replace(done, wheel_speed_radps=speed, reason=np.where(out, Reason.GAP, done.reason))

    assert doubts_of_wheels(sound | {"FR": [mostly_excluded(*each) for each in sound["FR"]]}) == []


@pytest.fixture(scope="module")
def truth(vehicle: Vehicle) -> dict[str, FloatArray]:
    """Return the true histories at the vehicle's samples, each of shape (wheels, n)."""
    runs = [[whole(simulated_stretches(OPTIONS, i, wheel)).truth for wheel in IDS] for i in range(OPTIONS.runs)]

    def at_samples(name: str) -> FloatArray:
        pieces = [
            [np.interp(vehicle.time_s[vehicle.run == i], wheel.time_s, getattr(wheel, name)) for wheel in wheels]
            for i, wheels in enumerate(runs)
        ]
        return np.concatenate(pieces, axis=1)

    names = ("slip", "drawbar_pull_n", "vertical_load_n", "driving_torque_nm", "ground_speed_mps", "wheel_speed_radps")
    return {name: at_samples(name) for name in names}


def test_the_record_is_aligned_and_of_the_samples_that_all_wheels_use(vehicle: Vehicle) -> None:
    assert list(vehicle.places) == list(IDS) and vehicle.runs == ("run-1", "run-2")
    assert vehicle.places["RR"] == Place(2, "right", "rear right")
    assert vehicle.share > 0.95 and vehicle.slip.shape == (4, len(vehicle.time_s))
    assert np.isfinite(vehicle.slip).all() and np.ptp(vehicle.slip, axis=0)[vehicle.mean_slip > 0.3].max() < 0.05


def test_sums_and_efficiency_are_those_of_the_simulation(vehicle: Vehicle, truth: dict[str, FloatArray]) -> None:
    found = figures_of_vehicle(vehicle)
    slip, pull, load = (truth["slip"].mean(0), truth["drawbar_pull_n"].sum(0), truth["vertical_load_n"].sum(0))
    output = (truth["drawbar_pull_n"] * truth["ground_speed_mps"]).sum(0)
    given = (truth["driving_torque_nm"] * truth["wheel_speed_radps"]).sum(0)
    near = np.abs(slip - 0.2) < 0.1

    def at(values: FloatArray) -> float:
        return float(np.polyval(np.polyfit(slip[near], values[near], 3), 0.2))

    name = "vehicle.{}_at_mean_slip_0.2".format
    assert found[name("pull")].value == pytest.approx(at(pull), rel=0.01)
    assert found[name("load")].value == pytest.approx(load[near].mean(), rel=0.003)
    assert found[name("drawbar_coefficient")].value == pytest.approx(at(pull) / load[near].mean(), rel=0.01)
    assert found[name("tractive_efficiency")].value == pytest.approx(at(output) / at(given), rel=0.01)
    assert found["vehicle.tractive_efficiency"].value == pytest.approx(highest(slip, output / given)[0], rel=0.05)


def test_the_load_transfer_is_that_of_the_simulated_vehicle(vehicle: Vehicle) -> None:
    of_vehicle = setup_of_wheel(OPTIONS, "FL").vehicle
    mass_kg = of_vehicle.mass_kg + 150.0
    expected = mass_kg * of_vehicle.centre_of_gravity_height_m / of_vehicle.wheelbase_m
    assert vehicle.transfer is not None
    moved, (low, high) = vehicle.transfer["acceleration"]
    assert moved == pytest.approx(expected, rel=0.08) and low < moved < high < 1.2 * low
    assert abs(vehicle.transfer["pull"][0]) < 0.01, "the simulated hitch is level with the axles"


def test_the_wheels_add_up_to_the_vehicle(vehicle: Vehicle) -> None:
    found = figures_of_vehicle(vehicle)
    for name in ("pull", "load"):
        parts = sum(found[f"wheel.{wheel}.{name}_at_mean_slip_0.2"].value for wheel in IDS)
        assert parts == pytest.approx(found[f"vehicle.{name}_at_mean_slip_0.2"].value, rel=1e-9)


def by_hand(places: dict[str, Place], slip: FloatArray, **changed: object) -> Vehicle:
    """Return a vehicle whose wheels have the given slips, shape (wheels, n), at 100 samples a second."""
    n = slip.shape[1]
    ones = np.ones_like(slip)
    columns = {"drawbar_pull_n": 1e3 * slip, "vertical_load_n": 5e3 * ones, "output_w": slip, "input_w": ones}
    columns["slip_sigma"] = 1e-3 * ones
    times = {"run": np.zeros(n, int), "time_s": np.arange(n) / 100, "acceleration_mps2": np.sin(np.arange(n) / 99)}
    return Vehicle(places=places, runs=("a",), share=1.0, slip=slip, **{**columns, **times, **changed})  # type: ignore[arg-type]


FRONT_LEFT, FRONT_RIGHT, REAR_LEFT = (Place(1, "left"), Place(1, "right"), Place(2, "left"))


def test_slips_are_compared_where_two_wheels_face_each_other() -> None:
    base = np.linspace(0.05, 0.4, 4000)
    three = by_hand({"A": FRONT_LEFT, "B": FRONT_RIGHT, "C": REAR_LEFT}, np.stack([base + 0.02, base, base - 0.01]))
    differences = three.slip_differences
    assert differences["left_right"] == pytest.approx(0.02) and differences["front_rear"] == pytest.approx(0.03)
    found = figures_of_vehicle(three)
    assert figure_value(found["vehicle.slip_left_right"]) == "0.020"
    across = by_hand({"B": FRONT_RIGHT, "C": REAR_LEFT}, np.stack([base, base]))
    assert not across.slip_differences and across.transfer is not None


def test_the_highest_efficiency_is_where_slip_exceeds_twice_its_error() -> None:
    """Where slip is hardly more than its error, efficiencies above 100 % were the highest."""
    slip = np.tile(np.linspace(0.01, 0.5, 4000), (2, 1))
    output = np.where(slip < 0.05, 1.3, 0.6 - slip)
    of_one_error = by_hand(
        {"A": FRONT_LEFT, "B": FRONT_RIGHT}, slip, output_w=output, slip_sigma=np.full_like(slip, 0.03)
    )
    highest = figures_of_vehicle(of_one_error)["vehicle.tractive_efficiency"].value
    assert highest == pytest.approx(0.52, abs=0.02)
    sure = replace(of_one_error, slip_sigma=np.full_like(slip, 1e-4))
    assert figures_of_vehicle(sure)["vehicle.tractive_efficiency"].value == pytest.approx(1.3)


def test_a_quantity_that_is_not_there_is_no_figure() -> None:
    base = np.linspace(0.3, 0.6, 4000)
    one_axle = by_hand({"A": FRONT_LEFT, "B": FRONT_RIGHT}, np.stack([base, base]), input_w=np.full((2, 4000), np.nan))
    found = figures_of_vehicle(one_axle)
    assert one_axle.transfer is None and not any("transfer" in key or "efficiency" in key for key in found)
    rigid = by_hand({"A": FRONT_LEFT, "C": REAR_LEFT}, np.stack([base, base]), acceleration_mps2=base)
    assert rigid.transfer is None, "pull and acceleration go together"


def test_wheels_without_a_common_sample_are_no_vehicle(four: Path) -> None:
    opened = Files().runs_of_wheels([four], set_aside=lambda _: None)
    processed = {wheel: process_runs(opened[wheel], ProcessOptions(purpose=LOOK)) for wheel in ("FL", "RL")}
    [first, second] = processed["RL"]
    with pytest.raises(DataError, match="at no time are the samples of all wheels used"):
        vehicle_of({"FL": processed["FL"][:1], "RL": [second]})
    alone = vehicle_of({"FL": processed["FL"], "RL": [first]})
    assert alone.runs == ("run-1",)
    counted_anew = replace(first[1], start_ns=first[1].start_ns + 10**9, time_s=first[1].time_s - 1.0)
    same = vehicle_of({"FL": processed["FL"], "RL": [(first[0], counted_anew)]})
    np.testing.assert_array_equal(same.slip, alone.slip, "times are those of the clock, not of the run")


@pytest.fixture(scope="module")
def reported(four: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Result, Path]]:
    """Write all pages, with the diagnosis of the last wheel made by hand."""
    made = [diagnosis("nothing_detectable")] * 3 + [diagnosis("named")]
    folder = tmp_path_factory.mktemp("vehicle")
    with patch("wheelsoil.workflows.report.diagnose_campaigns", side_effect=made):
        yield ok("report", four, "-o", folder / "report.html", "--no-cache"), folder


def test_each_wheel_has_a_report_and_the_vehicle_a_page_that_leads_to_them(reported: tuple[Result, Path]) -> None:
    result, folder = reported
    names = {path.name for path in folder.iterdir()}
    assert names == {f"report{part}.{kind}" for part in ("", *(f"-{w}" for w in IDS)) for kind in ("html", "json")}
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<dt><a href="([^"]+)">', page) == [f"report-{wheel}.html" for wheel in IDS]
    assert 'id="plot-' not in page and 'href="#appendix"' not in page, "all of its figures are drawings"
    of_one = (folder / "report-FL.html").read_text(encoding="utf-8")
    assert "Of wheel FL alone: if others are instrumented, all decide (wheelsoil report FOLDER)." in of_one
    headline = re.search(r"<h1>(.*?)</h1>", page)
    assert headline is not None and headline[1] == "RR: slip sinkage; FL, FR and RL: no cause is detected."
    assert re.search("wheel RR +Slip sinkage", result.out) and str(folder / "report-RR.html") in result.out


def test_page_json_and_terminal_have_the_same_numbers(reported: tuple[Result, Path], vehicle: Vehicle) -> None:
    result, folder = reported
    numbers = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert numbers["schema"] == "wheelsoil/vehicle/1" and [entry["wheel"] for entry in numbers["wheels"]] == list(IDS)
    assert numbers["wheels"][3] == {
        "wheel": "RR",
        "report": "report-RR.html",
        "numbers": "report-RR.json",
        "verdict": "named",
        "headline": headline_of(diagnosis("named")),
        "failed": [],
    }
    page = (folder / "report.html").read_text(encoding="utf-8")
    on_page = dict(re.findall(r'data-key="([^"]+)" data-value="([^"]+)"', page))
    in_json = numbers["sections"]["glance"]["key_figures"]
    found = figures_of_vehicle(vehicle)
    assert set(on_page) == set(found)
    for key, figure in found.items():
        assert in_json[key]["value"] == pytest.approx(figure.value, rel=1e-12)
        assert float(on_page[key]) == figure.value
    pull = figure_value(found["vehicle.pull_at_mean_slip_0.2"])
    assert pull in result.out and "Of the instrumented wheels" in result.out
    scales = {
        tuple(re.findall(r'class="tick"[^>]*>([^<]+)<', part))
        for part in re.findall(r'id="drawing-pull-.*?</svg>', page, re.S)
    }
    assert len(scales) == 1, "wheels side by side have one scale"


def test_the_json_of_the_command_lists_the_wheels(four: Path, tmp_path: Path) -> None:
    found = ok("report", four, "-o", tmp_path / "r.html", "--no-diagnosis", "--json").json
    assert [entry["wheel"] for entry in found["wheels"]] == list(IDS) and found["doubts"] == []
    assert found["report"].endswith("r.html") and found["wheels"][0]["numbers"].endswith("r-FL.json")
    assert found["vehicle"]["vehicle.pull_at_mean_slip_0.2"]["unit"] == "N"
    assert invoke("report", four, "-o", tmp_path / "new.html", "--no-diagnosis", "--wheel", "RL").code == 0
    assert {path.name for path in tmp_path.glob("new*")} == {"new.html", "new.json"}, "of one wheel as ever"
    (tmp_path / "r.html").unlink()
    (tmp_path / "r.json").unlink()
    again = invoke("report", four, "-o", tmp_path / "r.html", "--no-diagnosis")
    assert again.code == 2 and "r-FL.html" in again.err, "no report is replaced unasked"


def test_a_wheel_that_is_not_diagnosed_is_not_diagnosed_with_the_others(four: Path) -> None:
    nothing = diagnosis("nothing_detectable")
    answers = [nothing, DataError.of("nothing to go by"), nothing, nothing, diagnosis("named")]
    with patch("wheelsoil.workflows.diagnosis.diagnose_campaigns", side_effect=answers) as asked:
        result = invoke("diagnose", four, "--json")
    assert "a wheel without a result is not among all wheels together" in result.err and result.code == 1
    campaigns, _ = asked.call_args.args
    assert [campaign.name for campaign in campaigns] == ["wheel FL", "wheel RL", "wheel RR"]


def test_a_joint_diagnosis_takes_the_headline() -> None:
    joint = diagnosis("named")
    alone = [WheelReport("FL", diagnosed=Diagnosed(diagnosis("nothing_detectable"))), WheelReport("FR")]
    headline, details = verdict_of_all(joint, alone)
    assert headline == headline_of(joint) and details[0] == "All wheels together, on one soil."
    assert details[-1] == "Another verdict alone: FL; all together know more, so this page holds."
    at_another = replace(joint, causes=(replace(joint.causes[0], name="torque_gain@FR"),))
    assert "another verdict" not in " ".join(verdict_of_all(at_another, alone)[1])
    assert verdict_of_all(None, alone)[0] == "FL: no cause is detected; FR: not diagnosed."


def test_the_page_says_what_to_do_at_the_wheel_of_the_fault(four: Path, tmp_path: Path) -> None:
    """Every doubt about the wheels, then the step that removes the cause, with its wheel; the cause as numbers."""
    doubts = [
        Fault(f"wheel {name} is late", expected="one clock", next_step="check it; until then wait") for name in IDS
    ]
    joint = diagnosis("named")
    [cause, *_] = joint.causes
    at_wheel = replace(cause, name="torque_gain@FR", key="torque_gain@FR", kind="measurement", form="")
    one_load = Note(LackCode.ONE_LOAD, values={"spread": 0.051, "least": 0.08})
    wanting = {"load_gain@FL": one_load, "load_zero@FL": one_load}
    answers = [*[diagnosis("nothing_detectable")] * 4, replace(joint, causes=(at_wheel,), not_identifiable=wanting)]
    with (
        patch("wheelsoil.workflows.report.diagnose_campaigns", side_effect=answers),
        patch("wheelsoil.workflows.vehicle.doubts_of_wheels", return_value=doubts[1:3]),
    ):
        result = ok("report", four, "-o", tmp_path / "r.html")
    assert re.search("all wheels together +Torque gain of wheel FR", result.out)
    card = (tmp_path / "r.html").read_text(encoding="utf-8").split("<h3>Do next</h3>")[1]
    assert card.split("</ol>")[0].startswith('<p class="again"><b>Runs to repeat:</b> none. All runs are usable.</p>')
    assert "<b>Check it; until then wait.</b><span>Wheel FR is late; expected one clock.</span>" in card
    assert '<li data-n="3"><b>At wheel FR: calibrate the driving torque' in card
    glance = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["sections"]["glance"]
    assert glance["steps"][2]["what"].startswith("At wheel FR: calibrate the driving torque")
    assert glance["doubts"] == [{"where": "", "found": "", **vars(doubt)} for doubt in doubts[1:3]]
    notes = re.findall(r'<div class="n">([^<]*)</div>', (tmp_path / "r.html").read_text(encoding="utf-8"))[:3]
    assert [note.rpartition("; ")[2] == "not corrected for torque gain of wheel FR" for note in notes] == [
        False,
        False,
        True,
    ]
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "Not identifiable from these runs: load gain of wheel FL and load zero of wheel FL." in page
    assert "Load gain of wheel FL and load zero of wheel FL are not identifiable from these runs: " in page
    [found] = glance["together"]["causes"]
    assert (found["wheel"], found["name"]) == ("FR", "torque_gain")


def test_what_is_wrong_with_a_wheel_stands_in_its_line(four: Path, tmp_path: Path) -> None:
    def drive_again(inputs: ReportInputs, place: str = "under Runs") -> str:
        again = {"RL": f"run-2; the reasons stand {place}."}
        return again.get(" ".join(inputs.vehicle.wheel_ids), "none. All runs are usable.")

    for file in four.glob("*.dbc"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    text = (four / "vehicle.toml").read_text(encoding="utf-8")
    broken = tmp_path / "vehicle.toml"
    broken.write_text(text.replace("can3:WFT_Moments.My", "can3:WFT_Moments.Mq"), encoding="utf-8")
    page = tmp_path / "r.html"
    with (
        diagnosed_by_hand(diagnosis("nothing_detectable")),
        patch("wheelsoil.report.sections.glance.runs_again", drive_again),
    ):
        result = invoke("report", four, "--vehicle", broken, "-o", page)
    assert result.code == 2 and "no DBC has a signal 'WFT_Moments.Mq'" in result.err
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert [bool(entry["report"]) for entry in numbers["wheels"]] == [True, True, True, False]
    assert numbers["wheels"][3]["headline"] == "No report: no DBC has a signal 'WFT_Moments.Mq'."
    assert "instrumented wheels FL, FR and RL" in page.read_text(encoding="utf-8")
    assert "3 of 4 wheels diagnosed" in page.read_text(encoding="utf-8")
    drive = "FL and FR: none. All runs are usable. RL: run-2; the reasons stand in the report under Runs."
    assert drive in numbers["texts"]["glance"]


def test_a_fault_in_a_diagnosis_leaves_the_other_wheels_and_ends_with_1(four: Path, tmp_path: Path) -> None:
    answers = [*[diagnosis("named")] * 3, RuntimeError("x"), diagnosis("named")]
    with patch("wheelsoil.workflows.report.diagnose_campaigns", side_effect=answers):
        result = invoke("report", four, "-o", tmp_path / "r.html")
    assert result.code == 1 and re.search("wheel RR +Not diagnosed: a fault in the diagnosis", result.out)
    assert (tmp_path / "r-RR.html").is_file()


def test_the_last_report_of_a_vehicle_is_that_of_the_wheel(reported: tuple[Result, Path]) -> None:
    _, folder = reported
    assert load_last(folder / "report.json", "RR").name == "report-RR.json"
    assert load_last(folder, "FL").name == "report-FL.json"
    for wheel in ("", "XX"):
        with pytest.raises(ConfigError, match="of all wheels of a vehicle"):
            load_last(folder / "report.json", wheel)
