"""Sensitivities, readings, limits and bad values of the wheel-soil model."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import ConfigError
from model.effects import EFFECTS
from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, Quadrature, Wheel, WheelSoilModel
from model.wheel_soil.pressure_sinkage import closed_form
from model.wheel_soil.wheel_soil_model import INPUTS

WHEEL = Wheel(0.47, 0.318)
VALUES = {"vasilev": {"H_m": 0.03}, "lyasko": {"m1": 0.3, "m2": 0.1}, "ding": {"n1": 0.3}}
SLIP = np.array([-1.0, -0.8, -0.35, -0.1, 0.0, 0.05, 0.3, 0.7, 1.0])
LOAD = np.linspace(6e3, 11e3, len(SLIP))
EVERY = list(product(VALUES, ("clay", "sandy"), ("balanced", "literal")))
OUTPUTS = ("sinkage_m", "vertical_load_n", "drawbar_pull_n", "driving_torque_nm")


def _model(law: str | None, soil: str = "clay", reading: str = "balanced", **kw: object) -> WheelSoilModel:
    return WheelSoilModel(WHEEL, SOILS[soil], () if law is None else (EFFECTS[law],), reading, **kw)


@pytest.mark.parametrize(("law", "soil", "reading"), EVERY)
def test_sensitivities_equal_complex_step(law: str, soil: str, reading: str) -> None:
    model = _model(law, soil, reading, quadrature=Quadrature(48, 4))
    slip, load = SLIP[1:-1], LOAD[1:-1]
    wrt = (*SOIL_PARAMETERS, "radius_m", "width_m", *VALUES[law], *INPUTS)
    analytic = model.predict(Conditions(slip, load), VALUES[law], wrt=wrt)
    base = (
        {n: float(getattr(SOILS[soil], n)) for n in SOIL_PARAMETERS}
        | {"radius_m": 0.47, "width_m": 0.318}
        | VALUES[law]
    )
    for name in wrt:
        h = 1e-30
        # at s = 0 the laws have a kink: its right-hand side is what both see
        shift = {k: (v + 1j * h if k == name else v) for k, v in base.items()}
        inputs = [x[:, None] + (1j * h if name == i else 0) for x, i in ((slip, "slip"), (load, "vertical_load_n"))]
        with np.errstate(all="ignore"):
            stepped = model.evaluate(Conditions(*inputs), shift)
        for output in OUTPUTS:
            expected = np.broadcast_to(np.imag(stepped[output]) / h, (len(slip), 1))[:, 0]
            actual = getattr(analytic.sensitivities[name], output)
            # a balanced load does not depend on the soil: its derivative is zero but for rounding
            natural = np.max(np.abs(getattr(analytic, output))) / max(abs(base.get(name, 1.0)), 1e-3)
            scale = max(float(np.max(np.abs(expected))), 1e-3 * float(natural))
            np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9 * scale, err_msg=f"d{output}/d{name}")


@pytest.mark.parametrize(("law", "soil", "reading"), EVERY)
def test_neutral_effect_is_the_base_model_bit_for_bit(law: str, soil: str, reading: str) -> None:
    base = _model(None, soil, reading).predict(Conditions(SLIP, LOAD))
    same = _model(law, soil, reading).predict(Conditions(SLIP, LOAD))
    for name in (*OUTPUTS, "stress_scale"):
        np.testing.assert_array_equal(getattr(base, name), getattr(same, name))


@given(
    st.floats(-1, 1),
    st.floats(3e3, 13e3),
    st.sampled_from([None, *VALUES]),
    st.sampled_from(["clay", "sandy", "ding_clay"]),
)
def test_balanced_reading_carries_the_measured_load(slip: float, load: float, law: str | None, soil: str) -> None:
    got = _model(law, soil).predict(Conditions(np.array([slip]), np.array([load])), VALUES.get(law or "", {}))
    if np.isfinite(got.drawbar_pull_n[0]):
        assert got.vertical_load_n[0] == pytest.approx(load, rel=1e-9)
        assert 0 < got.sinkage_m[0] < WHEEL.radius_m


def test_literal_reading_carries_too_much_load() -> None:
    """Yang's way: 1.05 W to 1.25 W on clay (physics: W_model/W at s = .2 and 1)."""
    got = _model("lyasko", reading="literal").predict(
        Conditions(np.array([0.2, 1.0]), np.array([8e3, 8e3])), {"m1": 0.1, "m2": 0.05}
    )
    np.testing.assert_allclose(got.vertical_load_n / 8e3, [1.05, 1.25], atol=0.006)


def test_slip_sinkage_laws_leave_braking_alone() -> None:
    s = np.array([-0.6, -0.2])
    for law, values in VALUES.items():
        a = _model(law).predict(Conditions(s, LOAD[:2]), values)
        b = _model(None).predict(Conditions(s, LOAD[:2]))
        np.testing.assert_allclose(a.drawbar_pull_n, b.drawbar_pull_n, rtol=1e-9)


def test_continuous_through_zero_slip_and_many_samples_agree_with_one() -> None:
    eps = 1e-9
    got = _model(None).predict(Conditions(np.array([-eps, eps]), np.array([8e3, 8e3])))
    assert abs(np.diff(got.drawbar_pull_n)[0]) < 1e-3
    rng = np.random.default_rng(3)
    slip, load = rng.uniform(-1, 1, 5000), rng.uniform(5e3, 12e3, 5000)
    many = _model(None).predict(Conditions(slip, load))
    few = rng.integers(0, 5000, 20)
    one = np.array([_model(None).predict(Conditions(slip[[i]], load[[i]])).drawbar_pull_n[0] for i in few])
    np.testing.assert_allclose(many.drawbar_pull_n[few], one, rtol=1e-9)


def test_bad_samples_give_nan_and_leave_the_others() -> None:
    slip = np.array([0.3, np.nan, 1.5, 0.3, 0.3])
    load = np.array([8e3, 8e3, 8e3, -1.0, 1e9])
    got = _model("lyasko").predict(Conditions(slip, load), {"m1": 0.1})
    assert np.isfinite(got.drawbar_pull_n).tolist() == [True, False, False, False, False]
    none = _model(None).predict(Conditions(np.array([np.nan]), np.array([8e3])), wrt=("slip",))
    assert np.isnan(none.drawbar_pull_n).all()


def test_given_sinkage_is_used() -> None:
    free = _model(None).predict(Conditions(SLIP, LOAD))
    given = _model(None).predict(Conditions(SLIP, LOAD), sinkage_m=free.sinkage_m)
    np.testing.assert_allclose(given.drawbar_pull_n, free.drawbar_pull_n, rtol=1e-9, atol=1e-6)


def test_unknown_parameter_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="shear_modulus_m"):
        _model(None).predict(Conditions(SLIP, LOAD), {"shear_modulus": 0.02})


def test_closed_form_matches_the_table() -> None:
    s = SOILS["clay"]
    z = closed_form(8000.0, 0.47, 0.318, s.stiffness(0.318), s.sinkage_exponent)
    assert z == pytest.approx(0.119587375, rel=1e-8)
