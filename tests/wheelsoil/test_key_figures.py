"""A quantity has one key, one value and one text on the report, the page, the terminal, a notebook and in the JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args
from unittest.mock import patch

import numpy as np
import pytest
from diagnosis_samples import diagnosis
from report_support import material_of, processed_of

from daq import FloatArray, Note, Severity
from model import DiagnosisCode, ExtendedModel
from model.diagnosis import Cause, ParameterEstimate
from model.diagnosis.core.result import Verdict
from wheelsoil.fleet import Source
from wheelsoil.fleet.rows import Found, tables_of
from wheelsoil.notebook import diagnosis_html
from wheelsoil.report import build_report
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.overview import _traction_tiles
from wheelsoil.to_json import plain
from wheelsoil.view.jobs import shown_of
from wheelsoil.view.medians import compared
from wheelsoil.wording import figures
from wheelsoil.wording.cost_text import cost_meaning, cost_rows, cost_sentence
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.diagnosis_text import diagnosis_lines
from wheelsoil.wording.figures import figure_value
from wheelsoil.workflows import cause_cost, wheel_of
from wheelsoil.workflows.cause_cost import CausesCost, Driving, cost_of_verdict, highest_slip_of, usual_driving
from wheelsoil.workflows.key_figures import KeyFigure, figure_of_cost, figures_of_diagnosis, figures_of_traction
from wheelsoil.workflows.traction import pull_at, traction_of

GATE = ("named", "nothing_detectable")
GROUND = {"pull_at_slip_0.2", "drawbar_coefficient_at_slip_0.2", "drawbar_coefficient"}


class Keyed(HTMLParser):
    """Keys, unrounded values and texts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: dict[str, set[tuple[float, str]]] = {}
        self._open: tuple[str, float] | None = None
        self.feed(page)

    def handle_starttag(self, _: str, attributes: list[tuple[str, str | None]]) -> None:
        said = dict(attributes)
        if said.get("data-key"):
            self._open = (str(said["data-key"]), float(said["data-value"] or "nan"))

    def handle_data(self, data: str) -> None:
        if self._open is not None:
            key, value = self._open
            self.found.setdefault(key, set()).add(
                (value, data.replace("\u00a0", " ").removesuffix(" %"))
            )  # a tile writes its unit small
            self._open = None


@pytest.fixture(scope="module")
def material(campaign) -> ReportInputs:
    return material_of(processed_of(campaign))


def cost(material: ReportInputs) -> CausesCost:
    """Return what the named cause costs on the material's runs."""
    fit = material.fit
    return cost_of_verdict(
        diagnosis(),
        usual_driving(material.fitted),
        wheel_of(material.vehicle),
        fit.soil,
        fit.options.reading,
        highest_slip=highest_slip_of(material.fitted),
    )


def required(verdict: str) -> set[str]:
    """Return what every surface has to show of a verdict."""
    errors = {f"error.{channel}.calibrated_soil" for channel in ("dp", "t")}
    if verdict in ("named", "one_of"):
        errors |= {f"error.{channel}.with_causes" for channel in ("dp", "t")} | {"cause.slip_sinkage.H_m"}
    return errors | (set() if verdict == "unexplained" else {"candidate.slip_sinkage", "candidate.bulldozing"})


@pytest.mark.parametrize(("verdict", "said"), [("one_of", "torque gain, crosstalk or speed bias"), ("named", "")])
def test_a_measured_efficiency_says_which_errors_are_in_it(material: ReportInputs, verdict: Verdict, said: str) -> None:
    """That of the recommended model has none of them."""
    found = diagnosis(verdict)
    names = ("torque_gain", "load_gain", "crosstalk", "speed_bias")
    errors = [replace(found.causes[0], name=n, key=n, form="", kind="measurement", parameters=()) for n in names]
    notes = {
        tile.title: tile.note
        for tile in _traction_tiles(
            replace(material.traction, model="recommended" if verdict == "named" else "calibrated_soil"),
            replace(found, causes=tuple(errors)),
        )
    }
    title = "Highest tractive efficiency" if verdict == "named" else "Highest measured tractive efficiency"
    assert notes[title].partition("; not corrected for ")[2] == said


@pytest.mark.parametrize(
    "verdict", [pytest.param(v, marks=() if v in GATE else pytest.mark.slow) for v in get_args(Verdict)]
)
def test_every_surface_shows_the_same(material: ReportInputs, verdict: Verdict) -> None:
    found = diagnosis(verdict)
    expected = {key: (one.value, figure_value(one)) for key, one in figures_of_diagnosis(found).items()}
    for key, one in figures_of_traction(replace(material, diagnosed=found).traction).items():
        expected[key] = (one.value, figure_value(one))
    in_json = set(expected)
    found_cost = cost(material) if verdict == "named" else None
    costs = [figure_of_cost(each) for each in found_cost.costs] if found_cost else []
    expected |= {one.key: (one.value, figure_value(one)) for one in costs}
    report = build_report(replace(material, diagnosed=found))
    page = Keyed(report.html("report.json")).found
    notebook = Keyed(diagnosis_html(found)).found
    for surface in (page, notebook):
        assert surface.keys() <= expected.keys()
        for key, shown in surface.items():
            value, text = expected[key]
            assert shown == {(value, text.removesuffix(" %"))}, key
    terminal: dict[str, float] = {}
    with pytest.MonkeyPatch.context() as patch:
        written_as = figures._written_as

        def noted(one: KeyFigure, value: float) -> str:
            terminal.update({one.key: value} if value == one.value else {})
            return written_as(one, value)

        patch.setattr(figures, "_written_as", noted)
        diagnosis_lines(found, material.vehicle, verbose=True)
    assert all(value == expected[key][0] for key, value in terminal.items())
    viewed = {key: (one["value"], one["text"]) for key, one in shown_of(found, found_cost)["figures"].items()}
    assert all(shown == expected[key] for key, shown in viewed.items())
    written = json.loads(json.dumps(report.numbers()))["sections"]["glance"]["key_figures"]
    assert {key: one["value"] for key, one in written.items()} == {key: expected[key][0] for key in in_json}
    wanted = required(verdict)
    shown_in_report = page.keys() | ({key for key in wanted if key.startswith("error.t")} & written.keys())
    for name, surface in {"notebook": notebook, "terminal": terminal, "view": viewed, "json": written}.items():
        assert wanted <= surface.keys(), (name, wanted - surface.keys())
    assert wanted | GROUND <= shown_in_report, wanted | GROUND - shown_in_report
    assert {one.key for one in costs} <= page.keys() & viewed.keys()


def test_the_page_has_the_table_of_cost_of_the_report(material: ReportInputs) -> None:
    found = cost(material)
    table = cost_rows(found)
    shown = shown_of(diagnosis(), found)["cost"]
    assert [row[:4] + row[5:] for row in shown["rows"]] == [row[:4] + row[5:] for row in table]
    pull, sinkage, efficiency = table[0], table[2], table[3]
    assert sinkage[0] == "sinkage" and sinkage[-1] == "mm" and float(str(sinkage[3])) == pytest.approx(138, abs=2)
    assert pull[0] == "drawbar pull" and pull[1] == "0.20" and pull[-1] == "N" and efficiency[-1] == "points"
    written = [figure_value(cell) for row in (pull, efficiency) for cell in row if isinstance(cell, KeyFigure)]
    assert all(text.startswith("−") for text in written) and "%" not in written[1]
    assert found.costs[0].difference95[0] < found.costs[0].difference < 0
    assert "kN" in shown["says"] and shown["title"] == "With and without slip sinkage"


def test_a_cause_that_costs_nothing_has_no_table_of_zeros(material: ReportInputs) -> None:
    found = cost(material)
    nothing = tuple(replace(one, with_causes=one.without, difference95=(0.0, 0.0)) for one in found.costs)
    late = replace(found.causes[0], kind="measurement")
    free = replace(found, costs=nothing, causes=(late,))
    assert cost_meaning(free) == "Costs nothing in steady driving: an error of measurement." and not cost_rows(free)
    assert shown_of(diagnosis(), free)["cost"]["rows"] == []


def test_sizes_are_of_the_model_of_the_verdict() -> None:
    for verdict, model in (("named", "recommended"), ("one_of", "most_probable")):
        figures = figures_of_diagnosis(diagnosis(verdict))
        assert figures["cause.slip_sinkage.H_m"].model == model


def test_the_page_and_the_json_of_diagnose_have_the_values_of_the_report(material: ReportInputs) -> None:
    found = diagnosis()
    figures = figures_of_diagnosis(found)
    told = plain(diagnosis_json(found))
    held_out = told["gain"]["held_out"]
    assert held_out["base"]["channels"]["t"]["R0"] == figures["error.t.calibrated_soil"].value
    assert held_out["extended"]["R0_N"] == figures["error.dp.with_causes"].value
    assert told["causes"][0]["parameters"][0]["value"] == figures["cause.slip_sinkage.H_m"].value
    ground = figures_of_traction(traction_of(material.fitted))
    [group] = compared([material.fitted])["groups"]
    assert group["pull_n"] == ground["measured_pull_near_slip_0.2"].value
    assert group["pull_coefficient"] == ground["measured_drawbar_coefficient_near_slip_0.2"].value


def test_the_pull_at_slip_0_2_is_that_of_the_table_of_cost(material: ReportInputs, campaign: Path) -> None:
    inputs = replace(material, diagnosed=diagnosis())
    pull, [row, *_] = inputs.traction.pull, cost_rows(cost(material))
    assert pull is not None and figure_value(figures_of_traction(inputs.traction)["pull_at_slip_0.2"]) == row[3]
    assert pull.pull_n == cost(material).costs[0].with_causes and pull.load_n == cost(material).driving.load_n
    assert pull.interval95[0] < pull.pull_n < pull.interval95[1]
    written = build_report(inputs).numbers()["sections"]
    assert written["fit"]["traction"]["pull"]["pull_n"] == written["cost"]["costs"][0]["with_causes"]
    assert inputs.traction.efficiency >= cost(material).costs[3].with_causes
    found = Found(Source("a", "a"), processed_of(campaign), fit=material.fit, diagnosis=diagnosis())
    [row_of_fleet] = tables_of([found], "")["campaigns"].to_pylist()
    assert row_of_fleet["pull_at_slip_0_2_n"] == pull.pull_n
    assert row_of_fleet["pull_at_slip_0_2_lower95_n"] == pull.interval95[0]


def test_a_run_that_lies_apart_is_fair_in_the_report_and_in_the_fleet(material: ReportInputs, campaign: Path) -> None:
    values = {"run": material.runs[1].run.id, "family": "torque_zero", "channel": "t", "size": 90.0, "sigma": 10.0}
    note, found = Note(DiagnosisCode.RUN_APART, Severity.FAULT, values), diagnosis("nothing_detectable")
    found = replace(found, grounds=replace(found.grounds, cautions=(note,)))
    grades = replace(material, diagnosed=found).grades
    rows = tables_of([Found(Source("a", "a"), processed_of(campaign), diagnosis=found)], "")["runs"].to_pylist()
    assert [(row["grade"], row["grade_reasons"] or "") for row in rows] == [
        (grade.level, "; ".join(grade.reasons)) for grade in grades
    ]
    assert ["torque zero is +90 N m off" in "".join(grade.reasons) for grade in grades] == [False, True]


def test_an_efficiency_is_measured_where_the_slip_is_known(material: ReportInputs) -> None:
    run = material.fitted[0]
    best = traction_of((run,)).efficiency_at_slip
    unsure = replace(run, slip_sigma=np.where(run.slip < best + 0.05, 0.3, run.slip_sigma))
    assert 0 < best < best + 0.04 < traction_of((unsure,)).efficiency_at_slip
    unknown = replace(run, slip_sigma=np.full(len(run), np.nan))
    assert np.isfinite(traction_of((unknown,)).efficiency)


@pytest.mark.parametrize("bend", [0.09, 0.12, 0.16])
def test_the_measured_pull_near_slip_0_2_is_right_where_the_curve_is_bent(bend: float) -> None:
    slip = np.tile(0.02 + 0.6 * np.linspace(0, 1, 400) ** 2, 4)
    run = np.repeat(np.arange(4), 400)
    pull = 3000.0 * -np.expm1(-slip / bend) - 300.0
    found = pull_at(slip, pull, np.full(1600, 9000.0), np.tile(np.arange(400) / 100, 4), run)
    assert found is not None and found.passes == 4
    assert found.pull_n == pytest.approx(3000.0 * -np.expm1(-0.2 / bend) - 300.0, rel=0.015)


def test_rounding_is_no_cost_of_a_cause_that_acts_in_braking_only(material: ReportInputs) -> None:
    size = ParameterEstimate("H2_m", "m", 0.05, (0.03, 0.07), 0.01)
    skid = Cause("skid_sinkage", "", "physical", "skid_sinkage", 0.99, 1.0, (size,))
    inputs, fit = replace(material, diagnosed=replace(diagnosis(), causes=(skid,))), material.fit
    driving, wheel = usual_driving(material.fitted), wheel_of(material.vehicle)
    ground = (driving, wheel, fit.soil, fit.options.reading)
    noise = iter([1.0, 1.0 + 1e-13, 1.0, 1.0 - 1e-13])
    curves = cause_cost._curves

    def rounded(model: ExtendedModel, at: Driving) -> dict[str, FloatArray]:
        factor = next(noise)
        return {key: factor * values for key, values in curves(model, at).items()}

    with patch.object(cause_cost, "_curves", rounded):
        found = cost_of_verdict(inputs.diagnosis, *ground, highest_slip=0.9)
    assert {one.difference for one in found.costs} == {0.0}
    assert {end for one in found.costs for end in one.difference95} == {0.0}
    assert cost_meaning(found) == "Costs nothing in steady driving." and not cost_rows(found)
    assert cost_sentence(found.costs) == ""


def test_a_named_error_of_the_measurement_costs_no_pull(material: ReportInputs) -> None:
    size = ParameterEstimate("offset_n", "N", 80.0, (60.0, 100.0), 10.0)
    zero = Cause("drawbar_pull_zero", "", "measurement", "drawbar_pull_zero", 0.99, 1.0, (size,))
    inputs, fit = replace(material, diagnosed=replace(diagnosis(), causes=(zero,))), material.fit
    wheel = wheel_of(material.vehicle)
    driving = usual_driving(material.fitted)
    found = cost_of_verdict(inputs.diagnosis, driving, wheel, fit.soil, fit.options.reading, highest_slip=0.9)
    with_it = inputs.traction.pull
    assert with_it is not None and with_it.pull_n == found.costs[0].without
    assert found.costs[0].difference == pytest.approx(80.0)
    assert with_it.interval95[1] - with_it.pull_n > 20.0
    assert replace(material, diagnosed=diagnosis("unexplained")).traction.model == "calibrated_soil"
    assert material.traction.model == "laboratory_soil"
