"""What the analyst's page answers, asked over HTTP, against what the command line and the model say."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from cli_support import ok
from view_client import View, taken_from
from view_in_process import viewing_here

from model.effects import EFFECTS
from model.wheel_soil import SOIL_PARAMETERS, WheelSoilModel
from processing import ProcessedRun, ProcessOptions
from wheelsoil.view.curve import SLIPS, Base
from wheelsoil.wording.grounds_text import verdict_words
from wheelsoil.workflows import known_soil, load_choice, open_and_process, wheel_of

ROOT = Path(__file__).parents[2]
ARRAYS = (
    "time_s",
    "slip",
    "drawbar_pull_n",
    "driving_torque_nm",
    "vertical_load_n",
    "ground_speed_mps",
    "rim_speed_mps",
    "distance_m",
    "used",
    "reason",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(ROOT / "recordings" / "clay", tmp_path_factory.mktemp("view") / "clay", 3)


@pytest.fixture(autouse=True)
def _nothing_chosen(view: View) -> Iterator[None]:
    yield
    view.post("/api/choose", campaign="c1", choice={})
    view.settled()


@pytest.fixture(scope="module")
def processed(folder: Path) -> list[ProcessedRun]:
    return [run for _, run in open_and_process([folder], ProcessOptions())]


def test_the_list_names_every_run_with_its_quality(view: View, processed: list[ProcessedRun]) -> None:
    [campaign] = view.campaigns()
    assert campaign["name"] == "clay" and campaign["terrain"] == "clay"
    assert campaign["wheel"] == {"radius_m": 0.47, "width_m": 0.318}
    assert campaign["diagnosis"] == {
        "state": "none",
        "share": 0.0,
        "left_s": None,
        "verdict": None,
        "sentence": None,
        "why": None,
    }
    assert campaign["choice"] == {"schema": "wheelsoil/choice/1"} and campaign["saved_at"] is None
    assert [run["id"] for run in campaign["runs"]] == ["run-1", "run-2", "run-3"]
    for entry, run in zip(campaign["runs"], processed, strict=True):
        assert entry["state"] == "ready" and entry["why"] is None and entry["use"]
        assert entry["duration_s"] == pytest.approx(len(run) / 100)
        assert entry["grade"] == "good" and 0.9 < entry["usable_share"] <= 1
        assert len(entry["sha256"]) == 64


def test_the_points_of_a_run_keep_its_extremes_and_one_index(view: View, processed: list[ProcessedRun]) -> None:
    signals = {one["name"]: one["unit"] for one in view.get("/api/signals?campaign=c1&run=r2")["signals"]}
    assert "N" in signals.values() and view.get(f"/api/signal?campaign=c1&run=r2&name={quote(min(signals))}")
    points, run = view.get("/api/run?campaign=c1&run=r2"), processed[1]
    count = len(points["time_s"])
    assert all(len(points[name]) == count for name in ARRAYS)
    assert points["sinkage_m"] is None
    assert points["thinned_from"] == len(run) and count <= len(run) / 8
    assert points["time_s"] == sorted(set(points["time_s"]))
    rows = np.round(np.array(points["time_s"]) * 100).astype(int)
    for name in ("slip", "drawbar_pull_n", "driving_torque_nm", "distance_m"):
        shown = np.array(points[name], float)
        assert np.allclose(shown, getattr(run, name)[rows], atol=0.06, equal_nan=True)
    used = run.used
    shown_used = np.array(points["used"])
    assert np.array_equal(shown_used, used[rows])
    for name in ("slip", "drawbar_pull_n"):
        shown, whole = np.array(points[name], float)[shown_used], getattr(run, name)[used]
        assert shown.min() == pytest.approx(whole.min(), abs=0.06)
        assert shown.max() == pytest.approx(whole.max(), abs=0.06)
    assert {reason == "" for reason, kept in zip(points["reason"], points["used"], strict=True) if kept} == {True}
    segments = points["segments"]
    assert segments[0]["from_s"] == 0.0 and segments[-1]["to_s"] == pytest.approx(run.time_s[-1])
    assert all(a["to_s"] == b["from_s"] for a, b in pairwise(segments))
    assert {"standstill", "drive"} <= {segment["kind"] for segment in segments}


def test_the_curve_is_the_models(view: View, folder: Path) -> None:
    [first, *_] = open_and_process([folder], ProcessOptions())
    base = Base(wheel_of(first[0].vehicle), known_soil(None, first[0].terrain), 9000.0, 1.5)
    values = {"H_m": 0.04, "tan_phi": 0.3}
    for reading in ("balanced", "literal"):
        said = view.post(
            "/api/curve",
            campaign="c1",
            sinkage=reading,
            effects=["vasilev"],
            values={"H_m": 0.04},
            soil={"tan_phi": 0.3},
            load_n=9000.0,
        )
        model = WheelSoilModel(base.wheel, base.soil, [EFFECTS["vasilev"]], reading)  # type: ignore[arg-type]
        wanted = model.predict(base.conditions(), values)
        assert said["slip"] == SLIPS.tolist() and len(said["slip"]) == 120
        for name in ("drawbar_pull_n", "driving_torque_nm", "sinkage_m"):
            assert np.allclose(np.array(said[name], float), getattr(wanted, name), equal_nan=True, rtol=1e-12)
        assert said["load_n"] == 9000.0 and said["ms"] > 0


def test_every_effect_that_shows_moves_the_curve_from_where_its_sliders_rest(view: View) -> None:
    found = view.get("/api/parameters?campaign=c1")
    assert found["complete"] and [p["name"] for p in found["soil"]] == list(SOIL_PARAMETERS)
    plain = view.post("/api/curve", campaign="c1")
    assert {effect["key"] for effect in found["effects"]} == {k for k, e in EFFECTS.items() if not e.needs.roles}
    for effect in found["effects"]:
        assert effect["can"] == (effect["why_not"] == "")
        for parameter in effect["parameters"]:
            assert parameter["lowest"] <= parameter["low"] < parameter["high"] <= parameter["highest"]
            assert parameter["low"] <= parameter["value"] == parameter["neutral"] <= parameter["high"]
            assert 0 < parameter["step"] <= (parameter["high"] - parameter["low"]) / 100
        if effect["in_curve"]:
            starts = {p["name"]: p["start"] for p in effect["parameters"]}
            moved = view.post("/api/curve", campaign="c1", effects=[effect["key"]], values=starts)
            assert any(moved[name] != plain[name] for name in ("drawbar_pull_n", "driving_torque_nm", "sinkage_m"))


def test_effects_that_are_not_identifiable_have_a_reason(view: View) -> None:
    effects = {effect["key"]: effect for effect in view.get("/api/parameters?campaign=c1")["effects"]}
    assert "pass" in effects["multi_pass"]["why_not"]
    assert "literal" in effects["closed_form_sinkage"]["why_not"]
    assert effects["vasilev"]["can"] and not effects["vasilev"]["why_not"]
    view.post("/api/choose", campaign="c1", choice={"sinkage": "literal"})
    effects = {effect["key"]: effect for effect in view.get("/api/parameters?campaign=c1")["effects"]}
    assert effects["closed_form_sinkage"]["can"]


CHOICE: dict[str, Any] = {
    "slip_threshold": 0.15,
    "channels": ["dp", "t"],
    "effects": ["vasilev", "torque_zero"],
    "cutoff_hz": 2.5,
    "run": [{"id": "run-1", "use": False}, {"file": "run-2.mcap", "id": "run-2", "keep": [[5, 18.5], [20, 35]]}],
}


def test_the_fit_is_that_of_the_command_line_with_the_saved_choice(view: View, folder: Path) -> None:
    view.post("/api/choose", campaign="c1", choice=CHOICE)
    view.settled()
    ours = view.post("/api/fit", campaign="c1")
    saved = view.post("/api/save", campaign="c1", name="as-seen.toml")["path"]
    assert Path(saved) == folder.resolve() / "as-seen.toml"
    curves = ours.pop("curves")
    found = ok("fit", folder, "--choice", saved, "--json").json
    assert [run["cause"] for run in found.pop("runs_set_aside")] == ["switched_off"]
    assert ours == found
    assert list(curves) == list(ours["models"]) and "chosen" in curves
    values = {name: found["value"] for name, found in ours["models"]["vasilev"]["estimates"].items()}
    assert curves["vasilev"] == {"sinkage": "balanced", "effects": ["vasilev"], "values": values, "soil": {}}


def test_a_choice_shows_at_once_and_processes_again_only_where_it_must(view: View) -> None:
    before = view.campaigns()[0]["runs"]
    entry = view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-2", "keep": [[10, 20]]}]})
    assert [run["state"] for run in entry["runs"]] == ["ready"] * 3
    assert entry["runs"][1]["usable_share"] != before[1]["usable_share"]
    points = view.get("/api/run?campaign=c1&run=r2")
    kept = [t for t, used in zip(points["time_s"], points["used"], strict=True) if used]
    assert kept[0] >= 10 and kept[-1] <= 20 and "by_hand" in points["reason"]
    entry = view.post("/api/choose", campaign="c1", choice={"min_speed_mps": 1.2})
    assert "waiting" in {run["state"] for run in entry["runs"]}
    slower = view.settled()[0]["runs"]
    assert slower[0]["state"] == "ready"
    points = view.get("/api/run?campaign=c1&run=r1")
    both = zip(points["ground_speed_mps"], points["rim_speed_mps"], points["slip"], strict=True)
    speeds = [max(ground, rim) for ground, rim, slip in both if slip is not None]
    assert min(speeds) >= 1.2


def test_a_choice_taken_back_needs_no_processing(view: View) -> None:
    view.post("/api/choose", campaign="c1", choice={"cutoff_hz": 1.0})
    entry = view.post("/api/choose", campaign="c1", choice={})
    assert [run["state"] for run in entry["runs"][1:]] == ["ready", "ready"]


def test_what_is_saved_is_what_was_chosen_and_is_taken_up_again(view: View, folder: Path, tmp_path: Path) -> None:
    view.post("/api/choose", campaign="c1", choice=CHOICE)
    path = Path(view.post("/api/save", campaign="c1", name="mine.toml")["path"])
    assert view.campaigns()[0]["saved_at"] == str(path)
    choice = load_choice(path)
    assert choice.slip_threshold == 0.15 and choice.effects == ("vasilev", "torque_zero") and choice.cutoff_hz == 2.5
    assert [(run.id, run.use, run.keep) for run in choice.runs] == [
        ("run-1", False, None),
        ("run-2", True, ((5.0, 18.5), (20.0, 35.0))),
        ("run-3", True, None),
    ]
    before = path.read_bytes()
    view.post("/api/choose", campaign="c1", choice={"slip_threshold": 0.3})
    assert view.campaigns()[0]["saved_at"] is None
    answer = view.tell("/api/save", campaign="c1", name="mine.toml")
    assert answer.status == 400 and "exists already" in answer.faults[0]["what"]
    assert path.read_bytes() == before
    view.post("/api/save", campaign="c1", name="mine.toml", replace=True)
    assert load_choice(path).slip_threshold == 0.3
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    (again / "choice.toml").write_bytes(before)
    with viewing_here(again) as other:
        [campaign] = other.campaigns()
        assert campaign["saved_at"] == str(again.resolve() / "choice.toml")
        assert campaign["choice"]["slip_threshold"] == 0.15
        assert [run["use"] for run in campaign["runs"]] == [False, True, True]


def test_a_diagnosis_runs_beside_the_page_and_ends_with_another_choice(view: View) -> None:
    answer = view.tell("/api/diagnose", campaign="c1")
    assert answer.status == 202 and answer.json["diagnosis"]["state"] == "running"
    assert view.tell("/api/diagnose", campaign="c1").status == 409
    assert view.ask("GET", "/api/diagnosis?campaign=c1").status == 409
    assert view.post("/api/curve", campaign="c1", effects=["ding"], values={"n1": 0.3})["ms"] > 0
    entry = view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "use": False}]})
    assert entry["diagnosis"]["state"] == "none"
    assert view.post("/api/diagnose", campaign="c1")["diagnosis"]["state"] == "running"


@pytest.mark.slow
def test_the_diagnosis_is_that_of_the_command_line(view: View, folder: Path) -> None:
    view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-2", "keep": [[0, 30]]}]})
    saved = view.post("/api/save", campaign="c1", name="diagnosed.toml")["path"]
    view.post("/api/diagnose", campaign="c1")
    [campaign] = view.until(lambda found: found[0]["diagnosis"]["state"] != "running", "the diagnosis")
    ours = view.get("/api/diagnosis?campaign=c1")
    theirs = ok("diagnose", folder, "--choice", saved, "--json").json
    assert {"figures", "main_channel"} <= set(ours) - set(theirs), "what the page alone shows"
    theirs.pop("stages_s")
    sentence = ours["sentence"]
    ours = {key: value for key, value in ours.items() if key in theirs}
    assert json.dumps(ours, sort_keys=True) == json.dumps(theirs, sort_keys=True)
    assert campaign["diagnosis"] == {
        "state": "done",
        "share": 1.0,
        "left_s": None,
        "verdict": verdict_words(ours["verdict"], {c["name"]: c["probability"] for c in ours["candidates"]}),
        "sentence": sentence,
        "why": None,
    }
