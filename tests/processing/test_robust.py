import numpy as np
import pytest

from processing.robust import block_covariance, robust_linear, robust_spread


def _problem(rng: np.random.Generator, count: int = 2400) -> tuple[np.ndarray, np.ndarray]:
    """Return a matrix of very unlike columns and y with correlated noise and a tenth of outliers; truth (2, -3e-6)."""
    matrix = np.column_stack([np.ones(count), 1e6 * rng.standard_normal(count)])
    noise = np.convolve(rng.standard_normal(count + 19), np.ones(20), "valid") / np.sqrt(20)
    wild = np.where(rng.random(count) < 0.1, 50.0, 0.0)
    return matrix, matrix @ np.array([2.0, -3e-6]) + 0.5 * noise + wild


def test_outliers_do_not_move_the_fit_and_get_no_weight() -> None:
    matrix, y = _problem(np.random.default_rng(1))
    fit = robust_linear(matrix, y)
    assert fit.coefficients == pytest.approx([2.0, -3e-6], rel=0.1)
    assert fit.spread == pytest.approx(0.5, rel=0.25)
    assert (fit.weights[y - matrix @ fit.coefficients > 40] == 0).all()


def test_the_jackknife_allows_for_correlation() -> None:
    rng = np.random.default_rng(2)
    found, sigmas = [], []
    for _ in range(60):
        matrix, y = _problem(rng)
        fit = robust_linear(matrix, y)
        found.append(fit.coefficients[0])
        sigmas.append(np.sqrt(block_covariance(matrix, y, fit.weights)[0, 0]))
    assert np.mean(sigmas) == pytest.approx(np.std(found), rel=0.3)
    assert np.mean(sigmas) > 2.5 * 0.5 / np.sqrt(2400)


def test_a_column_that_is_seen_in_one_block_only_gives_a_finite_answer() -> None:
    rng = np.random.default_rng(3)
    matrix = np.column_stack([np.ones(240), np.r_[np.ones(20), np.zeros(220)]])
    y = matrix @ np.array([1.0, 2.0]) + 0.01 * rng.standard_normal(240)
    fit = robust_linear(matrix, y)
    assert np.isfinite(block_covariance(matrix, y, fit.weights)).all()
    assert np.isfinite(robust_linear(np.zeros((30, 2)), rng.standard_normal(30)).coefficients).all()


def test_spread_of_a_normal_sample() -> None:
    assert robust_spread(3.0 * np.random.default_rng(4).standard_normal(40_000)) == pytest.approx(3.0, rel=0.03)
