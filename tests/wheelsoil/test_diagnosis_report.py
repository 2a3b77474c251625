"""The report's sections of the diagnosis: complete, honest about what is not there, robust against hostile names."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from diagnosis_samples import SENTENCES, cause, diagnosis, seen
from report_support import cells_of

from daq import Fault, Note, VehicleConfig
from daq.runs import open_runs
from model import DiagnosisCode, LackCode
from model.diagnosis import Candidate, Diagnosis, Kind, ParameterEstimate, PlotData, Shape, SoilEstimate, WheelOrders
from model.diagnosis.core.result import BarredCause
from processing import ProcessOptions, RunCode
from wheelsoil.report import Drawing, Plane, Report, build_report
from wheelsoil.report.build import _unbroken
from wheelsoil.report.content import Bars, Figure, Pair, Panels, Section, Table, Text
from wheelsoil.report.drawing import beyond
from wheelsoil.report.figures import by_load
from wheelsoil.report.inputs import ReportInputs, versions
from wheelsoil.report.sections import OF_THE_DIAGNOSIS, SECTIONS, misfit, overview
from wheelsoil.report.sections.evidence import gain
from wheelsoil.report.sections.glance import LoadShift, _samples, data_tile, glance
from wheelsoil.to_json import to_json
from wheelsoil.wording.mending import next_steps, step_of
from wheelsoil.workflows import BenchFiles, fit_runs, process_runs
from wheelsoil.workflows.fit import FitChoices

EVIL = "<img src=x onerror=alert(1)>&{{7*7}}"
KEYS = [section.key for section in OF_THE_DIAGNOSIS]


@pytest.fixture(scope="module")
def plain_material(campaign) -> ReportInputs:
    processed = process_runs(open_runs([campaign]), ProcessOptions())
    fit = fit_runs(processed, FitChoices(), None)
    runs = tuple(run for _, run in processed)
    return ReportInputs(runs, fit, "", processed[0][0].vehicle, fit.soil.name, versions=versions())


def built(material: ReportInputs, found: Diagnosis) -> Report:
    report = build_report(replace(material, diagnosed=found))
    assert report.left_out == {}
    return report


def section(report: Report, key: str) -> Section:
    return next(section for section in report.sections if section.key == key)


def figures(report: Report, key: str) -> list[Figure]:
    return [figure for block in section(report, key).blocks if isinstance(block, Panels) for figure in block.figures]


def text(report: Report, key: str) -> str:
    found = section(report, key)
    return " ".join([*(block.text for block in found.blocks if isinstance(block, Text)), *cells_of(found)])


def test_the_band_of_the_first_figure_lies_about_its_model(plain_material):
    curves = built(plain_material, diagnosis("one_of")).numbers()["drawings"]["hero"]["curves"]
    [model] = [curve for curve in curves if curve["look"] == "model"]
    y, lower, upper = (np.array(model[key], np.float64) for key in ("y", "lower", "upper"))
    known = np.isfinite(lower)
    assert known.any() and (lower < upper)[known].all()
    np.testing.assert_allclose((lower + upper)[known] / 2, y[known])


@pytest.mark.parametrize("verdict", SENTENCES)
def test_every_section_is_there_and_its_sentence_leads(plain_material, verdict):
    report = built(plain_material, diagnosis(verdict))
    assert [section.key for section in report.sections] == [
        builder.key
        for builder in SECTIONS
        if builder.key != "against" and (builder.key != "cost" or verdict == "named")
    ]
    headline = section(report, "glance").blocks[0]
    assert isinstance(headline, Text) and headline.kind == "verdict" and len(headline.text) < 170
    assert report.numbers()["sections"]["glance"]["sentence"] == SENTENCES[verdict]
    assert report.sentence == SENTENCES[verdict]
    for key in KEYS:
        for figure in figures(report, key):
            assert figure.layout["xaxis"]["title"], figure.key
        for block in section(report, key).blocks:
            if isinstance(block, Panels):
                assert len(block.reading) < 330, "two lines on how to read it"
    html = report.html("x.json")
    ids = re.findall(r'id="((?:plot|data)-[^"]+)"', html)
    assert len(ids) == len(set(ids))
    levels = [int(level) for level in re.findall(r"<h([1-6])[ >]", html)]
    assert levels[0] == 1 and max(levels) == 5
    assert all(below <= above + 1 for above, below in pairwise(levels)), "a heading belongs to the one above it"


def test_every_number_is_in_the_json(plain_material):
    report = built(plain_material, diagnosis("named"))
    numbers = json.loads(to_json(report.numbers()))["sections"]
    assert any(isinstance(block, Table) for block in section(report, "gain").blocks)
    assert numbers["verdict"]["verdict"] == "named"
    assert numbers["verdict"]["best"] in ("lyasko", "vasilev", "ding")
    assert numbers["candidates"]["causes"][0]["parameters"][0]["interval95"] == [0.04, 0.06]
    assert numbers["gain"]["gain"]["base"]["dp"]["R0"] == 120.0
    assert numbers["detectable"]["share"]["vasilev"] == pytest.approx(0.012 / 0.05)
    assert numbers["next_run"]["next_run"][0]["separates"] == ["slip_sinkage", "bulldozing"]
    assert numbers["workings"]["noise"]["run_scatter"] is None
    left = np.array(numbers["misfit"]["dp"]["clay: against slip"]["median"]["median"])
    assert left[-1] < -100 < left[0]
    after = np.array(numbers["evidence"]["dp"]["clay"]["after"]["median"])
    assert np.abs(after).max() < 60


def test_residuals_are_drawn_against_everything_that_tells(plain_material):
    drawn = {figure.key for figure in figures(built(plain_material, diagnosis()), "misfit")}
    against = ("slip", "vertical_load_n", "ground_speed_mps", "time_s", "line_position", "run")
    assert drawn == {f"misfit-{channel}-{key}" for channel in ("dp", "t") for key in against}


def test_what_would_fit_almost_as_well_can_be_judged(plain_material):
    found = diagnosis()
    report = built(plain_material, replace(found, grounds=replace(found.grounds, confounded=("bulldozing",))))
    assert section(report, "evidence").numbers["members"] == ["vasilev", "bulldozing"]
    assert [row[0] for row in section(report, "causes").blocks[-1].rows] == ["slip sinkage", "bulldozing", "slope"]
    assert (
        "Bulldozing (3.0 %) has a similar signature, but is separable in these data."
        in section(report, "causes").blocks[-1].note
    )
    assert section(built(plain_material, found), "evidence").numbers["members"] == ["vasilev"]


def test_a_refused_set_is_not_drawn_as_the_explanation(plain_material):
    found = diagnosis("unexplained")
    for key in ("causes", "candidates"):
        blocks = section(built(plain_material, found), key).blocks
        assert not any(isinstance(block, Bars | Panels) for block in blocks), key
        assert blocks[0].text.startswith("Best of the library, refused: slip sinkage. Reason: an unknown cause acts")
    [drawing] = [one for one in section(built(plain_material, found), "causes").blocks if isinstance(one, Drawing)]
    assert drawing.title.startswith("Drawbar pull: median residual −"), drawing.title


def test_what_no_cause_explains_is_shown_in_the_channel_that_is_off_most_against_what_it_hangs_on(plain_material):
    found = diagnosis("unexplained")
    (pull, torque), data = found.what_is_wrong, found.plot_data[0]
    compressed = data.measured | {"t": data.base["t"] - 0.4 * np.maximum(data.base["t"] - 3000.0, 0.0)}
    place = Shape(Kind.TORQUE, "t", (-2.0, -0.3), "kN m")
    wrong = (replace(torque, place=place, size=-178.0, statistic=-14.7), pull)
    report = built(plain_material, replace(found, what_is_wrong=wrong, plot_data=(replace(data, measured=compressed),)))
    of_summary, of_causes = (
        next(block for block in section(report, key).blocks if isinstance(block, Drawing))
        for key in ("glance", "causes")
    )
    assert of_summary.title == of_causes.title and "−178 N m" in of_summary.caption
    (points,) = curves(of_summary, "measured")
    assert "Predicted driving torque (N m)" in of_summary.wide and points["x"].min() > 0
    np.testing.assert_allclose(points["y"], -0.4 * np.maximum(points["x"] - 3000.0, 0.0), atol=60.0)
    size = f"{points['y'].min():,.0f}".replace("-", "−").replace(",", "\u202f")
    assert of_summary.title.startswith(f"Driving torque: median residual {size} N m at a predicted 4\u202f")
    assert [caution.partition(":")[0] for caution in section(report, "glance").numbers["cautions"]][:1] == [
        "Driving, driving torque"
    ]


def test_a_cause_that_a_rule_bars_is_marked_in_the_json(plain_material):
    found = diagnosis("one_of")
    peak = Note(LackCode.PEAK_MAY_SHIFT, values={"family": "slip_sinkage", "probability": 0.3})
    grounds = replace(found.grounds, kept_back=(BarredCause(found.causes[0], peak),))
    numbers = section(built(plain_material, replace(found, grounds=grounds)), "causes").numbers
    assert numbers["barred"] == ["slip_sinkage"]
    assert "barred" not in section(built(plain_material, found), "causes").numbers


def test_each_step_says_the_odds_that_it_is_expected_to_give(plain_material):
    found = diagnosis()
    weaker = replace(found.next_run[0], expected_log_bayes_factor=0.63, cost_runs=2.0)
    steps = section(built(plain_material, replace(found, next_run=(found.next_run[0], weaker))), "glance")
    first, second = steps.numbers["steps"]
    assert first.why.startswith("Separates slip sinkage and bulldozing; expected odds 545 : 1. Write added_load_kg in")
    assert "expected odds 1.9 : 1; as long as 2 runs." in second.why
    [decided] = next_steps(replace(found, next_run=(replace(weaker, naming_chance=0.26),)), VehicleConfig())
    assert decided.why.startswith(
        "Separates slip sinkage and bulldozing: the right name in about 25 % of such cases, else none;"
    )


def test_the_noise_is_that_of_the_same_samples_in_every_figure(plain_material):
    of = seen()
    odd = np.arange(len(of.slip)) % 2 == 0
    wide = {c: np.where(odd, 4 * sigma, sigma) for c, sigma in of.base_sigma.items()}
    data = replace(of, measured={c: np.where(odd, np.nan, y) for c, y in of.measured.items()}, base_sigma=wide)
    drawn = built(plain_material, replace(diagnosis("nothing_detectable"), plot_data=(data,))).numbers()["drawings"]
    halves = []
    for name, look in (("hero", "model"), ("residual-dp", "noise")):
        [band] = [curve for curve in drawn[name]["curves"] if curve["look"] == look]
        upper, middle = (np.array(band[key], np.float64) for key in ("upper", "y"))
        halves.append(float(np.nanmedian(upper - middle)))
    assert halves[0] == pytest.approx(halves[1], rel=1e-3)


def test_what_turns_with_the_wheel_is_drawn_by_order(plain_material):
    orders = WheelOrders(np.array([0.95, 1.0, 1.05]), np.array([4.0, 26.0, 5.0]), np.array([7.0, 7.1, 7.2]))
    found = replace(diagnosis(), plot_data=(replace(seen(), wheel_orders={"dp": orders}),))
    report = built(plain_material, found)
    [drawn] = [figure for figure in figures(report, "misfit") if figure.key == "wheel-order-dp"]
    assert [4.0, 26.0, 5.0] in [trace["y"] for trace in drawn.data]
    assert section(report, "misfit").numbers["wheel_orders"]["clay"]["dp"] is orders


def test_without_a_torque_channel_there_are_no_empty_panels(plain_material):
    def pull_only(one: PlotData) -> PlotData:
        fields = ("measured", "base", "extended", "base_sigma")
        return replace(one, **{name: {"dp": getattr(one, name)["dp"]} for name in fields})

    found = diagnosis()
    report = built(plain_material, replace(found, plot_data=tuple(map(pull_only, found.plot_data))))
    keys = [figure.key for name in ("misfit", "evidence") for figure in figures(report, name)]
    assert keys and not [key for key in keys if key.endswith("-t") or "-t-" in key]


def test_several_campaigns_are_a_choice(plain_material):
    found = replace(diagnosis(), plot_data=(seen("clay"), seen("sand")))
    for key in ("misfit", "evidence"):
        assert figures(built(plain_material, found), key)
        for block in section(built(plain_material, found), key).blocks:
            if isinstance(block, Panels):
                assert block.choices == ["clay", "sand"]
                assert all(set(figure.groups) == {"clay", "sand"} for figure in block.figures)


@pytest.mark.parametrize(("campaigns", "runs"), [(("clay",), ("track: 1", "track: 2")), (("clay", "sand"), ("1", "2"))])
def test_a_drift_is_drawn_over_the_starts_of_its_own_runs(plain_material, campaigns, runs):
    data = [seen(campaign, runs) for campaign in campaigns]
    data = [replace(each, signatures={"zero_drift": {"dp": 90.0 * each.campaign_time}}) for each in data]
    drift = cause(
        "zero_drift",
        "zero_drift",
        "",
        0.99,
        ParameterEstimate("campaign_span_n", "N", 90.0, (80.0, 100.0), 5.0),
    )
    found = replace(diagnosis(), causes=(drift,), plot_data=tuple(data))
    [line, _] = built(plain_material, found).numbers()["drawings"]["hero"]["curves"]
    assert min(line["x"]) < 0.4 and max(line["x"]) > 10.0  # min: the second run begins after 600 s
    assert np.corrcoef(line["x"], line["y"])[0, 1] > 0.95 and np.ptp(line["y"]) > 40.0


def test_a_run_of_several_campaigns_shows_its_own_recommended_model(plain_material):
    names = [run.run.id for run in plain_material.runs]
    found = replace(diagnosis(), plot_data=(seen("clay", (names[0],)), seen("sand", (names[1],))))
    recommendation = replace(plain_material, diagnosed=found).recommendation
    assert [int(recommendation.of_run(name).sum()) for name in names] == [120, 120]
    driving, *_ = figures(built(plain_material, found), "slip")
    shown = [
        group for trace, group in zip(driving.data, driving.groups, strict=True) if trace.get("name") == "recommended"
    ]
    assert shown == ["all runs", *names]


def test_what_cannot_be_shown_is_said(plain_material):
    unexplained = built(plain_material, diagnosis("unexplained"))
    assert "No cause of the library" in text(unexplained, "evidence")
    assert "not a named cause" in text(unexplained, "candidates")
    assert "Do not rely on the probabilities" in text(unexplained, "candidates")
    nothing = built(plain_material, replace(diagnosis("nothing_detectable"), gain=None, next_run=(), plot_data=()))
    assert "No cause is sure, so that" in text(nothing, "evidence")
    assert "gave no signatures to draw" in text(built(plain_material, replace(diagnosis(), plot_data=())), "evidence")
    assert "at least two runs" in text(nothing, "gain")
    assert "asks for no further run" in text(nothing, "next_run")
    assert "not detectable in these data" in text(nothing, "detectable")
    assert figures(nothing, "misfit") == []


def test_where_no_cause_was_chosen_there_is_nothing_to_gain(plain_material):
    found = diagnosis("nothing_detectable")
    assert found.gain is not None
    report = built(plain_material, replace(found, gain=replace(found.gain, chosen=((), ()))))
    assert "there is no gain" in text(report, "gain")
    assert figures(report, "gain") == []


@pytest.mark.parametrize(("nats", "level"), [(0.5, "good"), (-0.5, "warning")])
def test_any_gain_is_good_and_any_loss_a_warning(nats: float, level: str) -> None:
    found = diagnosis()
    assert found.gain is not None
    worth = replace(found, gain=replace(found.gain, log_likelihood_gain=nats))
    (said, *_), _ = gain.contents(cast(ReportInputs, SimpleNamespace(diagnosis=worth)))
    assert isinstance(said, Text) and said.kind == level


def test_without_a_usable_sample_there_is_no_range_of_slip() -> None:
    tile = data_tile(cast(ReportInputs, SimpleNamespace(tables=(), runs=())))
    assert (tile.value, tile.note) == ("0", "no sample can be used")


def test_the_samples_of_a_figure_are_those_used_in_driving_in_the_unit_of_the_page() -> None:
    used = np.array([True, True, True, False])
    run = SimpleNamespace(slip=np.array([0.1, -0.1, 0.2, 0.3]), vertical_load_n=np.full(4, 1e3), used=used)
    run.sinkage_m = np.array([0.01, 0.02, 0.03, 0.04])
    shift = cast(LoadShift, SimpleNamespace(of=lambda _, load: 1e-5 * load))
    slip, values = _samples(cast(ReportInputs, SimpleNamespace(runs=[run])), "z", shift) or (None, None)
    np.testing.assert_allclose((slip, values), ([0.1, 0.2], [20.0, 40.0]))


@pytest.mark.parametrize(("median", "shown"), [(0.1, 6.0), (6.0, 6.6)])
def test_an_axis_in_sigmas_shows_six_of_them_and_every_median(median: float, shown: float) -> None:
    panel = {"run": None, "lower": np.array([-median, np.nan]), "upper": np.array([0.0, 0.0])}
    assert misfit._sigmas_shown([panel]) == pytest.approx(shown)


def test_a_few_samples_do_not_break_a_figure(plain_material):
    found = replace(diagnosis(), plot_data=(seen(runs=("one",), samples=2),))
    built(plain_material, found).html("x.json")


def test_a_failed_diagnosis_costs_its_sections_and_nothing_else(plain_material):
    report = build_report(replace(plain_material, no_diagnosis="too few samples"))
    assert sorted(report.left_out) == sorted(KEYS)
    assert set(report.left_out.values()) == {"too few samples"}
    assert "No diagnosis: too few samples" in text(report, "verdict")
    assert "model follows the drawbar pull best" in report.sentence
    assert report.failed == ()


def test_a_diagnosis_lost_through_a_fault_is_no_success(plain_material):
    lost = replace(plain_material, no_diagnosis="a fault in the program", diagnosis_failed=True)
    report = build_report(lost)
    assert report.failed == ("diagnosis",) and list(report.numbers()["failed"]) == ["diagnosis"]
    assert report.sentence.startswith("No diagnosis: a fault in the program")


def test_where_none_was_asked_for_the_page_is_silent(plain_material):
    report = build_report(plain_material)
    assert not {section.key for section in report.sections} & set(KEYS)
    assert report.left_out == {}


def test_a_diagnosis_leads_even_where_there_is_no_fit(plain_material):
    report = build_report(replace(plain_material, campaign=None, no_fit="no", diagnosed=diagnosis()))
    assert report.sentence == SENTENCES["named"]
    assert "could not be judged" in text(report, "verdict")


def test_names_stay_data(plain_material):
    found = replace(
        diagnosis("one_of"),
        candidates=(Candidate(EVIL, 0.5),),
        not_identifiable={EVIL: Note(LackCode.ONE_DIRECTION)},
        notes=(Note(DiagnosisCode.CAMPAIGN_EXCLUDED, values={"fault": Fault(EVIL)}),),
        plot_data=(seen(campaign=EVIL, runs=(EVIL, "b")),),
    )
    assert "<img" not in built(plain_material, found).html("x.json")


def curves(drawing: Drawing, look: str) -> list[dict[str, Any]]:
    """Return the lines and points of a look that a figure draws."""
    return [dict(curve) for curve in drawing.curves if curve["look"] == look]


def hero_of(report: Report) -> Drawing:
    """Return the figure of the first screen."""
    return next(block for block in section(report, "glance").blocks if isinstance(block, Drawing))


def test_the_points_of_the_first_figure_are_as_far_from_its_lines_as_the_residual_says(plain_material):
    found = diagnosis("named")
    (old,) = found.plot_data
    pull = np.where((old.slip > 0) & (old.slip < 0.15) & (np.arange(len(old.slip)) % 3 > 0), np.nan, old.measured["dp"])
    report = built(plain_material, replace(found, plot_data=(replace(old, measured={**old.measured, "dp": pull}),)))
    (points,), (line,), (base,) = (curves(hero_of(report), look) for look in ("measured", "model", "base"))
    residual = section(report, "fit").numbers["residual"]["dp"]
    for name, curve in (("recommended", line), ("baseline", base)):
        driven = residual[name].centre > 0
        np.testing.assert_allclose(points["x"], residual[name].centre[driven])
        np.testing.assert_allclose(points["y"] - curve["y"], residual[name].median[driven], atol=1e-9)


def test_a_median_that_lacks_in_one_bin_takes_no_figure_of_the_largest_residual(plain_material):
    found = diagnosis("unexplained")
    (old,) = found.plot_data
    channel = {c: np.where(old.slip < 0.1, np.nan, values) for c, values in old.measured.items()}
    report = built(plain_material, replace(found, plot_data=(replace(old, measured=channel),)))
    (drawing,) = [block for block in section(report, "causes").blocks if isinstance(block, Drawing)]
    assert drawing.title.startswith("Drawbar pull: median residual −")


def of_a_table(plain_material, slip: np.ndarray, load_n: np.ndarray) -> tuple[PlotData, Diagnosis, ReportInputs]:
    """Return six rows whose pull goes with the load, the diagnosis of them, and what a report is made of."""
    found, nothing, share = diagnosis("named"), np.full(6, np.nan), load_n / 25.0
    rows = PlotData(
        campaign="rig",
        runs=("3", "5"),
        run=np.array([0, 0, 0, 1, 1, 1]),
        time_s=np.arange(6.0),
        since_first_run_s=nothing,
        campaign_time=nothing,
        slip=slip,
        ground_speed_mps=nothing,
        vertical_load_n=load_n,
        line_position=nothing,
        measured={"dp": share * (4 * slip - 1.0), "z": share * (0.016 + 0.028 * slip)},
        base={"dp": share * (5 * slip - 1.5), "z": np.full(6, 0.018)},
        extended={"dp": share * (4.1 * slip - 1.0), "z": 0.015 + 0.027 * slip},
        base_sigma={"dp": np.full(6, 1.0), "z": np.full(6, 0.003)},
        signatures={"vasilev": {"dp": -slip, "z": 0.026 * slip}},
    )
    left = Note(DiagnosisCode.BRAKED_ROWS_EXCLUDED, values={"table": "rig", "rows": 12})
    grounds = replace(found.grounds, table_channels=("dp", "z"))
    found = replace(found, plot_data=(rows,), notes=(left,), grounds=grounds)
    rig = cast(BenchFiles, SimpleNamespace(rows=range(18)))
    return rows, found, ReportInputs((), None, "", plain_material.vehicle, "sand", diagnosed=found, tables=(rig,))


def test_a_table_of_two_loads_has_a_line_and_a_size_of_each(plain_material):
    slip = np.array([0.2, 0.5, 0.9, 0.2, 0.5, 0.9])
    _, _, inputs = of_a_table(plain_material, slip, np.array([25.0, 25.5, 24.8, 50.0, 51.0, 49.5]))
    (hero,) = [block for block in glance.build(inputs).blocks if isinstance(block, Drawing)]
    below, above = curves(hero, "model")
    assert [below["name"], above["name"]] == ["Recommended, 25 N", "Recommended, 50 N"]
    for line, points in zip((below, above), curves(hero, "measured"), strict=True):
        assert list(line["x"]) == list(points["x"]) == [0.2, 0.5, 0.9]
    assert hero.title == "Wong, calibrated soil, predicts 64 mm too little sinkage at slip 0.90 and 50 N"
    assert ">50 N</text>" in hero.narrow and ">50 N</text>" not in hero.wide
    for load_n in (np.array([9.0, 9.2]), np.arange(1.0, 9.0)):  # one load, and more than there is room for
        assert [(name, rows.all()) for name, rows in by_load(load_n)] == [("", True)]


def test_the_rows_of_a_table_are_drawn_themselves_and_those_not_used_are_said(plain_material):
    slip = np.array([0.0, 0.003, 0.23, 0.232, 0.5, 0.9])
    rows, found, inputs = of_a_table(plain_material, slip, np.full(6, 25.0))
    summary, shown = glance.build(inputs), overview.fit.build(inputs)
    tile = summary.numbers["tiles"]["Usable data"]
    assert (tile["value"], tile["unit"]) == ("6", "of 18 rows")
    hero = next(block for block in summary.blocks if isinstance(block, Drawing))
    assert hero.title == "Wong, calibrated soil, predicts 23 mm too little sinkage at slip 0.90"
    assert "12 braked rows are not used" in hero.caption
    (points,), (line,) = curves(hero, "measured"), curves(hero, "model")
    np.testing.assert_allclose(points["y"], 1e3 * rows.measured["z"])
    np.testing.assert_allclose(line["x"], [0.0015, 0.231, 0.5, 0.9])
    assert hero.wide.count("<circle") == 6, "the row at slip 0.003, too"
    assert shown.numbers["checks"][0].startswith("Drawbar pull: 6 of 6 rows are within ±2.0 N of the model")
    assert all("H = 0.051" in text for text in [summary.blocks[1].text])
    for drawing in (block for pair in shown.blocks if isinstance(pair, Pair) for block in pair.blocks):
        assert not isinstance(drawing, Drawing) or drawing.wide.count("<circle") == 12
    panels = misfit.misfit.build(inputs)
    drawn = [figure.key for block in panels.blocks if isinstance(block, Panels) for figure in block.figures]
    assert "misfit-z-slip" in drawn and not any("speed" in key or "line_position" in key for key in drawn)
    refused = replace(found, verdict="unexplained", causes=())
    causes = overview.causes.build(replace(inputs, diagnosed=refused)).blocks
    (residual,) = [block for block in causes if isinstance(block, Drawing)]
    assert "median residual" in residual.title
    assert residual.wide.count("<circle") == 6
    assert "all rows are of one wheel" in step_of(refused).what


def test_a_soil_has_positive_intervals_one_unit_and_a_name_for_people(plain_material):
    values, sigmas = (
        {"shear_modulus_m": 0.00106, "cohesion_pa": 50.0},
        {"shear_modulus_m": 0.00098, "cohesion_pa": 100.0},
    )
    found = replace(diagnosis("unexplained"), soils=(SoilEstimate("clay", values, sigmas),))
    report = built(replace(plain_material, terrain="sandy_loam"), found)
    (table,), (*_, of_workings, _) = (
        [
            part
            for block in section(report, key).blocks
            if isinstance(block, Pair)
            for part in block.blocks
            if isinstance(part, Table)
        ]
        for key in ("fit", "workings")
    )
    assert [row[1:4] for row in of_workings.rows] == [["0.001060", "0.00098", "m"], ["0.05000", "0.10", "kPa"]]
    assert "<title>Sandy loam</title>" in report.html("report.json") and report.head.title == "Sandy_loam"
    assert [row[2] for row in table.rows] == ["0.000227 … 0.00495", "−0.146 … 0.246"]
    assert [row[0] for row in table.rows] == ["K (m)", "c (kPa)"]


def test_what_is_noted_of_runs_names_them_and_their_channels(plain_material):
    slow = Note(RunCode.CHANNEL_GAPS, values={"role": "ground_speed", "share": 0.25})
    first, *others = plain_material.runs
    runs = (replace(first, quality=replace(first.quality, notes=[slow])), *others)
    texts = [b.text for b in overview.signals.build(replace(plain_material, runs=runs)).blocks if isinstance(b, Text)]
    assert f"In {first.run.id}: ground speed is missing for 25 % of the run, and those samples are excluded." in texts


def test_no_option_of_a_command_breaks_in_two():
    assert _unbroken("wheelsoil zero a-b.mcap --vehicle <v>") == (
        'wheelsoil zero a-b.mcap <span class="whole">--vehicle</span> &lt;v&gt;'
    )


def test_samples_beyond_the_axis_are_counted():
    plane = Plane((0.0, 1.0), (0.0, 10.0), "x", "y")
    x, y = np.full(100, 0.5), np.full(100, 5.0)
    assert beyond((x, y), plane) == ""
    y[:2] = 11.0, -1.0
    assert beyond((x, y), plane) == ", 2.0 % beyond the axis"
    x[0] = 2.0
    assert beyond((x, y), plane) == ", 1.0 % beyond the axis"
