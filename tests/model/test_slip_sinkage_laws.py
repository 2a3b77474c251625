"""The slip-sinkage laws as Yang et al. (2016) print them, Eq. 11 to 13, for driven and braked wheels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Conditions, Wheel, WheelSoilModel

SLIP = np.array([-0.6, -0.1, 0.0, 0.2, 0.5, 0.9, 1.0])
DRIVEN = np.array([0.0, 0.0, 0.0, 0.2, 0.5, 0.9, 1.0])
CONDITIONS = Conditions(SLIP, np.full(len(SLIP), 8e3))
WHEEL = Wheel(0.47, 0.318)
STATIC_M = 0.1
Law = Callable[[np.ndarray], np.ndarray]


@pytest.mark.parametrize(
    ("key", "values", "law"),
    [
        ("vasilev", {"H_m": 0.08}, lambda s: STATIC_M + 0.08 * s),
        ("lyasko", {"m1": 0.6, "m2": 0.3}, lambda s: STATIC_M * (1 + 0.6 * s) / (1 - 0.3 * s)),
        ("second_order", {"H_m": 0.08, "Q_m": 0.05}, lambda s: STATIC_M + 0.08 * s + 0.05 * s * (1 - s)),
    ],
)
def test_sinkage_grows_from_its_static_value(key: str, values: dict[str, float], law: Law) -> None:
    found = EFFECTS[key]().sinkage(STATIC_M, CONDITIONS, values)
    np.testing.assert_allclose(found, law(DRIVEN), rtol=1e-14)


def test_in_dings_law_the_exponent_grows_in_the_stress_and_in_the_static_sinkage() -> None:
    """Each slip by itself is a soil whose exponent is n + n1 s."""
    n = SOILS["clay"].sinkage_exponent
    laws = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["ding"],)).predict(CONDITIONS, {"n1": 0.35})
    for i, slip in enumerate(SLIP):
        soil = WheelSoilModel(WHEEL, SOILS["clay"])
        one = soil.predict(Conditions(SLIP[i : i + 1], np.full(1, 8e3)), {"sinkage_exponent": n + 0.35 * DRIVEN[i]})
        assert laws.sinkage_m[i] == pytest.approx(one.sinkage_m[0], rel=1e-9), slip
        assert laws.drawbar_pull_n[i] == pytest.approx(one.drawbar_pull_n[0], rel=1e-7), slip
