"""Accuracy of the quadrature of a braked patch, whose shear stress builds up in a thin layer or changes its sign."""

from __future__ import annotations

import numpy as np
import pytest

from model.wheel_soil import SOILS, Patch, Quadrature, resultants, speed_ratio

RADIUS_M, WIDTH_M = 0.47, 0.318
SLIP, ENTRY = (x.reshape(-1, 1) for x in np.meshgrid(np.linspace(-0.02, -0.999, 40), np.linspace(0.1, 1.1, 9)))


@pytest.mark.parametrize("name", ["clay", "sandy"])
def test_a_braked_patch_is_exact_to_a_billionth_of_the_load(name: str) -> None:
    s = SOILS[name]
    soil = (s.cohesion_pa, s.tan_phi, s.shear_modulus_m, s.stiffness(WIDTH_M), s.sinkage_exponent)
    patch = Patch(ENTRY, speed_ratio(SLIP), RADIUS_M, WIDTH_M, *soil)
    found, exact = resultants(patch), resultants(patch, Quadrature(48, 4))
    load = exact.load()
    for ours, theirs in (
        (found.load(), load),
        (found.pull(), exact.pull()),
        (found.torque() / RADIUS_M, exact.torque() / RADIUS_M),
    ):
        assert np.max(np.abs(ours - theirs) / load) < 1e-9
