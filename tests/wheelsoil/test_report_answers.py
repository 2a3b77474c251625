"""The section that answers what a test engineer asks: every question under every verdict, and nothing against it."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import get_args
from unittest.mock import patch

import pytest
from diagnosis_samples import diagnosis, seen
from report_support import material_of, processed_of

from daq import Note
from daq.runs import SetAsideRun
from model import DiagnosisCode, LackCode
from model.diagnosis import Candidate, Cause, Detectable, Grounds, LackOfFit, ParameterEstimate
from model.diagnosis.core.result import Verdict
from processing import RunCode
from wheelsoil.report import build_report
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.numbers import load_text
from wheelsoil.wording.transducer_text import transducer_words
from wheelsoil.wording.verdict import headline_of
from wheelsoil.workflows.cause_cost import cost_of_verdict, highest_slip_of

PLAIN = str.maketrans({"−": "-", "\u202f": ""})
ZERO = Cause(
    "torque_zero",
    "",
    "measurement",
    "torque_zero",
    0.99,
    1.0,
    (ParameterEstimate("offset_nm", "N m", 82.6, (78.1, 87.1), 2.3),),
)


@pytest.fixture(scope="module")
def material(campaign) -> ReportInputs:
    return material_of(processed_of(campaign))


def answers(inputs: ReportInputs) -> dict[str, str]:
    """Return the answers of a report by the first words of their questions."""
    report = build_report(inputs)
    assert not report.left_out
    [section] = [section for section in report.sections if section.key == "answers"]
    keys = {section.key for section in report.sections}
    assert all(not link or link.removeprefix("#") in keys for _, _, link in section.blocks[0].lines)
    return {question: text for question, text, _ in section.blocks[0].lines}


@pytest.mark.parametrize("verdict", get_args(Verdict))
def test_every_question_has_an_answer_under_every_verdict(material: ReportInputs, verdict: Verdict) -> None:
    found = answers(replace(material, diagnosed=diagnosis(verdict)))
    assert len(found) == 10 and all(text.strip(" .–-") for text in found.values())
    assert all(bad not in text for text in found.values() for bad in ("nan", "..", "  "))
    model, cost = found["How good is the model elsewhere?"], found["What does it cost?"]
    relied = verdict != "unexplained"
    assert ("Rely on no model" in model) != relied and ("Tested at" in model) == relied
    assert ("points" in cost) == (verdict in ("named", "one_of"))
    assert "Not known" in found["What has changed?"]


def test_what_a_named_cause_costs_is_said_at_the_usual_and_the_highest_slip(material: ReportInputs) -> None:
    text = answers(replace(material, diagnosed=diagnosis()))["What does it cost?"]
    report = build_report(replace(material, diagnosed=diagnosis())).numbers()["sections"]["cost"]["costs"]
    highest = max(one["slip"] for one in report)
    assert highest > 0.5 and f"; at slip {highest:g} drawbar pull" in text and ", at slip 0.2 drawbar pull −" in text
    [deeper] = [one["difference"] for one in report if one["quantity"] == "sinkage" and one["slip"] == highest]
    assert deeper == pytest.approx(0.051 * highest, rel=0.05)


def test_the_highest_slip_is_that_of_the_fitted_runs(material: ReportInputs) -> None:
    """As in the section of the cost: a run that lacks a signal is in neither."""
    *others, last = material.runs
    lost = {"driving_torque": Note(RunCode.NEVER_USABLE, values={"role": "driving_torque"})}
    lacking = replace(last, quality=replace(last.quality, missing=lost))
    runs = (*(replace(run, slip=0.45 * run.slip) for run in others), lacking)
    with patch("wheelsoil.report.sections.answers.cost_of_verdict", wraps=cost_of_verdict) as cost:
        build_report(replace(material, diagnosed=diagnosis(), runs=runs))
    assert {call.kwargs["highest_slip"] for call in cost.call_args_list} == {highest_slip_of(runs[:-1])}


def test_a_wheel_with_an_id_that_is_the_only_one_asks_for_no_others(material: ReportInputs) -> None:
    wheel = material.vehicle.wheel
    assert wheel is not None
    for axle, asked in ((None, False), (2, True)):
        vehicle = material.vehicle.model_copy(update={"wheel": wheel.model_copy(update={"id": "RL", "axle": axle})})
        report = build_report(replace(material, vehicle=vehicle, diagnosed=diagnosis()))
        assert ("Of wheel RL alone: if others are instrumented" in str(report.sections[0].blocks)) == asked


def test_the_channel_that_is_wrong_is_not_trusted_and_the_others_are() -> None:
    found = replace(diagnosis(), causes=(ZERO,), candidates=(Candidate("torque_zero", 0.99),))
    torque = next(text for text in transducer_words(found) if text.startswith("Driving torque"))
    assert torque.startswith("Driving torque: not as it is read: torque zero, offset = 82.6 (78.1 to 87.1) N m")
    pull = next(text for text in transducer_words(found) if text.startswith("Drawbar pull"))
    assert pull == "Drawbar pull: no error is found; drawbar pull zero from 32 N on would show."
    perhaps = replace(found, verdict="one_of", causes=(replace(ZERO, probability=0.4),))
    assert any("not known: torque zero (40.0 %) may act" in text for text in transducer_words(perhaps))
    beside = replace(found, candidates=(*found.candidates, Candidate("drawbar_pull_zero", 0.97)))
    assert "Drawbar pull: not known: drawbar pull zero (97.0 %) may act." in transducer_words(beside)


def test_what_the_runs_cannot_show_is_not_called_sound() -> None:
    held = {"drawbar_pull_zero": Note(LackCode.NOT_AT_STANDSTILL)}
    [pull] = [t for t in transducer_words(replace(diagnosis(), not_identifiable=held)) if t.startswith("Drawbar pull")]
    assert pull == "Drawbar pull: no error is found; these runs do not show drawbar pull zero."
    sizes = {"drawbar_pull_gain": Detectable("relative", 0.014, "1")}
    [pull] = [
        t for t in transducer_words(replace(diagnosis(), minimum_detectable=sizes)) if t.startswith("Drawbar pull")
    ]
    assert "drawbar pull gain from 1.4 % on would show" in pull


def test_no_channel_is_trusted_where_nothing_explains_the_runs() -> None:
    unknown = diagnosis("unexplained")
    off = replace(unknown, grounds=Grounds(lack_of_fit=LackOfFit(worst=unknown.what_is_wrong[1:])))
    said = {text.partition(":")[0]: text for text in transducer_words(off)}
    assert "do not use it" in said["Driving torque"]
    assert "not judged" in said["Drawbar pull"] and "not judged" in said["Vertical load"]


def test_a_run_that_lies_apart_stands_in_its_channel() -> None:
    values = {"run": "run-2", "channel": "dp", "size": 292.0, "sigma": 40.0, "chance": 1e-9}
    apart = replace(
        diagnosis("nothing_detectable"), grounds=Grounds(cautions=(Note(DiagnosisCode.RUN_APART, values=values),))
    )
    assert "Drawbar pull: in run-2 it is 292 N off" in " ".join(transducer_words(apart))
    assert headline_of(apart) == "No cause is detected, but run-2 lies apart from the other runs."


def test_no_channel_is_blamed_where_the_runs_ask_for_two_soils() -> None:
    unknown = diagnosis("unexplained")
    grounds = Grounds(lack_of_fit=LackOfFit(worst=unknown.what_is_wrong[1:]), terrains=(("run-1",), ("run-2",)))
    [text] = transducer_words(replace(unknown, grounds=grounds))
    assert "not judged" in text


def test_a_fault_of_a_sensor_stands_in_its_channel() -> None:
    told = transducer_words(diagnosis("nothing_detectable"), {"driving_torque": ["6.0 s frozen in run-14"]})
    [torque] = [text for text in told if text.startswith("Driving torque")]
    assert torque.endswith("6.0 s frozen in run-14.") and sum("frozen" in text for text in told) == 1


def test_what_several_passes_change_is_said_of_the_middle_passage(material: ReportInputs) -> None:
    size = ParameterEstimate("per_pass", "1", 0.22, (0.17, 0.27), 0.025)
    rut = Cause("multi_pass", "", "physical", "multi_pass", 0.99, 1.0, (size,))
    found = replace(diagnosis(), causes=(rut,))
    first = answers(replace(material, diagnosed=found))["What does it cost?"]
    assert first == "Costs nothing in steady driving."
    runs = tuple(
        replace(run, run=run.run.model_copy(update={"pass_number": 2 * i + 1})) for i, run in enumerate(material.runs)
    )
    later = answers(replace(material, runs=runs, diagnosed=found))["What does it cost?"]
    assert "passage 2 over the soil, at slip 0.2 drawbar pull +" in later


def test_an_error_of_the_reading_is_in_no_prediction(material: ReportInputs) -> None:
    size = ParameterEstimate("offset_n", "N", 80.0, (60.0, 100.0), 10.0)
    zero = Cause("drawbar_pull_zero", "", "measurement", "drawbar_pull_zero", 0.99, 1.0, (size,))
    sound, read = (
        answers(replace(material, diagnosed=found))["How good is the model elsewhere?"]
        for found in (diagnosis("nothing_detectable"), replace(diagnosis(), causes=(zero,)))
    )
    assert "would read" not in sound and "would read" in read and "without the cause" not in read
    said, reading = (
        float(re.findall(rf"{before} (−?[\d\u202f.]+) N", read)[0].translate(PLAIN)) for before in ("says", "read")
    )
    assert reading - said == pytest.approx(80.0, abs=10.0)


def test_two_soils_are_one_story_on_the_page(material: ReportInputs) -> None:
    names = tuple(run.run.id for run in material.runs)
    unknown = diagnosis("unexplained")
    grounds = Grounds(lack_of_fit=LackOfFit(worst=unknown.what_is_wrong[1:]), terrains=(names[:1], names[1:]))
    found = answers(replace(material, diagnosed=replace(unknown, grounds=grounds, plot_data=(seen(runs=names),))))
    assert "of two soils, or an unknown cause" in found["How sure is that?"]
    assert "ask" in found["What is wrong?"] and "another soil" in found["Which runs are bad?"]
    assert "not judged" in found["Can the transducer be trusted?"]
    assert "folder" in found["What next?"]


def test_what_is_beyond_what_is_plausible_is_not_shown_by_the_runs() -> None:
    sizes = {"load_gain": Detectable("relative", 0.93, "1"), "load_zero": Detectable("offset_n", 300.0, "N")}
    weighed = (Candidate("none", 0.9), Candidate("load_gain", 0.05), Candidate("load_zero", 0.05))
    null = replace(diagnosis("nothing_detectable"), minimum_detectable=sizes, candidates=weighed)
    [load] = [text for text in transducer_words(null) if text.startswith("Vertical load")]
    assert "load zero from 300 N on would show; these runs do not show load gain" in load


def test_a_cause_that_is_not_sure_is_not_nothing(material: ReportInputs) -> None:
    null, weighed = diagnosis("nothing_detectable"), (Candidate("none", 0.124), Candidate("wheel_radius", 0.778))
    for found, cost in (
        (null, "Nothing that these data show: no cause is detected."),
        (replace(null, candidates=weighed), "Not known. No cause is sure (no cause: 12.4 %)"),
    ):
        assert answers(replace(material, diagnosed=found))["What does it cost?"].startswith(cost)


def test_both_errors_are_labelled_where_no_cause_is_named(material: ReportInputs) -> None:
    text = answers(replace(material, diagnosed=diagnosis("one_of")))["How good is the model elsewhere?"]
    assert "120 N and driving torque 40.0 N m without a cause, drawbar pull 66.0 N" in text
    assert text.count("with slip sinkage") == 1 and "most probable" not in text


def test_runs_are_counted_as_the_badge_counts_them(material: ReportInputs) -> None:
    aside = SetAsideRun("run-8", "switched_off", "switched off in choice.toml", "say use = true")
    inputs = replace(material, diagnosed=diagnosis("nothing_detectable"), set_aside=(aside,))
    badge = build_report(inputs).head.badge
    assert badge is not None and answers(inputs)["Are the data good?"].startswith(f"{badge[1][2:]}; ")


def test_loads_are_written_by_one_rule() -> None:
    assert (load_text(8000.0, 11150.0), load_text(9180.0), load_text(120.0, 210.0)) == (
        "8.0 to 11.2 kN",
        "9.2 kN",
        "120 to 210 N",
    )
