"""Cells of runs and tables, their sinkage with its band, and its growth with slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosis_support import LEVEL
from stressed_wheel import StressedWheel

from daq import Channel
from daq.series import WheelTable
from model.diagnosis import bound_rows_of_runs, bound_rows_of_table, inconsistent
from model.sinkage_from_forces import (
    ForceCells,
    Growth,
    ShapeRanges,
    cells_of_runs,
    cells_of_table,
    sinkage_from_forces,
)
from processing import ProcessedRun
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.simulation.campaign import simulated_run
from wheelsoil.wording.notes import note_text

SLIPS = np.linspace(0.1, 0.9, 9)


def table(sinkages: Sequence[float], peaks: Sequence[float], sigma: float = 0.0, **more: object) -> WheelTable:
    """Return a wheel of 0.47 m at nine slips, in to a sinkage and with a stress peak each."""
    wheels = [
        StressedWheel(entry=float(np.arccos(1 - z / 0.47)), slip=s, peak=peak, exponent=1.0, **more)  # type: ignore[arg-type]
        for s, z, peak in zip(SLIPS, sinkages, peaks, strict=True)
    ]
    load, pull, torque = np.array([wheel.forces() for wheel in wheels]).T
    sigmas = {"drawbar_pull_n": np.full(9, sigma), "driving_torque_nm": np.full(9, 0.47 * sigma)} if sigma else {}
    return WheelTable("bench.csv", SLIPS, load, pull, torque, np.array(sinkages), np.zeros(9, np.intp), ("",), sigmas)


def growth_of(cells: ForceCells, ranges: ShapeRanges | None = None) -> Growth:
    return sinkage_from_forces(cells, np.random.default_rng(0), ranges).growth()


@pytest.mark.parametrize("grows_m", [0.0, 0.03, 0.08])
def test_growth_is_found_where_the_peak_stays(grows_m: float) -> None:
    found = growth_of(cells_of_table(table(0.1 + grows_m * SLIPS, np.zeros(9)), 0.47))
    low, high = found.if_peak_stays.interval95
    assert low - 1e-3 <= grows_m <= high + 1e-3
    assert found.measured.value == pytest.approx(grows_m, abs=1e-9)
    assert found.if_peak_moves.value < found.if_peak_stays.value


def test_a_contact_that_lengthens_behind_with_slip_is_no_falling_sinkage() -> None:
    """As in a granular simulation: the rear contact grows from .08 to .7 of the entry angle, and sinkage grows."""
    wheels = [
        StressedWheel(
            entry=float(np.arccos(1 - (0.02 + 0.03 * s) / 0.15)), slip=s, peak=0.7, exponent=1.0, exit=0.8 * s
        )
        for s in SLIPS
    ]
    load, pull, torque = np.array([wheel.forces() for wheel in wheels]).T
    radius = wheels[0].radius
    measured = radius * (1 - np.cos([wheel.entry for wheel in wheels]))
    rows = WheelTable("g.csv", SLIPS, load, pull, torque, measured, np.zeros(9, np.intp), ("",), {})
    found = growth_of(cells_of_table(rows, radius))
    assert found.from_forces.interval95[1] > 0.0  # a contact of constant shape makes of it a sinkage that falls


def test_a_measured_growth_that_contradicts_withdraws_the_claim() -> None:
    rows = table(0.1 + 0.08 * SLIPS, np.zeros(9))
    falls = replace(rows, sinkage_m=0.2 - 0.5 * (0.1 + 0.3 * SLIPS))
    assert not growth_of(cells_of_table(rows, 0.47)).contradicted
    assert growth_of(cells_of_table(falls, 0.47)).contradicted


def test_a_number_is_given_where_its_band_says_more_than_is_known_without_forces() -> None:
    """A shallow wheel's band is narrow against what wheels do; a deep one's is not."""
    for depth, tells in ((0.02, True), (0.2, False)):
        cells = cells_of_table(table(np.full(9, depth), np.full(9, 0.4)), 0.47)
        bins = sinkage_from_forces(cells, np.random.default_rng(0)).bins()
        assert {one.tells for one in bins[:5]} == {tells}


def test_a_depth_that_wheels_seldom_have_counts_less_in_the_level_and_not_in_the_growth() -> None:
    """Published wheels: ln(Z/r) is -2.09 in the middle, with a one-sigma of .66 and .66 x 1.55 for the next one."""
    for depth, sign in ((0.2, -1.0), (0.02, 1.0)):
        found = sinkage_from_forces(
            cells_of_table(table(np.full(9, depth), np.full(9, 0.4)), 0.47), np.random.default_rng(0)
        )
        plain, usual = found.draws_m[:, 4], found.draws_m[found.as_usual, 4]
        assert sign * (np.median(usual) - np.median(plain)) > 0
        assert found.bins()[4].sinkage_m.value == np.median(usual)
        off = (np.log(found.draws_m.mean(axis=1) / 0.47) + 2.09) / (0.66 * 1.55)
        share = np.exp(-0.5 * off**2)
        assert np.median(usual) == pytest.approx(
            np.quantile(plain, 0.5, weights=share, method="inverted_cdf"), rel=0.02
        )
        every = replace(found, as_usual=np.arange(len(found.shapes)))
        assert found.growth() == every.growth()


@pytest.mark.parametrize("grows_m", [0.0, 0.03, 0.08])
def test_growth_is_found_where_the_peak_moves(grows_m: float) -> None:
    found = growth_of(cells_of_table(table(0.1 + grows_m * SLIPS, 0.3 + 0.32 * SLIPS), 0.47))
    low, high = found.if_peak_moves.interval95
    assert low <= grows_m <= high
    low, high = found.from_forces.interval95
    assert low <= grows_m <= high


def test_noise_widens_the_band() -> None:
    quiet, noisy = (table(np.full(9, 0.12), np.zeros(9), sigma) for sigma in (0.0, 300.0))
    one = ShapeRanges(
        (0.3, 0.3), 0.32, 1.0, (1.0, 1.0), (0.0, 0.0), 1.0, 0.0, 0.0, (0.0, 0.0), 1.0, 0.0, no_exit_growth=1.0
    )
    widths = []
    for rows in (quiet, noisy):
        bins = sinkage_from_forces(cells_of_table(rows, 0.47), np.random.default_rng(0), one).bins()
        assert len(bins) == 9
        low, high = bins[4].sinkage_m.interval95
        widths.append(high - low)
        assert low - 2e-3 <= 0.12 <= high + 2e-3
    assert widths[0] < 1e-6
    assert widths[1] > 0.01


def test_too_little_slip_says_so() -> None:
    short = table(np.full(9, 0.1), np.zeros(9))
    cells = cells_of_table(replace(short, slip=0.4 + 0.001 * SLIPS), 0.47)
    found = growth_of(cells)
    assert found.reason and "0.2 of slip" in note_text(found.reason)
    assert np.isnan(found.from_forces.value)


def test_groups_at_one_slip_each_share_a_level() -> None:
    rows = replace(table(0.1 + 0.05 * SLIPS, np.zeros(9)), group=np.arange(9), group_names=tuple("abcdefghi"))
    found = growth_of(cells_of_table(rows, 0.47))
    assert not found.reason
    assert found.measured.value == pytest.approx(0.05)


def test_braked_rows_and_rows_without_torque_are_left_out() -> None:
    rows = table(np.full(9, 0.1), np.zeros(9))
    torque = rows.driving_torque_nm.copy()
    torque[3] = np.nan
    cells = cells_of_table(replace(rows, slip=SLIPS - 0.25, driving_torque_nm=torque), 0.47)
    assert len(cells) == 6
    assert len(bound_rows_of_table(replace(rows, slip=SLIPS - 0.25, driving_torque_nm=torque), 0.47)) == 6


@cache
def runs(H_m: float) -> tuple[list[ProcessedRun], np.ndarray, np.ndarray]:
    """Return two runs of the virtual test with slip sinkage, their true slip and sinkage."""
    effects = {"vasilev": {"H_m": H_m}} if H_m else {}
    options = SimulationOptions(soil="sandy", effects=effects, runs=2, duration_s=40.0, seed=2, **LEVEL)
    processed, slip, sinkage = [], [], []
    for index in range(options.runs):
        channels, vehicle, info = simulated_roles(options, index)
        virtual = simulated_run(options, index)
        truth = virtual.truth
        stamps = virtual.start_ns + ((truth.time_s + 0.25) * 1e9).astype(np.int64)
        deep = Channel("sinkage", "m", stamps[::20], truth.sinkage_m[::20])
        processed.append(process({**channels, "sinkage": deep}, vehicle, info))
        slip.append(truth.slip)
        sinkage.append(truth.sinkage_m)
    return processed, np.concatenate(slip), np.concatenate(sinkage)


@pytest.mark.parametrize("H_m", [pytest.param(0.0, marks=pytest.mark.slow), 0.08])
def test_runs_of_the_virtual_test(H_m: float) -> None:
    processed, slip, sinkage = runs(H_m)
    cells = cells_of_runs(processed)
    found = sinkage_from_forces(cells, np.random.default_rng(0))
    bins = found.bins()
    assert len(bins) >= 8
    assert [one.slip for one in bins] == sorted(one.slip for one in bins)
    for one in bins:
        true = sinkage[np.abs(slip - one.slip) < 0.05].mean()
        assert one.sinkage_m.interval95[0] < true < one.sinkage_m.interval95[1]
        assert one.measured_m == pytest.approx(true, rel=0.08)
        assert 0 < one.noise_m < 0.005
    growth = found.growth()
    low, high = growth.if_peak_stays.interval95
    assert low - 0.005 < growth.measured.value < high + 0.005
    assert growth.measured.value == pytest.approx(H_m, abs=0.015)


def test_good_runs_keep_the_bound_and_bad_ones_do_not() -> None:
    processed, _, _ = runs(0.08)
    rows = bound_rows_of_runs(processed)
    assert len(rows) > 1000
    assert np.isfinite(rows.torque_at_rest_nm).all()
    assert inconsistent(rows) == ()
    shallow = [replace(run, sinkage_m=0.02 * run.sinkage_m) for run in processed]
    (found,) = inconsistent(bound_rows_of_runs(shallow))
    assert found.channel == "sinkage"
    assert found.rows > 500


def test_runs_without_sinkage_have_no_bound_to_keep() -> None:
    processed, _, _ = runs(0.08)
    bare = [replace(run, sinkage_m=np.full(len(run), np.nan)) for run in processed]
    assert len(bound_rows_of_runs(bare)) == 0
    assert inconsistent(bound_rows_of_runs(bare)) == ()
    growth = growth_of(cells_of_runs(bare))
    assert np.isnan(growth.measured.value)
    assert np.isfinite(growth.from_forces.value)
