"""Numbers, units and names as a report writes them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_samples import BRAKING, cause, diagnosis
from report_support import cells_of, section_of, text_of

from daq import Note, Severity
from model import DiagnosisCode, StepCode
from model.diagnosis import Candidate, Grounds, NextRun, ParameterEstimate, Reduction
from model.sinkage_from_forces import Estimate, Growth
from processing import Reason, RunCode
from wheelsoil.notebook import diagnosis_html
from wheelsoil.report import build_report
from wheelsoil.report.content import Checks, Steps, Table, Text, Tiles, blocks_of
from wheelsoil.report.figures import form_name
from wheelsoil.report.sections.candidates import candidates
from wheelsoil.report.sections.coefficients import coefficients, criteria
from wheelsoil.report.sections.glance import glance
from wheelsoil.report.sections.overview import causes
from wheelsoil.report.sections.planning import detectable, next_run
from wheelsoil.report.sections.provenance import provenance
from wheelsoil.wording.names import letter
from wheelsoil.wording.numbers import measured, typeset, unbroken, unit
from wheelsoil.wording.verdict import NOT_JUDGED, headline_of, sentence_of
from wheelsoil.workflows.sinkage import growth_sentence

CODE = re.compile(r"\b\w+_\w+\b")


def cells(section) -> list[str]:
    return cells_of(section)


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (0.039648, 0.0284, "0.040"),
        (-0.017131, 0.0284, "−0.017"),
        (0.61532, 0.0012, "0.6153"),
        (9202.3, 130.0, "9\u202f202"),
        (0.123456, np.nan, "0.1235"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value, sigma, said):
    assert measured(value, sigma) == said


def test_names_and_units_are_those_of_a_reader():
    assert letter("H_m") == "H" and letter("extra_delay_s") == "extra delay" and letter("ln_mu") == "ln μ"
    assert letter("p = m1 + m2") == "p = m1 + m2"
    assert form_name("slip sinkage (vasilev)") == "slip sinkage (Vasil'ev)"
    assert unit("N/m^(n+1)") == "N/mⁿ⁺¹" and unit("N/m^2") == "N/m²" and unit("1") == ""


def test_no_reader_is_shown_a_key(material):
    found = replace(material, diagnosed=diagnosis("named"))
    for section in (candidates, coefficients, criteria, detectable):
        assert [cell for cell in cells(section.build(found)) if CODE.search(cell)] == [], section.key


def test_a_coefficient_has_its_unit(material):
    (laws,) = [b for b in criteria.build(material).blocks if isinstance(b, Table) and "Coefficients" in b.caption]
    of_vasilev = next(row[1] for row in laws.rows if row[0] == "Vasil'ev")
    assert re.fullmatch(r"H = [\d.]+ m", of_vasilev)


def test_the_error_of_a_torque_is_over_load_times_radius(material):
    vasilev = material.fit.model("vasilev").criteria["t"]
    load = np.mean(material.fit.observations.vertical_load_n)
    assert vasilev.R0_per_load == pytest.approx(vasilev.R0_N / load / material.fit.wheel.radius_m, rel=0.05)
    heads = [block.head for block in criteria.build(material).blocks if isinstance(block, Table)]
    assert "R₀ / (load × radius) (%)" in heads[1] and "R₀ / load (%)" in heads[0]


def test_odds_stop_where_noise_is_no_longer_what_limits(material):
    found = replace(diagnosis("one_of"), next_run=(NextRun(Note(StepCode.LIKE_OTHERS), ("slip_sinkage",), 22.3),))
    section = next_run.build(replace(material, diagnosed=found))
    assert "above 1000 : 1" in cells(section)
    assert not [cell for cell in cells(section) if "million" in cell]


def test_growth_is_not_said_of_every_shape_where_one_leaves_it_open():
    def growth(moves: tuple[float, float]) -> Growth:
        grows = Estimate(0.05, (0.001, 0.131))
        return Growth(grows, grows, Estimate(0.02, moves), Estimate(np.nan, (np.nan, np.nan)))

    assert growth_sentence(growth((-0.002, 0.039))).endswith("if its peak moves forward with slip it need not")
    assert growth_sentence(growth((0.002, 0.039))).endswith("grows with slip")


def test_one_sentence_leads_and_the_others_are_below(material):
    alike, likely = Grounds(confounded=("grouser",)), (Candidate("slip_sinkage", 0.97), Candidate("grouser", 0.06))
    runs = (NextRun(BRAKING, (), 5.0),)
    found = replace(diagnosis("named"), grounds=alike, candidates=likely, next_run=runs, not_identifiable={})
    report = build_report(replace(material, diagnosed=found))
    blocks = section_of(report, "glance").blocks
    texts = {block.kind: block.text for block in blocks if isinstance(block, Text)}
    assert texts["verdict"] == (
        "Slip sinkage explains the misfit: the drawbar pull error on held-out data falls by 45 %."
    )
    assert texts["lead"].startswith("Vasilev's form is most probable (62.0 %): H = 0.0510 (0.0400 to 0.0600) m.")
    assert "Grouser" in texts["lead"] and "Next:" not in texts["lead"] and "held-out" not in texts["lead"]
    (steps,) = [block for block in blocks if isinstance(block, Steps)]
    assert steps.steps[0].what == "A run with braking, down to a slip of -0.6"
    assert report.numbers()["sections"]["glance"]["sentence"] == sentence_of(found)


def test_a_page_of_two_terrains_is_not_green_and_shows_both(material):
    """The badge and the checks say it, the figure shows the groups, and no candidate stands as a fact."""
    names = tuple(run.run.id for run in material.runs)
    facts = {
        "campaign": "clay",
        "share": 0.22,
        "runs": names,
        "groups": (names[:1], names[1:]),
        "drawbar_coefficients": ((-0.02, 0.01), (0.09, 0.11)),
    }
    note = Note(DiagnosisCode.SEVERAL_TERRAINS, Severity.FAULT, facts)
    by_hand = replace(diagnosis("one_of"), grounds=Grounds(cautions=(note,)))
    seen_runs = replace(by_hand.plot_data[0], runs=names[:2])
    report = build_report(replace(material, diagnosed=replace(by_hand, plot_data=(seen_runs,))))
    assert report.head.badge is not None and report.head.badge[0] == "fair" and "one soil" in report.head.badge[1]
    checks = report.numbers()["sections"]["fit"]["checks"]
    assert any("differs by 22 % between runs of clay:" in check for check in checks)
    assert not any("no more than noise is left" in check for check in checks)
    judged = [block for block in blocks_of(section_of(report, "fit")) if isinstance(block, Checks)]
    assert judged and not any(check.good for block in judged for check in block.checks)
    hero = report.numbers()["drawings"]["hero"]
    assert hero["title"] == f"Drawbar pull over load: {names[0]} and {names[1]} differ"
    for curve, run in zip(hero["curves"], material.runs, strict=True):
        rows = run.used & (run.slip > 0.2) & (run.slip <= 0.25)
        at = [y for x, y in zip(curve["x"], curve["y"], strict=True) if abs(x - 0.225) < 1e-9]
        assert at == pytest.approx([np.median(run.drawbar_pull_n[rows] / run.vertical_load_n[rows])])
    table = section_of(report, "runs").blocks[0]
    assert isinstance(table, Table) and [row[1] for row in table.rows][1] == "▲ other soil" != table.rows[0][1]
    assert not any("Dp/W" in cell for cell in table.head), (
        "the highest of a run is mostly noise; Fit has that of all runs"
    )
    assert table.rows[1][-1].startswith("not of the soil of the first runs: see Do next")
    refused = causes.build(replace(material, diagnosed=replace(by_hand, verdict="unexplained", causes=())))
    assert refused.blocks == [Text(NOT_JUDGED, "warning")]
    assert text_of(report, "glance").count("bulldozing") == 0
    assert "part them first" in text_of(report, "next_run")
    assert "no more than noise" not in text_of(report, "candidates") and NOT_JUDGED in text_of(report, "candidates")
    assert report.numbers()["sections"]["glance"]["tiles"]["Confidence"]["value"] == "–"


def test_three_numbers_stand_below_the_verdict(material):
    (tiles,) = [b for b in glance.build(replace(material, diagnosed=diagnosis("named"))).blocks if isinstance(b, Tiles)]
    error, confidence, data = tiles.tiles
    assert (error.before, error.value, error.unit, error.change) == ("120", "66.0", "N", "−45 %")
    assert (confidence.value, confidence.unit) == ("97.0", "%") and "slip sinkage" in confidence.note
    assert data.unit == "% of motion" and "of all samples" in data.note


def test_the_error_beside_the_headline_is_the_one_it_speaks_of(material):
    found = diagnosis("named")
    assert found.gain is not None
    falls = {"dp": Reduction(-10.0, (-20.0, 1.0)), "t": Reduction(40.0, (30.0, 50.0))}
    found = replace(found, gain=replace(found.gain, reduction_percent=-10.0, interval95=(-20.0, 1.0), reductions=falls))
    assert "driving torque error" in headline_of(found)
    blocks, numbers = glance.contents(replace(material, diagnosed=found))
    (tiles,) = [block for block in blocks if isinstance(block, Tiles)]
    assert tiles.tiles[0].title == "Driving torque error, held-out" and "drawbar pull" in tiles.tiles[0].note
    assert "Driving torque error, held-out" in numbers["tiles"]


def test_a_run_that_is_short_or_lost_much_is_to_be_checked(material):
    first, second = material.runs
    reason = second.reason.copy()
    used = np.flatnonzero(second.used)
    reason[used[: int(0.3 * len(used))]] = Reason.INVALID_FIX
    report = build_report(replace(material, runs=(first, replace(second, reason=reason))))
    assert report.head.badge == ("fair", "▲ 2 of 2 runs usable, 1 to check")
    again = next(text for text in report.numbers()["texts"]["glance"] if text.startswith("none. "))
    assert re.fullmatch(rf"none\. Check {second.run.id} \(3\d % excluded\)\.", again)


def test_a_sensor_that_froze_or_comes_late_is_not_complete(material):
    values = {"role": "ground_speed", "kind": "frozen", "value": 0.0, "time_s": 26.1, "share": 0.65}
    note = Note(RunCode.SENSOR_FAULT, Severity.DOUBT, values)
    first, second = material.runs
    frozen = replace(second, quality=replace(second.quality, notes=(note,)))
    report = build_report(replace(material, runs=(first, frozen)))
    assert f"▲ 26.1 s frozen in {second.run.id}" in cells(section_of(report, "signals"))
    assert not report.numbers()["sections"]["signals"]["ground_speed"]["complete"]
    named = diagnosis("named")
    size = ParameterEstimate("extra_delay_s", "s", 0.15, (0.14, 0.16), 0.005)
    delay = replace(cause("speed_latency", "speed_latency", "", 0.99, size), kind="measurement")
    late = replace(named, causes=(delay,))
    report = build_report(replace(material, diagnosed=late))
    assert "▲ delayed: the named cause" in cells(section_of(report, "signals"))


def test_a_number_stays_with_its_unit():
    assert unbroken("79.9 N m at 99.9 %, 3 mm") == "79.9\u00a0N\u00a0m at 99.9\u00a0%, 3\u00a0mm"
    assert unbroken("12 s long, 3 runs in 4") == "12\u00a0s long, 3 runs in 4"
    assert typeset("p = m1 + m2; 2 % of load x radius") == "p = m₁ + m₂; 2 % of load × radius"


def test_a_notebook_shows_gain_next_run_and_no_certainty():
    found = diagnosis("one_of")
    sure = replace(found, causes=tuple(replace(cause, probability=0.99999) for cause in found.causes))
    page = diagnosis_html(sure)
    assert "&gt; 99.9 %" in page and "100.0 %" not in page
    assert "on held-out runs" in diagnosis_html(diagnosis("named"))
    assert "next run, best first" in page


def test_a_part_of_a_sum_is_not_in_the_sentence():
    nan = float("nan")
    parts = (
        ParameterEstimate("p", "1", 0.615, (0.58, 0.64), 0.02),
        ParameterEstimate("m1", "1", 0.582, (nan, nan), nan),
    )
    cause = replace(diagnosis("named").causes[0], key="lyasko", form="lyasko", parameters=parts)
    said = sentence_of(replace(diagnosis("named"), causes=(cause,)))
    assert "p = m1 + m2 = 0.615" in said and "m₁ = 0.582" not in said


def test_what_a_default_came_to_is_reported(material):
    section = provenance.build(replace(material, options={"slip_threshold": None, "soil_prior": False, "effects": ()}))
    tables = [part for part in blocks_of(section) if isinstance(part, Table)]
    said = dict(row for table in tables if table.caption == "Options" for row in table.rows)
    assert said["soil prior"] == "no" and said["effects"] == "none"
    assert said["slip threshold used"] == f"{material.fit.slip_threshold:g}"
    assert said["cut-off used"] == f"{material.runs[0].cutoff_hz:.3g} Hz"
