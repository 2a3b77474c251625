"""Sinkage from forces against wheels whose stresses are summed by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from stressed_wheel import StressedWheel

from model.sinkage_from_forces import ShapeRanges, draw_shapes, sinkage_of_forces
from model.sinkage_from_forces.sinkage import CENTRAL, entry_angle_of_forces, shear_share

SHAPES = draw_shapes(ShapeRanges(), 400, np.random.default_rng(1))


@st.composite
def wheels(draw: st.DrawFn) -> StressedWheel:
    """Draw a driven wheel on a soil whose stress has a published shape."""

    def between(low: float, high: float) -> float:
        return draw(st.floats(low, high))

    radius = draw(st.sampled_from([0.06, 0.13, 0.47, 0.63]))
    slip = between(0.05, 0.95)
    moves = draw(st.booleans())
    return StressedWheel(
        entry=between(0.2, 1.2),
        slip=slip,
        radius=radius,
        exponent=between(0.6, 1.3),
        peak=between(0.18, 0.43) + 0.32 * slip if moves else 0.0,
        exit=draw(st.sampled_from([0.0, 0.1, 0.2])),
        tan_phi=between(0.35, 0.85),
        cohesion=draw(st.sampled_from([0.0, 0.1, 0.2])),
        shear_modulus=radius * between(0.01, 0.11),
    )


def ratios(wheel: StressedWheel) -> tuple[float, float]:
    load, pull, torque = wheel.forces()
    return pull / load, torque / (wheel.radius * load)


@examples(60)
@given(wheels())
def test_a_known_shape_gives_the_sinkage(wheel: StressedWheel) -> None:
    angle = entry_angle_of_forces(*ratios(wheel), wheel.peak, wheel.exponent, wheel.exit)
    found = wheel.radius * (1 - np.cos(angle))
    assert found == pytest.approx(wheel.sinkage, rel=0.08)  # 7.1 % in the corner of all ranges


@examples(30)
@given(wheels(), st.floats(0.05, 0.9))
def test_a_constant_share_of_shear_is_exact(wheel: StressedWheel, share: float) -> None:
    plain = replace(wheel, cohesion=0.0, tan_phi=share, shear_modulus=1e-9 * wheel.radius)
    angle = entry_angle_of_forces(*ratios(plain), plain.peak, plain.exponent, plain.exit)
    assert angle == pytest.approx(plain.entry, rel=2e-3)


def test_the_band_holds_the_truth() -> None:
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(60):
        slip, moves, leaves = rng.uniform(0.05, 0.95), rng.random() < 2 / 3, rng.random() < 0.5
        wheel = StressedWheel(
            entry=rng.uniform(0.2, 1.2),
            slip=slip,
            exponent=rng.uniform(0.5, 1.4),
            peak=(rng.uniform(0.18, 0.43) + 0.32 * slip) * moves,
            exit=rng.uniform(0, 0.2) * leaves,
            tan_phi=rng.uniform(0.35, 0.85),
            cohesion=rng.uniform(0, 0.2),
            shear_modulus=0.47 * rng.uniform(0.01, 0.11),
        )
        pull, torque = (np.array([x]) for x in ratios(wheel))
        low, high = np.percentile(sinkage_of_forces(np.array([slip]), pull, torque, 0.47, SHAPES), [2.5, 97.5])
        inside.append(low <= wheel.sinkage <= high)
    assert np.mean(inside) >= 0.9


def test_a_peak_ahead_needs_less_sinkage_and_an_exit_behind_more() -> None:
    pull, torque = np.array([0.03]), np.array([0.31])

    def angle(peak: float, exit: float) -> float:
        return float(entry_angle_of_forces(pull, torque, peak, 1.0, exit)[0])

    assert angle(0.6, 0.0) < angle(0.3, 0.0) < angle(0.0, 0.0) < angle(0.0, 0.1) < angle(0.0, 0.2)


def test_what_no_wheel_shows_has_an_end() -> None:
    pull, torque = np.array([0.5, -3.0, np.nan, 0.1]), np.array([0.4, 0.4, 0.4, np.nan])
    angle = entry_angle_of_forces(pull, torque, 0.0, 1.0, 0.0)
    assert angle[0] == 0.0
    assert angle[1] == pytest.approx(np.pi / 2)
    assert np.isnan(angle[2:]).all()


def test_the_share_of_shear_is_found_again() -> None:
    wheel = StressedWheel(entry=0.8, slip=0.5, peak=0.305, tan_phi=0.7, shear_modulus=1e-9)
    assert shear_share(*(np.array([x]) for x in ratios(wheel)))[0] == pytest.approx(0.7, rel=1e-3)


def test_shapes_are_drawn_from_their_ranges() -> None:
    shapes = draw_shapes(ShapeRanges(), 300, np.random.default_rng(0))
    assert len(shapes) == 300
    assert shapes.peak_stays.sum() == 100
    assert (shapes.exit == 0).sum() == 150
    assert (shapes.peak_at_slip_0[shapes.peak_stays] == 0).all()
    moved = shapes.peak_at_slip_0[~shapes.peak_stays]
    assert 0.13 <= moved.min() < 0.18 < 0.58 < moved.max() <= 0.65
    assert len(CENTRAL) == 1
