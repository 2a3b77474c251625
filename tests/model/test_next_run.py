"""Manoeuvres are ranked, and what is ranked first does what was expected once it is driven."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from diagnosis_support import LEVEL
from firm_road import road
from short_campaign import driven, noise_of

from model import StepCode
from model.diagnosis import Campaign, DiagnosisOptions, coasted, samples_of
from model.diagnosis.core.bayes_factors import against_rest
from model.diagnosis.findings.isolability import least_left, own_columns
from model.diagnosis.findings.isolability import projected_without_soil as without_soil
from model.diagnosis.planning.manoeuvres import (
    braked,
    manoeuvres,
    only_run,
    slower_ramps,
    turned,
    typical_run,
    with_load_times,
)
from model.diagnosis.planning.next_run import Member, next_runs
from model.diagnosis.planning.static_tests import calibrated
from model.diagnosis.time_series import linearise_campaigns
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.samples import Samples
from model.effects.transducer import DrawbarPullGain
from model.wheel_soil import prior_of
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.wording.notes import note_text, step_text

STATIC = (StepCode.LIFTED_ZERO, StepCode.KNOWN_PULL, StepCode.KNOWN_TORQUE, StepCode.HARD_GROUND)
EFFECTS = ("slope", "drawbar_pull_zero", "crosstalk", "torque_zero", "bulldozing")


@lru_cache(maxsize=4)
def seen_of(*indices: int) -> LinearisedCampaign:
    """Look at some of four runs; the first and third go out, the others back."""
    campaign = replace(driven(), runs=tuple(driven().runs[i] for i in indices))
    return linearise_campaigns([campaign], DiagnosisOptions(effects=EFFECTS), [noise_of(driven())])


def driven_with(*added_load_kg: float) -> Campaign:
    """Return runs of 20 s with these added loads."""
    options = SimulationOptions(runs=len(added_load_kg), duration_s=20.0, seed=5, added_load_kg=added_load_kg, **LEVEL)
    runs = tuple(process(*simulated_roles(options, index)) for index in range(options.runs))
    return Campaign("clay", runs, options.wheel, options.laboratory_soil, prior_of(options.laboratory_soil))


def run_of_samples() -> Samples:
    return only_run(samples_of(driven()), 0)


def test_rounding_does_not_decide_which_of_two_runs_is_the_typical_one() -> None:
    samples = samples_of(driven())
    for rounding in (-1e-14, 1e-14):
        load_n = np.array([580.0, 590.0 * (1 + rounding), 600.0, 610.0])[samples.run]
        loaded = replace(samples, conditions=replace(samples.conditions, vertical_load_n=load_n))
        assert typical_run(loaded).run_names == samples.run_names[1:2]


def members(**sizes: float) -> tuple[Member, ...]:
    return tuple(Member(key, np.array([size])) for key, size in sizes.items())


def parted(seen: LinearisedCampaign, one: Member, other: Member) -> float:
    """Return half of d^2 that `other` leaves of `one`."""
    columns = own_columns(seen.grams, other.key)
    sided = np.array([seen.grams.causes[i].one_sided for i in columns])
    information = without_soil(seen.grams).information
    return 0.5 * least_left(information, own_columns(seen.grams, one.key), one.size, columns, sided) ** 2


def test_the_other_direction_parts_slope_from_a_zero_and_does_so_when_driven() -> None:
    seen = seen_of(0, 2)
    pair = members(slope=3.0, drawbar_pull_zero=0.4)
    ranked = next_runs(seen, pair, most=20)
    worth = {run.step.code: run.expected_log_bayes_factor for run in ranked}
    back = next(run for run in ranked if run.step.code == StepCode.OTHER_DIRECTION)
    assert worth[back.step.code] > 2 * worth[StepCode.LIKE_OTHERS]
    assert set(back.separates) == {"slope", "drawbar_pull_zero"}
    gained = {
        runs: parted(seen_of(0, 2, runs), *pair) - parted(seen, *pair)
        for runs in (1, 2)  # a run back, and the same run out once more
    }
    assert gained[1] > 2 * gained[2]
    assert gained[1] == pytest.approx(back.expected_log_bayes_factor, rel=0.6)


@pytest.mark.slow
def test_the_load_that_ranks_first_of_what_can_be_driven_parts_cross_talk_from_a_zero() -> None:
    """Runs at one load, then one more at that load against one with about the load that was advised."""
    light = driven_with(0.0, 0.0, 0.0)
    seen = linearise_campaigns([light], DiagnosisOptions(effects=EFFECTS), [noise_of(light)])
    pair = members(crosstalk=0.4, drawbar_pull_zero=0.4)
    ranked = [r for r in next_runs(seen, pair, most=20) if r.step.code not in STATIC]
    assert ranked[0].step.code == StepCode.MORE_LOAD
    gained = {}
    for added_kg in (0.0, 600.0):
        more = driven_with(0.0, 0.0, 0.0, added_kg)
        after = linearise_campaigns([more], DiagnosisOptions(effects=EFFECTS), [noise_of(light)])
        gained[added_kg] = parted(after, *pair) - parted(seen, *pair)
    assert gained[600.0] > 3 * max(gained[0.0], 0.0)
    worth = ranked[0].expected_log_bayes_factor
    assert gained[600.0] == pytest.approx(worth, rel=0.6)


def test_a_lifted_wheel_parts_a_zero_from_cross_talk() -> None:
    seen = seen_of(0, 1, 2, 3)
    ranked = next_runs(seen, members(drawbar_pull_zero=0.2, crosstalk=0.3))
    assert ranked[0].step.code == StepCode.LIFTED_ZERO
    assert sum(run.step.code == StepCode.LIKE_OTHERS for run in ranked) <= 1


def test_a_radius_that_may_be_something_else_is_told_by_coasting_on_hard_ground() -> None:
    options = DiagnosisOptions(effects=("wheel_radius", "load_gain", "grouser", "speed_bias"))
    seen = linearise_campaigns([driven()], options, [noise_of(driven())])
    for rival in ("load_gain", "grouser"):
        ranked = next_runs(seen, members(**{"wheel_radius": 1.0, rival: 0.5}))
        assert ranked[0].step.code == StepCode.HARD_GROUND, [r.step.code for r in ranked]
        assert set(ranked[0].separates) == {"wheel_radius", rival}
    coasting = replace(driven(), static=(coasted(road()),))
    seen = linearise_campaigns([coasting], options, [noise_of(driven())])
    ranked = next_runs(seen, members(wheel_radius=1.0, load_gain=0.5))
    assert all(run.step.code != StepCode.HARD_GROUND for run in ranked), "it errs as the first does"


def test_one_member_needs_no_run() -> None:
    seen = seen_of(0, 2)
    assert next_runs(seen, members(slope=1.0)) == ()
    assert next_runs(seen, members(slope=1.0, unheard_of=1.0)) == ()


def test_manoeuvres_keep_what_they_do_not_change() -> None:
    run = run_of_samples()
    slip = np.asarray(run.conditions.slip)
    back = turned(run)
    np.testing.assert_array_equal(back.conditions.direction, -np.asarray(run.conditions.direction))
    np.testing.assert_array_equal(turned(back).conditions.line_position, run.conditions.line_position)
    heavier = with_load_times(run, 1.5)
    np.testing.assert_allclose(heavier.instants.vertical_load_n.mean(), 1.5 * run.instants.vertical_load_n.mean())
    np.testing.assert_array_equal(heavier.conditions.slip, slip)
    slow = slower_ramps(run)
    assert len(slow) == 2 * len(run) and np.ptp(slow.time_s) > 1.9 * np.ptp(run.time_s)
    assert (np.diff(slow.time_s) > 0).all()


def ballasted(*added_kg: float) -> Samples:
    """Return runs of a wheel under 8 kN that carries a third of the ballast."""
    samples = samples_of(driven())
    load_n = 8000.0 + np.array(added_kg)[samples.run] * 9.80665 / 3
    return replace(samples, conditions=replace(samples.conditions, vertical_load_n=load_n))


def test_a_load_to_drive_with_is_told_as_mass_on_that_wheel() -> None:
    added_kg = (2000.0, 2500.0, 2000.0, 2500.0)
    offered = {m.step.code: m for m in manoeuvres(ballasted(*added_kg), added_kg)}
    for code, so_far, words in (
        (StepCode.MORE_LOAD, 8000 + 2500 * 9.80665 / 3, "kg more"),
        (StepCode.LESS_LOAD, 8000 + 2000 * 9.80665 / 3, "kg less"),
    ):
        text = note_text(offered[code].step)
        load_n, mass_kg = (float(x) for x in re.findall(r"([\d.]+) k(?:N|g)", text))
        assert words in text
        assert abs(load_n * 1e3 - so_far) / 9.80665 == pytest.approx(mass_kg, abs=11.0)
        assert np.mean(offered[code].samples.conditions.vertical_load_n) == pytest.approx(load_n * 1e3, abs=51.0)


@pytest.mark.parametrize(
    ("added_kg", "least_n"),
    [((100.0, 500.0) * 2, None), ((0.0, 300.0) * 2, None), ((900.0,) * 4, None), ((2500.0, 3000.0) * 2, 12129.0)],
)
def test_no_load_below_the_unballasted_wheel_is_offered(added_kg: tuple[float, ...], least_n: float | None) -> None:
    """Where the ballast is the same in all runs, the wheel's share of it does not show: nothing lighter is offered."""
    lighter = [m for m in manoeuvres(ballasted(*added_kg), added_kg) if m.step.code == StepCode.LESS_LOAD]
    assert [m.step.values["load_n"] for m in lighter] == ([] if least_n is None else [pytest.approx(least_n, rel=1e-3)])


def test_ballast_that_can_come_off_bounds_the_lightest_load() -> None:
    added_kg = (600.0, 900.0) * 2
    [lighter] = [m for m in manoeuvres(ballasted(*added_kg), added_kg) if m.step.code == StepCode.LESS_LOAD]
    assert lighter.step.values["load_n"] == pytest.approx(8000.0)
    assert lighter.step.values["added_kg"] == pytest.approx(-200.0)


def test_a_static_calibration_parts_a_gain_of_the_pull_from_one_of_the_torque_and_says_its_cost() -> None:
    options = DiagnosisOptions(effects=("drawbar_pull_gain", "torque_gain", "drawbar_pull_zero"))
    seen = linearise_campaigns([driven()], options, [noise_of(driven())])
    ranked = next_runs(seen, members(drawbar_pull_gain=0.3, torque_gain=0.4), most=20)
    worth = {run.step.code: run.expected_log_bayes_factor for run in ranked}
    driving = max(nats for code, nats in worth.items() if code not in STATIC)
    for code in (StepCode.KNOWN_PULL, StepCode.KNOWN_TORQUE):
        assert worth[code] > 5 * driving
    first = ranked[0]
    assert first.cost_runs == 2.0 and set(first.separates) == {"drawbar_pull_gain", "torque_gain"}
    assert "on the lifted wheel: about" in step_text(first)
    assert StepCode.LIFTED_ZERO not in worth, "a zero tells nothing of a gain"


def test_a_known_pull_shows_as_much_of_a_gain_as_it_is_large() -> None:
    """By hand: of a lifted wheel pulled by P, a gain e shows as e P, over the noise of the reading and of P."""
    options = DiagnosisOptions(effects=("drawbar_pull_gain",))
    [data] = linearise_campaigns([driven()], options, [noise_of(driven())]).campaigns
    run = typical_run(data.samples)
    scale = DrawbarPullGain.parameters[0].prior_scale
    small, large = (float(calibrated("dp", size, data, data.simulation, run)[0, 0]) for size in (100.0, 1e5))
    assert large == pytest.approx((scale / 0.005) ** 2, rel=2e-3)
    assert 0 < small < large


def test_a_braked_run_brakes_with_slip_that_belongs_to_its_speeds() -> None:
    run = braked(run_of_samples())
    c = run.conditions
    slip = np.asarray(c.slip)
    assert (slip < 0).all() and slip.min() >= -0.61
    ratio = run.wheel_radius_m * np.asarray(c.wheel_speed_radps) / np.asarray(c.ground_speed_mps)
    np.testing.assert_allclose(slip, ratio - 1.0, atol=1e-12)


def test_a_sinkage_sensor_is_offered_where_there_is_none() -> None:
    codes = [m.step.code for m in manoeuvres(samples_of(driven()))]
    assert StepCode.SINKAGE in codes
    assert StepCode.TORQUE not in codes
    read = next(m for m in manoeuvres(samples_of(driven())) if m.step.code == StepCode.RUT).samples
    slips = np.asarray(read.conditions.slip)[np.isfinite(read.measured["z"])]
    assert len(slips) == 5 and np.ptp(slips) == np.ptp(np.asarray(read.conditions.slip))
    without = samples_of(driven(), ("dp",))
    assert StepCode.TORQUE in [m.step.code for m in manoeuvres(without)]


def test_members_that_a_run_parts_by_thousands_of_nats_are_parted() -> None:
    nats = np.array([1896.0, 1896.0, 1896.0, 0.0])
    weights = np.array([0.9, 0.05, 0.03, 0.02])
    assert against_rest(nats, weights, 3) == pytest.approx(1896.0)
    assert against_rest(np.zeros(4), weights, 0) == pytest.approx(0.0)
