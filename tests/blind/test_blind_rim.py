"""The truth's own stresses and balance, against published values, an adaptive quadrature and bare mechanics."""

from __future__ import annotations

import csv
import itertools

import numpy as np
import pytest
from blind.causes import KNOWN
from blind.field import physics_of
from blind.ground import LABORATORY
from blind.rim import Rim, settled, sums
from blind.wheel import COLUMNS, YANG, Moments, Physics, readings, soil_forces
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from support import shared_file

RADIUS_M, WIDTH_M = YANG.radius_m, YANG.width_m


def moments(slip: np.ndarray, load_n: float = 9000.0, speed: float = 1.5) -> Moments:
    """Return moments at a speed, with all else ordinary."""
    ones = np.ones(len(slip))
    omega = speed / np.where(slip < 0, 1 / (1 + slip), 1 - slip) / RADIUS_M
    named = dict.fromkeys(COLUMNS, 0.0 * ones)
    named |= {"speed": speed * ones, "omega": omega, "load": load_n * ones, "passes": ones, "inflation": 340 * ones}
    named |= {"direction": ones, "time_s": np.arange(len(slip)) * 0.2}
    return Moments(**named, later=lambda dt: speed * ones)


def test_reference_values_come_out() -> None:
    worst = np.zeros(3)
    with shared_file("reference_values.csv").open() as file:
        for row in csv.DictReader(file):
            soil = LABORATORY["clay" if row["soil"] == "clay" else "sandy"]
            width = float(row["b_m"])
            rim = Rim(
                ratio=1 - float(row["s"]),
                radius=float(row["r_m"]),
                width=width,
                cohesion=soil.cohesion,
                friction=soil.friction,
                shear_modulus=soil.shear_modulus,
                stiffness=soil.stiffness(width),
                exponent=float(row["n"]),
            )
            found = sums(rim, np.array([[float(row["z_m"])]]))
            both = (
                found.load + found.load_cohesion,
                found.pull + found.pull_cohesion,
                found.torque + found.torque_cohesion,
            )
            published = np.array([float(row[name]) for name in ("Wmodel_N", "Dp_N", "T_Nm")])
            worst = np.maximum(worst, np.abs(np.array([x[0, 0] for x in both]) - published))
    assert (worst < 1e-4).all(), worst  # of some thousand newtons; the table has ten digits


@pytest.mark.parametrize(
    ("slip", "refined"),
    [
        (0.3, {}),
        (-0.25, {}),
        (0.6, {"peak": 0.3, "exit_angle": -0.1}),
        (-0.15, {"peak": 0.2, "exit_angle": -0.05}),
        (0.2, {"exit_share": 0.1}),
    ],
)
def test_integrals_are_those_of_an_adaptive_quadrature(slip: float, refined: dict[str, float]) -> None:
    soil = LABORATORY["sandy"]
    ratio = 1 / (1 + slip) if slip < 0 else 1 - slip
    rim = Rim(ratio, RADIUS_M, WIDTH_M, 900.0, soil.friction, 0.02, soil.stiffness(WIDTH_M), soil.exponent, **refined)
    z = 0.15
    entry = np.arccos(1 - z / RADIUS_M)
    exit_ = -np.arccos(1 - rim.exit_share * z / RADIUS_M) + rim.exit_angle
    middle = rim.peak * entry

    def stress(theta: float) -> tuple[float, float]:
        felt = theta if theta >= middle else entry - (theta - exit_) / (middle - exit_) * (entry - middle)
        sigma = rim.stiffness * max(RADIUS_M * (np.cos(felt) - np.cos(entry)), 0.0) ** rim.exponent
        j = RADIUS_M * (entry - theta - ratio * (np.sin(entry) - np.sin(theta)))
        return sigma, (rim.cohesion + sigma * rim.friction) * np.sign(j) * -np.expm1(-abs(j) / 0.02)

    def integral(weigh) -> float:
        cuts = sorted({exit_, middle, entry})
        grid = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(cuts)])
        return sum(quad(lambda t: weigh(t, *stress(t)), a, b)[0] for a, b in itertools.pairwise(grid) if b > a)

    area = RADIUS_M * WIDTH_M
    expected = [
        area * integral(lambda t, s, tau: s * np.cos(t) + tau * np.sin(t)),
        area * integral(lambda t, s, tau: tau * np.cos(t) - s * np.sin(t)),
        area * RADIUS_M * integral(lambda t, s, tau: tau),
    ]
    found = sums(rim, np.array([[z]]))
    got = [found.load + found.load_cohesion, found.pull + found.pull_cohesion, found.torque + found.torque_cohesion]
    assert np.allclose([x[0, 0] for x in got], expected, rtol=2e-4, atol=0.05)


@given(st.floats(-0.4, 0.92), st.floats(6e3, 14.5e3), st.sampled_from(["clay", "sandy"]))
@settings(max_examples=25, deadline=None)
def test_the_patch_carries_the_load(slip: float, load_n: float, soil: str) -> None:
    ground = LABORATORY[soil]
    ratio = 1 / (1 + slip) if slip < 0 else 1 - slip
    rim = Rim(
        np.array([[ratio]]),
        RADIUS_M,
        WIDTH_M,
        ground.cohesion,
        ground.friction,
        0.025,
        ground.stiffness(WIDTH_M),
        ground.exponent,
    )
    found = sums(rim, settled(rim, np.array([[load_n]])))
    assert float((found.load + found.load_cohesion)[0, 0]) == pytest.approx(load_n, rel=1e-8)


@pytest.mark.parametrize("soil", ["clay", "sandy"])
def test_the_wheel_never_gains_energy(soil: str) -> None:
    slip = np.linspace(-0.4, 0.92, 60)
    m = moments(slip)
    pull, torque, _ = soil_forces(Physics(), LABORATORY[soil], m)
    assert (torque * m.omega - pull * m.speed > 0).all()


@pytest.mark.parametrize("key", [key for key, hidden in KNOWN.items() if hidden.family != "wheel_inertia"])
def test_nothing_hidden_is_nothing_changed(key: str) -> None:
    m = moments(np.linspace(-0.3, 0.9, 13))
    plain, _ = readings(Physics(), LABORATORY["clay"], m)
    least, _ = readings(physics_of([(key, 1e-9 * np.sign(KNOWN[key].scale))]), LABORATORY["clay"], m)
    assert np.allclose(least.pull, plain.pull, atol=1.0)
    assert np.allclose(least.torque, plain.torque, atol=1.0)


def changes(key: str, size: float, soil: str = "clay") -> tuple[np.ndarray, np.ndarray]:
    """Return what a cause changes of pull and torque at slip -.2, .1, .3, .6, .9."""
    m = moments(np.array([-0.2, 0.1, 0.3, 0.6, 0.9]), 8000.0)
    plain, _ = readings(Physics(), LABORATORY[soil], m)
    with_it, _ = readings(physics_of([(key, size)]), LABORATORY[soil], m)
    return with_it.pull - plain.pull, with_it.torque - plain.torque


@pytest.mark.parametrize("key", ["vasilev", "lyasko", "ding", "saturating_sinkage"])
def test_slip_sinkage_costs_pull_and_grows_with_slip(key: str) -> None:
    pull, _ = changes(key, KNOWN[key].scale)
    assert pull[0] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(pull[1:]) < 0).all()
    assert pull[4] < -20


def test_signs_are_those_of_the_table_of_causes() -> None:
    """Clay: grousers and a rear contact help, a shifted peak, softening and a bow wave cost, skid shows in skid."""
    stiffer, _ = changes("multi_pass", 0.0)
    assert np.allclose(stiffer, 0.0)  # first pass
    assert (changes("grouser", 0.012)[0][1:] > 0).all()
    assert (changes("peak_at_rest", 0.2)[0][1:] < -50).all()
    assert (changes("constant_exit", 0.1)[0][1:] > 50).all()
    assert (changes("hump", 0.5)[0][3:] < -50).all()
    assert (changes("shear_softening", 0.3)[0][2:] < -50).all()
    assert (changes("bulldozing", 0.1)[0] < -50).all()
    assert (changes("hegedus", 0.1)[0] < -30).all()
    skid_pull, skid_torque = changes("skid_sinkage", 0.5)
    assert abs(skid_pull[0]) > 20
    assert np.allclose(skid_pull[1:], 0.0)
    assert np.allclose(skid_torque[1:], 0.0)


@pytest.mark.parametrize(
    ("soil", "m1", "m2", "expected"),
    [("clay", 0.1, 0.05, (-15, -54, -124, -202)), ("sandy", 0.6, 0.03, (18, -39, -246, -606))],
)
def test_literal_slip_sinkage_has_the_size_of_the_table(
    soil: str, m1: float, m2: float, expected: tuple[int, ...]
) -> None:
    """physics.md 3.1: what Lyasko's law changes of the pull, read literally, from these integrals."""
    ground = LABORATORY[soil]
    slip = np.array([[0.1], [0.3], [0.6], [0.9]])
    n, k = ground.exponent, ground.stiffness(WIDTH_M)
    static = (3 * 8000 / ((3 - n) * k * WIDTH_M * np.sqrt(2 * RADIUS_M))) ** (2 / (2 * n + 1))
    rim = Rim(1 - slip, RADIUS_M, WIDTH_M, ground.cohesion, ground.friction, ground.shear_modulus, k, n)
    pulls = []
    for factor in (np.ones((4, 1)), (1 + m1 * slip) / (1 - m2 * slip)):
        found = sums(rim, static * factor)
        pulls.append((found.pull + found.pull_cohesion)[:, 0])
    assert np.allclose(pulls[1] - pulls[0], expected, atol=1.0)
