"""The report: self-contained, complete, robust against missing channels and hostile names."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import invoke, ok
from report_support import cells_of, diagnosed_by_hand, section_of, text_of

from daq.recording import Recording, RecordingWriter
from processing import ProcessOptions
from wheelsoil.report import build_report
from wheelsoil.report.content import Contents
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections import SECTIONS
from wheelsoil.report.sections.glance import _dates, header_facts
from wheelsoil.report.sections.verdict import rank
from wheelsoil.workflows import report_of_processed
from wheelsoil.workflows.fit import FitChoices

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
EVIL = '<script>alert("x")</script></script><b>&{{7*7}}'


class Page(HTMLParser):
    """What a browser would load, and the JSON of every figure."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.scripts: list[dict[str, str | None]] = []
        self.ids: list[str] = []
        self.figures: dict[str, Any] = {}
        self._figure = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        if tag == "script":
            self.scripts.append(found)
            identity = found.get("id") or ""
            self._figure = identity.removeprefix("data-") if identity.startswith("data-") else ""
        self.loads += [found[key] or "" for key in ("src", "data", "srcset") if key in found]
        if tag in ("link", "iframe", "img", "object", "embed", "base", "form"):
            self.loads.append(tag)
        if "id" in found:
            self.ids.append(found["id"] or "")

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self._figure = ""

    def handle_data(self, data: str) -> None:
        if self._figure:
            self.figures[self._figure] = json.loads(data)


def without(material: ReportInputs, **values: float) -> ReportInputs:
    """Return the material with channels that were not measured."""
    runs = tuple(
        replace(run, **{name: np.full(len(run), value) for name, value in values.items()}) for run in material.runs
    )
    return replace(material, runs=runs)


def test_the_page_is_one_file_that_loads_nothing(report):
    text = report.read_text(encoding="utf-8")
    page = Page(text)
    assert page.loads == []
    assert "default-src 'none'" in text
    assert len(page.ids) == len(set(page.ids))
    assert len(text) < 1_500_000


def test_every_section_and_figure_is_there(report):
    page = Page(report.read_text(encoding="utf-8"))
    asked_for = {"against", "cost"}  # of an earlier report, and of a named cause
    assert {section.key for section in SECTIONS} - asked_for <= set(page.ids)
    assert len(page.figures) >= 14
    for key, figure in page.figures.items():
        assert f"plot-{key}" in page.ids
        for axis in ("xaxis", "yaxis"):
            drawn = figure["layout"][axis]
            assert drawn["title"] or drawn.get("order"), key


def test_json_holds_the_numbers_that_are_shown(report):
    numbers = json.loads(report.with_suffix(".json").read_text(encoding="utf-8"))
    text = report.read_text(encoding="utf-8").replace("\u00a0", " ")
    assert numbers["schema"] == "wheelsoil/report/2"
    assert numbers["left_out"] == {}
    sections = numbers["sections"]
    assert sections["glance"]["headline"] in unescape(text)
    assert sections["glance"]["next_step"][1:] in unescape(text)
    figures = Page(text).figures
    assert list(numbers["figures"]) == list(figures)
    for key, figure in figures.items():
        for trace, kept in zip(figure["data"], numbers["figures"][key]["traces"], strict=True):
            assert [kept.get(axis) for axis in "xyz"] == [trace.get(axis) for axis in "xyz"], key
    assert [file["sha256"][:16] in text for file in sections["provenance"]["files"]] == [True, True]
    assert {channel["missing_runs"] for channel in sections["signals"].values()} == {0}
    assert set(sections["criteria"]["models"]) == {"wong", "vasilev", "lyasko", "ding"}
    m0 = sections["criteria"]["models"]["wong"]["criteria"]["dp"]["R0_N"]
    assert m0 > sections["criteria"]["models"]["lyasko"]["criteria"]["dp"]["R0_N"]


def test_the_report_agrees_with_fit(report, campaign):
    fit = ok("fit", campaign, "--json").json
    shown = json.loads(report.with_suffix(".json").read_text(encoding="utf-8"))["sections"]
    for name, model in fit["models"].items():
        assert model["criteria"] == shown["criteria"]["models"][name]["criteria"]
        assert list(model["estimates"].values()) == shown["coefficients"][name]["estimates"]


@pytest.mark.slow
def test_names_from_data_stay_data(campaign, tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    for path in campaign.glob("*.dbc"):
        (folder / path.name).write_bytes(path.read_bytes())
    quoted = json.dumps(EVIL)
    vehicle = (campaign / "vehicle.toml").read_text()
    terrain = (campaign / "terrain.toml").read_text()
    (folder / "vehicle.toml").write_text(re.sub(r'(?m)^name = ".*"', lambda _: f"name = {quoted}", vehicle, count=1))
    (folder / "terrain.toml").write_text(re.sub(r'(?m)^name = ".*"', lambda _: f"name = {quoted}", terrain, count=1))
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "run-1.mcap"\nid = {quoted}\n')
    (folder / "run-1.mcap").write_bytes((campaign / "run-1.mcap").read_bytes())
    page_path = tmp_path / "report.html"
    with diagnosed_by_hand():
        ok("report", folder, "-o", page_path)
    text = page_path.read_text(encoding="utf-8")
    page = Page(text)
    numbers = json.loads(page_path.with_suffix(".json").read_text(encoding="utf-8"))
    plain_scripts = [script for script in page.scripts if script.get("type") != "application/json"]
    assert len(plain_scripts) == 1, "ours"
    assert "<script>alert" not in text
    assert "49" not in numbers["title"], "templates in names are not run"
    assert EVIL in numbers["title"]


def test_without_a_diagnosis_the_best_law_is_beside_wong(material):
    shown, pool = material.recommendation, material.pool
    assert not shown.is_base and shown.title == shown.name != shown.base_name
    np.testing.assert_array_equal(shown.base["dp"], pool.predicted("wong", "drawbar_pull_n"))
    rms = {base: np.nanmean(shown.residual("dp", base=base) ** 2) for base in (False, True)}
    assert rms[False] < rms[True]


def test_the_size_of_each_file_is_shown(material):
    sizes = {f"{source.bytes / 1e6:.2f}" for source in material.sources}
    assert sizes and sizes <= set(cells_of(section_of(build_report(material), "provenance")))


def test_a_tyre_without_a_name_is_not_in_the_head(material):
    runs = tuple(replace(run, run=run.run.model_copy(update={"inflation_kpa": None})) for run in material.runs)
    wheel = material.vehicle.wheel
    for tyre, expected in (("12.5R20", ["12.5R20"]), ("", [])):
        vehicle = material.vehicle.model_copy(update={"wheel": wheel.model_copy(update={"tyre": tyre})})
        facts = header_facts(replace(material, runs=runs, vehicle=vehicle))
        assert [value for label, value in facts if label == "Tyre"] == expected


def test_the_days_of_the_runs_are_said_where_a_clock_was_set() -> None:
    day = 1_714_564_800 * 10**9
    said = {
        "date unknown": [0],
        "1 May 2024, 12:00 UTC": [day],
        "1 May 2024, 12:00 to 13:00 UTC": [day, 0, day + 3600 * 10**9],
    }
    said["1 May 2024 to 2 May 2024"] = [day, day + 86400 * 10**9]
    assert {_dates(starts_ns): starts_ns for starts_ns in said.values()} == said


def test_a_missing_channel_costs_its_section(material):
    report = build_report(without(material, driving_torque_nm=np.nan))
    assert list(report.left_out) == ["torque"]
    assert "driving torque was not measured" in report.left_out["torque"]
    assert "Omitted" in text_of(report, "torque")
    assert "nothing independent checks" in text_of(report, "verdict")


def test_runs_without_forces_still_give_quality_and_provenance(processed):
    stripped = [
        (run, replace(done, drawbar_pull_n=np.full(len(done), np.nan), vertical_load_n=np.full(len(done), np.nan)))
        for run, done in processed
    ]
    report = report_of_processed(stripped, FitChoices(), ProcessOptions())
    kept = {section.key for section in report.sections} - set(report.left_out)
    assert kept == {"glance", "runs", "signals", "quality", "time", "track", "sensors", "provenance"}
    assert "No result" in section_of(report, "glance").blocks[0].text
    assert report.sentence.startswith("no result")
    assert "6 of 6" not in report.html("x.json")


def test_a_fault_in_a_section_costs_only_that_section(material, monkeypatch):
    def broken(given: ReportInputs) -> Contents:
        raise ZeroDivisionError(given.terrain)

    last = replace(SECTIONS[-1], contents=broken)
    monkeypatch.setattr("wheelsoil.report.build.SECTIONS", (*SECTIONS[:-1], last))
    report = build_report(material)
    assert list(report.left_out) == [last.key]
    assert "please report it" in report.left_out[last.key]


def test_the_verdict_knows_a_lead_from_chance(material):
    ranking = rank(material)
    assert ranking.best.name != "wong"
    wong = ranking.rival("wong")
    assert wong is not None and wong.is_worse
    nobody = replace(material, campaign=replace(material.fit, models=(material.fit.model("wong"),) * 2))
    (twin,) = rank(nobody).rivals
    assert not twin.is_worse, "a model has no lead over itself"


def test_the_verdict_has_reservations_about_an_offset(material):
    shifted = tuple(replace(run, drawbar_pull_n=run.drawbar_pull_n - 400.0) for run in material.runs)
    report = build_report(replace(material, runs=shifted))
    assert "look at the transducer&#39;s zero" in report.html("x.json")


def test_literal_reading_shows_the_load_it_carries(campaign, tmp_path):
    page = tmp_path / "literal.html"
    ok("report", campaign / "run-1.mcap", "-o", page, "--sinkage", "literal", "--no-diagnosis")
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))["sections"]["load"]
    assert numbers["quantity"] == "load of Eq. 7 / measured load"
    assert numbers["models"]["lyasko"]["load_ratio"]["highest"] > 1.05


def test_no_slip_above_the_threshold_is_said(campaign, tmp_path):
    page = tmp_path / "high.html"
    ok("report", campaign / "run-1.mcap", "-o", page, "--slip-threshold", 0.99, "--no-diagnosis")
    numbers = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert "no slip at or above the threshold 0.99" in numbers["left_out"]["verdict"]
    assert "coefficients" not in numbers["left_out"]


def test_a_damaged_recording_is_reported_as_such(campaign, tmp_path):
    whole = Recording.open(campaign / "run-1.mcap")
    cut = tmp_path / "cut.mcap"
    with RecordingWriter(cut, run=whole.run, attachments=whole.attachments, chunk_bytes=100_000) as writer:
        writer.write_frames(whole.frames())
    cut.write_bytes(cut.read_bytes()[: int(0.8 * cut.stat().st_size)])
    result = invoke("report", cut, "-o", tmp_path / "r.html", "--json", "--no-diagnosis")
    assert result.code == 0
    assert "wheelsoil recover" in result.err
    numbers = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert numbers["sections"]["provenance"]["files"][0]["loss"]
    assert any("Frames are missing" in check["text"] for check in numbers["sections"]["verdict"]["checks"])


def test_the_page_is_readable_in_black_and_white():
    from wheelsoil.report.figures import STYLES

    assert len({style.dash for style in STYLES.values()}) == len(STYLES)
    assert len({style.symbol for style in STYLES.values()}) == len(STYLES)


def test_output_names(tmp_path: Path, campaign):
    given = ("report", campaign / "run-1.mcap", "-o", tmp_path / "r.html", "--json", "--no-diagnosis")
    (tmp_path / "r.html").write_text("of another report", encoding="utf-8")
    assert invoke(*given).code == 2
    assert (tmp_path / "r.html").read_text(encoding="utf-8") == "of another report"
    result = ok(*given, "--force")
    assert result.json["report"].endswith("r.html")
    assert Path(result.json["numbers"]).is_file()
    assert "of another report" not in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_what_lies_where_the_numbers_would_go_is_kept(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("{}", encoding="utf-8")
    done = invoke("report", CLAY, "--no-diagnosis", "-o", tmp_path / "x.html")
    assert done.code == 2 and "x.json" in done.err and not (tmp_path / "x.html").exists()
    done = invoke("report", CLAY, "--no-diagnosis", "-o", tmp_path / "y.json")
    assert done.code == 2 and ".html or .pdf" in done.err
    assert (tmp_path / "x.json").read_text(encoding="utf-8") == "{}"
