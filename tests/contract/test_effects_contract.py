"""What every effect must keep: neutral is nothing, finite over its bounds, documented, found again with its sign."""

from __future__ import annotations

import ast
import json
from dataclasses import fields, replace
from math import nan
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from diagnosis_samples import diagnosis, seen
from effects_support import FINE, OUTPUTS, WHEEL, away, full_conditions, measured, model_with, reading_of, slopes

from daq import VehicleConfig
from model.diagnosis import Cause, ParameterEstimate
from model.effects import EFFECTS, MEASUREMENT, PHYSICAL, Parameter
from model.effects.base import Abscissa
from model.fit.gauss_newton import gauss_newton
from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, WheelSoilModel
from model.wheel_soil.dual import column
from processing import QualityReport
from wheelsoil.report.cause_figure import _VIEWS, cause_figure
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import of_diagnosis
from wheelsoil.wording.error_text import error_text

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs" / "effects"
CONDITIONS = full_conditions()
ALWAYS = ("slip", "vertical_load_n", "ground_speed_shift_s", "miscompensated_n")
OPTIONAL = tuple(f.name for f in fields(Conditions) if f.name not in ALWAYS)
PARAMETERS = [(key, name) for key, effect in EFFECTS.items() for name in effect.parameter_keys().values()]
SENSORS = [key for key, effect in EFFECTS.items() if effect.kind == "measurement"]

every_effect = pytest.mark.parametrize("key", list(EFFECTS))
every_parameter = pytest.mark.parametrize(("key", "name"), PARAMETERS)


def _parameter(key: str, name: str) -> Parameter:
    effect = EFFECTS[key]
    return dict(zip(effect.parameter_keys().values(), effect.parameters, strict=True))[name]


@every_effect
def test_is_documented(key: str) -> None:
    effect = EFFECTS[key]
    if effect in (*PHYSICAL, *MEASUREMENT):
        assert effect.summary.endswith(".") and effect.__doc__ and all(p.source for p in effect.parameters)
        assert any(c.isdigit() for c in effect.source), "a source has its year"
    assert effect.name and effect.kind in ("physical", "measurement")
    for p in effect.parameters:
        assert p.unit and p.prior_scale > 0
        assert p.lower <= p.neutral <= p.upper and p.lower <= p.start <= p.upper
        assert (p.start - p.neutral) * (p.side or 1) > 0, "an estimate starts off neutral, on the plausible side"


@every_effect
def test_neutral_is_the_base_model(key: str) -> None:
    base = WheelSoilModel(WHEEL, SOILS["sandy"], (), reading_of(EFFECTS[key])).predict(CONDITIONS)
    with_effect = model_with(key).predict(CONDITIONS, away(key, 0.0))
    for name in OUTPUTS:
        np.testing.assert_array_equal(getattr(base, name), getattr(with_effect, name))


@every_parameter
@pytest.mark.parametrize("share", [0.0, pytest.param(0.5, marks=pytest.mark.slow)])
def test_derivative_is_that_of_small_changes(key: str, name: str, share: float) -> None:
    """At neutral too, from the plausible side: there Gauss-Newton may start."""
    model, values = model_with(key, quadrature=FINE), away(key, share)
    parameter = _parameter(key, name)
    got = slopes(model.predict(CONDITIONS, values, wrt=(name,)), (name,))[:, 0]
    assert np.isfinite(got).all() and np.any(got != 0)

    def change(step: float) -> np.ndarray:
        moved = [measured(model.predict(CONDITIONS, {**values, name: values[name] + k * step})) for k in (0, 1, 2)]
        return np.asarray(-1.5 * moved[0] + 2.0 * moved[1] - 0.5 * moved[2]) / step

    step = 2e-4 * (parameter.side or 1) * parameter.scale(WHEEL)
    scale = np.abs(got).max()
    np.testing.assert_allclose(change(step), got, rtol=0, atol=2e-4 * scale)


@every_parameter
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_derivative_is_that_of_the_complex_step(key: str, name: str, share: float) -> None:
    model, values = model_with(key), away(key, share)
    analytic = model.predict(CONDITIONS, values, wrt=(name,)).sensitivities[name]
    soil, h = SOILS["sandy"], 1e-30
    known = {n: getattr(soil, n) for n in SOIL_PARAMETERS} | {"radius_m": WHEEL.radius_m, "width_m": WHEEL.width_m}
    stepped = model.evaluate(CONDITIONS.map(column), known | values | {name: values[name] + 1j * h})
    plain, scale = model.predict(CONDITIONS, values), _parameter(key, name).scale(WHEEL)
    for output in OUTPUTS:
        found = getattr(analytic, output)
        expected = np.broadcast_to(np.imag(stepped[output]) / h, (len(found), 1))[:, 0]
        size = np.abs(getattr(plain, output)).max() / scale
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-6 * size, err_msg=output)


@pytest.mark.parametrize("key", SENSORS)
def test_the_order_in_which_effects_are_given_changes_nothing(key: str) -> None:
    few = full_conditions(6)
    for other in SENSORS:
        if other != key:
            both, values = (EFFECTS[key], EFFECTS[other]), away(key, 0.5) | away(other, 0.5)
            one, two = (
                WheelSoilModel(WHEEL, SOILS["sandy"], given).predict(few, values) for given in (both, both[::-1])
            )
            np.testing.assert_allclose(measured(one), measured(two), rtol=1e-12, err_msg=other)


@every_effect
def test_the_balance_is_found_again(key: str) -> None:
    """In the balanced reading Eq. 7 gives back the true load, whatever the effect changes."""
    effect, values = (
        EFFECTS[key],
        {p.name: p.neutral + 0.5 * (p.side or 1) * p.scale(WHEEL) for p in EFFECTS[key].parameters},
    )
    model = WheelSoilModel(WHEEL, SOILS["sandy"], (effect,))
    got = model.predict(CONDITIONS, effect.keyed(values))
    np.testing.assert_allclose(got.vertical_load_n, effect().inputs(CONDITIONS, values).vertical_load_n, rtol=1e-9)


@every_effect
def test_finite_or_nan_over_the_bounds_but_never_infinite(key: str) -> None:
    effect, model = EFFECTS[key], model_with(key)
    for name, p in zip(effect.parameter_keys().values(), effect.parameters, strict=True):
        for value in np.linspace(p.lower, p.upper, 9):
            got = model.predict(CONDITIONS, {name: float(value)})
            off = (value - p.neutral) * (p.side or 1)
            plausible = abs(off) <= p.scale(WHEEL) and (off >= 0 or not p.side)
            assert not plausible or np.isfinite(measured(got)).all(), f"no answer at {name} = {value}"
            for output in OUTPUTS:
                assert not np.isinf(getattr(got, output)).any(), f"{output} at {name} = {value}"


@every_effect
@pytest.mark.parametrize("share", [1 / 3, -1 / 3])
def test_sign_round_trip(key: str, share: float) -> None:
    """What is put in with another quadrature is found again from drawbar pull and torque, sign and size."""
    effect, values = EFFECTS[key], away(key, share)
    if share < 0 and any(p.side for p in effect.parameters):
        values = away(key, 2 / 3)
    truth = measured(model_with(key, quadrature=FINE).predict(CONDITIONS, values))
    names = tuple(values)
    model = model_with(key)

    def residual(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        got = model.predict(CONDITIONS, dict(zip(names, x.tolist(), strict=True)), wrt=names)
        return measured(got) - truth, slopes(got, names)

    found = gauss_newton(
        residual,
        [p.neutral for p in effect.parameters],
        lower=[p.lower for p in effect.parameters],
        upper=[p.upper for p in effect.parameters],
    )
    np.testing.assert_allclose(found.estimate, list(values.values()), rtol=1e-3)


@every_effect
def test_survives_json(key: str) -> None:
    values, model = away(key, 0.4), model_with(key)
    again = json.loads(json.dumps(values))
    before, after = (measured(model.predict(CONDITIONS, v)) for v in (values, again))
    np.testing.assert_array_equal(before, after)


@every_effect
def test_needs_what_it_says_and_nothing_else(key: str) -> None:
    model, values = model_with(key), away(key, 0.4)
    needed = set()
    for name in OPTIONAL:
        without = replace(CONDITIONS, **{name: np.full(len(CONDITIONS.slip), np.nan)})
        if np.isnan(measured(model.predict(without, values))).any():
            needed.add(name)
    assert needed == set(OPTIONAL) & set(EFFECTS[key].needs.conditions)


def _changed(key: str) -> dict[str, np.ndarray]:
    """Return, for drawbar pull and torque, which samples an effect changes."""
    without = WheelSoilModel(WHEEL, SOILS["sandy"], (), reading_of(EFFECTS[key])).predict(CONDITIONS)
    prediction = model_with(key).predict(CONDITIONS, away(key, 0.4))
    forces = {"drawbar_pull": "drawbar_pull_n", "driving_torque": "driving_torque_nm"}
    return {c: ~np.isclose(getattr(without, name), getattr(prediction, name), 1e-6) for c, name in forces.items()}


@every_effect
def test_asks_for_the_only_force_in_which_it_shows(key: str) -> None:
    shown = [channel for channel, changed in _changed(key).items() if changed.any()]
    assert EFFECTS[key].needs.channels == (tuple(shown) if len(shown) == 1 else ())


@every_effect
def test_asks_for_a_driven_or_a_braked_wheel_where_it_shows_on_that_only(key: str) -> None:
    needs, changed = EFFECTS[key].needs, np.logical_or.reduce(list(_changed(key).values()))
    driven, braked = changed[CONDITIONS.slip > 0].any(), changed[CONDITIONS.slip < 0].any()
    assert needs.braking == (not driven)
    assert bool(needs.largest_slip) == (not braked)


@every_effect
def test_asks_for_runs_that_differ_in_what_it_takes(key: str) -> None:
    needs = EFFECTS[key].needs
    assert needs.both_directions == bool({"direction", "line_position"} & set(needs.conditions))
    assert needs.several_passes == ("pass_number" in needs.conditions)
    assert needs.several_runs == ("campaign_time" in needs.conditions)
    assert needs.pressures == ("inflation_kpa" in needs.conditions)
    assert needs.standstill == EFFECTS[key].at_standstill


@every_effect
def test_a_total_is_of_parameters_of_one_scale_and_a_first_estimate_of_the_only_one(key: str) -> None:
    effect = EFFECTS[key]
    if effect.total:
        assert len({(p.unit, p.prior_scale, p.neutral) for p in effect.parameters}) == 1 < len(effect.parameters)
    if effect.first_estimate is not None:
        assert len(effect.parameters) == 1
        assert effect.first_estimate.quality in QualityReport.__dataclass_fields__


@every_effect
def test_says_whether_it_shows_at_standstill(key: str) -> None:
    effect, model = EFFECTS[key], model_with(key)
    standing = replace(CONDITIONS, slip=np.zeros(len(CONDITIONS.slip)))
    pull, torque = model.at_rest(standing, away(key, 1.0))
    assert (np.any(pull != 0) or np.any(torque != 0)) == effect.at_standstill


@pytest.mark.parametrize("key", [effect.key() for effect in (*PHYSICAL, *MEASUREMENT)])
def test_has_a_page(key: str) -> None:
    effect = EFFECTS[key]
    page = (DOCS / f"{effect.name}.md").read_text()
    assert page.startswith(f"# {effect.name}\n")
    assert all(f"`{p.name}`" in page and f"{p.prior_scale:g}" in page for p in effect.parameters)
    assert f"[{effect.name}]({effect.name}.md)" in (DOCS / "README.md").read_text()


@every_effect
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sentence_and_figure_of_an_error_can_be_made(key: str, sign: float) -> None:
    effect, first = EFFECTS[key], EFFECTS[key].parameters[0]
    size = ParameterEstimate(first.name, first.unit, sign * first.prior_scale, (nan, nan), first.prior_scale)
    cause, data = Cause(effect.name, effect.form, effect.kind, key, 0.9, 1.0, (size,)), seen()
    text = error_text(cause, "drawbar pull")
    assert not set(text) & set("{}") and (text == "") == (effect.error_text == "")
    data = replace(data, signatures={key: {"dp": np.ones(len(data.slip))}})
    found = replace(diagnosis(), causes=(cause,), plot_data=(data,))
    inputs = ReportInputs((), None, "", VehicleConfig(), "clay", diagnosed=found)
    drawing = cause_figure(inputs, of_diagnosis(found), "dp")
    assert (drawing is None) == (effect.abscissa == "")


def test_every_abscissa_has_its_figure() -> None:
    assert get_args(Abscissa) == ("", *_VIEWS)


ROOMS = ("processing", "model", "wheelsoil")
OTHER_MEANING = {("consistency.py", "wheel_radius")}
"""Names that mean a measured quantity: the channel that a broken bound makes suspect."""


def test_no_family_is_known_by_name_outside_the_effects() -> None:
    """What the program must know of an effect it declares itself, so that one of another package is an equal."""
    families = {effect.name for effect in (*PHYSICAL, *MEASUREMENT)}
    files = [path for room in ROOMS for path in (ROOT / room).glob("**/*.py") if "effects" not in path.parts]
    found = [
        (path.name, node.value)
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in families
    ]
    assert set(found) <= OTHER_MEANING
