"""The report's sections: what their tables show stands in report.json, and says what it should."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnosis_samples import diagnosis
from report_support import cells_of, material_of, section_of, text_of

from daq import Note, StaticTest
from daq.recording import Event
from model import FitCode
from wheelsoil.cli.runs import print_fit
from wheelsoil.report import build_report
from wheelsoil.report.content import Panels, Table
from wheelsoil.report.inputs import model_sigmas, source_of
from wheelsoil.report.sections.quality import sensors
from wheelsoil.workflows.fit import FitChoices

EVIL = '<script>alert("x")</script>'
_NUMBER = re.compile(r"(?<![\w.])[−+-]?\d[\d\u202f]*(?:\.(\d+))?(?:e[+-]\d+)?(?![\w.])")
_SCALES = (1.0, 100.0, 1e3, 1e-3, 1e-6)
"""From the unit in report.json to that of a table: percent, milli, kilo, mega."""


def all_numbers(value: Any) -> list[float]:
    """Return every number in JSON values, those in texts too."""
    if isinstance(value, dict):
        return [n for key, item in value.items() for n in [*all_numbers(key), *all_numbers(item)]]
    if isinstance(value, list):
        return [n for item in value for n in all_numbers(item)]
    if isinstance(value, str):
        return [as_float(found[0]) for found in _NUMBER.finditer(value)]
    return [float(value)] if isinstance(value, int | float) and not isinstance(value, bool) else []


def as_float(text: str) -> float:
    return float(text.replace("\u202f", "").replace("−", "-"))


def test_every_number_of_a_table_is_in_the_json(processed):
    full = replace(material_of(processed, FitChoices(soil_prior=True)), diagnosed=diagnosis("named"))
    report = build_report(full)
    numbers = report.numbers()
    looked = 0
    for section in report.sections:
        known = np.array(all_numbers(numbers["sections"][section.key]))
        for cell in cells_of(section):
            if re.fullmatch("[0-9a-f]{16}", cell):
                continue  # the beginning of a hash, now and then of digits only
            for found in _NUMBER.finditer(cell):
                shown = as_float(found[0])
                last = 10.0 ** (-len(found[1] or "") + (int(found[0].partition("e")[2] or 0)))
                near = [np.abs(known * scale - shown) <= 0.5001 * last + 1e-9 * abs(shown) for scale in _SCALES]
                assert np.any(near), f"{section.key}: {found[0]} of {cell!r}"
                looked += 1
    assert looked > 200


@pytest.mark.parametrize(("latency_s", "said"), [(0.0312, "31 ± 4 late"), (-0.0312, "31 ± 4 early"), (np.nan, "–")])
def test_a_latency_is_a_positive_number_and_a_direction(material, latency_s, said):
    run = material.runs[0]
    quality = replace(run.quality, residual_latency_s=latency_s, residual_latency_sigma_s=0.004)
    section = sensors.build(replace(material, runs=(replace(run, quality=quality), *material.runs[1:])))
    table = next(block for block in section.blocks if isinstance(block, Table) and block.caption == "Clocks and speeds")
    assert table.rows[0][table.head.index("ground speed delay (ms)")] == said


@pytest.mark.parametrize("reason", ["no_progress", "max_iterations"])
def test_a_fit_that_is_not_at_an_end_gets_a_next_step(material, reason, capsys):
    stuck = tuple(replace(model, stop_reason=reason) for model in material.fit.models)
    fit = replace(material.fit, models=stuck)
    result = build_report(replace(material, campaign=fit)).numbers()["sections"]["verdict"]
    (text,) = [check["text"] for check in result["checks"] if "stopped after" in check["text"]]
    assert "check cohesive_modulus_kn" in text
    print_fit(fit)
    assert "next: the data ask for a sinkage beyond the axle" in capsys.readouterr().err
    print_fit(material.fit)
    assert "next:" not in capsys.readouterr().err


def test_what_a_recording_tells_of_itself_is_shown(processed, material):
    sources = [source_of(run) for run, _ in processed]
    start_ns = material.runs[0].start_ns
    events = (
        Event(start_ns + 2_500_000_000, "mark", EVIL),
        Event(start_ns + 4_000_000_000, "bus", "can0 is down", "error"),
    )
    sources[0] = replace(sources[0], events=events, dropped_frames=12, losses={"kernel.can0": 12}, exit_status="")
    report = build_report(replace(material, sources=tuple(sources)))
    tables = {block.caption: block.rows for block in section_of(report, "sensors").blocks if isinstance(block, Table)}
    assert tables["Marks and events"] == [["run-1", "2.5", "mark", EVIL], ["run-1", "4.0", "error", "can0 is down"]]
    assert tables["Losses counted by the logger"] == [["run-1", "kernel.can0", "12"]]
    assert [row[2:4] for row in tables["Recordings"]] == [["12", "cut off"], ["not counted", "ok"]]
    grades = report.numbers()["sections"]["glance"]["grades"]
    assert (grades["run-1"]["level"], grades["run-2"]["level"]) == ("fair", "good")
    assert "<script>alert" not in report.html("x.json")


def test_intervals_and_bounds_are_laid_out_as_lmfit_does(material):
    lyasko = material.fit.model("lyasko")
    held = replace(lyasko.estimates[0], at_bound=True, sigma=float("nan"))
    stuck = replace(
        lyasko,
        estimates=(held, *lyasko.estimates[1:]),
        warnings=(Note(FitCode.HELD_BY_BOUND, values={"names": ("m1",), "value": 20.0}),),
    )
    models = tuple(stuck if model.name == "lyasko" else model for model in material.fit.models)
    report = build_report(replace(material, campaign=replace(material.fit, models=models)))
    tables = {block.caption: block for block in section_of(report, "coefficients").blocks if isinstance(block, Table)}
    variables = tables["Variables (the paper's Tab. 3)"]
    (row,) = [row for row in variables.rows if row[0] == "Lyasko"]
    shown = dict(zip(variables.head, row, strict=True))
    assert (shown["variable"], shown["standard error"], shown["held"]) == ("m₁", "–", "by its bound")
    assert (shown["min"], shown["max"]) == ("−1.00", "20.0")
    assert [row[1] for row in tables["Correlations"].rows] == ["C(m₁, m₂)"]
    assert "held by its bound 20" in text_of(report, "coefficients")


def test_a_pair_of_coefficients_is_drawn_with_what_the_data_leave(material):
    [panels] = [b for b in section_of(build_report(material), "coefficients").blocks if isinstance(b, Panels)]
    [figure] = [one for one in panels.figures if one.key == "pair-lyasko"]
    fit = material.fit.model("lyasko")
    _, region, centre = figure.data
    for axis, name in (("x", "m1"), ("y", "m2")):
        estimate = fit.estimate(name)
        assert centre[axis] == [pytest.approx(estimate.value, rel=1e-4)]
        assert max(region[axis]) - estimate.value == pytest.approx(
            2.4477 * estimate.sigma, rel=0.01
        )  # chi2, 2 and 95 %
    assert {one.key for one in panels.figures} == {f"pair-{m.name}" for m in material.fit.models if m.correlation}


def test_the_band_is_what_the_coefficients_leave_open(material):
    ding = material.sigmas["dp"]["ding"]
    assert np.isnan(material.sigmas["dp"]["wong"]).all(), "nothing is fitted in it"
    seen = np.isfinite(ding)
    assert 100 < seen.sum() < len(ding)
    (n1,) = material.fit.model("ding").estimates
    doubled = replace(material.fit.model("ding"), estimates=(replace(n1, sigma=2 * n1.sigma),))
    again = model_sigmas(material.runs, replace(material.fit, models=(doubled,)))
    assert np.allclose(again["dp"]["ding"][seen], 2 * ding[seen])
    slip = material.pool.slip
    assert np.median(ding[seen & (slip > 0.5)]) > 3 * np.median(ding[seen & (slip > 0) & (slip < 0.1)])


def test_the_radius_on_which_the_wheel_coasted_is_shown_beside_that_of_the_slip(material):
    speeds = {"test": "coasting", "ground_speed_mps": 3.0, "ground_speed_sigma_mps": 0.01, "wheel_speed_radps": 6.4}
    tests = (
        StaticTest(test="lifted", driving_torque_nm=1.0, driving_torque_sigma_nm=0.5),
        StaticTest.model_validate(speeds),
        StaticTest.model_validate({**speeds, "run": "road", "ground_speed_mps": 3.04}),
        StaticTest.model_validate(speeds),
    )
    report = build_report(replace(material, diagnosed=replace(diagnosis(), static=tests)))
    shown = " ".join(cells_of(section_of(report, "sensors")))
    again = "by hand, 3.0 m/s 468.8 463.2 474.3 470.0"
    assert f"{again} run road 475.0 469.4 480.6 470.0 {again}" in shown, "two of one speed are two"
    radii = report.numbers()["sections"]["sensors"]["rolling_radius_mm"]
    assert [test["test"] for test in radii] == ["by hand, 3.0 m/s", "run road", "by hand, 3.0 m/s"]
    assert [test["radius"] for test in radii] == pytest.approx([468.75, 475.0, 468.75])
    assert radii[1]["interval95"] == pytest.approx([469.4, 480.6], abs=0.05)
    without = build_report(replace(material, diagnosed=diagnosis())).numbers()["sections"]["sensors"]
    assert "rolling_radius_mm" not in without
