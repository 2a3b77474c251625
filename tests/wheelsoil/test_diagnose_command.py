"""`wheelsoil diagnose` as other programs use it: the JSON's shape, campaigns, options, the saved model."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_support import invoke, ok
from diagnosis_samples import SENTENCES, diagnosis

from daq import ConfigError
from daq.runs import Run, open_runs
from model.effects import EFFECTS
from processing import ProcessedRun, ProcessOptions
from wheelsoil.to_json import plain
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.workflows import campaigns_of, diagnosis_options, process_runs

NUMBER = (int, float, type(None))
QUICK = ("--effects", "vasilev,slope,torque_zero", "--most-causes", 1)


def check_shape(found: dict[str, Any]) -> None:
    """Hold a diagnosis to the contract that other programs read."""
    assert found["schema"] == "wheelsoil/diagnosis/1"
    assert found["verdict"] in ("named", "one_of", "unexplained", "nothing_detectable")
    assert isinstance(found["sentence"], str) and found["sentence"]
    for cause in found["causes"]:
        assert {"name", "form", "kind", "probability", "parameters"} <= set(cause)
        assert cause["kind"] in ("physical", "measurement")
        assert 0 <= cause["probability"] <= 1
        for parameter in cause["parameters"]:
            assert set(parameter) == {"name", "unit", "value", "interval95"}
            assert len(parameter["interval95"]) == 2
            assert isinstance(parameter["value"], NUMBER)
    assert bool(found["causes"]) == (found["verdict"] in ("named", "one_of"))
    for candidate in found["candidates"]:
        assert set(candidate) == {"name", "probability"}
        assert 0 <= candidate["probability"] <= 1
    probabilities = [candidate["probability"] for candidate in found["candidates"]]
    assert probabilities == sorted(probabilities, reverse=True)
    for one in found["sets"]:
        assert set(one) == {"causes", "probability"}
        assert set(one["causes"]) <= {candidate["name"] for candidate in found["candidates"]}
    for finding in found["what_is_wrong"]:
        assert set(finding) == {"channel", "where", "size", "statistic", "median_there"}
        inputs = {"ground_speed", "vertical_load"} if found["verdict"] == "unexplained" else set()
        assert finding["channel"] in {"drawbar_pull", "driving_torque", "sinkage"} | inputs
    if found["gain"] is not None:
        for which in ("base", "extended"):
            assert {"R0_N", "M0_percent", "R2"} <= set(found["gain"]["held_out"][which])
        assert isinstance(found["gain"]["reduction_percent"], NUMBER)
        assert len(found["gain"]["interval95"]) == 2
    for item in found["inconsistent"]:
        assert set(item) == {"channel", "rows", "why", "lines", "slips"}
    if found["adequacy"] is not None:
        assert set(found["adequacy"]) == {"statistic", "threshold", "ok", "measure"}
    if found["linearisation"] is not None:
        assert set(found["linearisation"]) == {"samples", "used", "iterations", "converged"}
        assert 0 < found["linearisation"]["used"] <= found["linearisation"]["samples"]
        assert set(found["gain"]["expected_R0"]) <= {"dp", "t", "z"} if found["gain"] else True
    if found["reason"] is not None:
        assert set(found["reason"]) == {"code", "text", "values"}
    if found["proposal"] is not None:
        assert {"formula", "gain"} <= set(found["proposal"])
    for least in found["minimum_detectable"].values():
        assert set(least) == {"parameter", "value", "unit"}
    for run in found["next_run"]:
        assert {"change", "step", "values", "separates", "expected_log_bayes_factor", "cost_runs"} <= set(run)
        assert isinstance(run["separates"], list)


@pytest.mark.parametrize("verdict", SENTENCES)
def test_what_is_made_by_hand_has_the_shape(verdict):
    check_shape(plain(diagnosis_json(diagnosis(verdict))))


@pytest.fixture(scope="module")
def found(campaign, tmp_path_factory) -> tuple[dict[str, Any], Path, str]:
    """Return a diagnosis, the model that it left, and what was said beside."""
    model = tmp_path_factory.mktemp("model") / "model.toml"
    result = ok("diagnose", campaign, *QUICK, "--next-run", "-o", model, "--json")
    return result.json, model, result.err


def test_what_is_found_has_the_shape(found):
    diagnosed, _, printed = found
    check_shape(diagnosed)
    assert {c["name"] for c in diagnosed["candidates"]} == {"slip_sinkage", "slope", "torque_zero", "none"}
    assert set(diagnosed["minimum_detectable"]) == {"vasilev", "slope", "torque_zero"}
    assert diagnosed["next_run"], "it was asked for"
    assert "diagnosis: " not in printed, "the seconds of the stages are in the JSON and in the report's appendix"


def test_the_model_it_leaves_is_taken_elsewhere(found, campaign, tmp_path):
    diagnosed, model, printed = found
    saved = tomllib.loads(model.read_text(encoding="utf-8"))
    assert saved["provenance"]["verdict"] == diagnosed["verdict"]
    assert saved["provenance"]["sentence"] == diagnosed["sentence"]
    if diagnosed["verdict"] == "one_of":
        assert next([e["name"] for e in one["effect"]] for one in saved["set"]) == diagnosed["sets"][0]["causes"]
    else:
        named = [c["name"] for c in diagnosed["causes"] if diagnosed["verdict"] == "named"]
        assert [e["name"] for e in saved["effect"]] == named
    assert f"wrote {model}" in printed
    assert "extended" in ok("fit", campaign, "--model", model, "--json").json["models"]
    ok("simulate", "--model", model, "-o", tmp_path / "again", "--runs", 1, "--duration", 15)
    page = tmp_path / "r.html"
    report = ok("report", campaign, "--model", model, "--no-diagnosis", "-o", page, "--json").json
    assert report["left_out"] == {}
    assert "extended" in page.read_text(encoding="utf-8")
    assert invoke("diagnose", campaign, *QUICK, "-o", model).code == 2, "it is there already"


def test_the_same_seed_gives_the_same_answer(found, campaign):
    def timeless(answer: dict[str, Any]) -> dict[str, Any]:
        return {key: value for key, value in answer.items() if key != "stages_s"}

    again = ok("diagnose", campaign, *QUICK, "--next-run", "--json").json
    assert timeless(again) == timeless(found[0])


def each_by_itself(paths: Sequence[Path]) -> Iterator[tuple[Run, ProcessedRun]]:
    """Process runs of which some are copies of others, all of which count."""
    for run in open_runs(paths):
        yield from process_runs([run], ProcessOptions(purpose="diagnose"))


def test_folders_are_campaigns_and_loose_runs_are_grouped_by_soil(campaign, tmp_path):
    other = tmp_path / "meadow"
    shutil.copytree(campaign, other)
    soil = (other / "terrain.toml").read_text()
    assert "cohesion_kpa = 7.58" in soil
    (other / "terrain.toml").write_text(soil.replace("cohesion_kpa = 7.58", "cohesion_kpa = 8.0"))
    single = tmp_path / "single.mcap"
    shutil.copy(campaign / "run-1.mcap", single)
    paths = [campaign, other, single]
    grouped = campaigns_of(paths, [*each_by_itself(paths)])
    assert [(c.name, len(c.runs)) for c in grouped] == [("clay (1)", 2), ("meadow", 2), ("clay (2)", 1)]
    assert [c.soil.cohesion_pa for c in grouped] == pytest.approx([7580.0, 8000.0, 7580.0])
    loose = [campaign / "run-1.mcap", other / "run-1.mcap", campaign / "run-2.mcap"]
    apart = campaigns_of(loose, [*each_by_itself(loose)])
    assert [len(c.runs) for c in apart] == [2, 1]
    [(run, done)] = each_by_itself(loose[:1])
    vehicle = run.vehicle.model_copy(
        update={"signals": run.vehicle.signals | {"slip": run.vehicle.signals["wheel_speed"]}}
    )
    commanded = campaigns_of([], [(replace(run, vehicle=vehicle), done)])
    assert [c.commanded_slip for c in (*apart, *commanded)] == [False, False, True]


def test_effects_are_chosen_by_key_family_and_kind():
    assert set(diagnosis_options(effects=["slip_sinkage"]).effects) == {"vasilev", "lyasko", "ding", "second_order"}
    kinds = {EFFECTS[key].kind for key in diagnosis_options(without=["measurement"]).effects}
    assert kinds == {"physical"}
    assert "ding" not in diagnosis_options(without=["ding"]).effects
    assert "closed_form_sinkage" not in diagnosis_options().effects
    assert "closed_form_sinkage" in diagnosis_options("literal").effects


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"effects": ["slip_sinkige"]}, "nearest: slip_sinkage"),
        ({"effects": ["closed_form_sinkage"]}, "needs --sinkage literal"),
        ({"channels": ["dp", "torque"]}, "no channel 'torque'"),
        ({"channels": []}, "no channel ''"),
        ({"most_causes": 0}, "1 to 3"),
    ],
)
def test_wrong_options_are_reported(wrong, said):
    with pytest.raises(ConfigError, match=said.replace("(", r"\(")):
        diagnosis_options(**wrong)


@pytest.mark.parametrize(
    ("args", "said"),
    [
        ([], "no run is given"),
        (["nowhere.mcap"], "no such file"),
        (["--rename", "a=b"], "--rename and --where choose from a table"),
        (["x", "--table", "rows.csv"], "RUN and --table exclude each other"),
        (["--table", "rows.csv"], "the wheel is not known"),
    ],
)
def test_bad_input_is_one_clear_message(args, said):
    result = invoke("diagnose", *args)
    assert result.code in (2, 3)
    assert said in result.err
    assert "Traceback" not in result.err and not result.out


def test_a_soil_is_needed(campaign, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(campaign, folder)
    (folder / "terrain.toml").write_text("[soil]\nname = 'x'\n")
    result = invoke("diagnose", folder)
    assert result.code == 2
    assert "soil.cohesion_kpa" in result.err and "soil.sinkage_exponent" in result.err


def test_a_bench_table_is_diagnosed(tmp_path):
    (tmp_path / "wheel.toml").write_text('[wheel]\nradius_m = 0.3\nwidth_m = 0.2\ntyre = "smooth"\n')
    rows = [f"{s / 10},{w},{50 + 0.05 * w * s / 10}" for s in range(1, 9, 2) for w in (1500, 2500)]
    (tmp_path / "rows.csv").write_text("\n".join(["slip,vertical_load_n,drawbar_pull_n", *rows]))
    args = ("--table", tmp_path / "rows.csv", "--vehicle", tmp_path / "wheel.toml", "--soil", "sandy")
    answer = ok("diagnose", *args, "--effects", "vasilev,drawbar_pull_zero", "--most-causes", 1, "--json").json
    check_shape(answer)
    assert "driving_torque" not in {finding["channel"] for finding in answer["what_is_wrong"]}


@pytest.mark.slow
def test_the_sample_campaign_of_lyaskos_law_is_named_with_its_p(sample_report):
    sections = json.loads(sample_report("sandy").with_suffix(".json").read_text(encoding="utf-8"))["sections"]
    assert sections["verdict"]["verdict"] == "named"
    [cause] = sections["candidates"]["causes"]
    assert (cause["name"], cause["form"]) == ("slip_sinkage", "lyasko")
    p = next(parameter for parameter in cause["parameters"] if parameter["name"] == "p")
    low, high = p["interval95"]
    assert low < 0.63 < high
