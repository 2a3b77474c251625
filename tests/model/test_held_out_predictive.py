"""How likely a left-out run is, against the same density written out in full."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_grams import columns_of_runs, grams_of
from gram_support import WIDTHS, widths_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from model.diagnosis.time_series.evidence import log_evidence, log_likelihood_of_run


def made(seed: int):
    rng = np.random.default_rng(seed)
    columns = columns_of_runs(rng, runs=3, samples=12)
    residual = rng.normal(size=(3, 12)) + 1.5 * columns[:, :, 5]
    return columns, residual, grams_of(columns, residual)


def density(columns: np.ndarray, residual: np.ndarray, causes: list[int]) -> float:
    """Return ln N(r; 0, I + S S' + w^2 X X'), averaged over the widths w of the prior."""
    flat = columns.reshape(-1, columns.shape[2])
    soil, own = flat[:, :3] @ flat[:, :3].T, flat[:, causes] @ flat[:, causes].T
    each = [
        np.log(share) + multivariate_normal.logpdf(residual.ravel(), cov=np.eye(len(flat)) + soil + width**2 * own)
        for width, share in widths_of(causes)
    ]
    return float(np.logaddexp.reduce(each))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([(), ("slope",), ("slope", "torque_zero")]))
def test_a_run_given_the_others_is_the_ratio_of_normal_densities(seed: int, keys: tuple[str, ...]) -> None:
    columns, residual, grams = made(seed)
    own = [{"slope": 5, "torque_zero": 6}[key] for key in keys]
    expected = density(columns, residual, own) - density(columns[1:], residual[1:], own)
    assert log_likelihood_of_run(grams, 0, keys) == pytest.approx(expected, abs=1e-6)


def test_a_one_sided_cause_has_a_half_normal_prior() -> None:
    columns, residual, grams = made(5)
    flat = columns.reshape(-1, columns.shape[2])
    covariance = np.eye(len(flat)) + flat[:, :3] @ flat[:, :3].T
    chances = multivariate_normal(np.zeros(len(flat)), covariance)
    reference = chances.logpdf(residual.ravel())

    def integrand(size: float) -> float:
        prior = sum(share * 2 * norm.pdf(size, scale=width) for width, share in WIDTHS)
        return float(prior * np.exp(chances.logpdf(residual.ravel() - size * flat[:, 3]) - reference))

    expected = reference + np.log(quad(integrand, 0, 30, points=[1, 4])[0])
    assert log_evidence(grams, ("vasilev",)) == pytest.approx(expected, abs=1e-5)


def test_the_noise_determinant_counts() -> None:
    _, _, grams = made(6)
    wider = replace(grams, log_determinants=np.array([2.0, 0.0, 0.0]))
    assert log_evidence(wider) == pytest.approx(log_evidence(grams) - 1.0)
    assert log_likelihood_of_run(wider, 1) == pytest.approx(log_likelihood_of_run(grams, 1))
