"""Runs that lack a speed or a force on the analyst's page: what is there is drawn, with the report's reason."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from view_client import View, taken_from
from view_in_process import viewing_here

from wheelsoil.workflows import report_of

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
POINTS = {
    "wheel_speed": "rim_speed_mps",
    "ground_speed": "ground_speed_mps",
    "vertical_load": "vertical_load_n",
    "drawbar_pull": "drawbar_pull_n",
    "driving_torque": "driving_torque_nm",
}


def without(folder: Path, *roles: str, runs: int = 1) -> Path:
    """A folder of some runs whose vehicle.toml knows no signal for some roles."""
    taken_from(CLAY, folder, runs)
    vehicle = folder / "vehicle.toml"
    kept = [line for line in vehicle.read_text().splitlines() if line.partition(" =")[0] not in roles]
    vehicle.write_text("\n".join(kept) + "\n")
    return folder


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("missing")


@pytest.fixture(scope="module")
def view(home: Path) -> Iterator[View]:
    """The page on a folder for each role, and one that lacks all."""
    with viewing_here(*(without(home / role, role) for role in POINTS), without(home / "all", *POINTS)) as running:
        running.settled()
        yield running


@pytest.mark.parametrize("role", POINTS)
def test_what_is_there_is_drawn_and_what_is_missing_is_said(view: View, home: Path, role: str) -> None:
    grade = report_of([home / role], diagnose=False).numbers()["sections"]["glance"]["grades"]["run-1"]
    [campaign] = [each for each in view.campaigns() if each["name"] == role]
    key, [run] = campaign["key"], campaign["runs"]
    assert run["state"] == "ready"
    assert run["grade"] == grade["level"] and run["notes"][: len(grade["reasons"])] == grade["reasons"]
    points = view.get(f"/api/run?campaign={key}&run={run['key']}")
    for other, name in POINTS.items():
        values = points[name] or [None]
        assert any(value is not None for value in values) == (other != role)
    has_slip = role not in ("wheel_speed", "ground_speed")
    assert any(points["used"]) == has_slip
    assert any(value is not None for value in points["slip"]) == has_slip
    assert ("slip_not_measured" in points["reason"]) == (not has_slip)
    assert len(points["time_s"]) > 5 * run["duration_s"]
    if role == "driving_torque":
        assert view.post("/api/fit", campaign=key)["models"]
        return
    why = f"{role} is missing; name it under [signals] of vehicle.toml"
    assert run["grade"] == "poor" and run["notes"][0] == why and run["notes"].count(why) == 1
    for path in ("/api/fit", "/api/diagnose"):
        answer = view.tell(path, campaign=key)
        assert answer.status == 400 and answer.faults[0]["what"] == why
        assert answer.faults[0]["next_step"].startswith("correct vehicle.toml")
    answer = view.ask("GET", f"/api/parameters?campaign={key}")
    if role == "drawbar_pull":
        assert answer.status == 200
    else:
        assert answer.status == 422 and answer.faults[0]["what"] == why
    assert view.post("/api/curve", campaign=key, load_n=9e3)["load_n"] == 9e3


def test_without_any_role_a_run_has_failed(view: View) -> None:
    campaign, why = view.campaigns()[-1], "no signal has a role that can be shown"
    [run] = campaign["runs"]
    assert run["state"] == "failed" and why in run["why"]
    assert why in view.tell("/api/fit", campaign=campaign["key"]).faults[0]["what"]
