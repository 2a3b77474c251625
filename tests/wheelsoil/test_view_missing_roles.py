"""Runs that lack a speed or a force on the analyst's page: what is there is drawn, with the report's reason."""

from __future__ import annotations

from pathlib import Path

import pytest
from view_client import taken_from, viewing

from wheelsoil.reporting import report_of

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


@pytest.mark.parametrize("role", POINTS)
def test_what_is_there_is_drawn_and_what_is_missing_is_said(tmp_path: Path, role: str) -> None:
    folder = without(tmp_path / "clay", role)
    told = report_of([folder], diagnose=False).numbers()["sections"]["glance"]["grades"]["run-1"]
    with viewing(folder) as view:
        [campaign] = view.settled()
        [run] = campaign["runs"]
        assert run["state"] == "ready"
        assert run["grade"] == told["level"] and run["notes"][: len(told["reasons"])] == told["reasons"]
        points = view.get("/api/run?campaign=c1&run=r1")
        for other, name in POINTS.items():
            values = points[name] or [None]
            assert any(value is not None for value in values) == (other != role)
        has_slip = role not in ("wheel_speed", "ground_speed")
        assert any(points["used"]) == has_slip
        assert any(value is not None for value in points["slip"]) == has_slip
        assert ("slip_not_measured" in points["reason"]) == (not has_slip)
        assert len(points["time_s"]) > 5 * run["duration_s"]
        if role == "driving_torque":
            assert view.post("/api/fit", campaign="c1")["models"]
            return
        why = f"{role} is missing; name it under [signals] of vehicle.toml"
        assert run["grade"] == "poor" and run["notes"][0] == why and run["notes"].count(why) == 1
        for path in ("/api/fit", "/api/diagnose"):
            answer = view.tell(path, campaign="c1")
            assert answer.status == 400 and answer.faults[0]["what"] == why
        answer = view.ask("GET", "/api/parameters?campaign=c1")
        if role == "drawbar_pull":
            assert answer.status == 200
        else:
            assert answer.status == 422 and answer.faults[0]["what"] == why
        assert view.post("/api/curve", campaign="c1", load_n=9e3)["load_n"] == 9e3


def test_without_any_role_a_run_has_failed(tmp_path: Path) -> None:
    with viewing(without(tmp_path / "clay", *POINTS)) as view:
        [campaign] = view.settled()
        [run] = campaign["runs"]
        assert run["state"] == "failed" and "no signal has a role that can be shown" in run["why"]
