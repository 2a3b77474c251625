"""The grade of a run just below and just above each of its limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from implausible import implausible
from synthetic_run import forces, speeds, vehicle

from processing import ProcessedRun, Reason, Standstill
from processing.pipeline import process
from wheelsoil.workflows.grading import grade_of

LOAD_N = 8000.0


@cache
def any_run() -> ProcessedRun:
    return process(speeds(10.0, 0.2) | forces(10.0), vehicle())


def run_with(usable: float = 1.0, slip: float = 0.6, standing: float = 0.3, **quality: object) -> ProcessedRun:
    """Return a run: a share of its samples in motion is usable, its slip reaches a value, and it stands for a while."""
    run = any_run()
    n = len(run)
    reason = np.full(n, Reason.GAP, np.uint8)
    moving = n - int(standing * n)
    reason[:moving][: round(usable * moving)] = Reason.USED
    reason[moving:] = Reason.STANDSTILL
    arrays = {"slip": np.full(n, slip), "vertical_load_n": np.full(n, LOAD_N), "reason": reason}
    return replace(run, **arrays, quality=replace(run.quality, notes=(), **quality))


@pytest.mark.parametrize(
    ("usable", "slip", "level"),
    [
        (0.79, 0.6, "fair"),
        (0.81, 0.6, "good"),
        (0.49, 0.6, "poor"),
        (0.51, 0.6, "fair"),
        (1.0, 0.49, "fair"),
        (1.0, 0.51, "good"),
    ],
)
def test_shares_and_slip(usable: float, slip: float, level: str) -> None:
    grade = grade_of(run_with(usable, slip))
    assert grade.level == level
    assert grade.usable_share == pytest.approx(usable, abs=2e-3)
    assert grade.highest_slip == slip


@pytest.mark.parametrize(("slip", "said"), [(0.09, True), (0.11, False)])
def test_a_run_without_slip_is_called_hardly_driven(slip: float, said: bool) -> None:
    (reason,) = grade_of(run_with(slip=slip)).reasons
    assert reason.startswith("hardly driven") == said


@pytest.mark.parametrize("arm_m", [None, 0.47])
@pytest.mark.parametrize(
    ("share", "sigmas", "level"), [(0.019, 9.0, "good"), (0.021, 9.0, "fair"), (0.5, 2.9, "good"), (0.5, 3.1, "fair")]
)
def test_a_zero_is_larger_than_a_fiftieth_of_the_load_and_three_sigmas(
    arm_m: float | None, share: float, sigmas: float, level: str
) -> None:
    """Of the torque: of the load times the radius."""
    role = "driving_torque" if arm_m else "drawbar_pull"
    value = share * LOAD_N * (arm_m or 1.0)
    stands = (Standstill(0.0, 2.0, {role: value}, {role: value / sigmas}, "released"),)
    assert grade_of(run_with(standstills=stands)).level == level


def test_a_wrong_sign_is_poor() -> None:
    run = run_with()
    note = implausible("sign:vertical_load")
    noted = replace(run, quality=replace(run.quality, notes=(note,)))
    assert grade_of(noted).level == "poor"
