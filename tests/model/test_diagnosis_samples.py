"""Samples: block means of what was driven, places and clocks, and what is not used and why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from daq import DataError, Note, RunInfo
from model import DiagnosisCode, LackCode
from model.diagnosis import Campaign, considered, not_identifiable, samples_of
from model.diagnosis.time_series import coverage_of, linearise_campaigns
from model.diagnosis.time_series.samples import STENCIL, _calmed
from model.effects import EFFECTS
from model.wheel_soil import conditions_of
from model.wheel_soil.run_conditions import campaign_times, line_positions
from processing import ProcessedRun, Reason
from wheelsoil.wording.notes import note_text

RUNS = 2


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return simulated_campaign(runs=RUNS)


def changed(campaign: Campaign, **fields: object) -> Campaign:
    """Return the campaign with fields of every run replaced; a number stands for a whole array."""
    runs = []
    for run in campaign.runs:
        arrays = {name: np.full(len(run), x) if isinstance(x, float) else x for name, x in fields.items()}
        runs.append(replace(run, **arrays))
    return replace(campaign, runs=tuple(runs))


def with_info(campaign: Campaign, *infos: RunInfo) -> Campaign:
    runs = [replace(run, run=info) for run, info in zip(campaign.runs, infos, strict=True)]
    return replace(campaign, runs=tuple(runs))


@pytest.mark.parametrize("value", [0.0, -1.7])
def test_a_history_that_is_constant_where_it_is_known_stays_so(value: float) -> None:
    history = np.where(np.arange(200) % 7 < 5, value, np.nan)
    np.testing.assert_allclose(_calmed(history, 10.0), history, atol=1e-12)


def test_samples_are_means_over_a_fifth_of_a_second(campaign: Campaign) -> None:
    samples = samples_of(campaign)
    run = campaign.runs[0]
    first = np.flatnonzero(samples.run == 0)
    for i in first[:: max(1, len(first) // 20)]:
        rows = np.abs(run.time_s - samples.time_s[i]) < 0.0999
        assert rows.sum() == 20
        assert run.used[rows].all()
        assert samples.measured["dp"][i] == pytest.approx(run.drawbar_pull_n[rows].mean())
        assert samples.conditions.vertical_load_n[i] == pytest.approx(run.vertical_load_n[rows].mean())
    assert np.abs(samples.conditions.slip).min() >= 0.05
    assert set(samples.measured) == {"dp", "t"}
    assert samples.excluded["standstill"] > 10


def test_an_accelerometer_leaves_nothing_to_the_ground_speed_and_nothing_to_a_slope(campaign: Campaign) -> None:
    heavy = replace(campaign, outboard_mass_kg=75.0)
    read = changed(heavy, outboard_role="longitudinal_acceleration")
    found, plain = samples_of(read), samples_of(campaign)
    np.testing.assert_array_equal(found.measured["dp"], plain.measured["dp"])
    assert np.abs(samples_of(heavy).measured["dp"] - plain.measured["dp"]).max() > 1.0
    assert not found.conditions.compensated_mass_kg.any()
    assert not_identifiable(coverage_of(read, found))["slope"].values == {"conditions": ("outboard_mass_kg",)}


def test_a_wheel_runs_in_the_ruts_of_the_axles_ahead_of_it(campaign: Campaign) -> None:
    """On the second of three axles the second pass is the fifth wheel."""
    passes = with_info(campaign, RunInfo(), RunInfo(pass_number=2))
    rear = changed(passes, axle=2, axles=3)
    for one, expected in ((passes, [1.0, 2.0]), (rear, [2.0, 5.0])):
        samples = samples_of(one)
        np.testing.assert_array_equal(samples.conditions.pass_number, np.array(expected)[samples.run])
        np.testing.assert_array_equal(samples.rests.conditions.pass_number, np.array(expected)[samples.rests.run])
        assert [found.pass_number[0] for found in conditions_of(one.runs, 16_500.0)] == expected
        assert coverage_of(one, samples).several_passes


def test_three_instants_average_to_the_mean_and_have_the_spread_of_block_and_filter(campaign: Campaign) -> None:
    samples = samples_of(campaign)
    weights = np.array(STENCIL)[:, None]
    at = samples.instants.vertical_load_n
    assert np.allclose((weights * at).sum(axis=0), samples.conditions.vertical_load_n)
    ramp = changed(campaign, vertical_load_n=campaign.runs[0].time_s[: min(map(len, campaign.runs))])
    shortest = min(map(len, campaign.runs))
    cut = replace(ramp, runs=tuple(_first(run, shortest) for run in ramp.runs))
    times = samples_of(cut).instants.vertical_load_n
    spread = (weights * (times - (weights * times).sum(axis=0)) ** 2).sum(axis=0)
    assert np.allclose(spread, 0.2**2 / 12 + 0.0331**2, rtol=0.1)
    known = (replace(r, vertical_load_n=np.where(r.used, r.vertical_load_n, np.nan)) for r in campaign.runs)
    beside = samples_of(replace(campaign, runs=tuple(known)))
    assert np.allclose((weights * beside.instants.vertical_load_n).sum(axis=0), beside.conditions.vertical_load_n)


def _first(run: ProcessedRun, count: int) -> ProcessedRun:
    arrays = {
        name: getattr(run, name)[:count]
        for name in run.__dataclass_fields__
        if isinstance(getattr(run, name), np.ndarray) and len(getattr(run, name)) > count
    }
    return replace(run, **arrays)


def test_the_line_goes_from_where_out_starts_to_where_back_starts(campaign: Campaign) -> None:
    out, back = campaign.runs
    lost, notes = line_positions(campaign.runs)
    assert notes == (Note(DiagnosisCode.NO_POSITIONS),)
    assert np.nanmin(lost[0]) == pytest.approx(-1.0)
    assert np.nanmax(lost[1]) == pytest.approx(1.0)
    rng = np.random.default_rng(1)
    placed = []
    for run, start, side in ((out, 0.0, 1.0), (back, 60.0, -1.0)):
        along = start + side * run.distance_m + 0.3 * rng.standard_normal(len(run))
        north, east = along * np.cos(1.1), along * np.sin(1.1)
        degrees = np.degrees(1 / 6_371_008.8)
        longitude = (179.9999 + east * degrees / np.cos(np.radians(45.0)) + 180.0) % 360.0 - 180.0
        placed.append(replace(run, latitude_deg=45.0 + north * degrees, longitude_deg=longitude))
    found, notes = line_positions(placed)
    assert notes == ()
    for run, x, start, side in zip(placed, found, (0.0, 60.0), (1.0, -1.0), strict=True):
        expected = (start + side * run.distance_m) / 30.0 - 1.0
        assert np.nanmax(np.abs(x - expected)) < 0.02


def test_the_campaigns_clock_runs_from_minus_to_plus_a_half(campaign: Campaign) -> None:
    clocks = campaign_times(campaign.runs)
    assert clocks[0][0] == -0.5
    assert clocks[-1][-1] == pytest.approx(0.5)
    assert all((np.diff(clock) > 0).all() for clock in clocks)
    whole_s = (campaign.runs[-1].start_ns - campaign.runs[0].start_ns) * 1e-9 + campaign.runs[-1].time_s[-1]
    assert np.ptp(clocks[0]) * whole_s == pytest.approx(campaign.runs[0].time_s[-1])


def test_what_one_kind_of_run_cannot_tell_is_said(campaign: Campaign) -> None:
    one_way = with_info(campaign, RunInfo(direction="out"), RunInfo(direction="out"))
    said = not_identifiable(coverage_of(one_way, samples_of(one_way)))
    assert said["slope"].code == LackCode.ONE_DIRECTION
    assert said["multi_pass"].code == LackCode.SAME_PASS
    silent = changed(campaign, driving_torque_nm=np.nan)
    samples = samples_of(silent)
    assert set(samples.measured) == {"dp"}
    silence = not_identifiable(coverage_of(silent, samples))["torque_zero"]
    assert silence == Note(LackCode.CHANNEL_MISSING, values={"role": "driving_torque"})
    smooth = replace(campaign, tyre="smooth")
    covered = coverage_of(smooth, samples_of(smooth))
    assert "grouser" not in {effect.name for effect in considered(covered, tuple(EFFECTS), "balanced")}
    assert not_identifiable(covered)["grouser"].code == LackCode.SMOOTH_TYRE
    commanded = replace(campaign, commanded_slip=True)
    ordered = coverage_of(commanded, samples_of(commanded))
    of_speeds = {"wheel_radius", "speed_latency", "speed_bias"}
    assert not of_speeds & {effect.name for effect in considered(ordered, tuple(EFFECTS), "balanced")}
    assert {not_identifiable(ordered)[name] for name in of_speeds} == {Note(LackCode.SLIP_COMMANDED)}
    only_one = replace(campaign, runs=campaign.runs[:1])
    said = not_identifiable(coverage_of(only_one, samples_of(only_one)))
    assert note_text(said["crosstalk"]).startswith("one load only: drive")
    near = replace(ordered, load_spread=0.043)
    assert "only (loads differ by 4.3 %, two by 8 % or more): drive" in note_text(not_identifiable(near)["crosstalk"])
    assert said["zero_drift"].code == LackCode.ONE_RUN_NO_DRIFT


def test_holes_cost_their_samples_only(campaign: Campaign) -> None:
    run = campaign.runs[0]
    hole = (run.time_s > 12.0) & (run.time_s < 13.0)
    reason = np.where(hole, Reason.GAP, run.reason).astype(np.uint8)
    broken = replace(run, reason=reason, drawbar_pull_n=np.where(hole, np.nan, run.drawbar_pull_n))
    whole, left = (samples_of(replace(campaign, runs=(r,))) for r in (run, broken))
    assert 3 <= len(whole) - len(left) <= 8
    assert all(np.isfinite(x).all() for x in left.measured.values())


def test_too_little_is_refused_in_words(campaign: Campaign) -> None:
    stood = [replace(run, reason=np.full(len(run), Reason.STANDSTILL, np.uint8)) for run in campaign.runs]
    with pytest.raises(DataError, match="too few usable samples"):
        linearise_campaigns([replace(campaign, runs=tuple(stood))])
    with pytest.raises(DataError, match="neither drawbar pull nor torque"):
        linearise_campaigns([changed(campaign, drawbar_pull_n=np.nan, driving_torque_nm=np.nan)])
