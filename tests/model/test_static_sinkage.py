"""Static sinkage where Eq. 7 and Eq. 10 have an answer in closed form, and where a wheel has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Conditions, Wheel, WheelSoilModel, entry_angle
from model.wheel_soil.balance import balanced
from model.wheel_soil.pressure_sinkage import closed_form, stiffness


def solved(share: float, exponent: float, guess: float) -> float:
    """Return the sinkage, as a share of the radius, of a wheel whose load is k Z^(n + 1/2) (1 + Z/r)."""
    radius, one = 0.47, np.ones((1, 1))

    def load_of(z: np.ndarray, _index: np.ndarray) -> np.ndarray:
        return 1e5 * z ** (exponent + 0.5) * (1 + z / radius)

    load = load_of(share * radius * one, np.zeros(1, int))
    return float(balanced(load, guess * radius * one, radius * one, exponent * one, load_of)[0, 0]) / radius


@settings(deadline=None)
@given(st.floats(1e-4, 0.998), st.floats(0.3, 1.5), st.floats(1e-3, 2.0))
def test_the_balance_is_solved_up_to_the_axle(share: float, exponent: float, guess: float) -> None:
    assert solved(share, exponent, guess) == pytest.approx(share, rel=1e-10)


@pytest.mark.parametrize("guess", [np.nan, -0.3, 0.0, np.inf])
@pytest.mark.parametrize("share", [1e-3, 0.3, 0.9])
def test_the_balance_needs_no_first_guess(share: float, guess: float) -> None:
    assert solved(share, 3.5, guess) == pytest.approx(share, rel=1e-10)


@settings(deadline=None)
@given(st.floats(2.5, 6.0), st.floats(5.0, 500.0))
def test_the_load_is_carried_where_the_closed_form_has_no_answer(exponent: float, load: float) -> None:
    """Eq. 10 divides by 3 - n; Eq. 7 has a sinkage for any n."""
    soil = replace(SOILS["lunar"], sinkage_exponent=exponent, frictional_modulus=1e12)
    found = WheelSoilModel(Wheel(0.1, 0.08), soil).predict(Conditions(np.full(1, 0.3), np.full(1, load)))
    assert 0 < found.sinkage_m[0] < 0.1
    assert found.vertical_load_n[0] == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("share", [1.001, 1.5, 10.0])
def test_a_wheel_sunk_beyond_its_axle_has_no_sinkage(share: float) -> None:
    assert np.isnan(solved(share, 1.0, 0.3))


def test_the_entry_angle_is_that_of_the_circle() -> None:
    depth = np.array([-0.01, 0.0, 1e-9, 0.1, 0.47, 0.4701])
    found = entry_angle(depth, 0.47)
    np.testing.assert_allclose(found[2:5], [np.sqrt(2e-9 / 0.47), np.arccos(1 - 0.1 / 0.47), np.pi / 2], rtol=1e-8)
    assert np.isnan(found[[0, 1, 5]]).all()


@settings(deadline=None)
@given(st.floats(500.0, 2e4), st.floats(0.3, 1.5), st.floats(0.1, 0.8), st.floats(0.1, 0.6))
def test_the_closed_form_satisfies_bekkers_equation(load: float, n: float, radius: float, width: float) -> None:
    """W = b k sqrt(D) Z^(n + 1/2) (3 - n) / 3 with D = 2 r (Bekker 1969), which Eq. 10 solves for Z."""
    k_c, k_phi = 43.68e3, 499.3e3
    z = closed_form(load, radius, width, stiffness(k_c, k_phi, width), n)
    carried = (k_c + width * k_phi) * np.sqrt(2 * radius) * z ** (n + 0.5) * (3 - n) / 3
    assert carried == pytest.approx(load, rel=1e-9)


def test_a_load_that_cohesion_alone_carries_has_no_stress_scale() -> None:
    """At a given sinkage cohesion carries 2.7 kN of clay: of less load no positive normal stress is the rest."""
    model = WheelSoilModel(Wheel(0.47, 0.318), SOILS["clay"], (EFFECTS["vasilev"],))
    slip, load = np.full(2, 0.5), np.array([8e3, 200.0])
    found = model.predict(Conditions(slip, load), sinkage_m=np.full(2, 0.2))
    assert np.isfinite(found.drawbar_pull_n[0])
    assert np.isnan(found.drawbar_pull_n[1])


@pytest.mark.parametrize("name", ["frictional_modulus", "sinkage_exponent", "tan_phi"])
def test_the_derivative_of_the_sinkage_is_that_of_small_changes(name: str) -> None:
    soil = SOILS["clay"]
    model, conditions = (
        WheelSoilModel(Wheel(0.47, 0.318), soil),
        Conditions(np.array([-0.3, 0.1, 0.6]), np.full(3, 8e3)),
    )
    value = getattr(soil, name)
    step = 1e-4 * value
    above, below = (model.predict(conditions, {name: value + side}).sinkage_m for side in (step, -step))
    found = model.predict(conditions, {}, wrt=(name,)).sensitivities[name].sinkage_m
    np.testing.assert_allclose(found, (above - below) / (2 * step), rtol=1e-5)
