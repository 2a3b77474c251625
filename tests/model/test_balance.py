"""The balance: what its derivatives were taken from is what a second integration at the solution gives."""

from __future__ import annotations

import numpy as np
import pytest

from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, Dual, Quadrature, SoilState
from model.wheel_soil.balance import Contact, solve
from model.wheel_soil.contact import CHUNK
from model.wheel_soil.dual import column

UNSOLVABLE = 7


def contact(slip: np.ndarray) -> Contact:
    soil = SOILS["clay"]
    parameters = (Dual(getattr(soil, name), {name: 1.0}) for name in SOIL_PARAMETERS)
    load = np.linspace(6e3, 12e3, len(slip))
    load[UNSOLVABLE] = 1e9
    conditions = Conditions(slip=Dual(column(slip), {"slip": 1.0}), vertical_load_n=column(load))
    return Contact(SoilState(*parameters), 0.47, 0.318, conditions, (), Quadrature())


@pytest.mark.parametrize(("low", "high"), [(0.01, 0.8), (-0.8, -0.01), (-0.4, 0.6)])
def test_the_forces_of_the_balance_are_those_at_its_sinkage(low: float, high: float) -> None:
    wheel = contact(np.linspace(low, high, CHUNK + 200))
    found = solve(wheel, None, None, balanced=True)
    again = wheel.resultants(found.sinkage)
    pairs = (
        (found.vertical_load, again.load()),
        (found.drawbar_pull, again.pull()),
        (found.driving_torque, again.torque()),
    )
    for ours, theirs in pairs:
        assert np.isnan(ours.value[UNSOLVABLE]).all()
        assert np.isfinite(ours.value).sum() == len(ours.value) - 1
        assert np.allclose(ours.value, theirs.value, rtol=1e-12, equal_nan=True)
    for name in (*SOIL_PARAMETERS, "slip"):
        least = 1e-10 * max(np.nanmax(np.abs(theirs.partials[name])) for _, theirs in pairs)
        for ours, theirs in pairs:
            assert np.allclose(ours.partials[name], theirs.partials[name], rtol=0, atol=least, equal_nan=True), name
