"""The model against values that were not computed by it: the reference table, public peers, mpmath."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import mpmath as mp
import numpy as np
import pytest
from support import shared_file

from model.effects import EFFECTS
from model.wheel_soil import (
    SOILS,
    Conditions,
    Patch,
    Quadrature,
    Wheel,
    WheelSoilModel,
    entry_angle,
    resultants,
    speed_ratio,
)
from model.wheel_soil.balance import balanced

TAB3 = {
    "clay": {"H_m": 0.02, "m1": 0.1, "m2": 0.05, "n1": 0.35},
    "sand": {"H_m": 0.08, "m1": 0.6, "m2": 0.03, "n1": 0.53},
}


def test_reference_values_hold_to_1e_8() -> None:
    with shared_file("reference_values.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 296
    for row in rows:
        soil = SOILS["clay" if row["soil"] == "clay" else "sandy"]
        law = () if row["model"] == "wong" else (EFFECTS[row["model"]],)
        reading = "balanced" if row["sinkage_rule"] == "balance" else "literal"
        model = WheelSoilModel(Wheel(float(row["r_m"]), float(row["b_m"])), soil, law, reading, Quadrature(24, 3))
        values = {p.name: TAB3[row["soil"]][p.name] for effect in law for p in effect.parameters}
        got = model.predict(Conditions(np.array([float(row["s"])]), np.array([float(row["W_N"])])), values)
        expected = [float(row[k]) for k in ("z_m", "theta1_rad", "Wmodel_N", "Dp_N", "T_Nm")]
        actual = [
            got.sinkage_m[0],
            got.entry_angle_rad[0],
            got.vertical_load_n[0],
            got.drawbar_pull_n[0],
            got.driving_torque_nm[0],
        ]
        np.testing.assert_allclose(actual, expected, rtol=1e-8, err_msg=str(row))


def _balance(load: float, slip: float, radius: float, width: float, peak: float, exit_of, **soil) -> dict[str, float]:
    """Return a balanced wheel with a moved stress peak and an exit angle, as the public peers have them."""

    def patch(z):
        theta = entry_angle(z, radius)
        return Patch(
            entry_angle=theta,
            speed_ratio=speed_ratio(np.array([[slip]])),
            radius=radius,
            width=width,
            peak_angle=peak * theta,
            exit_angle=exit_of(z),
            **soil,
        )

    rule = Quadrature(32, 4)
    one = np.ones((1, 1))
    z = balanced(
        load * one,
        0.2 * radius * one,
        radius * one,
        soil["exponent"] * one,
        lambda z, _: resultants(patch(z), rule).load(),
    )
    forces = resultants(patch(z), rule)
    return {
        "theta1": float(entry_angle(z, radius)[0, 0]),
        "z": float(z[0, 0]),
        "Dp": float(forces.pull()[0, 0]),
        "T": float(forces.torque()[0, 0]),
        "W": float(forces.load()[0, 0]),
        "peak": float(peak * entry_angle(z, radius)[0, 0]),
    }


def _none(_z: np.ndarray) -> float:
    return 0.0


MELANZ = [  # github.com/melanz/wheel-soil, README set: W N, s, theta1 rad, z mm, Dp N, T N m
    (64, 0.1, 0.559268, 19.806346, 23.5339, 5.21226),
    (64, 0.3, 0.579652, 21.235087, 21.9615, 5.18767),
    (64, 0.7, 0.638314, 25.596777, 17.8494, 5.12402),
    (130, 0.1, 0.676612, 28.639194, 38.6053, 10.29670),
    (130, 0.3, 0.701977, 30.736297, 34.6497, 10.23402),
    (130, 0.7, 0.775493, 37.170137, 24.4741, 10.11178),
    (130, 0.9, 0.831812, 42.440122, 17.5501, 10.06718),
]


@pytest.mark.parametrize(("load", "slip", "theta1", "z_mm", "pull", "torque"), MELANZ)
def test_peer_melanz(load, slip, theta1, z_mm, pull, torque) -> None:
    soil = {
        "cohesion": 139.28,
        "tan_phi": np.tan(np.radians(34.74)),
        "shear_modulus": 5.15e-4,
        "exponent": 1.387,
        "stiffness": 2.54e5 / 0.16**1.387,
    }
    got = _balance(load, slip, 0.13, 0.16, 0.43 + 0.32 * slip, _none, **soil)
    assert got["theta1"] == pytest.approx(theta1, abs=1e-6)
    assert got["z"] * 1e3 == pytest.approx(z_mm, abs=1e-5)
    assert got["Dp"] == pytest.approx(pull, abs=1e-4)
    assert got["T"] == pytest.approx(torque, abs=1.1e-5)


@pytest.mark.parametrize(
    ("slip", "h_mm", "pull"),
    [(0.1, 15.322, 4.10869), (0.3, 15.811, 12.89618), (0.5, 16.295, 19.51572), (0.7, 16.796, 24.44960)],
)
def test_peer_bretwitt(slip, h_mm, pull) -> None:
    """github.com/bretwitt/terramechanics, Ishigami's soil with a rear exit angle."""
    soil = {
        "cohesion": 800.0,
        "tan_phi": np.tan(np.radians(37.2)),
        "shear_modulus": 0.043 * np.radians(5.0) + 0.036,
        "exponent": 1.0,
        "stiffness": 1370 / 0.11 + 8.14e5,
    }
    got = _balance(64.68, slip, 0.09, 0.11, 0.40 + 0.15 * slip, lambda z: -np.arccos(1 - 0.9 * z / 0.09), **soil)
    assert got["z"] * 1e3 == pytest.approx(h_mm, abs=6e-4)
    assert got["Dp"] == pytest.approx(pull, abs=1e-5)
    assert got["W"] == pytest.approx(64.68, abs=1e-6)


LB, INCH, PSI = 4.4482216152605, 0.0254, 6894.757293168
COMPACT = {"c": 0.1, "phi": 33.3, "k1": 20, "k2": 2.5, "n": 0.47, "c1": 0.43, "c2": 0.32}
LOOSE = {"c": 0.12, "phi": 31.1, "k1": 0, "k2": 2, "n": 1.15, "c1": 0.18, "c2": 0.32}
WONG_REECE = [  # github.com/jcmadsen/pyTerramechanics: soil, b in, W lb, s, theta1 deg, theta_m deg, z mm, Dp N, T N m
    (COMPACT, 6, 2006, 0.1, 36.4463, 16.8382, 122.707, 673.760, 2154.161),
    (COMPACT, 6, 2006, 0.221, 36.5402, 18.2964, 123.318, 1292.512, 2553.459),
    (COMPACT, 6, 2006, 0.6, 38.0365, 23.6587, 133.244, 1744.612, 2966.029),
    (LOOSE, 6, 1986, 0.1, 55.5372, 11.7739, 272.364, 1045.550, 2808.972),
    (LOOSE, 6, 1986, 0.6, 58.5941, 21.7970, 300.454, 666.423, 2937.492),
    (LOOSE, 12, 2085, 0.221, 47.2715, 11.8519, 201.687, 1541.619, 2937.060),
]


@pytest.mark.parametrize(("s", "b_in", "load", "slip", "theta1", "theta_m", "z_mm", "pull", "torque"), WONG_REECE)
def test_peer_wong_reece(s, b_in, load, slip, theta1, theta_m, z_mm, pull, torque) -> None:
    width = b_in * INCH
    soil = {
        "cohesion": s["c"] * PSI,
        "tan_phi": np.tan(np.radians(s["phi"])),
        "shear_modulus": 1.5 * INCH,
        "exponent": s["n"],
        "stiffness": (s["k1"] + s["k2"] * b_in) * PSI / width ** s["n"],
    }
    got = _balance(load * LB, slip, 24.7 * INCH, width, s["c1"] + s["c2"] * slip, _none, **soil)
    assert np.degrees(got["theta1"]) == pytest.approx(theta1, abs=6e-5)
    assert np.degrees(got["peak"]) == pytest.approx(theta_m, abs=6e-5)
    assert got["z"] * 1e3 == pytest.approx(z_mm, abs=6e-4)
    assert got["Dp"] == pytest.approx(pull, abs=6e-4)
    assert got["T"] == pytest.approx(torque, abs=6e-4)


@pytest.mark.parametrize(
    ("slip", "z_mm", "pull"),
    [(0.1, 44.297, 8.063), (0.2, 44.502, 14.773), (0.4, 45.503, 19.985), (0.6, 47.104, 20.258)],
)
def test_azimi_set(slip, z_mm, pull) -> None:
    """Azimi, Kovecses, Angeles (2013), Tab. III."""
    soil = {
        "cohesion": 234.0,
        "tan_phi": np.tan(np.radians(30.0)),
        "shear_modulus": 0.013,
        "exponent": 0.8,
        "stiffness": 4.1e5 * 0.1 / 0.1**0.8,
    }
    got = _balance(165.0, slip, 0.15, 0.1, 0.18 + 0.32 * slip, _none, **soil)
    assert got["z"] * 1e3 == pytest.approx(z_mm, abs=6e-4)
    assert got["Dp"] == pytest.approx(pull, abs=6e-4)


def _mp_forces(theta1, kappa, r, b, c, tan_phi, K, k, n) -> Iterator[mp.mpf]:
    """Eq. 7-9 with 30 digits, straight from the paper's formulas."""
    theta1, kappa, r, b, c, tan_phi, K, k, n = (mp.mpf(float(x)) for x in (theta1, kappa, r, b, c, tan_phi, K, k, n))

    def sigma(t):
        return k * (r * (mp.cos(t) - mp.cos(theta1))) ** n

    def tau(t):
        j = r * ((theta1 - t) - kappa * (mp.sin(theta1) - mp.sin(t)))
        return mp.sign(j) * (c + sigma(t) * tan_phi) * (1 - mp.exp(-abs(j) / K))

    def j_over_r(t):
        return (theta1 - t) - kappa * (mp.sin(theta1) - mp.sin(t))

    cuts = [mp.mpf(0), theta1 * (1 - mp.mpf(10) ** -6), theta1]
    if kappa > 1 and kappa * mp.cos(theta1) < 1:
        cuts.append(mp.findroot(j_over_r, (theta1 * mp.mpf("1e-3"), theta1 * mp.mpf("0.999")), solver="anderson"))
    # the layer in which the shear stress of a braked wheel builds up
    cuts += [theta1 * (1 - mp.mpf(10) ** -e) for e in (1, 2, 3, 4)]
    cuts = sorted(set(cuts))
    yield r * b * mp.quad(lambda t: sigma(t) * mp.cos(t) + tau(t) * mp.sin(t), cuts)
    yield r * b * mp.quad(lambda t: tau(t) * mp.cos(t) - sigma(t) * mp.sin(t), cuts)
    yield r * r * b * mp.quad(tau, cuts)


POINTS = [  # theta1, slip, soil
    (0.73, 0.2, "clay"),
    (0.80, -0.28, "clay"),
    (0.90, 0.5, "sandy"),
    (0.40, -0.06, "ding_clay"),
]
FURTHER_POINTS = [
    (0.73, 0.0, "clay"),
    (0.95, 0.95, "clay"),
    (0.60, -0.10, "clay"),
    (0.73, -0.75, "clay"),
    (0.73, -0.999, "clay"),
    (0.85, -0.4, "sandy"),
    (0.40, 1.0, "ding_clay"),
]


@pytest.mark.parametrize(
    ("theta1", "slip", "name"), [*POINTS, *(pytest.param(*one, marks=pytest.mark.slow) for one in FURTHER_POINTS)]
)
def test_thirty_digits(theta1, slip, name) -> None:
    s, r, b = SOILS[name], 0.47, 0.318
    kappa = float(speed_ratio(np.array([[slip]]))[0, 0])
    soil = (s.cohesion_pa, s.tan_phi, s.shear_modulus_m, s.stiffness(b), s.sinkage_exponent)
    patch = Patch(np.array([[theta1]]), np.array([[kappa]]), r, b, *soil)
    with mp.workdps(30):
        exact = [float(x) for x in _mp_forces(theta1, kappa, r, b, *soil)]
    for rule, tolerance in ((Quadrature(48, 4), 1e-10), (Quadrature(), 1e-6)):
        forces = resultants(patch, rule)
        got = [float(x[0, 0]) for x in (forces.load(), forces.pull(), forces.torque())]
        np.testing.assert_allclose(got, exact, rtol=0, atol=tolerance * exact[0])


def test_locked_wheel_is_the_limit() -> None:
    """s_b = -1: the whole patch slides, tau = -(c + sigma tan phi), with no shear to build up."""
    s, r, b, theta1 = SOILS["clay"], 0.47, 0.318, 0.73
    soil = (s.cohesion_pa, s.tan_phi, s.shear_modulus_m, s.stiffness(b), s.sinkage_exponent)
    slips = np.array([[-1.0]])
    forces = resultants(Patch(np.array([[theta1]]), speed_ratio(slips), r, b, *soil), Quadrature(48, 4))
    with mp.workdps(30):
        sigma = lambda t: s.stiffness(b) * (r * (mp.cos(t) - mp.cos(theta1))) ** s.sinkage_exponent  # noqa: E731
        tau = lambda t: -(s.cohesion_pa + sigma(t) * s.tan_phi)  # noqa: E731
        pull = float(r * b * mp.quad(lambda t: tau(t) * mp.cos(t) - sigma(t) * mp.sin(t), [0, 0.7 * theta1, theta1]))
    assert float(forces.pull()[0, 0]) == pytest.approx(pull, rel=1e-9)
