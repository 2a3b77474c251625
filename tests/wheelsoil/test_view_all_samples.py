"""What the analyst's page counts, averages and grades is of all samples, not of the points that it draws."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from view_client import View, taken_from

from processing import ProcessedRun, ProcessOptions, Reason, keep_only
from wheelsoil.workflows import open_and_process, report_of

ROOT = Path(__file__).parents[2]
KEEP = [[0.0, 13.0]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(ROOT / "recordings" / "sandy", tmp_path_factory.mktemp("all") / "sandy", 2)


@pytest.fixture(scope="module")
def runs(folder: Path) -> list[ProcessedRun]:
    return [run for _, run in open_and_process([folder], ProcessOptions())]


@pytest.fixture(autouse=True)
def _nothing_chosen(view: View) -> Iterator[None]:
    view.post("/api/choose", campaign="c1", choice={})
    yield


def selected(view: View, **asked: Any) -> dict[str, Any]:
    found: dict[str, Any] = view.post("/api/selected", campaign="c1", run="r1", **asked)
    return found


@pytest.mark.parametrize(("low", "high"), [(10.0, 15.0), (20.0, 25.0), (0.0, 60.0)])
def test_a_stretch_of_time_has_the_mean_of_its_samples(
    view: View, runs: list[ProcessedRun], low: float, high: float
) -> None:
    run = runs[0]
    rows = (run.time_s >= low) & (run.time_s <= high)
    said = selected(view, kind="time", low=low, high=high)
    assert (said["samples"], said["of"]) == (rows.sum(), len(run))
    assert said["seconds"] == pytest.approx(rows.sum() / 100) and said["left_out"] == (rows & ~run.used).sum()
    assert said["drawbar_pull_n"] == pytest.approx(run.drawbar_pull_n[rows & run.used].mean(), rel=1e-5)
    assert said["slip"] == pytest.approx([np.nanmin(run.slip[rows]), np.nanmax(run.slip[rows])])
    used = selected(view, kind="time", low=low, high=high, left_out=False)
    assert used["samples"] == (rows & run.used).sum() and used["left_out"] == 0


@pytest.mark.parametrize("channel", ["drawbar_pull_n", "driving_torque_nm", "rim_speed_mps"])
def test_a_box_over_slip_holds_the_samples_inside(view: View, runs: list[ProcessedRun], channel: str) -> None:
    run = runs[0]
    values = run.wheel_radius_m * run.wheel_speed_radps if channel.startswith("rim") else getattr(run, channel)
    bottom, top = np.percentile(values[run.used], [20, 70])
    rows = (run.slip >= -0.2) & (run.slip <= 0.7) & (values >= bottom) & (values <= top)
    said = selected(view, kind="slip", low=-0.2, high=0.7, channel=channel, bottom=bottom, top=top)
    assert said["samples"] == pytest.approx(rows.sum(), abs=1) and said["samples"] > 50


def test_a_reason_is_counted_and_has_the_share_of_the_report(view: View, runs: list[ProcessedRun]) -> None:
    shares = view.get("/api/run?campaign=c1&run=r1")["shares"]
    assert shares == {why.lower(): share for why, share in runs[0].quality.shares.items() if why != "USED"}
    assert len(shares) > 2
    for code in shares:
        rows = runs[0].reason == Reason[code.upper()]
        assert selected(view, kind="reason", code=code)["samples"] == rows.sum() > 0
        assert code in view.get("/api/run?campaign=c1&run=r1")["reason"]
    assert selected(view, kind="reason", code="nonsense")["samples"] == 0


def test_a_cut_counts_at_once(view: View, runs: list[ProcessedRun]) -> None:
    view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "keep": KEEP}]})
    kept = keep_only(runs[0], [(0.0, 13.0)])
    said = selected(view, kind="time", low=0, high=99, left_out=False)
    assert said["samples"] == kept.used.sum()
    by_hand = view.get("/api/run?campaign=c1&run=r1")["shares"]["by_hand"]
    assert by_hand == (kept.reason == Reason.BY_HAND).mean()


@pytest.mark.parametrize("keep", [None, KEEP])
def test_curves_stand_on_the_medians_of_all_used_samples(
    view: View, runs: list[ProcessedRun], keep: list[list[float]] | None
) -> None:
    used = runs
    if keep is not None:
        view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "keep": keep}]})
        used = [keep_only(runs[0], [(0.0, 13.0)]), runs[1]]
    base = view.get("/api/parameters?campaign=c1")["base"]
    for name in ("load_n", "ground_speed_mps"):
        quantity = name.replace("load_n", "vertical_load_n")
        median = np.median(np.concatenate([getattr(run, quantity)[run.used] for run in used]))
        assert base[name] == pytest.approx(median, rel=1e-6)


@pytest.mark.parametrize("use", [True, False])
def test_a_run_s_curve_stands_on_its_own_load(view: View, runs: list[ProcessedRun], use: bool) -> None:
    view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "use": use, "keep": KEEP}]})
    kept = [keep_only(runs[0], [(0.0, 13.0)]) if use else runs[0], runs[1]]
    for key, run in zip(("r1", "r2"), kept, strict=True):
        load_n = np.median(run.vertical_load_n[run.used])
        assert view.post("/api/curve", campaign="c1", run=key)["load_n"] == pytest.approx(load_n, rel=1e-6)
        assert view.post("/api/curve", campaign="c1", run=key, load_n=7e3)["load_n"] == 7e3
    assert (
        view.post("/api/curve", campaign="c1", run="nix")["load_n"] == view.post("/api/curve", campaign="c1")["load_n"]
    )


@pytest.mark.parametrize("keep", [KEEP, [[0.0, 4.0]]])
def test_grade_and_usable_share_of_a_cut_run_are_those_of_the_report(
    view: View, folder: Path, keep: list[list[float]]
) -> None:
    choice = {"run": [{"id": "run-1", "keep": keep}, {"id": "run-2", "keep": KEEP}]}
    view.post("/api/choose", campaign="c1", choice=choice)
    from wheelsoil.workflows import parse_choice

    graded = report_of([folder], choice=parse_choice({"schema": "wheelsoil/choice/1", **choice}), diagnose=False)
    said = graded.numbers()["sections"]["glance"]["grades"]
    for run in view.campaigns()[0]["runs"]:
        theirs = said[run["id"]]
        assert run["grade"] == theirs["level"] and run["notes"][: len(theirs["reasons"])] == theirs["reasons"]
        assert run["usable_share"] == theirs.get("usable_share", run["usable_share"])


@pytest.mark.parametrize(
    "asked",
    [
        {},
        {"kind": "all"},
        {"kind": "time", "low": "1"},
        {"kind": "slip", "channel": "reason"},
        {"kind": "time", "left_out": 1},
        {"kind": "time", "surprise": 1},
    ],
    ids=str,
)
def test_a_selection_that_cannot_be_is_a_fault(view: View, asked: dict[str, Any]) -> None:
    answer = view.tell("/api/selected", campaign="c1", run="r1", **asked)
    assert answer.status == 400 and answer.faults
    assert view.tell("/api/selected", campaign="c1", run="r9", kind="time").status == 404


def test_a_comparison_has_the_medians_of_all_used_samples(view: View, runs: list[ProcessedRun]) -> None:
    view.post("/api/choose", campaign="c1", choice={"run": [{"id": "run-1", "keep": KEEP}]})
    both = [keep_only(runs[0], [(0.0, 13.0)]), runs[1]]
    told = view.get("/api/compare?campaign=c1&run=&campaign_b=c1&run_b=r2")
    for group, members in zip(told["groups"], (both, runs[1:]), strict=True):
        slip, pull, load = (
            np.concatenate([getattr(run, name)[run.used] for run in members])
            for name in ("slip", "drawbar_pull_n", "vertical_load_n")
        )
        assert group["runs"] == len(members) and group["load_n"] == pytest.approx(np.median(load), rel=1e-6)
        i = int(np.argmin(np.abs(np.array(told["slip"]) - 0.275)))
        inside = (slip >= 0.25) & (slip < 0.3)
        assert group["curves"]["drawbar_pull_n"][i] == pytest.approx(np.median(pull[inside]), rel=1e-5)


def test_marks_and_comments_cost_no_diagnosis_and_no_fit(view: View) -> None:
    view.post("/api/choose", campaign="c1", choice={"slip_threshold": 0.3})
    view.post("/api/diagnose", campaign="c1")
    marks = [{"at_s": 3.0, "text": "here"}]
    entry = view.post(
        "/api/choose",
        campaign="c1",
        choice={"slip_threshold": 0.3, "comment": "wet", "run": [{"id": "run-1", "marks": marks}]},
    )
    assert entry["diagnosis"]["state"] in ("running", "done") and entry["choice"]["run"][0]["marks"] == marks
    assert view.post("/api/cancel", campaign="c1")["diagnosis"]["state"] in ("none", "done")
