"""The grade of a run: good, fair or poor, with what speaks against it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_samples import cause, diagnosis
from implausible import implausible

from daq import Note, Severity, SoilSection, TerrainConfig, UncertaintySection, VehicleConfig
from daq.runs import open_runs
from processing import ProcessedRun, ProcessOptions, Reason, RunCode, Standstill
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.workflows import process_runs
from wheelsoil.workflows.grading import doubted_soils, grade_of, short_runs


@pytest.fixture(scope="module")
def run(campaign) -> ProcessedRun:
    return process_runs(open_runs([campaign / "run-1.mcap"]), ProcessOptions())[0][1]


def without(run: ProcessedRun, share: float, why: Reason) -> ProcessedRun:
    """Return the run with a share of its used samples left out, from the first on."""
    reason = run.reason.copy()
    used = np.flatnonzero(run.used)
    reason[used[: int(share * len(used))]] = why
    return replace(run, reason=reason)


def noted(run: ProcessedRun, note: Note) -> ProcessedRun:
    return replace(run, quality=replace(run.quality, notes=(note,)))


def test_a_run_as_it_should_be_is_good(run):
    grade = grade_of(run)
    assert (grade.level, grade.reasons) == ("good", ())
    assert grade.usable_share > 0.95 and 0.5 < grade.highest_slip < 1


@pytest.mark.parametrize(("share", "level"), [(0.1, "good"), (0.35, "fair"), (0.7, "poor")])
def test_samples_that_are_missing_tell(run, share, level):
    grade = grade_of(without(run, share, Reason.INVALID_FIX))
    assert grade.level == level
    assert level == "good" or "invalid fix" in grade.reasons[0]


def test_what_was_left_out_by_hand_speaks_against_nothing(run):
    assert grade_of(without(run, 0.4, Reason.BY_HAND)).usable_share > 0.95


def test_a_run_without_a_usable_sample_is_poor_and_says_why(run):
    grade = grade_of(without(run, 1.0, Reason.GAP))
    assert grade.level == "poor" and "no sample can be used; most: gap" in grade.reasons[0]


def test_low_slip_tells(run):
    assert grade_of(replace(run, slip=0.4 * run.slip)).level == "fair"
    assert grade_of(replace(run, slip=0.05 * run.slip)).level == "fair"


def test_a_run_that_was_only_braked_is_no_bad_data(run):
    grade = grade_of(replace(run, slip=-np.abs(run.slip)))
    assert grade.level == "fair"
    assert grade.reasons[0].startswith("hardly driven: slip reaches")


def test_what_processing_noted_tells(run):
    turned = grade_of(noted(run, implausible("sign:driving_torque")))
    assert turned.level == "poor" and "driving torque seems to have the wrong sign" in turned.reasons[0]
    stamps = grade_of(noted(run, Note(RunCode.LATE_STAMPS, Severity.DOUBT, {"role": "ground_speed", "count": 3})))
    assert stamps.level == "fair" and "run backward" in stamps.reasons[0]
    assert grade_of(noted(run, Note(RunCode.NO_STANDSTILL))).level == "good"


def test_losses_make_a_good_run_fair(run):
    grade = grade_of(run, ["12 frames were lost before they were recorded"])
    assert (grade.level, grade.reasons) == ("fair", ("12 frames were lost before they were recorded",))


@pytest.mark.parametrize(("levels", "level"), [((400.0, 390.0), "fair"), ((400.0, -390.0), "good"), ((40.0,), "good")])
def test_a_zero_tells_where_it_is_large_and_stays(run, levels, level):
    stands = tuple(Standstill(0.0, 2.0, {"drawbar_pull": n}, {"drawbar_pull": 5.0}, "released") for n in levels)
    grade = grade_of(replace(run, quality=replace(run.quality, standstills=stands)))
    assert grade.level == level
    [said, *_] = grade.reasons or [""]
    assert level == "good" or said.startswith("drawbar pull reads 395 N at standstill, more than 2 % of load (")


def test_a_zero_that_is_named_for_all_runs_is_not_judged_by_one(run):
    """The limit goes with the load, so that one zero spoiled some runs and not others."""
    stands = (Standstill(0.0, 2.0, {"driving_torque": 90.0}, {"driving_torque": 3.0}, "released"),)
    light = replace(run, quality=replace(run.quality, standstills=stands))
    heavy = replace(light, vertical_load_n=2.0 * light.vertical_load_n)
    assert [grade_of(one).level for one in (light, heavy)] == ["fair", "good"]
    named = replace(diagnosis(), causes=(cause("torque_zero", "torque_zero", "", 0.99),))
    vehicle = VehicleConfig.model_validate({"wheel": {"radius_m": 0.5, "width_m": 0.3}})
    inputs = ReportInputs((light, heavy), None, "", vehicle, "clay", diagnosed=named)
    assert {grade.reasons for grade in inputs.grades} == {("torque zero, the named cause: see Do next",)}
    unsure = replace(inputs, diagnosed=replace(named, verdict="one_of"))
    assert [grade.level for grade in unsure.grades] == ["fair", "good"]


def test_a_run_far_shorter_than_the_others_is_noted(run):
    short = replace(run, rate_hz=3 * run.rate_hz)
    assert short_runs([run, short]) == [[], []]
    [none, [said], also_none] = short_runs([run, short, run])
    lengths = [f"{len(one) / one.rate_hz:.0f} s" for one in (short, run)]
    assert said == f"{lengths[0]} long, most runs {lengths[1]}: check whether it was cut off"
    assert none == also_none == [] and grade_of(run, [said]).reasons == (said,)


@pytest.mark.parametrize(("share", "noted"), [(0.1, False), (2.9, False), (10.0, True)])
def test_a_sigma_in_percent_is_noted_once(share, noted):
    soil = SoilSection(
        name="field",
        cohesion_kpa=1.0,
        friction_angle_deg=25.0,
        shear_modulus_m=0.02,
        sinkage_exponent=1.0,
        cohesive_modulus_kn=1.0,
        frictional_modulus_kn=500.0,
    )
    terrain = TerrainConfig(soil=soil, uncertainty=UncertaintySection(cohesion_kpa=share))
    found = doubted_soils([terrain, None, terrain])
    assert [text.endswith("percent, write 0.1") for text in found] == [True] * noted
