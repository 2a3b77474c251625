"""The bound that no soil breaks, on stresses summed by hand; and whom it suspects when it is broken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from property_settings import examples
from stressed_wheel import StressedWheel

from model.diagnosis import BoundRows, inconsistent
from wheelsoil.wording.notes import note_text

POINTS = 400


def rows(wheel: StressedWheel, slips: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9), sigma: float = 1.0) -> BoundRows:
    """Return what a test rig measures of a wheel at several slips."""
    load, pull, torque = np.array([replace(wheel, slip=s).forces() for s in slips]).T
    n = len(slips)
    return BoundRows(
        load,
        pull,
        torque,
        np.full(n, wheel.sinkage),
        np.full(n, 20.0 * sigma),
        np.full(n, 15.0 * sigma),
        np.full(n, 5.0 * sigma),
        np.full(n, 1e-3 * sigma),
        np.zeros(n),
        wheel.radius,
        speed_scale=1.0,
    )


@examples(200)
@given(
    st.floats(0.05, 1.5),
    st.lists(st.tuples(st.floats(0, 1e5), st.floats(0, 1e5)), min_size=1, max_size=12),
)
def test_no_stress_between_bottom_and_entry_breaks_it(entry: float, stresses: list[tuple[float, float]]) -> None:
    """Whatever the stresses: any steps of normal and shear stress, wherever they peak."""
    angle = entry * (np.arange(POINTS) + 0.5) / POINTS
    place = np.minimum(angle / entry * len(stresses), len(stresses) - 1).astype(int)
    normal, shear = np.array(stresses).T[:, place]
    load = np.sum(normal * np.cos(angle) + shear * np.sin(angle))
    pull = np.sum(shear * np.cos(angle) - normal * np.sin(angle))
    assert np.sum(shear) - pull <= load * np.tan(entry) * (1 + 1e-12) + 1e-9


@examples(60)
@given(
    st.floats(0.2, 1.3),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.9),
    st.floats(0.0, 0.3),
    st.floats(0.3, 1.0),
    st.floats(0, 1),
)
def test_soil_keeps_it_with_a_peak_ahead_and_an_exit_behind(
    entry: float, slip: float, peak: float, exit: float, tan_phi: float, cohesion: float
) -> None:
    wheel = StressedWheel(
        entry=entry, slip=slip, peak=peak, exit=exit, tan_phi=tan_phi, cohesion=cohesion, shear_modulus=0.01
    )
    load, pull, torque = wheel.forces()
    assert torque / wheel.radius - pull <= load * np.tan(entry)


@given(st.floats(0.1, 1.4), st.floats(0.01, 0.5))
def test_behind_the_bottom_it_takes_more_shear_than_friction_gives(entry: float, behind: float) -> None:
    """At an angle phi behind, the bound is kept at a point up to the stated share of shear, and not beyond."""
    share = np.sin(entry + behind) / (2 * np.sin(entry + behind / 2) * np.sin(behind / 2))

    def over(shear: float) -> float:
        resistance = -np.sin(behind) + shear * (1 - np.cos(behind))
        load = np.cos(behind) - shear * np.sin(behind)
        return float(resistance - load * np.tan(entry))

    assert over(0.99 * share) < 0 < over(1.01 * share)
    assert share > 0.8 / behind


def test_lugs_are_allowed_what_their_arm_adds() -> None:
    """Stress at the entry alone is as far as soil can go; lugs take T/r beyond it, but not T/(r + h)."""
    shallow = replace(WHEEL, entry=0.3)
    good, angle = rows(shallow, sigma=1e-3), 0.99 * shallow.entry
    load = 1e3 * (np.cos(angle) + 0.9 * np.sin(angle)) * np.ones(5)
    pull, torque = 1e3 * (0.9 * np.cos(angle) - np.sin(angle)) * np.ones(5), 900.0 * WHEEL.radius * np.ones(5)
    edge = replace(good, vertical_load_n=load, drawbar_pull_n=pull, driving_torque_nm=torque)
    on_lugs = replace(edge, driving_torque_nm=1.08 * torque)
    assert inconsistent(edge) == ()
    assert (on_lugs.excess_n > 0).all()
    assert inconsistent(replace(on_lugs, lugged=True)) == ()


@settings(max_examples=30, deadline=None)
@given(st.floats(0.3, 1.1), st.floats(0.0, 0.4), st.integers(0, 1000))
def test_noise_alone_is_consistent(entry: float, peak: float, seed: int) -> None:
    wheel = StressedWheel(entry=entry, slip=0.5, peak=peak)
    clean = rows(wheel)
    rng = np.random.default_rng(seed)
    noisy = replace(
        clean,
        drawbar_pull_n=clean.drawbar_pull_n + clean.drawbar_pull_sigma_n * rng.standard_normal(5),
        driving_torque_nm=clean.driving_torque_nm + clean.driving_torque_sigma_nm * rng.standard_normal(5),
        sinkage_m=clean.sinkage_m + clean.sinkage_sigma_m * rng.standard_normal(5),
    )
    assert inconsistent(noisy) == ()


WHEEL = StressedWheel(entry=0.7, slip=0.5, peak=0.5)


def test_a_sinkage_that_is_too_small_is_suspected() -> None:
    good = rows(WHEEL)
    (found,) = inconsistent(replace(good, sinkage_m=0.1 * good.sinkage_m))
    assert (found.channel, found.rows) == ("sinkage", 5)
    assert "no soil can do" in note_text(found.why)
    assert "mm more sinkage" in note_text(found.why)


def test_a_torque_that_is_too_large_is_suspected() -> None:
    good = rows(WHEEL)
    (found,) = inconsistent(replace(good, driving_torque_nm=3.0 * good.driving_torque_nm))
    assert found.channel == "driving_torque"
    assert "shear stress" in note_text(found.why)


def test_a_torque_that_shows_at_rest_is_suspected() -> None:
    good = rows(WHEEL)
    shift = 0.8 * good.vertical_load_n * good.radius_m
    wrong = replace(good, driving_torque_nm=good.driving_torque_nm + shift, torque_at_rest_nm=shift)
    (found,) = inconsistent(wrong)
    assert found.channel == "driving_torque"
    assert "standstill" in note_text(found.why)


def test_a_radius_that_is_too_small_is_suspected() -> None:
    good = rows(replace(WHEEL, entry=0.3, peak=0.7, tan_phi=0.9), sigma=0.01)
    (found,) = inconsistent(replace(good, radius_m=0.5 * good.radius_m, speed_scale=2.0))
    assert found.channel == "wheel_radius"
    assert "ground over rim speed is 2" in note_text(found.why)


def test_what_would_mend_it_does() -> None:
    good = rows(WHEEL)
    wrong = replace(good, sinkage_m=0.1 * good.sinkage_m)
    (found,) = inconsistent(wrong)
    less, more = (found.why.values[name] for name in ("less_torque_nm", "more_sinkage_m"))
    assert inconsistent(replace(wrong, driving_torque_nm=wrong.driving_torque_nm - less)) == ()
    assert inconsistent(replace(wrong, sinkage_m=wrong.sinkage_m + more)) == ()


def test_a_wheel_above_the_ground_cannot_be_held_back() -> None:
    good = rows(WHEEL)
    (found,) = inconsistent(replace(good, sinkage_m=np.full(5, -0.01)))
    assert found.rows == 5


def test_one_row_is_enough() -> None:
    good = rows(WHEEL)
    sinkage = good.sinkage_m.copy()
    sinkage[2] = 0.001
    (found,) = inconsistent(replace(good, sinkage_m=sinkage))
    assert found.rows == 1


@pytest.mark.parametrize("count", [0, 1])
def test_few_rows(count: int) -> None:
    assert inconsistent(rows(WHEEL)[np.arange(count)]) == ()
