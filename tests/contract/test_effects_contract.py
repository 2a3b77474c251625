"""What every effect must keep: neutral is nothing, finite over its bounds, documented, found again with its sign."""

from __future__ import annotations

import numpy as np
import pytest

from model.conditions import Conditions
from model.contact import Quadrature
from model.effects import EFFECTS
from model.gauss_newton import gauss_newton
from model.soils import SOILS
from model.wheel import Wheel
from model.wheel_soil import WheelSoilModel

WHEEL = Wheel(0.47, 0.318)
SLIP = np.concatenate([np.linspace(-0.6, -0.05, 6), np.linspace(0.02, 0.95, 15)])
LOAD = np.where(np.arange(len(SLIP)) % 2, 8e3, 1e4)
CONDITIONS = Conditions(SLIP, LOAD)
OUTPUTS = ("sinkage_m", "drawbar_pull_n", "driving_torque_nm", "vertical_load_n")

pytestmark = pytest.mark.parametrize("key", list(EFFECTS))


def _model(key: str, **options: object) -> WheelSoilModel:
    return WheelSoilModel(WHEEL, SOILS["sandy"], (EFFECTS[key],), **options)


def _small(key: str) -> dict[str, float]:
    """Return a modest size of the effect: a third of the prior scale off neutral."""
    return {p.name: p.neutral + p.prior_scale / 3 for p in EFFECTS[key].parameters}


def test_is_documented(key: str) -> None:
    effect = EFFECTS[key]
    assert effect.name and effect.summary.endswith(".") and effect.source and effect.__doc__
    assert effect.kind in ("physical", "measurement")
    for p in effect.parameters:
        assert p.unit and p.lower <= p.neutral <= p.upper and p.lower <= p.start <= p.upper and p.prior_scale > 0


def test_neutral_is_the_base_model(key: str) -> None:
    base = WheelSoilModel(WHEEL, SOILS["sandy"]).predict(CONDITIONS)
    with_effect = _model(key).predict(CONDITIONS)
    for name in OUTPUTS:
        np.testing.assert_array_equal(getattr(base, name), getattr(with_effect, name))


def test_derivative_at_neutral_is_there_and_finite(key: str) -> None:
    """Gauss-Newton may start at neutral."""
    names = tuple(p.name for p in EFFECTS[key].parameters)
    got = _model(key).predict(CONDITIONS, wrt=names)
    for name in names:
        slope = got.sensitivities[name].drawbar_pull_n
        assert np.isfinite(slope).all() and np.any(slope != 0)


def test_finite_or_nan_over_the_bounds_but_never_infinite(key: str) -> None:
    for p in EFFECTS[key].parameters:
        for value in np.linspace(p.lower, p.upper, 9):
            got = _model(key).predict(CONDITIONS, {p.name: float(value)})
            near_neutral = abs(value - p.neutral) <= p.prior_scale
            assert not near_neutral or np.isfinite(got.drawbar_pull_n).all(), f"no answer at {p.name} = {value}"
            for name in OUTPUTS:
                assert not np.isinf(getattr(got, name)).any(), f"{name} at {p.name} = {value}"


def test_sign_round_trip(key: str) -> None:
    """What is put in with another quadrature is found again, sign and size."""
    values = _small(key)
    truth = _model(key, quadrature=Quadrature(40, 4)).predict(CONDITIONS, values)
    names = tuple(values)
    model = _model(key)

    def residual(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        got = model.predict(CONDITIONS, dict(zip(names, x.tolist(), strict=True)), wrt=names)
        slopes = np.stack([got.sensitivities[n].drawbar_pull_n for n in names], axis=1)
        return got.drawbar_pull_n - truth.drawbar_pull_n, slopes

    parameters = EFFECTS[key].parameters
    found = gauss_newton(
        residual,
        [p.neutral for p in parameters],
        lower=[p.lower for p in parameters],
        upper=[p.upper for p in parameters],
    )
    np.testing.assert_allclose(found.estimate, list(values.values()), rtol=1e-3)
