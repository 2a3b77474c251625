"""Reports of runs that lack a speed or a force: the sentence says which, and what is there is drawn."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import invoke, ok
from report_support import text_of

from daq.runs import open_runs
from processing import LOOK, ProcessOptions
from wheelsoil.workflows import process_runs, report_of, report_of_processed
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.report import diagnosed_runs

OTHER_ROLES = [pytest.param(role, marks=pytest.mark.slow) for role in ("vertical_load", "drawbar_pull")]
SHOWN = ("wheel_speed", "ground_speed", "vertical_load", "drawbar_pull", "driving_torque")
OF_THE_FIT = {"fit", "verdict", "coefficients", "slip", "torque", "criteria", "sinkage", "load"}
OF_THE_DIAGNOSIS = {
    "answers",
    "causes",
    "misfit",
    "candidates",
    "evidence",
    "gain",
    "detectable",
    "next_run",
    "workings",
}
FIGURES = {
    "wheel_speed": {"shares", "time-dp", "time-t", "drive-speed", "drive-load", "track-use"},
    "ground_speed": {"shares", "time-dp", "time-t", "drive-speed", "drive-load", "track-use"},
    "vertical_load": {"shares", "time-dp", "time-t", "drive-speed", "drive-slip", "track-slip", "track-use"},
    "drawbar_pull": {"shares", "time-t", "drive-speed", "drive-slip", "drive-load", "track-slip", "track-use"},
}


def rewritten(campaign: Path, folder: Path, runs: int = 1, **signals: str) -> Path:
    """Return a copy of a campaign's first runs, some roles of which have another signal, or none ("")."""
    folder.mkdir()
    names = [f"run-{i + 1}.mcap" for i in range(runs)]
    for path in campaign.iterdir():
        if path.suffix in (".dbc", ".toml") or path.name in names:
            (folder / path.name).write_bytes(path.read_bytes())
    vehicle = (folder / "vehicle.toml").read_text()
    for role, signal in signals.items():
        vehicle = re.sub(rf"(?m)^{role} = .*\n", f'{role} = "{signal}"\n' if signal else "", vehicle)
    (folder / "vehicle.toml").write_text(vehicle)
    entries = [f'[[run]]\nfile = "{name}"\nid = "{name[:-5]}"\n' for name in names]
    (folder / "runs.toml").write_text("\n".join(entries))
    return folder


def reported(folder: Path, page: Path, *options: str) -> tuple[dict[str, Any], str]:
    """Return the numbers of a report and its page's text; without a result its exit code is 1, and it is written."""
    found = invoke("report", folder, "-o", page, "--json", *options)
    numbers = found.json["numbers"]
    assert found.code == ("verdict" in json.loads(Path(numbers).read_text(encoding="utf-8"))["left_out"])
    return json.loads(Path(numbers).read_text(encoding="utf-8")), unescape(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("role", [role for role in SHOWN if role != "driving_torque"])
def test_what_is_missing_is_said_and_what_is_there_is_drawn(campaign, tmp_path, role):
    numbers, page = reported(rewritten(campaign, tmp_path / "c", **{role: ""}), tmp_path / "r.html")
    why = f"{role} is missing; name it under [signals] of vehicle.toml"
    assert numbers["left_out"] == dict.fromkeys(OF_THE_FIT | OF_THE_DIAGNOSIS, why)
    assert page.count(f"Omitted: {why}.") == len(numbers["left_out"])
    glance = numbers["sections"]["glance"]
    assert glance["sentence"] == f"No result: {why}." and glance["sentence"] in page
    assert glance["grades"]["run-1"]["level"] == "poor" and glance["grades"]["run-1"]["reasons"][0] == why
    assert set(numbers["figures"]) == FIGURES[role]
    for figure in numbers["figures"].values():
        assert any(value is not None for trace in figure["traces"] for value in trace["x"])
    quality = numbers["sections"]["quality"]["run-1"]
    assert quality["quality"]["missing"] == {role: why}
    assert (quality["used_share"] > 0) == (role in ("vertical_load", "drawbar_pull"))
    assert role not in numbers["sections"]["sensors"]["channels"]
    assert set(SHOWN) - {role} <= set(numbers["sections"]["sensors"]["channels"])
    assert numbers["sections"]["provenance"]["files"][0]["sha256"][:16] in page


def test_a_torque_that_is_missing_costs_the_torque(campaign, tmp_path):
    numbers, _ = reported(rewritten(campaign, tmp_path / "c", driving_torque=""), tmp_path / "r.html", "--no-diagnosis")
    assert numbers["left_out"] == {"torque": "the driving torque was not measured"}
    assert numbers["sections"]["glance"]["grades"]["run-1"]["level"] != "poor"


def test_a_signal_that_never_came_is_missing_too(campaign, tmp_path):
    folder = rewritten(campaign, tmp_path / "c", wheel_speed="Silent.Speed")
    with (folder / "wheel_speed.dbc").open("a") as dbc:
        dbc.write('\nBO_ 1999 Silent: 8 Vector__XXX\n SG_ Speed : 0|16@1+ (0.01,0) [0|650] "rad/s" Vector__XXX\n')
    numbers, _ = reported(folder, tmp_path / "r.html", "--no-diagnosis")
    why = "wheel_speed is missing; Silent.Speed holds no sample: check that its frames were recorded (wheelsoil info)"
    assert numbers["left_out"] == dict.fromkeys(OF_THE_FIT, why)
    assert numbers["sections"]["glance"]["sentence"] == f"No result: {why}."


@pytest.mark.parametrize("command", ["process", "fit", "diagnose"])
def test_who_calculates_still_asks_for_it(campaign, tmp_path, command):
    result = invoke(command, rewritten(campaign, tmp_path / "c", wheel_speed=""))
    assert result.code == 2 and "no signal has the role 'wheel_speed'" in result.err


@pytest.mark.parametrize("role", [pytest.param("ground_speed", marks=pytest.mark.slow), *OTHER_ROLES])
def test_a_run_that_lacks_a_signal_leaves_the_others_their_fit(campaign, tmp_path, role):
    folder = rewritten(campaign, tmp_path / "c", runs=2)
    whole = report_of([folder / "run-2.mcap"], diagnose=False).numbers()
    runs = process_runs(open_runs([folder]), ProcessOptions())
    poor = rewritten(campaign, tmp_path / "d", **{role: ""})
    lacking = process_runs(open_runs([poor]), ProcessOptions(purpose=LOOK))
    mixed = [lacking[0], runs[1]]
    found = diagnosed_runs([folder], mixed, FitChoices(), None)
    report = report_of_processed(mixed, FitChoices(), ProcessOptions(), diagnosed=found)
    assert report.not_fitted == "run-1"
    numbers = report.numbers()
    assert numbers["left_out"] == {}
    assert numbers["not_fitted"] == "run-1"
    criteria, alone = (one["sections"]["criteria"]["models"]["lyasko"] for one in (numbers, whole))
    assert criteria["coefficients"] == pytest.approx(alone["coefficients"], rel=1e-6)
    glance = numbers["sections"]["glance"]
    assert not glance["sentence"].startswith("No result")
    assert {run: grade["level"] for run, grade in glance["grades"].items()}["run-1"] == "poor"


@pytest.mark.parametrize("role", ["ground_speed", *OTHER_ROLES])
def test_figures_of_the_models_hold_the_fitted_runs_only_and_say_so(campaign, tmp_path, role):
    folder = rewritten(campaign, tmp_path / "c", runs=2)
    [_, whole] = process_runs(open_runs([folder]), ProcessOptions())
    [(run, poor)] = process_runs(
        open_runs([rewritten(campaign, tmp_path / "d", **{role: ""})]), ProcessOptions(purpose=LOOK)
    )
    off = replace(poor, drawbar_pull_n=poor.drawbar_pull_n + 3000.0)
    report = report_of_processed([(run, off), whole], FitChoices(), ProcessOptions())
    mixed, alone = (one.numbers() for one in (report, report_of_processed([whole], FitChoices(), ProcessOptions())))
    for key in (key for key in alone["figures"] if key.startswith(("slip-", "torque-", "sinkage", "load"))):
        traces = zip(mixed["figures"][key]["traces"], alone["figures"][key]["traces"], strict=True)
        for ours, theirs in traces:
            for axis in set("xyz") & set(theirs):
                assert np.array(ours[axis], float) == pytest.approx(np.array(theirs[axis], float), nan_ok=True)
    assert mixed["sections"]["verdict"]["sentence"] == alone["sections"]["verdict"]["sentence"]
    assert f"excluded from the fit, for want of a signal: run-1 ({role})." in text_of(report, "verdict")
    assert "only the blue part is fitted, and nothing of run-1" in text_of(report, "quality")
    assert "Not included because a signal is missing: run-1." in text_of(report, "slip")
    names = [trace["name"] for trace in mixed["figures"]["time-t"]["traces"] if trace["shown_for"] == "run-1"]
    assert ("measured" in names) == (role != "ground_speed") and "Lyasko" not in names
    assert "run-1" in mixed["figures"]["shares"]["traces"][0]["y"]
    assert "run-1" in {trace["shown_for"] for trace in mixed["figures"]["drive-speed"]["traces"]}


def test_the_terminal_tells_what_was_not_fitted(campaign, tmp_path):
    whole = rewritten(campaign, tmp_path / "c", runs=2)
    poor = rewritten(campaign, tmp_path / "d", ground_speed="")
    page = ("-o", tmp_path / "r.html", "--no-diagnosis", "--json")
    shown = ok("report", poor / "run-1.mcap", whole / "run-2.mcap", *page)
    assert "not fitted because a signal is missing (the page names it): run-1" in shown.err
    assert shown.json["not_fitted"] == "run-1"
    alone = invoke("report", poor, *page, "--force")
    assert alone.code == 1 and "no result: ground_speed is missing; name it under [signals]" in alone.json["result"]
    assert "not fitted" not in alone.err and alone.json["not_fitted"] == ""


def test_runs_that_lack_different_signals_are_named(campaign, tmp_path):
    roles = ("wheel_speed", "drawbar_pull", "drawbar_pull")
    runs = []
    for number, role in enumerate(roles, 1):
        folder = rewritten(campaign, tmp_path / f"c{number}", vertical_load="", **{role: ""})
        [(run, lacking)] = process_runs(open_runs([folder]), ProcessOptions(purpose=LOOK))
        runs.append((run, replace(lacking, run=lacking.run.model_copy(update={"id": f"run-{number}"}))))
    step = "name it under [signals] of vehicle.toml"
    found = diagnosed_runs([tmp_path], runs, FitChoices(), None)
    assert found.why_not == (
        f"vertical_load is missing; {step}, and run-1: wheel_speed is missing; {step}, "
        f"and run-2, run-3: drawbar_pull is missing; {step}"
    )
    glance = report_of_processed(runs, FitChoices(), ProcessOptions()).numbers()["sections"]["glance"]
    assert glance["sentence"] == f"No result: {found.why_not}."
    alone = report_of_processed(runs[:1], FitChoices(), ProcessOptions()).numbers()["sections"]["glance"]
    assert "run-1" not in alone["sentence"]
