"""The analyst's page strikes out a run that is impossible as it is declared, says why, and fits the others."""

from __future__ import annotations

import shutil
from pathlib import Path

from view_in_process import viewing_here


def test_a_refused_run_is_struck_out_and_not_fitted(campaign: Path, tmp_path: Path) -> None:
    for name in ("run-1.mcap", "terrain.toml"):
        shutil.copy(campaign / name, tmp_path)
    text = (campaign / "vehicle.toml").read_text(encoding="utf-8")
    (tmp_path / "vehicle.toml").write_text(text.replace('"WFT_Forces.Fx"', '"-WFT_Forces.Fx"'), encoding="utf-8")
    with viewing_here(tmp_path) as view:
        view.settled()
        [found] = view.campaigns()
        for run in found["runs"]:
            assert run["state"] == "ready" and run["grade"] == "poor"
            assert "drawbar pull seems to have the wrong sign" in run["refused"]
            assert run["refused"] in run["notes"]
        answer = view.tell("/api/fit", campaign=found["key"])
        assert answer.status == 400 and "impossible as it is declared" in answer.faults[0]["what"]
        answer = view.tell("/api/curve", campaign=found["key"])
        assert answer.status == 422 and found["runs"][0]["refused"] in answer.faults[0]["what"]


def test_a_run_on_firm_ground_that_hardly_coasts_is_struck_out_and_no_other(campaign: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(campaign, tmp_path / "clay")
    listed = (folder / "runs.toml").read_text(encoding="utf-8")
    (folder / "runs.toml").write_text(listed.replace("[[run]]\n", '[[run]]\nground = "firm"\n', 1), encoding="utf-8")
    with viewing_here(folder) as view:
        view.settled()
        [found] = view.campaigns()
        firm, *others = found["runs"]
        assert firm["refused"].startswith(
            "a run on firm ground that hardly coasts shows no rolling radius; where: run run-1; "
        )
        assert "mean torque while it turned" in firm["refused"] and firm["refused"].endswith("of a run on soil")
        assert all(run["refused"] is None and run["on_soil"] for run in others) and not firm["on_soil"]
        drawn = [view.get(f"/api/run?campaign={found['key']}&run={run['key']}") for run in (firm, others[0])]
        assert [any(run["used"]) for run in drawn] == [False, True]
        assert drawn[0]["shares"]["set_aside"] > 0.5 and "set_aside" not in drawn[1]["shares"]
        asked = {"campaign": found["key"], "kind": "reason", "code": "set_aside"}
        counted = [view.post("/api/selected", run=run["key"], **asked)["samples"] for run in (firm, others[0])]
        assert counted[0] > 0 == counted[1]
        assert view.post("/api/fit", campaign=found["key"])["models"]
