"""Recordings that lack something on the analyst's page: each says why, and the others are as good as ever."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_support import ok
from view_client import View, taken_from, viewing

from wheelsoil.reporting import report_of

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"
SCRIPT = '<script>alert("1")</script>'


def without(folder: Path, *roles: str) -> Path:
    """A folder of one run whose vehicle.toml knows no signal for some roles."""
    taken_from(CLAY, folder, 1)
    vehicle = folder / "vehicle.toml"
    kept = [line for line in vehicle.read_text().splitlines() if line.partition(" =")[0] not in roles]
    vehicle.write_text("\n".join(kept) + "\n")
    return folder


def only(view: View) -> dict[str, Any]:
    """The one run of the one campaign, once it is processed."""
    [campaign] = view.settled()
    [run] = campaign["runs"]
    return dict(run)


def test_a_recording_without_torque_is_drawn_and_fitted_without_it(tmp_path: Path) -> None:
    with viewing(without(tmp_path / "clay", "driving_torque")) as view:
        assert only(view)["state"] == "ready"
        points = view.get("/api/run?campaign=c1&run=r1")
        assert points["driving_torque_nm"] is None and len(points["slip"]) > 100
        told = {e["key"]: e["why_not"] for e in view.get("/api/parameters?campaign=c1")["effects"]}
        assert "torque" in told["torque_zero"]
        assert set(view.post("/api/fit", campaign="c1")["models"]) == {"wong", "vasilev", "lyasko", "ding"}
        view.post("/api/choose", campaign="c1", choice={"channels": ["dp", "t"]})
        answer = view.tell("/api/fit", campaign="c1")
        assert answer.status == 400 and "driving_torque" in answer.faults[0]["what"]


def test_a_recording_without_forces_is_drawn_and_says_why_no_model_is(tmp_path: Path) -> None:
    with viewing(without(tmp_path / "clay", "vertical_load", "drawbar_pull", "driving_torque")) as view:
        assert only(view)["state"] == "ready"
        points = view.get("/api/run?campaign=c1&run=r1")
        assert any(points["used"]) and set(points["drawbar_pull_n"]) == {None}
        answer = view.ask("GET", "/api/parameters?campaign=c1")
        assert answer.status == 422 and "load" in answer.faults[0]["what"]
        answer = view.tell("/api/fit", campaign="c1")
        assert answer.status in (400, 422) and answer.faults


def test_a_recording_without_position_is_as_good_as_any(tmp_path: Path) -> None:
    with viewing(without(tmp_path / "clay", "latitude", "longitude", "course")) as view:
        assert only(view)["state"] == "ready"
        known = [x for x in view.get("/api/run?campaign=c1&run=r1")["distance_m"] if x is not None]
        assert known[-1] > 1
        assert view.get("/api/parameters?campaign=c1")["complete"]


def test_a_recording_whose_soil_or_wheel_is_not_known_says_so(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 1)
    text = (folder / "vehicle.toml").read_text()
    [name] = _frames_only(folder)
    (folder / "terrain.toml").unlink()
    with viewing(folder) as view:
        assert only(view)["state"] == "ready", name
        for answer in (view.ask("GET", "/api/parameters?campaign=c1"), view.tell("/api/fit", campaign="c1")):
            assert answer.status == 400 and "soil is not known" in answer.faults[0]["what"]
    with viewing(folder, "--soil", "sandy") as view:
        view.settled()
        assert view.campaigns()[0]["terrain"] == "sandy"
        assert view.get("/api/parameters?campaign=c1")["soil"][0]["value"] == 1000
    (folder / "vehicle.toml").write_text(re.sub(r"\[wheel\].*?\n\n", "", text, flags=re.DOTALL))
    with viewing(folder, "--soil", "sandy") as view:
        run = only(view)
        assert run["state"] == "failed" and "wheel" in run["why"]
        assert view.tell("/api/curve", campaign="c1", load_n=9e3).status == 400


def test_a_damaged_recording_costs_itself(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    (folder / "run-3.mcap").write_bytes(b"no recording at all")
    whole = (folder / "run-2.mcap").read_bytes()
    (folder / "run-2.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    with viewing(folder) as view:
        [campaign] = view.settled()
        [remark] = view.get("/api/list")["remarks"]
        assert "run-3.mcap" in remark
        assert [run["state"] for run in campaign["runs"]] == ["ready", "ready"]
        assert campaign["runs"][1]["grade"] != "good"
        assert any("damaged" in note or "end" in note for note in campaign["runs"][1]["notes"])


def test_the_grade_is_that_of_the_report(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    whole = (folder / "run-2.mcap").read_bytes()
    (folder / "run-2.mcap").write_bytes(whole[: len(whole) // 2])
    graded = report_of([folder], diagnose=False).numbers()["sections"]["glance"]["grades"]
    with viewing(folder) as view:
        [campaign] = view.settled()
    assert {run["id"]: run["grade"] for run in campaign["runs"]} == {run: said["level"] for run, said in graded.items()}
    for run in campaign["runs"]:
        assert run["notes"][: len(graded[run["id"]]["reasons"])] == graded[run["id"]]["reasons"]


def test_one_run_of_a_file_is_a_campaign(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    with viewing(folder / "run-1.mcap") as view:
        [campaign] = view.settled()
        assert [run["id"] for run in campaign["runs"]] == ["run-1"]
        assert campaign["path"] == str(folder)
        assert view.post("/api/fit", campaign="c1")["models"]["lyasko"]["samples"] > 0
        assert (
            "one run"
            in {e["key"]: e for e in view.get("/api/parameters?campaign=c1")["effects"]}["zero_drift"]["why_not"]
        )


def test_two_terrains_in_one_folder_are_two_campaigns(tmp_path: Path) -> None:
    folder = tmp_path / "field"
    folder.mkdir()
    for source, name in ((CLAY, "clay"), (SANDY, "sandy")):
        for number in (1, 2):
            shutil.copy(source / f"run-{number}.mcap", folder / f"{name}-{number}.mcap")
    with viewing(folder) as view:
        clay, sandy = view.settled()
        assert (clay["terrain"], sandy["terrain"]) == ("clay", "sandy")
        assert clay["name"] == "field, clay" and sandy["name"] == "field, sandy"
        assert [run["file"] for run in sandy["runs"]] == ["sandy-1.mcap", "sandy-2.mcap"]
        view.post("/api/choose", campaign="c2", choice={"run": [{"id": sandy["runs"][0]["id"], "keep": [[5, 30]]}]})
        ours = view.post("/api/fit", campaign="c2")
        assert ours["soil"]["name"] == "sandy"
        saved = view.post("/api/save", campaign="c2", name="choice.toml")["path"]
        assert ours.pop("curves") and ours == ok("fit", folder, "--choice", saved, "--json").json
        assert view.ask("GET", "/api/run?campaign=c1&run=r3").status == 404  # it is of the other campaign
    with viewing(folder) as view:
        clay, sandy = view.campaigns()
        assert clay["saved_at"] is None and "run" not in clay["choice"]
        assert sandy["saved_at"] == saved and sandy["choice"]["run"][0]["keep"] == [[5.0, 30.0]]


def test_a_choice_is_of_its_folder_where_another_has_a_run_of_that_name(tmp_path: Path) -> None:
    folders = [taken_from(CLAY, tmp_path / name, 1) for name in ("a", "b")]
    with viewing(*folders) as view:
        first, second = view.settled()
        assert [c["runs"][0]["id"] for c in (first, second)] == ["run-1", "run-1"]
        view.post("/api/choose", campaign="c2", choice={"run": [{"id": "run-1", "keep": [[5, 9]]}]})
        shares = [view.get(f"/api/run?campaign=c{n}&run=r{n}")["shares"] for n in (1, 2)]
        assert "by_hand" not in shares[0] and shares[1]["by_hand"] > 0.5


def test_a_run_that_is_named_twice_is_there_once(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    with viewing(folder / "run-2.mcap", folder, folder) as view:
        [campaign] = view.campaigns()
        assert [run["id"] for run in campaign["runs"]] == ["run-1", "run-2"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 'wheelsoil/choice/1'\nslip_threshold = 7", "slip_threshold"),
        ("schema = 'wheelsoil/choice/1'\n[[run]]\nid = 'nobody'", "nobody"),
        ("no toml at all", "TOML"),
    ],
)
def test_a_choice_in_the_folder_that_is_wrong_is_told_and_left_alone(tmp_path: Path, text: str, said: str) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 1)
    (folder / "choice.toml").write_text(text)
    with viewing(folder) as view:
        [remark] = view.get("/api/list")["remarks"]
        assert "choice.toml" in remark and said in remark
        assert view.campaigns()[0]["choice"] == {"schema": "wheelsoil/choice/1"}


def test_a_recording_that_was_changed_since_the_choice_is_noticed(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    digest = "0" * 64
    (folder / "choice.toml").write_text(
        f"schema = 'wheelsoil/choice/1'\n[[run]]\nid = 'run-1'\nfile = 'run-1.mcap'\nsha256 = '{digest}'\nuse = true\n"
    )
    with viewing(folder) as view:
        [remark] = view.get("/api/list")["remarks"]
        assert "another recording" in remark
        assert view.campaigns()[0]["saved_at"]


def test_names_stay_data(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "<i>folder", 1)
    (folder / "run-1.mcap").rename(folder / "<img src=x onerror=alert(1)>.mcap")
    for name, key in (("vehicle.toml", 'name = "virtual test vehicle"'), ("terrain.toml", 'name = "clay"')):
        text = (folder / name).read_text()
        assert key in text
        (folder / name).write_text(text.replace(key, f"name = {json.dumps(SCRIPT)}"))
    (folder / "runs.toml").write_text(
        f'[[run]]\nfile = "<img src=x onerror=alert(1)>.mcap"\nid = {json.dumps(SCRIPT)}\n'
    )
    with viewing(folder) as view:
        [campaign] = view.settled()
        answer = view.ask("GET", "/api/list")
        assert answer.headers["content-type"] == "application/json"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert campaign["vehicle"] == campaign["terrain"] == campaign["runs"][0]["id"] == SCRIPT
        assert campaign["runs"][0]["state"] == "ready"
        view.post("/api/choose", campaign="c1", choice={"run": [{"id": SCRIPT, "keep": [[5, 30]]}]})
        saved = view.post("/api/save", campaign="c1", name="<b>.toml")["path"]
        ours = view.post("/api/fit", campaign="c1")
        assert ours["soil"]["name"] == SCRIPT
        assert ours.pop("curves") and ours == ok("fit", folder, "--choice", saved, "--json").json


def _frames_only(folder: Path) -> list[str]:
    """Replace the recordings of a folder by ones that carry no terrain."""
    from daq.recording import Recording, RecordingWriter

    names = []
    for path in sorted(folder.glob("*.mcap")):
        frames = Recording.open(path).frames()
        path.unlink()
        with RecordingWriter(path) as writer:
            writer.write_frames(frames)
        names.append(path.name)
    return names
