from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from model.fit.linear_step import LinearProblem, bounded_least_squares


@examples(200)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7), st.floats(0, 1), st.booleans())
def test_the_box_is_met_as_scipy_meets_it(seed: int, count: int, tight: float, at_corner: bool) -> None:
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(count + 2, count)), rng.normal(size=count + 2)
    lower, upper = -tight * rng.exponential(size=count) - 1e-9, tight * rng.exponential(size=count) + 1e-9
    start = np.where(rng.random(count) < 0.5, lower, upper) if at_corner else rng.normal(size=count)
    found = bounded_least_squares(matrix, target, lower, upper, start)
    expected = lsq_linear(matrix, target, (lower, upper), method="bvls", tol=1e-15, max_iter=100)
    assert np.all((found >= lower) & (found <= upper))
    cost = float(np.sum((matrix @ found - target) ** 2))
    assert cost <= 2 * expected.cost * (1 + 1e-10)


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e3))
def test_a_damped_step_is_as_long_as_the_radius_and_the_minimum_of_its_problem(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    residual, jacobian = rng.normal(size=9), rng.normal(size=(9, 4))
    free = np.full(4, np.inf)
    problem = LinearProblem.of(residual, jacobian, unit=rng.uniform(0.1, 10, size=4), lower=-free, upper=free)
    step, mu = problem.step_within(radius)
    if mu == 0:
        assert np.linalg.norm(step) <= 1.1 * radius
    else:
        assert np.linalg.norm(step) == pytest.approx(radius, rel=0.11)
    scaled = jacobian / problem.unit
    assert (scaled.T @ scaled + mu * np.eye(4)) @ step == pytest.approx(-scaled.T @ residual, rel=1e-6, abs=1e-9)
    after = residual + scaled @ step
    assert problem.predicted_gain(step) == pytest.approx(residual @ residual - after @ after, rel=1e-8, abs=1e-12)


def test_a_parameter_without_influence_is_left_where_it_is() -> None:
    free = np.full(2, np.inf)
    problem = LinearProblem.of(
        np.array([1.0, 2.0]), np.array([[1.0, 0.0], [2.0, 0.0]]), unit=np.ones(2), lower=-free, upper=free
    )
    assert problem.newton_step == pytest.approx([-1.0, 0.0])
