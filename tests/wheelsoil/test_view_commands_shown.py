"""The commands that the page shows once a choice is saved do what was done on the page."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cli_support import ok
from view_client import View, taken_from
from view_in_process import viewing_here

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(CLAY, tmp_path_factory.mktemp("shown") / "clay", 2)


@pytest.fixture(scope="module")
def view(folder: Path) -> Iterator[View]:
    """The page on a folder, and on one that holds nothing."""
    empty = folder.parent / "empty"
    empty.mkdir()
    with viewing_here(folder, empty) as running:
        running.settled()
        yield running


def repeated(view: View, campaign: dict[str, Any], choice: dict[str, Any]) -> list[str]:
    """Choose, fit, save, and hold the shown `fit` to the same numbers; return the shown commands."""
    key = campaign["key"]
    assert campaign["commands"] == []
    view.post("/api/choose", campaign=key, choice=choice)
    view.settled()
    ours = view.post("/api/fit", campaign=key)
    assert ours.pop("curves")
    saved = view.post("/api/save", campaign=key, name="mine.toml")["campaign"]
    shown: list[str] = saved["commands"]
    assert [line.split()[:2] for line in shown] == [["wheelsoil", verb] for verb in ("fit", "diagnose", "report")]
    assert ok(*shlex.split(shown[0])[1:], "--json").json == ours
    return shown


def test_recordings_of_a_folder_that_holds_more_are_named_one_by_one(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay field", 3)
    with viewing_here(folder / "run-1.mcap", folder / "run-3.mcap") as view:
        [campaign] = view.settled()
        shown = repeated(view, campaign, {"run": [{"id": name, "keep": [[5, 20]]} for name in ("run-1", "run-3")]})
    assert "run-1.mcap" in shown[2] and "run-2.mcap" not in shown[2]
    assert shlex.split(shown[2])[-2:] == ["-o", "report.html"]


@pytest.mark.slow
@pytest.mark.parametrize("runs", [0, 1])
def test_what_was_given_beside_the_recordings_is_given_again(tmp_path: Path, runs: int) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    truck = tmp_path / "clay" / "truck.toml"
    truck.write_text((folder / "vehicle.toml").read_text().replace("radius_m = 0.47", "radius_m = 0.48"))
    assert truck.read_text() != (folder / "vehicle.toml").read_text()
    given = [folder / "run-1.mcap"] if runs else [folder]
    with viewing_here(*given, soil="sandy", vehicle=truck, lenient_dbc=True) as view:
        [campaign] = view.settled()
        kept = [{"id": run["id"], "keep": [[5, 20]]} for run in campaign["runs"]]
        shown = repeated(view, campaign, {"effects": ["vasilev"], "run": kept})
        answer = view.tell("/api/save", campaign="c1", name="truck.toml", replace=True)
        assert answer.status == 400 and "not a choice" in answer.faults[0]["what"]
    assert "[vehicle]" in truck.read_text()
    for line in shown:
        assert f"--vehicle {truck}" in line and "--soil sandy" in line and "--lenient-dbc" in line


def test_recordings_of_one_name_are_distinguished(tmp_path: Path) -> None:
    first, second = taken_from(CLAY, tmp_path / "a", 1), taken_from(CLAY, tmp_path / "b", 1)
    (second / "run-1.mcap").write_bytes((CLAY / "run-2.mcap").read_bytes())
    (second / "runs.toml").write_text('[[run]]\nfile = "run-1.mcap"\nid = "run-1"\n')
    with viewing_here(first / "run-1.mcap", second / "run-1.mcap") as view:
        [campaign] = view.settled()
        files = [(run["file"], run["id"]) for run in campaign["runs"]]
        assert files == [("run-1.mcap", "run-1"), ("run-1.mcap", "run-1-2")]
        choice = {"run": [{"file": file, "id": name, "keep": [[0, 20]]} for file, name in files[1:]]}
        repeated(view, campaign, choice)
        text = Path(view.campaigns()[0]["saved_at"]).read_text()
        assert text.count("keep") == 1


@pytest.mark.slow
def test_recordings_of_two_terrains_and_one_name_are_two_campaigns(tmp_path: Path) -> None:
    first, second = taken_from(CLAY, tmp_path / "a", 1), taken_from(SANDY, tmp_path / "b", 1)
    with viewing_here(first / "run-1.mcap", second / "run-1.mcap") as view:
        for campaign in view.settled():
            repeated(view, campaign, {"run": [{"id": "run-1", "keep": [[5, 20]]}]})


def test_a_run_named_by_its_id_and_another_file_is_a_fault(view: View) -> None:
    answer = view.tell("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "file": "run-2.mcap"}]})
    assert answer.status == 400 and "run-2.mcap" in answer.faults[0]["what"]
    view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "use": False, "keep": [[1, 9]]}]})
    path = view.post("/api/save", campaign="c1", name="unused.toml")["path"]
    [unused, _] = view.campaigns()[0]["runs"]
    assert not unused["use"] and "keep" in Path(path).read_text()


def test_a_replacement_that_fails_leaves_nothing_behind(view: View, folder: Path) -> None:
    view.post("/api/choose", campaign="c1", choice={})
    path = Path(view.post("/api/save", campaign="c1", name="mine.toml")["path"])
    before = path.read_bytes()
    (folder / f".wheelsoil-{os.getpid()}.toml").write_bytes(b"of a replacement that failed")
    view.post("/api/choose", campaign="c1", choice={"slip_threshold": 0.3})
    view.post("/api/save", campaign="c1", name="mine.toml", replace=True)
    assert path.read_bytes() != before
    assert not [file for file in folder.iterdir() if file.name.startswith(".")]


def test_a_folder_that_cannot_be_read_costs_itself(view: View, folder: Path) -> None:
    [campaign] = view.campaigns()
    assert campaign["name"] == "clay" and campaign["runs"][0]["state"] == "ready"
    [remark] = view.get("/api/list")["remarks"]
    empty = str(folder.parent / "empty")
    assert empty in remark and "skipped" in remark
    assert any(empty in line for line in view.said)
