"""Every derivative rule against the complex step, which is exact to rounding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from model.wheel_soil import Dual, where
from model.wheel_soil.dual import _RULES

STEP = 1e-30
A = np.linspace(0.05, 0.95, 40)
B = np.random.default_rng(0).permutation(A)
ONE = [ufunc for ufunc in _RULES if ufunc.nin == 1]
TWO = [ufunc for ufunc in _RULES if ufunc.nin == 2]


def slope(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return the derivative by the complex step."""
    return np.imag(function(at + 1j * STEP)) / STEP


@pytest.mark.parametrize("ufunc", ONE, ids=lambda ufunc: ufunc.__name__)
def test_functions_of_one_number(ufunc: np.ufunc) -> None:
    found = ufunc(Dual(A, {"x": 1.0}))
    np.testing.assert_array_equal(found.value, ufunc(A))
    np.testing.assert_allclose(found.partials["x"] * np.ones(40), slope(ufunc, A), rtol=1e-10)


@pytest.mark.parametrize("ufunc", TWO, ids=lambda ufunc: ufunc.__name__)
def test_functions_of_two_numbers(ufunc: np.ufunc) -> None:
    by_a, by_b = slope(lambda x: ufunc(x, B), A), slope(lambda x: ufunc(A, x), B)
    both = ufunc(Dual(A, {"x": 2.0}), Dual(B, {"x": 3.0, "y": 1.0}))
    np.testing.assert_array_equal(both.value, ufunc(A, B))
    np.testing.assert_allclose(both.partials["x"] * np.ones(40), 2 * by_a + 3 * by_b, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(both.partials["y"] * np.ones(40), by_b, rtol=1e-10, atol=1e-12)


def test_a_choice_takes_the_derivative_of_what_it_takes() -> None:
    a, b = Dual([1.0, 2.0], {"x": np.array([10.0, 20.0])}), Dual([3.0, 4.0], {"y": np.array([30.0, 40.0])})
    found = where(np.array([True, False]), a, b)
    np.testing.assert_array_equal(found.value, [1.0, 4.0])
    np.testing.assert_array_equal(found.partials["x"], [10.0, 0.0])
    np.testing.assert_array_equal(found.partials["y"], [0.0, 40.0])
