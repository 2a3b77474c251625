"""Cells of forces: which samples they hold, how sure they are, and what a growth through them claims."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from stressed_wheel import StressedWheel
from synthetic_run import forces, speeds, vehicle

from daq.series import WheelTable
from model.sinkage_from_forces import cells_of_runs, cells_of_table, sinkage_from_forces
from model.sinkage_from_forces.force_cells import Forces
from processing import ProcessedRun, Reason
from processing.pipeline import process

RATE_HZ = 50
BLOCK = 10
"""Samples of 0.2 s."""
LOAD_N, PULL_N, TORQUE_NM = 8000.0, 500.0, 1200.0


@cache
def any_run() -> ProcessedRun:
    return process(speeds(4.0, 0.2) | forces(4.0), vehicle())


def run_of(slip: np.ndarray, torque_nm: np.ndarray) -> ProcessedRun:
    """Return a run at 50 Hz whose samples are all usable, with a constant load and pull."""
    n = len(slip)
    run = any_run()
    arrays = {k: np.zeros(n) for k in ProcessedRun.__dataclass_fields__ if isinstance(getattr(run, k), np.ndarray)}
    given = {
        "slip": slip,
        "vertical_load_n": np.full(n, LOAD_N),
        "drawbar_pull_n": np.full(n, PULL_N),
        "driving_torque_nm": torque_nm,
        "sinkage_m": np.full(n, np.nan),
        "time_s": np.arange(n) / RATE_HZ,
        "reason": np.full(n, Reason.USED, np.uint8),
        "segment": np.zeros(n, np.uint8),
    }
    return replace(run, rate_hz=float(RATE_HZ), **(arrays | given))


def test_the_noise_of_a_cell_is_that_of_repeated_cells_where_neighbouring_blocks_are_correlated() -> None:
    """A correlation of a third from block to block doubles the variance of a mean."""
    rng = np.random.default_rng(4)
    blocks, share, runs = 30, 1 / 3, []
    for _ in range(80):
        noise = rng.standard_normal(blocks)
        for i in range(1, blocks):
            noise[i] = share * noise[i - 1] + np.sqrt(1 - share**2) * noise[i]
        runs.append(run_of(np.full(blocks * BLOCK, 0.3), np.repeat(TORQUE_NM + 30.0 * noise, BLOCK)))
    cells = cells_of_runs(runs)
    found = cells.forces.central_m(cells.radius_m)
    assert len(cells) == 80
    assert np.sqrt(np.mean(cells.noise_m**2)) == pytest.approx(np.std(found), rel=0.2)


def test_a_cell_is_a_tenth_of_slip_of_a_driven_wheel_and_five_blocks_at_least() -> None:
    blocks = {0.03: 9, 0.07: 6, 0.14: 4, 0.2: 5, 0.24: 2, 0.26: 8}
    slip = np.repeat(list(blocks), [count * BLOCK for count in blocks.values()])
    cells = cells_of_runs([run_of(slip, np.full(len(slip), TORQUE_NM))])
    assert cells.samples.tolist() == [6 + 4, 5 + 2, 8]
    assert cells.bin.tolist() == [0, 1, 2]
    few = cells_of_runs([run_of(slip[: (9 + 4) * BLOCK], np.full((9 + 4) * BLOCK, TORQUE_NM))])
    assert len(few) == 0


def test_the_ratios_have_no_unit() -> None:
    found = Forces(*(np.array([x]) for x in (0.3, LOAD_N, PULL_N, TORQUE_NM)))
    assert [float(x[0]) for x in found.ratios(0.5)] == [PULL_N / LOAD_N, TORQUE_NM / (0.5 * LOAD_N)]


def test_a_wheel_of_the_central_shape_has_its_own_sinkage() -> None:
    wheel = StressedWheel(entry=0.7, slip=0.4, peak=0.305 + 0.32 * 0.4, exponent=1.0)
    load, pull, torque = wheel.forces()
    one = Forces(*(np.array([x]) for x in (0.4, load, pull, torque)))
    assert one.central_m(wheel.radius)[0] == pytest.approx(wheel.sinkage, rel=0.03)


def test_the_interval_of_a_measured_growth_is_students() -> None:
    """Slope of a straight line through eight points, as a textbook has it; t(6) = 2.447 at 95 %."""
    rng = np.random.default_rng(6)
    slip = np.linspace(0.1, 0.8, 8)
    sinkage = 0.1 + 0.05 * slip + 0.002 * rng.standard_normal(8)
    wheel = np.array([StressedWheel(entry=0.7, slip=s).forces() for s in slip]).T
    table = WheelTable("t.csv", slip, *wheel, sinkage, np.zeros(8, np.intp), ("",), {})
    found = sinkage_from_forces(cells_of_table(table, 0.47), np.random.default_rng(0), draws=8).growth().measured
    slope, intercept = np.polyfit(slip, sinkage, 1)
    sigma = np.sqrt(np.sum((sinkage - intercept - slope * slip) ** 2) / 6 / np.sum((slip - slip.mean()) ** 2))
    assert found.value == pytest.approx(slope)
    np.testing.assert_allclose(found.interval95, [slope - 2.4469 * sigma, slope + 2.4469 * sigma], rtol=1e-4)
