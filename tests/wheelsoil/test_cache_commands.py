"""Commands compute nothing twice, and say the same the second time."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import Result, invoke, ok
from view_client import viewing

import model.diagnosis
import model.fit
import processing.pipeline
from daq import ConfigError
from daq.runs import open_runs
from processing import LOOK, ProcessedRun, ProcessOptions, purposes_served
from processing.options import NEEDED_ROLES
from wheelsoil.cache import entries, nothing_kept
from wheelsoil.cache.codec import to_bytes
from wheelsoil.view.jobs import process_run
from wheelsoil.workflows import process_runs

QUICK = ("--effects", "lyasko,slope", "--most-causes", 1)


@pytest.fixture(scope="module")
def before(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of results that `process`, `fit`, `diagnose`, `sinkage` and `report` have left."""
    folder = tmp_path_factory.mktemp("before")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WHEELSOIL_CACHE", str(folder / "kept"))
        for name in ("process", "fit", "sinkage"):
            (folder / f"{name}.txt").write_text(said(ok(name, campaign)))
        (folder / "diagnose.txt").write_text(said(ok("diagnose", campaign, *QUICK)))
        ok("report", campaign, "-o", folder / "report.html", "--no-diagnosis")
    return folder


@pytest.fixture
def filled(before: Path, place: Path) -> Path:
    """Return a copy of those results that the test's commands use."""
    shutil.copytree(before / "kept", place)
    return place


def said(result: Result) -> str:
    """Return what a command printed, without how long it took."""
    return result.out + re.sub(r"(?s)diagnosis: [0-9.]+ s.*?\)\n", "", result.err)


def kinds(place: Path) -> Counter[str]:
    """Return how many results of each kind are kept."""
    return Counter(entry.path.stem.partition("-")[0] for entry in entries(place))


def compute_nothing(patch: pytest.MonkeyPatch) -> None:
    """Fail where a run is processed, a model fitted or a campaign diagnosed."""
    for where, name in (
        (processing.pipeline, "process_stream"),
        (model.fit, "fit_models"),
        (model.diagnosis, "diagnose"),
    ):
        patch.setattr(where, name, lambda *_: pytest.fail("computed again"), raising=False)


def test_commands_share_what_they_have_in_common(before: Path) -> None:
    assert kinds(before / "kept") == {"processed": 2, "fit": 1, "diagnosis": 1, "sinkage": 1}


@pytest.mark.parametrize("name", ["process", "fit", "sinkage", "diagnose"])
def test_a_second_call_computes_nothing_and_says_the_same(
    name: str, before: Path, filled: Path, campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_nothing(monkeypatch)
    there = kinds(filled)
    again = ok(name, campaign, *(QUICK if name == "diagnose" else ()))
    assert said(again) == (before / f"{name}.txt").read_text()
    assert kinds(filled) == there


def test_a_second_report_is_the_first(
    before: Path, filled: Path, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_nothing(monkeypatch)
    assert filled.is_dir()
    ok("report", campaign, "-o", tmp_path / "report.html", "--no-diagnosis")
    first, second = (json.loads((folder / "report.json").read_text()) for folder in (before, tmp_path))
    assert first | {"made_at": ""} == second | {"made_at": ""}
    pages = [(folder / "report.html").read_text() for folder in (before, tmp_path)]
    one, two = (re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", "", page) for page in pages)
    assert one == two


@pytest.mark.slow
def test_a_report_and_the_page_take_the_diagnosis_that_there_is(
    place: Path, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ok("diagnose", campaign)
    monkeypatch.setattr(model.diagnosis, "diagnose", lambda *_: pytest.fail("diagnosed again"), raising=False)
    done = ok("report", campaign, "-o", tmp_path / "report.html")
    assert "diagnosed again" not in done.out + done.err + (tmp_path / "report.json").read_text()
    assert kinds(place)["diagnosis"] == 1
    told = json.loads((tmp_path / "report.json").read_text())["sections"]["glance"]["sentence"]
    with viewing(campaign) as view:
        [there] = view.until(lambda found: found[0]["diagnosis"]["state"] != "none", "the kept diagnosis on the page")
        assert (there["diagnosis"]["state"], there["diagnosis"]["sentence"]) == ("done", told)
        view.post("/api/choose", campaign="c1", choice={"min_speed_mps": 0.7})
        assert view.settled()[0]["diagnosis"]["state"] == "none"
        view.post("/api/choose", campaign="c1", choice={})
        view.until(lambda found: found[0]["diagnosis"]["state"] == "done", "it again, with the choice that it is of")
    assert kinds(place)["diagnosis"] == 1


OTHERS = {
    "fit": [("--channels", "dp,t"), ("--soil-prior",), ("--slip-threshold", 0.3), ("--sinkage", "literal")],
    "diagnose": [(*QUICK, "--channels", "dp")],
    "process": [("--rate", 50), ("--cutoff", 2), ("--min-speed", 0.7)],
}


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param(name, one, marks=() if place == 0 and name != "diagnose" else pytest.mark.slow)
        for name, each in OTHERS.items()
        for place, one in enumerate(each)
    ],
)
def test_another_option_is_another_result(name: str, options: tuple[object, ...], filled: Path, campaign: Path) -> None:
    there = kinds(filled)
    found = said(ok(name, campaign, *options))
    kind = {"fit": "fit", "diagnose": "diagnosis", "process": "processed"}[name]
    assert kinds(filled) - there == {kind: 2 if name == "process" else 1}
    assert found == said(ok(name, campaign, *options, "--no-cache"))


def test_a_choice_takes_parts_of_runs_that_are_kept(
    filled: Path, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = tmp_path / "choice.toml"
    chosen.write_text('schema = "wheelsoil/choice/1"\n[[run]]\nid = "run-1"\nkeep = [[5.0, 12.0]]\n')
    monkeypatch.setattr(processing.pipeline, "process_stream", lambda *_: pytest.fail("processed"), raising=False)
    there = kinds(filled)
    found = ok("fit", campaign, "--choice", chosen).out
    assert kinds(filled) - there == {"fit": 1}
    assert found != ok("fit", campaign).out


def test_nothing_is_kept_or_used_where_that_is_asked_for(filled: Path, campaign: Path) -> None:
    there = {entry.path: entry for entry in entries(filled)}
    first, second = (said(ok("fit", campaign, *option)) for option in ((), ("--no-cache",)))
    assert first == second
    for file in there:
        file.write_bytes(b"damaged")
    assert said(ok("fit", campaign, "--no-cache")) == first
    assert all(file.read_bytes() == b"damaged" for file in there)
    assert os.environ["WHEELSOIL_CACHE"] == str(filled), "as it was"


def test_damaged_entries_are_made_anew_without_a_word(before: Path, filled: Path, campaign: Path) -> None:
    whole = {entry.path: entry.path.read_bytes() for entry in entries(filled)}
    for i, (file, data) in enumerate(whole.items()):
        file.write_bytes(data[: len(data) * (i + 1) // 7])
    assert said(ok("fit", campaign)) == (before / "fit.txt").read_text()
    made = {file for file, data in whole.items() if file.read_bytes() == data}
    assert {file.stem.partition("-")[0] for file in made} == {"processed", "fit"}


@pytest.mark.usefixtures("place")
def test_a_recording_that_is_damaged_is_reported_each_time(campaign: Path, tmp_path: Path, place: Path) -> None:
    there = shutil.copytree(campaign, tmp_path / "other")
    cut = there / "run-1.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 4 // 5])
    first, second = (invoke("process", there) for _ in range(2))
    assert first == second and "read without what is damaged" in second.err
    assert kinds(place) == {"processed": 1}


def test_a_file_that_changes_while_it_is_read_is_not_kept(
    campaign: Path, tmp_path: Path, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = shutil.copytree(campaign, tmp_path / "other")
    stream = processing.pipeline.process_stream

    def while_it_grows(*given: object) -> ProcessedRun:
        found: ProcessedRun = stream(*given)  # type: ignore[arg-type]
        with (there / "run-1.mcap").open("ab") as file:
            file.write(b" ")
        return found

    monkeypatch.setattr(processing.pipeline, "process_stream", while_it_grows)
    ok("process", there / "run-1.mcap")
    assert not entries(place)


def processed_for(purpose: str, folder: Path) -> ProcessedRun:
    """Return the first run of a folder, processed for a purpose."""
    return process_runs(open_runs([folder / "run-1.mcap"]), ProcessOptions(purpose=purpose))[0][1]


def processed_anew(purposes: Iterable[str], folder: Path) -> dict[str, bytes]:
    """Return the first run of a folder, processed for each purpose with nothing kept."""
    with nothing_kept():
        return {purpose: to_bytes(processed_for(purpose, folder)) for purpose in purposes}


@pytest.fixture(scope="module")
def anew(campaign: Path) -> dict[str, bytes]:
    """Return the first run of `campaign`, processed for each purpose."""
    return processed_anew((LOOK, *NEEDED_ROLES), campaign)


@pytest.mark.parametrize("first", [LOOK, *NEEDED_ROLES])
def test_a_whole_run_serves_every_purpose(first: str, campaign: Path, place: Path, anew: dict[str, bytes]) -> None:
    made = to_bytes(processed_for(first, campaign))
    assert purposes_served(processed_for(first, campaign)) == (LOOK, *NEEDED_ROLES)
    for purpose, expected in anew.items():
        assert made == expected, "as if it were processed for it"
        assert to_bytes(processed_for(purpose, campaign)) == made
    assert kinds(place) == {"processed": 1}


def without(role: str, campaign: Path, folder: Path) -> Path:
    """Return a copy of a campaign whose vehicle.toml has no signal of a role."""
    there = shutil.copytree(campaign, folder)
    lines = (there / "vehicle.toml").read_text().splitlines()
    (there / "vehicle.toml").write_text("\n".join(line for line in lines if not line.startswith(f"{role} =")))
    return there


@pytest.mark.parametrize("role", ["driving_torque", "drawbar_pull", "ground_speed"])
def test_a_run_that_lacks_a_channel_serves_no_purpose_that_needs_it(
    role: str, campaign: Path, tmp_path: Path, place: Path
) -> None:
    there = without(role, campaign, tmp_path / "other")
    served = [LOOK, *(purpose for purpose, needed in NEEDED_ROLES.items() if role not in needed)]
    anew = processed_anew(served, there)
    for _ in range(2):
        looked = processed_for(LOOK, there)
        assert to_bytes(looked) == anew[LOOK]
        for purpose, needed in NEEDED_ROLES.items():
            if role in needed:
                with pytest.raises(ConfigError, match=role):
                    processed_for(purpose, there)
            else:
                assert to_bytes(processed_for(purpose, there)) == anew[purpose]
    assert set(purposes_served(looked)) <= set(served)
    assert kinds(place)["processed"] == (2 if role == "drawbar_pull" else 1)


def test_a_run_with_notes_on_a_channel_is_kept_for_its_own_purpose(campaign: Path) -> None:
    whole = processed_for(LOOK, campaign)
    facts = whole.quality.sensors | {"sinkage": replace(whole.quality.sensors["drawbar_pull"], samples=0)}
    assert purposes_served(replace(whole, quality=replace(whole.quality, sensors=facts))) == ()


def test_the_page_uses_it(filled: Path, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = kinds(filled)
    compute_nothing(monkeypatch)
    [run, _] = open_runs([campaign])
    data = process_run(run, ProcessOptions(), None, tmp_path / "run.pickle")
    assert data.run.run.id == "run-1" and kinds(filled) == there


@pytest.mark.slow
def test_two_commands_at_once(campaign: Path, place: Path, before: Path) -> None:
    command = [sys.executable, "-c", "from wheelsoil.cli.app import main; main()", "fit", str(campaign)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        out, err = process.communicate(timeout=240)
        assert process.returncode == 0, err
        assert out + err == (before / "fit.txt").read_text()
    assert kinds(place) == {"processed": 2, "fit": 1} and len(list(place.iterdir())) == 3


def test_the_command_lists_and_removes(filled: Path) -> None:
    found = ok("cache", "--json").json
    assert found["folder"] == str(filled) and found["entries"] == 5 and found["limit_bytes"] == 2_000_000_000
    assert found["bytes"] == sum(file.stat().st_size for file in filled.iterdir())
    assert "5 entries removed" in ok("cache", "--clear").err
    assert re.search(r"entries +0\b", ok("cache").out) and not list(filled.iterdir())


def test_the_command_says_that_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_CACHE", "off")
    assert "off" in ok("cache").out and ok("cache", "--json").json["folder"] is None
