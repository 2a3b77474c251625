"""Effects against values that were not computed by them: public peers, another program's sizes, closed expressions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from effects_support import WHEEL
from scipy.integrate import quad

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Conditions, Quadrature, Reading, Soil, Wheel, WheelSoilModel

SLIP = np.array([0.1, 0.3, 0.6, 0.9])
AT_8_KN = Conditions(
    SLIP, np.full(4, 8e3), ground_speed_mps=1.5, ground_acceleration_mps2=1.0, ground_jerk_mps3=0.0, line_position=1.0
)
TAB3 = {"clay": {"m1": 0.1, "m2": 0.05}, "sandy": {"m1": 0.6, "m2": 0.03}}
PEAK = {"stress_peak_shift.c1": 0.18, "stress_peak_shift.c2": 0.32}
SOFTER, STIFFER = ({"track_drift.log_stiffness_half_span": float(np.log(f))} for f in (0.8, 1.3))
LATE = {"speed_latency.extra_delay_s": 0.1}


def pull(soil: str, keys: list[str], values: dict[str, float], reading: Reading) -> np.ndarray:
    model = WheelSoilModel(WHEEL, SOILS[soil], [EFFECTS[key] for key in keys], reading, Quadrature(32, 4))
    return model.predict(AT_8_KN, values).drawbar_pull_n


@pytest.mark.parametrize(
    ("soil", "key", "values", "expected"),
    [
        ("clay", "track_drift", SOFTER, [-26, -115, -163, -192]),
        ("sandy", "track_drift", SOFTER, [-152, -292, -440, -600]),
        ("clay", "track_drift", STIFFER, [6, 108, 166, 199]),
        ("sandy", "track_drift", STIFFER, [114, 295, 464, 636]),
        ("clay", "speed_latency", LATE, [-208, -32, 0, 1]),
    ],
)
def test_sizes_on_the_literal_lyasko_model(
    soil: str, key: str, values: dict[str, float], expected: list[float]
) -> None:
    """Changes of drawbar pull in N as another program with adaptive quadrature found them (r 0.47, b 0.318 m, 8 kN)."""
    got = pull(soil, ["lyasko", key], TAB3[soil] | values, "literal") - pull(soil, ["lyasko"], TAB3[soil], "literal")
    np.testing.assert_allclose(got, expected, atol=0.6)


@pytest.mark.parametrize(
    ("soil", "keys", "values", "base", "expected"),
    [
        ("clay", ["stress_peak_shift"], PEAK, [], [-288, -438, -664, -930]),
        ("sandy", ["stress_peak_shift"], PEAK, [], [-440, -656, -991, -1399]),
        ("clay", ["exit_angle"], {"exit_angle.lambda": 0.1}, ["stress_peak_shift"], [952, 1050, 1104, 1164]),
    ],
)
def test_sizes_on_the_balanced_model(
    soil: str, keys: list[str], values: dict[str, float], base: list[str], expected: list[float]
) -> None:
    known = PEAK if base else {}
    got = pull(soil, base + keys, known | values, "balanced") - pull(soil, base, known, "balanced")
    np.testing.assert_allclose(got, expected, atol=0.6)


def test_peak_shift_as_melanz_has_it() -> None:
    """github.com/melanz/wheel-soil, README set: theta_m = (.43 + .32 s) theta_1."""
    soil = Soil("", 139.28, np.radians(34.74), 5.15e-4, 1.387, 0.0, 2.54e5 / 0.16**1.387)
    model = WheelSoilModel(Wheel(0.13, 0.16), soil, [EFFECTS["stress_peak_shift"]], quadrature=Quadrature(32, 4))
    slip, load = np.array([0.1, 0.7, 0.1, 0.9]), np.array([64.0, 64.0, 130.0, 130.0])
    got = model.predict(Conditions(slip, load), {"stress_peak_shift.c1": 0.43, "stress_peak_shift.c2": 0.32})
    np.testing.assert_allclose(got.sinkage_m * 1e3, [19.806346, 25.596777, 28.639194, 42.440122], atol=1e-5)
    np.testing.assert_allclose(got.drawbar_pull_n, [23.5339, 17.8494, 38.6053, 17.5501], atol=1e-4)
    np.testing.assert_allclose(got.driving_torque_nm, [5.21226, 5.12402, 10.29670, 10.06718], atol=1.1e-5)


def test_exit_angle_as_bretwitt_has_it() -> None:
    """github.com/bretwitt/terramechanics: theta_2 = -acos(1 - .9 Z/r), theta_m = (.40 + .15 s) theta_1."""
    soil = Soil("", 800.0, np.radians(37.2), 0.043 * np.radians(5.0) + 0.036, 1.0, 1370.0, 8.14e5)
    effects = [EFFECTS["exit_angle"], EFFECTS["stress_peak_shift"]]
    model = WheelSoilModel(Wheel(0.09, 0.11), soil, effects, quadrature=Quadrature(32, 4))
    values = {"stress_peak_shift.c1": 0.40, "stress_peak_shift.c2": 0.15, "exit_angle.lambda": 0.9}
    got = model.predict(Conditions(np.array([0.1, 0.3, 0.5, 0.7]), np.full(4, 64.68)), values)
    np.testing.assert_allclose(got.sinkage_m * 1e3, [15.322, 15.811, 16.295, 16.796], atol=6e-4)
    np.testing.assert_allclose(got.drawbar_pull_n, [4.10869, 12.89618, 19.51572, 24.44960], atol=1e-5)


def test_the_closed_form_blends_into_the_balance() -> None:
    """All the way it is the balanced reading, with the slip-sinkage law too."""
    literal = pull(
        "sandy", ["lyasko", "closed_form_sinkage"], TAB3["sandy"] | {"closed_form_sinkage.blend": 1.0}, "literal"
    )
    np.testing.assert_allclose(literal, pull("sandy", ["lyasko"], TAB3["sandy"], "balanced"), rtol=1e-12)


def test_bulldozing_is_rankines_wedge() -> None:
    """Clay, b = 0.318 m: gamma Z^2 Kp / 2 + 2 c sqrt(Kp) Z a metre of width."""
    model = WheelSoilModel(WHEEL, SOILS["clay"], [EFFECTS["bulldozing"]])
    base, all_of_it = model.predict(AT_8_KN), model.predict(AT_8_KN, {"bulldozing.fraction": 1.0})
    depth, root = base.sinkage_m, np.tan(np.radians(45.0 + 7.0))
    wedge = 0.318 * (16_500.0 * depth**2 * root**2 / 2.0 + 2.0 * 7580.0 * root * depth)
    np.testing.assert_allclose(base.drawbar_pull_n - all_of_it.drawbar_pull_n, wedge, rtol=1e-10)


def test_friction_at_the_rim_is_an_error_of_tan_phi_for_the_wheel_but_not_for_the_soil() -> None:
    ln_mu = -0.25
    rim = {"interface_friction.ln_mu": ln_mu}
    weaker = {"tan_phi": SOILS["clay"].tan_phi * np.exp(ln_mu)}
    np.testing.assert_allclose(
        pull("clay", ["interface_friction"], rim, "balanced"), pull("clay", [], weaker, "balanced")
    )
    both = ["interface_friction", "bulldozing"]
    wedge = {"bulldozing.fraction": 1.0}
    assert np.all(
        pull("clay", both, rim | wedge, "balanced") < pull("clay", ["bulldozing"], weaker | wedge, "balanced")
    )


def test_a_locked_wheel_skids_in_by_h2_and_a_driven_one_not_at_all() -> None:
    model = WheelSoilModel(WHEEL, SOILS["clay"], [EFFECTS["skid_sinkage"]])
    conditions = Conditions(np.array([-1.0, -0.5, 0.0, 0.5]), np.full(4, 8e3))
    got = model.predict(conditions, {"skid_sinkage.H2_m": 0.1})
    np.testing.assert_allclose(got.sinkage_m - got.static_sinkage_m, [0.1, 0.025, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(got.vertical_load_n, 8e3, rtol=1e-9)
    assert EFFECTS["skid_sinkage"].parameters[0].scale(Wheel(0.058, 0.05)) == pytest.approx(0.0348)


def _by_quad(slip: float, sinkage: float, values: dict[str, float]) -> tuple[float, float, float]:
    """Return W, Dp (N) and T (N m) of clay from the textbook's integrals, written down again in theta."""
    soil, r, b = SOILS["clay"], WHEEL.radius_m, WHEEL.width_m
    c1, c2, rebound, lug, q = values.values()
    entry = np.arccos(1.0 - sinkage / r)
    peak, end = (c1 + c2 * max(slip, 0.0)) * entry, -np.arccos(1.0 - rebound * sinkage / r)
    travel = r * (1.0 - slip if slip >= 0 else 1.0 / (1.0 + slip))  # V/omega
    k = soil.stiffness(b)

    def stresses(theta: float) -> tuple[float, float]:
        mirrored = theta if theta > peak else entry - (theta - end) / (peak - end) * (entry - peak)
        sigma = k * (r * max(np.cos(mirrored) - np.cos(entry), 0.0)) ** soil.sinkage_exponent
        j = (r + lug) * (entry - theta) - travel * (np.sin(entry) - np.sin(theta))
        left = 1.0 - q * (1.0 - np.exp(-abs(j) / 0.15))
        share = np.sign(j) * (1.0 - np.exp(-abs(j) / soil.shear_modulus_m)) * left
        return sigma, (soil.cohesion_pa + sigma * soil.tan_phi) * share

    def integral(weights: tuple[Callable[[float], float], Callable[[float], float]]) -> float:
        def integrand(theta: float) -> float:
            sigma, tau = stresses(theta)
            return sigma * weights[0](theta) + tau * weights[1](theta)

        found, _ = quad(integrand, end, entry, points=(0.0, peak), epsabs=1e-6, epsrel=1e-10, limit=400)
        return float(found)

    load = r * b * integral((np.cos, np.sin))
    pull = r * b * integral((lambda t: -np.sin(t), np.cos))
    return load, pull, r * (r + lug) * b * integral((lambda _: 0.0, lambda _: 1.0))


@pytest.mark.parametrize("slip", [0.05, 0.4, 0.9, -0.1, -0.5])
def test_everything_that_changes_the_patch_at_once(slip: float) -> None:
    keys = ("stress_peak_shift", "exit_angle", "grouser", "shear_softening")
    values = {
        "stress_peak_shift.c1": 0.2,
        "stress_peak_shift.c2": 0.3,
        "exit_angle.lambda": 0.15,
        "grouser.height_m": 0.015,
        "shear_softening.fraction": 0.4,
    }
    model = WheelSoilModel(WHEEL, SOILS["clay"], [EFFECTS[k] for k in keys], "literal", Quadrature(48, 4))
    got = model.predict(Conditions(np.array([slip]), np.array([8e3])), values, sinkage_m=np.array([0.11]))
    expected = _by_quad(slip, 0.11, values)
    found = (got.vertical_load_n[0], got.drawbar_pull_n[0], got.driving_torque_nm[0])
    np.testing.assert_allclose(found, expected, atol=1e-7 * 8e3)
