"""The probability of a box against one dimension's exact one and against integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from model.diagnosis.time_series.evidence import log_box_probability, log_interval_probability


@pytest.mark.parametrize(
    ("lower", "upper"), [(-1.0, 2.0), (0.0, np.inf), (-np.inf, -3.0), (20.0, np.inf), (-np.inf, 25.0), (-9.0, -8.0)]
)
def test_an_interval_is_exact(lower: float, upper: float) -> None:
    expected = norm.logsf(lower) if upper == np.inf else norm.logcdf(upper) + np.log1p(
        -np.exp(norm.logcdf(lower) - norm.logcdf(upper))
    )  # fmt: skip
    found = log_interval_probability(np.array([lower]), np.array([upper]))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-300)


def posterior_like(rng: np.random.Generator, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of coefficients of columns that look alike."""
    columns = rng.normal(size=(8, 1)) * rng.normal(size=size) * rng.uniform()
    columns = (columns + rng.normal(size=(8, size)) * rng.uniform(0.02, 1)) * np.exp(rng.uniform(-1, 2.5, size=size))
    covariance = np.linalg.inv(np.eye(size) + columns.T @ columns)
    residual = columns @ np.abs(rng.normal(size=size)) * rng.choice([1.0, 1.0, -0.5]) + rng.normal(size=8)
    return covariance @ columns.T @ residual, covariance


def test_orthants_are_near_integration() -> None:
    rng = np.random.default_rng(0)
    near, far = [], []
    for _ in range(150):
        size = int(rng.integers(2, 5))
        mean, covariance = posterior_like(rng, size)
        exact = np.log(max(multivariate_normal(np.zeros(size), covariance, seed=1).cdf(mean), 1e-300))
        found = float(log_box_probability(mean, covariance, np.zeros(size), np.full(size, np.inf)))
        if exact > -3:
            near.append(found - exact)
        elif exact > -8:
            far.append(found - exact)
    assert len(near) > 80
    assert len(far) > 5
    assert np.max(np.abs(near)) < 0.1
    assert np.max(np.abs(far)) < 0.5


def test_many_boxes_at_once_are_each_alone() -> None:
    rng = np.random.default_rng(3)
    cases = [posterior_like(rng, 3) for _ in range(5)]
    means = np.stack([mean for mean, _ in cases], axis=-1)
    covariances = np.stack([covariance for _, covariance in cases], axis=-1)
    lower, upper = np.full((3, 1), -0.2), np.full((3, 1), 1.5)
    together = log_box_probability(means, covariances, lower, upper)
    alone = [log_box_probability(mean, cov, lower[:, 0], upper[:, 0]) for mean, cov in cases]
    np.testing.assert_allclose(together, alone)
