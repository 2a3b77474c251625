"""Recordings that lack something on the analyst's page: each says why, and the others are as good as ever."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cli_support import ok
from view_client import View, taken_from
from view_in_process import viewing_here

from wheelsoil.view.campaigns import open_campaigns
from wheelsoil.workflows import Files, report_of

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"
SCRIPT = '<script>alert("1")</script>'
LACKING = {
    "no torque": ("driving_torque",),
    "no forces": ("vertical_load", "drawbar_pull", "driving_torque"),
    "no position": ("latitude", "longitude", "course"),
}


def without(folder: Path, *roles: str) -> Path:
    """A folder of one run whose vehicle.toml knows no signal for some roles."""
    taken_from(CLAY, folder, 1)
    vehicle = folder / "vehicle.toml"
    kept = [line for line in vehicle.read_text().splitlines() if line.partition(" =")[0] not in roles]
    vehicle.write_text("\n".join(kept) + "\n")
    return folder


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("poor")


@pytest.fixture(scope="module")
def view(home: Path) -> Iterator[View]:
    """The page on all of them."""
    folders = [without(home / name, *roles) for name, roles in LACKING.items()]
    folders += [make(home) for make in (_no_soil, _damaged, _two_terrains, _markup)]
    folders += [taken_from(CLAY, home / name, 1) for name in ("a", "b")]
    with viewing_here(*folders, taken_from(CLAY, home / "one run", 2) / "run-1.mcap") as running:
        running.settled()
        yield running


def campaign_of(view: View, name: str) -> dict[str, Any]:
    """The campaign of a name, as the list has it."""
    [found] = [campaign for campaign in view.campaigns() if campaign["name"] == name]
    return found


def only(campaign: dict[str, Any]) -> dict[str, Any]:
    """The one run of a campaign."""
    [run] = campaign["runs"]
    return dict(run)


def points_of(view: View, campaign: dict[str, Any]) -> dict[str, Any]:
    """What is drawn of a campaign's first run."""
    found: dict[str, Any] = view.get(f"/api/run?campaign={campaign['key']}&run={campaign['runs'][0]['key']}")
    return found


def test_a_recording_without_torque_is_drawn_and_fitted_without_it(view: View) -> None:
    campaign = campaign_of(view, "no torque")
    key = campaign["key"]
    assert only(campaign)["state"] == "ready"
    points = points_of(view, campaign)
    assert points["driving_torque_nm"] is None and len(points["slip"]) > 100
    reasons = {e["key"]: e["why_not"] for e in view.get(f"/api/parameters?campaign={key}")["effects"]}
    assert "torque" in reasons["torque_zero"]
    assert set(view.post("/api/fit", campaign=key)["models"]) == {"wong", "vasilev", "lyasko", "ding"}
    view.post("/api/choose", campaign=key, choice={"channels": ["dp", "t"]})
    answer = view.tell("/api/fit", campaign=key)
    assert answer.status == 400 and "driving_torque" in answer.faults[0]["what"]


def test_a_recording_without_forces_is_drawn_and_says_why_no_model_is(view: View) -> None:
    campaign = campaign_of(view, "no forces")
    assert only(campaign)["state"] == "ready"
    points = points_of(view, campaign)
    assert any(points["used"]) and set(points["drawbar_pull_n"]) == {None}
    answer = view.ask("GET", f"/api/parameters?campaign={campaign['key']}")
    assert answer.status == 422 and "load" in answer.faults[0]["what"]
    answer = view.tell("/api/fit", campaign=campaign["key"])
    assert answer.status in (400, 422) and answer.faults


def test_a_recording_without_position_is_as_good_as_any(view: View) -> None:
    campaign = campaign_of(view, "no position")
    assert only(campaign)["state"] == "ready"
    known = [x for x in points_of(view, campaign)["distance_m"] if x is not None]
    assert known[-1] > 1
    assert view.get(f"/api/parameters?campaign={campaign['key']}")["complete"]


def test_a_recording_whose_soil_is_not_known_says_so(view: View) -> None:
    campaign = campaign_of(view, "no soil")
    key = campaign["key"]
    assert only(campaign)["state"] == "ready"
    for answer in (view.ask("GET", f"/api/parameters?campaign={key}"), view.tell("/api/fit", campaign=key)):
        assert answer.status == 400 and "soil is not known" in answer.faults[0]["what"]


def test_a_soil_that_is_given_stands_in_but_nothing_does_for_a_wheel(tmp_path: Path) -> None:
    soil, wheel = _no_soil(tmp_path), tmp_path / "no wheel"
    shutil.copytree(soil, wheel)
    text = (wheel / "vehicle.toml").read_text()
    (wheel / "vehicle.toml").write_text(re.sub(r"\[wheel\].*?\n\n", "", text, flags=re.DOTALL))
    with viewing_here(soil, wheel, soil="sandy") as view:
        known, unknown = view.settled()
        assert known["terrain"] == "sandy"
        assert view.get("/api/parameters?campaign=c1")["soil"][0]["value"] == 1000
        assert only(unknown)["state"] == "failed" and "wheel" in only(unknown)["why"]
        assert view.tell("/api/curve", campaign="c2", load_n=9e3).status == 400


def test_a_damaged_recording_costs_itself(view: View) -> None:
    campaign = campaign_of(view, "damaged")
    [remark] = view.get("/api/list")["remarks"]
    assert "run-3.mcap" in remark
    assert [run["state"] for run in campaign["runs"]] == ["ready", "ready"]
    assert campaign["runs"][1]["grade"] != "good"
    assert any("damaged" in note or "end" in note for note in campaign["runs"][1]["notes"])


def test_the_grade_is_that_of_the_report(view: View, home: Path) -> None:
    campaign = campaign_of(view, "damaged")
    paths = [home / "damaged" / name for name in ("run-1.mcap", "run-2.mcap")]
    graded = report_of(paths, diagnose=False).numbers()["sections"]["glance"]["grades"]
    assert {run["id"]: run["grade"] for run in campaign["runs"]} == {run: said["level"] for run, said in graded.items()}
    for run in campaign["runs"]:
        assert run["notes"][: len(graded[run["id"]]["reasons"])] == graded[run["id"]]["reasons"]


def test_one_run_of_a_file_is_a_campaign(view: View, home: Path) -> None:
    campaign = campaign_of(view, "one run")
    key = campaign["key"]
    assert [run["id"] for run in campaign["runs"]] == ["run-1"]
    assert campaign["path"] == str(home / "one run")
    assert view.post("/api/fit", campaign=key)["models"]["lyasko"]["samples"] > 0
    reasons = {e["key"]: e["why_not"] for e in view.get(f"/api/parameters?campaign={key}")["effects"]}
    assert "one run" in reasons["zero_drift"]


def test_two_terrains_in_one_folder_are_two_campaigns(view: View, home: Path) -> None:
    clay, sandy = campaign_of(view, "field, clay"), campaign_of(view, "field, sandy")
    assert (clay["terrain"], sandy["terrain"]) == ("clay", "sandy")
    assert [run["file"] for run in sandy["runs"]] == ["sandy-1.mcap", "sandy-2.mcap"]
    choice = {"run": [{"id": sandy["runs"][0]["id"], "keep": [[5, 30]]}]}
    view.post("/api/choose", campaign=sandy["key"], choice=choice)
    ours = view.post("/api/fit", campaign=sandy["key"])
    assert ours["soil"]["name"] == "sandy"
    saved = view.post("/api/save", campaign=sandy["key"], name="choice.toml")["path"]
    found = ok("fit", home / "field", "--choice", saved, "--json").json
    assert {run["cause"] for run in found.pop("runs_set_aside")} == {"switched_off"}
    assert ours.pop("curves") and ours == found
    of_the_other = f"/api/run?campaign={clay['key']}&run={sandy['runs'][0]['key']}"
    assert view.ask("GET", of_the_other).status == 404
    (clay_again, sandy_again), _ = open_campaigns([home / "field"], Files())
    assert clay_again.saved_at is None and not clay_again.choice.runs
    assert str(sandy_again.saved_at) == saved and sandy_again.choice.runs[0].keep == ((5.0, 30.0),)


def test_a_choice_is_of_its_folder_where_another_has_a_run_of_that_name(view: View) -> None:
    first, second = (campaign_of(view, name) for name in ("a", "b"))
    assert only(first)["id"] == only(second)["id"] == "run-1"
    view.post("/api/choose", campaign=second["key"], choice={"run": [{"id": "run-1", "keep": [[5, 9]]}]})
    shares = [points_of(view, campaign)["shares"] for campaign in (first, second)]
    assert "by_hand" not in shares[0] and shares[1]["by_hand"] > 0.5


def test_a_run_that_is_named_twice_is_there_once(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    [campaign], _ = open_campaigns([folder / "run-2.mcap", folder, folder], Files())
    assert [run.run.id for run in campaign.runs] == ["run-1", "run-2"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 'wheelsoil/choice/1'\nslip_threshold = 7", "slip_threshold"),
        ("schema = 'wheelsoil/choice/1'\n[[run]]\nid = 'nobody'", "nobody"),
        ("no toml at all", "TOML"),
    ],
)
def test_a_choice_in_the_folder_that_is_wrong_is_reported_and_left_alone(tmp_path: Path, text: str, said: str) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 1)
    (folder / "choice.toml").write_text(text)
    [campaign], [remark] = open_campaigns([folder], Files())
    assert "choice.toml" in remark and said in remark
    assert campaign.choice.to_mapping() == {"schema": "wheelsoil/choice/1"}


def test_a_recording_that_was_changed_since_the_choice_is_noticed(tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    digest = "0" * 64
    (folder / "choice.toml").write_text(
        f"schema = 'wheelsoil/choice/1'\n[[run]]\nid = 'run-1'\nfile = 'run-1.mcap'\nsha256 = '{digest}'\nuse = true\n"
    )
    [campaign], [remark] = open_campaigns([folder], Files())
    assert "another recording" in remark
    assert campaign.saved_at == folder / "choice.toml"


def test_names_stay_data(view: View, home: Path) -> None:
    campaign = campaign_of(view, "<i>folder")
    key = campaign["key"]
    answer = view.ask("GET", "/api/list")
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert campaign["vehicle"] == campaign["terrain"] == only(campaign)["id"] == SCRIPT
    assert only(campaign)["state"] == "ready"
    view.post("/api/choose", campaign=key, choice={"run": [{"id": SCRIPT, "keep": [[5, 30]]}]})
    saved = view.post("/api/save", campaign=key, name="<b>.toml")["path"]
    ours = view.post("/api/fit", campaign=key)
    assert ours["soil"]["name"] == SCRIPT
    assert ours.pop("curves") and ours == ok("fit", home / "<i>folder", "--choice", saved, "--json").json


def _no_soil(home: Path) -> Path:
    """The recordings carry no terrain, and no terrain.toml lies beside them."""
    folder = taken_from(CLAY, home / "no soil", 1)
    _frames_only(folder)
    (folder / "terrain.toml").unlink()
    return folder


def _damaged(home: Path) -> Path:
    """The second recording is cut off, the third is none."""
    folder = taken_from(CLAY, home / "damaged", 2)
    (folder / "run-3.mcap").write_bytes(b"no recording at all")
    whole = (folder / "run-2.mcap").read_bytes()
    (folder / "run-2.mcap").write_bytes(whole[: len(whole) // 2])
    return folder


def _two_terrains(home: Path) -> Path:
    folder = home / "field"
    folder.mkdir()
    for source, name in ((CLAY, "clay"), (SANDY, "sandy")):
        for number in (1, 2):
            shutil.copy(source / f"run-{number}.mcap", folder / f"{name}-{number}.mcap")
    return folder


def _markup(home: Path) -> Path:
    """Every name is markup."""
    folder = taken_from(CLAY, home / "<i>folder", 1)
    image = "<img src=x onerror=alert(1)>.mcap"
    (folder / "run-1.mcap").rename(folder / image)
    for name, key in (("vehicle.toml", 'name = "virtual test vehicle"'), ("terrain.toml", 'name = "clay"')):
        text = (folder / name).read_text()
        assert key in text
        (folder / name).write_text(text.replace(key, f"name = {json.dumps(SCRIPT)}"))
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "{image}"\nid = {json.dumps(SCRIPT)}\n')
    return folder


def _frames_only(folder: Path) -> None:
    """Replace the recordings of a folder by ones that carry no terrain."""
    from daq.recording import Recording, RecordingWriter

    for path in sorted(folder.glob("*.mcap")):
        frames = Recording.open(path).frames()
        path.unlink()
        with RecordingWriter(path) as writer:
            writer.write_frames(frames)
