from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from property_settings import examples

from daq import ConfigError
from model.fit import StopReason
from model.fit.gauss_newton import GaussNewtonOptions, gauss_newton
from model.fit.linear_step import ResidualAndJacobian
from wheelsoil.wording.notes import texts_of

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)


def _linear(rng: np.random.Generator, rows: int, count: int) -> tuple[Array, Array]:
    return rng.normal(size=(rows, count)), rng.normal(size=rows)


def _of(matrix: Array, target: Array) -> ResidualAndJacobian:
    return lambda x: (matrix @ x - target, matrix)


def _decay(t: Array, y: Array) -> ResidualAndJacobian:
    def function(x: Array) -> tuple[Array, Array]:
        fall = np.exp(-x[1] * t)
        return x[0] * fall - y, np.column_stack([fall, -x[0] * t * fall])

    return function


def _seeing(function: ResidualAndJacobian, seen: list[Array]) -> ResidualAndJacobian:
    def seeing(x: Array) -> tuple[Array, Array]:
        seen.append(x)
        return function(x)

    return seeing


def _rosenbrock(x: Array) -> tuple[Array, Array]:
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


@given(seeds, st.integers(1, 6), st.integers(0, 30))
def test_a_linear_problem_is_solved_in_one_step(seed: int, count: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, target = _linear(rng, count + more, count)
    if np.linalg.cond(matrix) > 1e6:
        return
    seen: list[Array] = []
    result = gauss_newton(_seeing(_of(matrix, target), seen), rng.normal(size=count) * 10)
    expected, *_ = np.linalg.lstsq(matrix, target)
    assert seen[1] == pytest.approx(expected, rel=1e-7, abs=1e-7)
    assert result.estimate == pytest.approx(expected, rel=1e-8, abs=1e-8)
    assert result.converged
    if more:
        variance = float(np.sum((matrix @ expected - target) ** 2)) / more
        assert result.covariance == pytest.approx(variance * np.linalg.inv(matrix.T @ matrix), rel=1e-5)


@settings(deadline=None)
@given(seeds, st.integers(1, 5))
def test_bounds_are_kept_at_every_evaluation_and_the_optimality_conditions_hold(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, target = _linear(rng, count + 3, count)
    middle = rng.normal(size=count)
    lower, upper = middle - rng.exponential(size=count), middle + rng.exponential(size=count)
    seen: list[Array] = []

    def cubic(x: Array) -> tuple[Array, Array]:
        seen.append(x)
        return matrix @ (x + 0.1 * x**3) - target, matrix * (1 + 0.3 * x**2)

    start = rng.uniform(lower, upper)
    result = gauss_newton(cubic, start, lower=lower, upper=upper)
    assert all(np.all((x >= lower) & (x <= upper)) for x in seen)
    assert result.converged
    assert (result.stop_reason is StopReason.AT_BOUNDS) == bool(result.at_bound.any())
    gradient = result.jacobian.T @ result.residual
    size = np.linalg.norm(result.jacobian, axis=0) * max(np.sqrt(result.cost), 1e-12)
    inside = (result.estimate > lower) & (result.estimate < upper)
    assert np.all(np.abs(gradient[inside]) <= 1e-5 * size[inside])
    assert np.all(gradient[result.estimate == lower] >= -1e-5 * size[result.estimate == lower])
    assert np.all(gradient[result.estimate == upper] <= 1e-5 * size[result.estimate == upper])


@examples(50)
@given(seeds)
def test_a_bounded_linear_problem_agrees_with_scipy(seed: int) -> None:
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(seed)
    matrix, target = _linear(rng, 12, 4)
    lower, upper = np.full(4, -0.2), np.full(4, 0.3)
    result = gauss_newton(_of(matrix, target), np.zeros(4), lower=lower, upper=upper)
    expected = lsq_linear(matrix, target, (lower, upper), method="bvls", tol=1e-14)
    assert result.estimate == pytest.approx(expected.x, abs=1e-7)


@settings(deadline=None)
@given(seeds, st.lists(st.floats(-6, 6), min_size=2, max_size=2))
def test_the_units_of_the_parameters_do_not_matter(seed: int, exponents: list[float]) -> None:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 3, 20)
    function = _decay(t, 2 * np.exp(-0.7 * t) + 0.02 * rng.normal(size=t.size))
    unit = 10.0 ** np.array(exponents)

    def in_other_units(x: Array) -> tuple[Array, Array]:
        residual, jacobian = function(x * unit)
        return residual, jacobian * unit

    start, low, high = np.array([1.0, 2.0]), np.array([0.5, 0.1]), np.array([1.95, 5.0])
    first = gauss_newton(function, start, lower=low, upper=high)
    second = gauss_newton(in_other_units, start / unit, lower=low / unit, upper=high / unit)
    assert second.iterations == first.iterations
    assert second.stop_reason == first.stop_reason
    assert second.estimate * unit == pytest.approx(first.estimate, rel=1e-9)
    deviations = [np.sqrt(np.diag(result.covariance)) for result in (first, second)]
    assert deviations[1] * unit == pytest.approx(deviations[0], rel=1e-6, nan_ok=True)


@given(seeds)
def test_the_cost_never_rises_and_its_covariance_is_that_of_the_linearised_problem(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 3, 30)
    y = 2 * np.exp(-0.7 * t) + 0.05 * rng.normal(size=t.size)
    seen: list[Array] = []
    result = gauss_newton(_seeing(_decay(t, y), seen), [rng.uniform(0.1, 10), rng.uniform(0, 3)])
    costs = [float(np.sum(_decay(t, y)(x)[0] ** 2)) for x in seen]
    assert result.cost <= min(costs) * (1 + 1e-12)
    variance = result.cost / (t.size - 2)
    assert result.covariance == pytest.approx(variance * np.linalg.inv(result.jacobian.T @ result.jacobian), rel=1e-8)


@given(seeds)
def test_prior_rows_give_the_posterior(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, target = _linear(rng, 8, 3)
    mean, sigma = rng.normal(size=3), rng.uniform(0.1, 3, size=3)
    rows, values = np.vstack([matrix, np.diag(1 / sigma)]), np.concatenate([target, mean / sigma])
    result = gauss_newton(_of(rows, values), mean, options=GaussNewtonOptions(noise="unit"))
    precision = matrix.T @ matrix + np.diag(sigma**-2)
    assert result.estimate == pytest.approx(np.linalg.solve(precision, matrix.T @ target + mean / sigma**2), rel=1e-6)
    assert result.covariance == pytest.approx(np.linalg.inv(precision), rel=1e-8)


def test_a_curved_valley_is_followed_to_its_end() -> None:
    result = gauss_newton(_rosenbrock, [-1.2, 1.0])
    assert result.estimate == pytest.approx([1, 1], abs=1e-9)
    assert result.converged


def test_parameters_start_at_neutral_zero_on_their_bound() -> None:
    t = np.linspace(0, 1, 20)

    def function(x: Array) -> tuple[Array, Array]:
        return t * x[0] + t**2 * x[1] - 0.3 * t, np.column_stack([t, t**2])

    result = gauss_newton(function, [0, 0], lower=[0, 0], scale=[0.1, 0.1])
    assert result.estimate == pytest.approx([0.3, 0], abs=1e-12)


def test_a_bound_is_left_again() -> None:
    result = gauss_newton(_rosenbrock, [-1.0, 2.0], lower=[-1.0, -3], upper=[2, 2])
    assert result.estimate == pytest.approx([1, 1], abs=1e-9)
    assert not result.at_bound.any()


def test_equal_bounds_hold_a_parameter_fixed() -> None:
    t = np.linspace(0, 3, 20)
    function = _decay(t, 2 * np.exp(-0.7 * t))
    result = gauss_newton(function, [1.0, 0.7], lower=[0, 0.7], upper=[9, 0.7])
    assert result.estimate == pytest.approx([2, 0.7], rel=1e-12)
    assert result.stop_reason in (StopReason.CONVERGED_COST, StopReason.CONVERGED_STEP)
    assert result.at_bound.tolist() == [False, True]
    assert np.isnan(result.covariance[1, 1])
    everything = gauss_newton(function, [1.0, 0.7], lower=[1.0, 0.7], upper=[1.0, 0.7])
    assert everything.converged
    assert everything.iterations == 0


# --- stops -----------------------------------------------------------------------------------------------------------


def test_a_parameter_at_its_bound_is_said() -> None:
    result = gauss_newton(_rosenbrock, [0.0, 0.0], upper=[0.5, 9], names=["a", "b"])
    assert result.stop_reason is StopReason.AT_BOUNDS
    assert result.estimate == pytest.approx([0.5, 0.25], rel=1e-9)
    assert any(text.startswith("a: ended at its bound 0.5") for text in texts_of(result.warnings))
    assert np.isnan(result.covariance[0, 0])
    assert np.isinf(result.covariance[1, 1]) or result.covariance[1, 1] >= 0


def test_a_parameter_without_influence_is_singular() -> None:
    def function(x: Array) -> tuple[Array, Array]:
        return np.array([x[0] - 1, 2 * x[0]]), np.array([[1.0, 0.0], [2.0, 0.0]])

    result = gauss_newton(function, [3.0, 4.0], names=["a", "b"])
    assert result.stop_reason is StopReason.SINGULAR
    assert not result.converged
    assert result.estimate == pytest.approx([0.2, 4.0])
    assert np.isinf(result.covariance[1, 1])
    assert np.isfinite(result.covariance[0, 0])
    assert any("b: has no influence" in text for text in texts_of(result.warnings))


def test_a_residual_that_vanishes_to_rounding_has_converged() -> None:
    t = np.linspace(0, 1, 40)

    def function(x: Array) -> tuple[Array, Array]:  # exact for every fall that is fast enough
        relative = t * np.exp(-x[1])
        left = np.exp(-relative)
        return x[0] * (1 - left) - 1e4 * (t > 0), np.column_stack([1 - left, -x[0] * relative * left])

    result = gauss_newton(function, [8e3, -2.0])
    assert result.cost < 1e-15
    assert result.stop_reason in (StopReason.CONVERGED_COST, StopReason.SINGULAR)


@pytest.mark.parametrize(("share", "reason"), [(0.9e-12, StopReason.CONVERGED_COST), (1.1e-12, StopReason.NO_PROGRESS)])
def test_a_gain_that_does_not_come_is_rounding_below_a_millionth_of_a_millionth(
    share: float, reason: StopReason
) -> None:
    def function(_: Array) -> tuple[Array, Array]:  # the slope promises this share of the cost
        return np.array([1.0, 0.0]), np.array([[np.sqrt(share)], [1.0]])

    options = GaussNewtonOptions(cost_tolerance=1e-15, epsilon=1e-12)
    assert gauss_newton(function, [1.0], options=options).stop_reason is reason


def test_only_the_sum_is_determined() -> None:
    rng = np.random.default_rng(1)
    s = np.linspace(0, 1, 50)
    rows = np.column_stack([s, s + 0.01 * s**2])
    result = gauss_newton(_of(rows, 0.6 * s + 0.03 * rng.normal(size=50)), [0.1, 0.1], names=["m1", "m2"])
    (text,) = texts_of(result.warnings)
    rho = result.correlation[0, 1]
    assert rho < -0.999
    assert text.startswith(f"m1 and m2: correlation {rho:.6f}"[: len("m1 and m2: correlation -0.9999")])
    assert "only their sum is determined" in text


def test_a_start_that_is_not_finite_is_a_reason_not_an_exception() -> None:
    result = gauss_newton(lambda x: (x * np.nan, np.ones((1, 1))), [1.0])
    assert result.stop_reason is StopReason.NOT_FINITE
    assert not result.converged
    assert np.isnan(result.covariance).all()


def test_steps_into_the_undefined_are_taken_back() -> None:
    def function(x: Array) -> tuple[Array, Array]:
        return np.array([np.log(x[0]) - 2]), np.array([[1 / x[0]]])

    seen: list[Array] = []
    result = gauss_newton(_seeing(function, seen), [60.0])
    assert seen[1] < 0  # the undamped step
    assert result.estimate == pytest.approx([np.exp(2)], rel=1e-9)


def test_too_few_iterations_are_said() -> None:
    result = gauss_newton(_rosenbrock, [-1.2, 1.0], options=GaussNewtonOptions(max_iterations=3))
    assert result.stop_reason is StopReason.MAX_ITERATIONS
    assert result.iterations == 3
    assert not result.converged


def test_a_wrong_jacobian_makes_no_progress() -> None:
    result = gauss_newton(lambda x: (np.array([x[0] - 1, x[0] + 3]), np.array([[-1.0], [-1.0]])), [5.0])
    assert result.stop_reason is StopReason.NO_PROGRESS
    assert result.estimate == pytest.approx([5.0])


def test_as_many_residuals_as_parameters_have_no_noise() -> None:
    result = gauss_newton(lambda x: (x - 1, np.eye(2)), [5.0, 6.0])
    assert result.converged
    assert np.isnan(result.covariance).all()
    assert any("noise cannot be estimated" in text for text in texts_of(result.warnings))


# --- the door --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "keywords", "words"),
    [
        ([], {}, "at least one number"),
        ([[1.0]], {}, "at least one number"),
        ([np.nan, 1.0], {}, "start of x1 is not a finite number"),
        ([1.0], {"lower": [2.0]}, "start of x1 is outside its bounds"),
        ([1.0], {"lower": [2.0], "upper": [1.0]}, "wrong way round"),
        ([1.0], {"lower": [np.nan]}, "wrong way round"),
        ([1.0], {"lower": [0.0, 0.0]}, "one number a parameter"),
        ([1.0], {"scale": [0.0]}, "scale of x1 must be positive"),
        ([1.0], {"names": ["a", "b"]}, "1 parameters but 2 names"),
        ([1.0], {"options": GaussNewtonOptions(epsilon=0, max_iterations=0)}, "2 faults"),
        ([1.0, 2.0], {"lower": [3.0, 3.0], "names": ["a", "b"]}, "2 faults"),
    ],
)
def test_the_door_says_what_is_wrong(start: object, keywords: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        gauss_newton(lambda x: (x, np.eye(x.size)), start, **keywords)  # type: ignore[arg-type]


def test_wrong_shapes_of_the_callable_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(m, 2\)"):
        gauss_newton(lambda x: (x, np.eye(3)), [1.0, 2.0])
