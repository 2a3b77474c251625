"""Samples, segments and fits just below and just above the limits that the documents state."""

from __future__ import annotations

import numpy as np
import pytest

from processing import Reason, Segment
from processing.pipeline.collection import Collector
from processing.pipeline.kinematics import segment, slip_sigma
from processing.pipeline.quality import combine_reasons
from processing.robust import robust_linear

RATE_HZ = 100.0
COUNT = 600
NOTHING = np.full(COUNT, np.nan)
TIME = np.arange(COUNT) / RATE_HZ


def kinds(**channels: np.ndarray | float) -> np.ndarray:
    """Return the segments of six seconds; what is not given is not measured, and the speeds are 3 m/s."""
    given = {name: np.broadcast_to(np.asarray(value, float), (COUNT,)) for name, value in channels.items()}
    speed = given.get("speed", np.full(COUNT, 3.0))
    rest = (given.get(name, NOTHING) for name in ("acceleration", "slip", "force", "load"))
    return segment(speed, speed, *rest, RATE_HZ)


@pytest.mark.parametrize(("seconds", "stands"), [(0.45, False), (0.55, True)])
def test_a_standstill_lasts_half_a_second(seconds: float, stands: bool) -> None:
    speed = np.where(np.abs(TIME - 3.0) < seconds / 2, 0.0, 3.0)
    assert (kinds(speed=speed, force=900.0, load=8e3) == Segment.STANDSTILL).any() == stands


@pytest.mark.parametrize(("speed", "stands"), [(0.14, True), (0.16, False)])
def test_a_standstill_begins_below_15_cm_a_second(speed: float, stands: bool) -> None:
    found = kinds(speed=np.where(TIME < 2.0, 3.0, speed), force=0.0, load=8e3)[300:]
    assert (found == Segment.STANDSTILL).all() == stands


@pytest.mark.parametrize(
    ("acceleration", "kind"),
    [(0.21, Segment.DRIVE), (0.19, Segment.COAST), (-0.49, Segment.COAST), (-0.51, Segment.BRAKE)],
)
def test_without_torque_acceleration_decides(acceleration: float, kind: Segment) -> None:
    assert set(kinds(acceleration=acceleration, slip=0.0)) == {kind}


@pytest.mark.parametrize(
    ("first", "then", "kind"),
    [
        (0.029, 0.029, Segment.COAST),
        (0.031, 0.031, Segment.DRIVE),
        (0.031, 0.016, Segment.DRIVE),
        (0.031, 0.014, Segment.COAST),
        (-0.031, -0.016, Segment.BRAKE),
        (-0.031, -0.014, Segment.COAST),
    ],
)
def test_drive_and_brake_are_entered_at_three_percent_and_left_at_half_of_it(
    first: float, then: float, kind: Segment
) -> None:
    assert kinds(force=8e3 * np.where(TIME < 3.0, first, then), load=8e3)[-1] == kind


def test_a_sample_without_load_or_with_an_impossible_slip_is_not_used() -> None:
    nothing = np.zeros(5, np.uint8)
    load = np.array([1.0, 0.0, -1.0, 1.0, 1.0])
    slip = np.array([1.0, 0.5, 0.5, 1.001, -1.001])
    driving = np.full(5, Segment.DRIVE, np.uint8)
    found = combine_reasons([nothing], driving, slip, load)
    expected = [Reason.USED, *[Reason.NEGATIVE_LOAD] * 2, *[Reason.SLIP_OUT_OF_RANGE] * 2]
    assert found.tolist() == [int(reason) for reason in expected]


def test_the_first_reason_counts() -> None:
    gap = np.array([Reason.GAP, Reason.USED, Reason.FILTER_EDGE], np.uint8)
    segments = np.array([Segment.STANDSTILL, Segment.STANDSTILL, Segment.DRIVE], np.uint8)
    found = combine_reasons([gap], segments, np.array([np.nan, np.nan, 0.1]), np.array([-1.0, -1.0, 1.0]))
    order = [reason for reason in Reason if reason in (Reason.GAP, Reason.STANDSTILL)]
    assert found.tolist() == [order[0], Reason.STANDSTILL, Reason.FILTER_EDGE]


def test_where_there_is_no_slip_there_is_no_sigma() -> None:
    rim, ground, sigma = np.array([0.49, 0.51]), np.array([0.1, 0.1]), np.full(2, 0.02)
    assert np.isnan(slip_sigma(rim, ground, sigma, sigma, 0.5)).tolist() == [True, False]


def test_the_noise_from_sample_to_sample_is_its_sigma() -> None:
    """A ramp does not count: second differences of white noise have six times its variance."""
    collector = Collector(10_000_000)
    values = np.random.default_rng(1).normal(0.0, 0.3, 4000) + 0.01 * np.arange(4000)
    collector.add(np.arange(4000) * 50_000_000, values)
    assert collector.finish().rough == pytest.approx(0.3, rel=0.05)


def test_a_third_of_wild_samples_does_not_move_a_robust_fit() -> None:
    rng = np.random.default_rng(2)
    matrix = np.column_stack([np.ones(900), np.linspace(-1.0, 1.0, 900)])
    wild = np.where(np.arange(900) % 3 == 0, 50.0, 0.0)
    fit = robust_linear(matrix, matrix @ [2.0, 3.0] + 0.5 * rng.standard_normal(900) + wild)
    assert fit.coefficients == pytest.approx([2.0, 3.0], abs=0.1)
    assert (fit.weights[::3] == 0).all()
