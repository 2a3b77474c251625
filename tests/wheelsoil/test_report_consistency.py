"""The report is consistent: the diagnosis has the last word, and two errors of one channel are distinguished."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_samples import BRAKING, SENTENCES, diagnosis

from daq.runs import open_runs
from model import ExtendedEffect, ExtendedModel
from model.diagnosis import CauseSet, NextRun, ParameterEstimate
from processing import ProcessOptions
from wheelsoil.report import Drawing, build_report, checks_of
from wheelsoil.report.content import Checks, Panels, Section, Step, Steps, Table, Text, blocks_of
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.candidates import candidates
from wheelsoil.report.sections.evidence import gain
from wheelsoil.report.sections.glance import glance
from wheelsoil.report.sections.misfit import misfit
from wheelsoil.report.sections.overview import fit
from wheelsoil.report.sections.planning import detectable
from wheelsoil.report.sections.verdict import Ranking, verdict
from wheelsoil.workflows import fit_runs, process_runs
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.last_report import LastReport, Stated


def text(section: Section) -> str:
    said = [block.text for block in section.blocks if isinstance(block, Text)]
    tables = [block for block in section.blocks if isinstance(block, Table)]
    cells = [cell for table in tables for row in table.rows for cell in row]
    return " ".join([*said, *(table.caption for table in tables), *(table.note for table in tables), *cells])


@pytest.mark.parametrize("named", SENTENCES)
def test_a_fit_does_not_contradict_the_diagnosis(material, named):
    found = diagnosis(named)
    if named == "named":
        found = replace(found, causes=(replace(found.causes[0], name="stress_peak_shift", form=""),))
    said = text(verdict.build(replace(material, diagnosed=found)))
    assert "None of the checks below speaks against relying on it" not in said
    assert "its coefficients are not to be relied on" in said
    assert "Fitted by themselves: " in said


def test_where_both_say_slip_sinkage_the_checks_count(material):
    said = text(verdict.build(replace(material, diagnosed=diagnosis("named"))))
    assert "The diagnosis names slip sinkage too." in said
    assert "not to be relied on" not in said


def test_two_errors_of_drawbar_pull_are_distinguished(material):
    said = text(verdict.build(replace(material, diagnosed=diagnosis("named"))))
    assert "the gain's 120 N without and 66.0 N with what was found are over 5 Hz means of held-out runs" in said
    assert "the soil as the laboratory states it" in said
    assert "Two errors" not in text(verdict.build(replace(material, diagnosed=replace(diagnosis(), gain=None))))


def test_an_extended_model_is_called_so(material, campaign):
    nan = float("nan")
    ding = ExtendedEffect("ding", (ParameterEstimate("n1", "1", 0.3, (nan, nan), nan),))
    extended = ExtendedModel(material.fit.wheel, material.fit.soil, (ding,))
    processed = process_runs(open_runs([campaign]), ProcessOptions())
    fit = fit_runs(processed, FitChoices(extended=extended), None)
    section = verdict.build(replace(material, campaign=replace(fit, models=(fit.models[0], fit.models[-1]))))
    said = f"{text(section)} {section.numbers['sentence']}"
    assert "extended's" not in said
    assert "xtended model" in said


def test_a_model_of_ones_own_is_called_so(material, campaign):
    processed = process_runs(open_runs([campaign]), ProcessOptions())
    fit = fit_runs(processed, FitChoices(effects=("lyasko",)), None)
    own = replace(fit, models=(fit.models[0], fit.models[-1]))
    sentence = verdict.build(replace(material, campaign=own)).numbers["sentence"]
    assert "hosen model" in sentence
    assert "hosen's" not in sentence


def test_sets_and_what_is_never_named_are_in_the_candidates(material):
    found = replace(diagnosis("one_of"), sets=(CauseSet(("load_gain", "grouser"), 0.43), CauseSet((), 0.1)))
    said = text(candidates.build(replace(material, diagnosed=found)))
    assert "load gain + grouser 43.0 %" in said
    assert "no cause 10.0 %" in said
    assert "Detectable, not identifiable" in said and "Not detectable" in said
    alone = text(candidates.build(replace(material, diagnosed=replace(found, causes=found.causes[:1]))))
    assert "Most probable, not named" in alone
    sizes = text(detectable.build(replace(material, diagnosed=found)))
    assert "speed bias *" in sizes and "* detectable, not identifiable" in sizes


def test_a_finding_says_what_its_size_is(material):
    said = text(misfit.build(replace(material, diagnosed=diagnosis("named"))))
    assert "The two can have opposite signs" in said
    assert "Mean of measured − predicted" not in said


def test_a_table_tells_what_its_panel_shows(material):
    found = diagnosis("named")
    [one] = found.plot_data
    there = (one.slip >= 0.4) & (one.slip <= 0.9)
    raised = replace(one, measured=one.measured | {"dp": one.base["dp"] + np.where(there, 250.0, -80.0)})
    section = misfit.build(replace(material, diagnosed=replace(found, plot_data=(raised,))))
    assert found.what_is_wrong[0].size == -122.0
    assert "250 N" in text(section) and "−122 N" in text(section)
    assert section.numbers["median_there"][0] == pytest.approx(250.0)
    assert np.isnan(section.numbers["median_there"][1])


def test_a_median_far_beyond_the_noise_stays_in_its_panel(material):
    found = diagnosis("named")
    [one] = found.plot_data
    far = one.base["dp"] + 40.0 * one.base_sigma["dp"]
    spread = replace(found, plot_data=(replace(one, measured=one.measured | {"dp": far}),))
    panels = [b for b in misfit.build(replace(material, diagnosed=spread)).blocks if isinstance(b, Panels)]
    for figure in (f for f in panels[0].figures if f.key != "misfit-dp-slip"):
        assert figure.layout["yaxis"]["range"][1] > 40, figure.key


def test_a_driven_wheel_keeps_its_dots_beside_wild_braking(material):
    found = diagnosis("named")
    [one] = found.plot_data
    wild = one.measured["dp"] + np.where(one.slip < 0, 50_000.0 * one.slip, 0.0)
    spread = replace(found, plot_data=(replace(one, measured=one.measured | {"dp": wild}),))

    def dots(found) -> int:
        panels = [b for b in misfit.build(replace(material, diagnosed=found)).blocks if isinstance(b, Panels)]
        figure = next(f for f in panels[0].figures if f.key == "misfit-dp-slip")
        cloud = next(trace for trace in figure.data if trace["name"] == "samples")
        return sum(float(x) > 0 for x in cloud["x"])

    assert dots(spread) == dots(found) > 60


def test_a_run_that_parts_nothing_surely_is_not_said_to(material):
    alone = replace(diagnosis("one_of"), next_run=(NextRun(BRAKING, (), 1.2),))
    (steps,) = [b for b in glance.build(replace(material, diagnosed=alone)).blocks if isinstance(b, Steps)]
    assert steps.steps[0] == Step("A run with braking, down to a slip of -0.6")


def test_an_error_that_grows_is_said_to_grow(material):
    found = diagnosis("named")
    worse = replace(found.gain, reduction_percent=-38.0, interval95=(-75.0, -4.6))
    said = text(gain.build(replace(material, diagnosed=replace(found, gain=worse))))
    assert "R₀ of the drawbar pull grows by 38 % (95 %: 4.6 to 75 %)" in said


def test_the_terminal_says_to_check_what_the_report_says(material):
    one = diagnosis("named")
    seen = one.plot_data[0]
    off = replace(one, plot_data=(replace(seen, extended={c: x + 300.0 for c, x in seen.extended.items()}),))
    told = glance.build(replace(material, diagnosed=off)).numbers["cautions"]
    assert told == checks_of(off) != []


def test_braking_that_swings_is_not_called_good_and_lies_in_its_figure(material):
    one = diagnosis("named")
    seen = one.plot_data[0]
    braked = seen.slip < 0
    noise = {c: np.where(braked, 8 * x[~braked].mean(), x) for c, x in seen.base_sigma.items()}
    swing = {c: x - np.where(braked, 4 * noise[c][~braked].mean(), 0.0) for c, x in seen.measured.items()}
    swung = replace(one, plot_data=(replace(seen, base_sigma=noise, extended=swing),))
    blocks = blocks_of(fit.build(replace(material, diagnosed=swung)))
    checks = next(block for block in blocks if isinstance(block, Checks)).checks
    amber = [check.text for check in checks if not check.good]
    assert any(said.startswith("The model is not confirmed for braking: drawbar pull") for said in amber)
    assert any(check.good and check.text.startswith("Drawbar pull, driving:") for check in checks)
    assert text(glance.build(replace(material, diagnosed=swung))).endswith(" Confirmed for driving only.")
    assert "driving only" not in text(glance.build(replace(material, diagnosed=replace(swung, verdict="one_of"))))
    [pull] = [block for block in blocks if isinstance(block, Drawing) and block.key == "residual-dp"]
    medians = next(curve["y"] for curve in pull.curves if curve["look"] == "model")
    ticks = [
        float(t.replace("\u202f", "").replace("−", "-"))
        for t in re.findall(r'class="tick"[^>]*"end">([^<]+)', pull.wide)
    ]
    assert np.nanmax(medians) < max(ticks) + (ticks[1] - ticks[0])


def test_what_differs_from_the_last_report_is_on_the_first_screen(material):
    torque = Stated("cause", ("torque_zero", "offset_nm"), 80.0, 4.0, "N m")
    last = LastReport("last.json", "2026-05-04T10:00:00", "Clay", (torque,))
    for stated, said in ((last, True), (replace(last, stated=()), False)):
        sections = build_report(replace(material, diagnosed=diagnosis("nothing_detectable"), last=stated)).sections
        assert ("Since last time: torque zero, offset was 80.0 N m last time" in text(sections[0])) == said
    of_sand = replace(last, subject={"soil": "sand"})
    found = build_report(replace(material, diagnosed=diagnosis("nothing_detectable"), last=of_sand)).sections
    assert "The last report is of soil sand, not clay. Since then: torque zero, offset was" in text(found[0])


def test_an_unexplained_misfit_is_to_be_looked_into(material):
    found = replace(diagnosis("unexplained"), next_run=())
    step = glance.build(replace(material, diagnosed=found)).numbers["next_step"]
    assert "no further run" not in step
    assert "do not rely on the model there" in step


def test_a_fault_in_judging_the_fit_leaves_the_diagnosis_its_sentence(material, monkeypatch):
    def broken(given: ReportInputs) -> Ranking:
        raise ZeroDivisionError(given.terrain)

    monkeypatch.setattr("wheelsoil.report.sections.verdict.rank", broken)
    report = build_report(replace(material, diagnosed=diagnosis("named")))
    assert set(report.left_out) == {"verdict"}
    assert report.numbers()["sections"]["glance"]["sentence"] == SENTENCES["named"]
    summary = next(section for section in report.sections if section.key == "glance")
    assert text(summary).startswith("Slip sinkage explains the misfit")
