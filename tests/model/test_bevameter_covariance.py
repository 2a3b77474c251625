"""What the covariance of terrain parameters says of the quantity that was measured."""

from __future__ import annotations

import numpy as np
import pytest
from bench_soil import plate_tests, shear_tests

from model.bevameter import fit_plate, fit_pressure_sinkage, fit_shear_strength
from model.bevameter.joint import _sigmas
from model.bevameter.pressure_sinkage import ASSUMED_SCATTER as OF_PLATES
from model.bevameter.shear_strength import ASSUMED_SCATTER as OF_SHEARS


def test_the_pressure_under_a_plate_is_as_sure_as_the_one_test_with_it() -> None:
    """k_c, k_phi and n are strongly correlated; what they say together of ln p at z_r is the scatter of a test."""
    widths = (0.05, 0.08)
    found = fit_pressure_sinkage(plate_tests(np.random.default_rng(1), widths_m=widths, repeats=1))
    k_c, k_phi, _ = found.joint.values
    depth = found.reference_sinkage_m
    for width in widths:
        k = k_c / width + k_phi
        gradient = np.array([1 / width / k, 1 / k, np.log(depth)])
        assert np.sqrt(gradient @ found.joint.covariance @ gradient) == pytest.approx(OF_PLATES[0], rel=0.02)
    assert np.sqrt(found.joint.covariance[2, 2]) == pytest.approx(OF_PLATES[1] / np.sqrt(2), rel=0.02)


def test_pressure_and_its_sigma_at_another_depth() -> None:
    """p = k z^n; at the reference depth the two estimates are nearly independent, away from it n counts."""
    (test,) = plate_tests(np.random.default_rng(2), widths_m=(0.05,), repeats=1, noise=0.02)
    fit = fit_plate(test)
    for depth in (0.3 * fit.reference_sinkage_m, 2.0 * fit.reference_sinkage_m):
        (log_pressure, n), covariance = fit.at(depth)
        assert log_pressure == pytest.approx(np.log(fit.stiffness * depth**fit.exponent))
        assert n == fit.exponent
        turn = np.log(depth / fit.reference_sinkage_m)
        own = fit.covariance
        assert covariance[0, 0] == pytest.approx(own[0, 0] + 2 * turn * own[0, 1] + turn**2 * own[1, 1])


def test_k_is_as_sure_as_the_tests_are_many() -> None:
    tests = shear_tests(np.random.default_rng(3), normal_stresses_pa=(10e3, 60e3), repeats=1)
    found = fit_shear_strength(tests)
    cohesion, tan_phi, modulus = found.joint.values
    assert np.sqrt(found.joint.covariance[2, 2]) == pytest.approx(OF_SHEARS[1] * modulus / np.sqrt(2), rel=0.02)
    for stress in (10e3, 60e3):
        gradient = np.array([1.0, stress, 0.0]) / (cohesion + stress * tan_phi)
        assert np.sqrt(gradient @ found.joint.covariance @ gradient) == pytest.approx(OF_SHEARS[0], rel=0.02)


def test_tests_that_agree_closely_keep_their_weights() -> None:
    omega, points = np.diag([1e-10, 4e-10]), np.zeros((2, 2, 2))
    np.testing.assert_allclose(_sigmas(omega, points), [[1e-5, 2e-5]] * 2)
    assert (_sigmas(0 * omega, points) > 0).all()
