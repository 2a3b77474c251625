"""Reports of recordings that lack something, of one run and of fifty: each gets its reason, the rest is there."""

from __future__ import annotations

import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from diagnosis_samples import diagnosis
from report_support import cells_of, diagnosed_by_hand, section_of

from daq import ConfigError
from daq.runs import SetAsideRun
from processing import ProcessedRun
from wheelsoil.report import Report, build_report
from wheelsoil.report.content import texts_of
from wheelsoil.report.sections.overview import _shown_runs
from wheelsoil.workflows import Files, report_of

MOST_BYTES = 12_000_000
ROLES = {"position and clock": ("latitude", "longitude", "gnss_time")}
SHOWN = ("wheel_speed", "ground_speed", "ground_speed_valid", "vertical_load", "drawbar_pull", "driving_torque")


def campaign_without(campaign: Path, folder: Path, *roles: str) -> Path:
    """Return a copy of a campaign's first run whose vehicle.toml does not name some signals."""
    folder.mkdir()
    for path in campaign.iterdir():
        if path.suffix in (".dbc", ".toml") or path.name == "run-1.mcap":
            (folder / path.name).write_bytes(path.read_bytes())
    vehicle = (folder / "vehicle.toml").read_text()
    for role in roles:
        vehicle = re.sub(rf"(?m)^{role} = .*\n", "", vehicle)
        vehicle = re.sub(rf"(?m)^\[sensors\.{role}\]\n(?:\w.*\n)*", "", vehicle)
    (folder / "vehicle.toml").write_text(vehicle)
    (folder / "runs.toml").write_text('[[run]]\nfile = "run-1.mcap"\nid = "only"\n')
    return folder


@pytest.mark.parametrize(
    ("lacking", "left_out", "reason"),
    [
        ("position and clock", {"track"}, "no run has latitude and longitude"),
    ],
)
def test_what_is_missing_costs_its_section(campaign, tmp_path, lacking, left_out, reason):
    folder = campaign_without(campaign, tmp_path / "c", *ROLES[lacking])
    found = ok("report", folder, "-o", tmp_path / "r.html", "--no-diagnosis", "--json").json
    assert set(found["left_out"]) == left_out
    assert all(reason in why for why in found["left_out"].values())
    assert f"{reason}." in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_without_any_signal_there_is_no_report_but_a_reason(campaign, tmp_path):
    folder = campaign_without(campaign, tmp_path / "c", *SHOWN)
    result = invoke("report", folder, "-o", tmp_path / "r.html", "--no-diagnosis")
    assert result.code == 2
    assert "no signal has a role that can be shown" in result.err and "vehicle.toml" in result.err


@pytest.mark.parametrize("made_by_hand", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_one_run_has_every_section_but_no_choice_of_runs(campaign, made_by_hand):
    found = replace(diagnosis("named"), gain=None)
    with diagnosed_by_hand(found) if made_by_hand else nullcontext():
        report = report_of([campaign / "run-1.mcap"])
    assert report.left_out == {}
    section = next(section for section in report.sections if section.key == "gain")
    assert "at least two runs" in " ".join(texts_of(section))


def test_a_run_without_a_usable_sample_is_poor_and_named_first(material):
    nothing = np.full(len(material.runs[0]), 5, np.uint8)
    report = build_report(replace(material, runs=(replace(material.runs[0], reason=nothing), *material.runs[1:])))
    glance = report.numbers()["sections"]["glance"]
    assert glance["grades"]["run-1"]["level"] == "poor"
    assert glance["next_step"].startswith("Look at data quality first; run-1 is poor")


ASIDE = (
    SetAsideRun("run-9", "unreadable", "the file is empty", "drive it again"),
    SetAsideRun("run-8", "switched_off", "switched off in choice.toml", "say use = true"),
)


def test_runs_that_are_set_aside_are_counted_named_and_listed(material):
    report = build_report(replace(material, set_aside=ASIDE))
    numbers = report.numbers()
    assert report.head.badge == ("fair", "▲ 2 of 4 runs used") and ("Runs", "4") in report.head.facts
    assert numbers["runs_set_aside"] == [run.facts() for run in ASIDE]
    assert "run-9; the reasons stand under Runs." in numbers["texts"]["glance"]
    assert any("run-9: the file is empty. Next: drive it again." in text for text in numbers["texts"]["quality"])
    cells = cells_of(section_of(report, "runs"))
    assert cells[cells.index("run-9") + 1] == "✕ set aside" and cells[cells.index("run-8") + 1] == "– set aside"
    assert "the file is empty. Next: drive it again" in cells
    assert build_report(material).numbers()["runs_set_aside"] == []


def test_a_run_that_is_switched_off_is_not_driven_again(material):
    glance = build_report(replace(material, set_aside=ASIDE[1:])).numbers()["texts"]["glance"]
    assert "none. Set aside: run-8; the reasons stand under Runs." in glance


def test_the_worst_runs_of_many_are_shown():
    levels = ["good"] * 98 + ["poor", "fair"]
    assert _shown_runs(levels) == [*range(38), 98, 99] and _shown_runs(levels[:3]) == [0, 1, 2]


@pytest.mark.slow
def test_fifty_runs_are_one_page_of_bearable_size(material, tmp_path):
    copies = 25
    runs = tuple(_renamed(run, i, k) for k in range(copies) for i, run in enumerate(material.runs))
    models = tuple(replace(m, predictions=m.predictions * copies) for m in material.fit.models)
    report = build_report(replace(material, runs=runs, campaign=replace(material.fit, models=models)))
    assert report.left_out == {}
    page, _ = report.write(tmp_path / "fifty.html")
    assert page.stat().st_size < MOST_BYTES
    assert len(report.numbers()["sections"]["glance"]["grades"]) == 50
    assert {trace["shown_for"] for trace in _drawn(report, "slip-driving")} == {"all runs", *(r.run.id for r in runs)}


def test_two_soils_are_refused_before_the_work(tmp_path):
    recordings = Path(__file__).parents[2] / "recordings"
    absent = Files(zero=tmp_path / "absent.toml")  # where work begins, this file is missed
    with pytest.raises(ConfigError, match="of different soils"):
        report_of([recordings / "clay" / "run-1.mcap", recordings / "sandy" / "run-1.mcap"], files=absent)


def test_runs_of_one_name_are_distinguished(campaign, tmp_path):
    shutil.copytree(campaign, tmp_path / "other")
    (tmp_path / "other" / "runs.toml").write_text('[[run]]\nfile = "run-2.mcap"\nid = "run-1"\n')
    report = report_of([campaign / "run-1.mcap", tmp_path / "other"], diagnose=False)
    names = ["run-1", "run-1-2"]
    assert list(report.numbers()["sections"]["glance"]["grades"]) == names
    assert {trace["shown_for"] for trace in _drawn(report, "time-dp")} == set(names)


def test_a_pdf_needs_a_browser(campaign, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    result = invoke("report", campaign, "-o", tmp_path / "r.pdf")
    assert result.code == 2
    assert "no browser that can create a PDF" in result.err and "apt-get install chromium" in result.err
    assert not (tmp_path / "r.pdf").exists()


def test_a_browser_that_makes_no_pdf_is_reported(campaign, tmp_path, monkeypatch):
    browser = tmp_path / "chromium"
    browser.write_text("#!/bin/sh\necho 'cannot open display' >&2\nexit 1\n")
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    nothing_to_fit = campaign_without(campaign, tmp_path / "c", "vertical_load", "drawbar_pull", "driving_torque")
    result = invoke("report", nothing_to_fit, "-o", tmp_path / "r.pdf", "--no-diagnosis")
    assert result.code == 1
    assert "the browser created no PDF" in result.err and "cannot open display" in result.err


@pytest.mark.parametrize(("name", "form"), [("r.html", "pdf"), ("r.pdf", "html")])
def test_a_format_and_a_name_that_differ_are_refused(campaign, tmp_path, name, form):
    result = invoke("report", campaign, "-o", tmp_path / name, "--format", form)
    assert result.code == 2 and "contradicts" in result.err


def _renamed(run: ProcessedRun, index: int, copy: int) -> ProcessedRun:
    return replace(run, run=run.run.model_copy(update={"id": f"run {copy}.{index}"}))


def _drawn(report: Report, key: str) -> list[dict[str, object]]:
    return report.numbers()["figures"][key]["traces"]
