"""The Kalman filter whitens, and smooths, as the dense covariance does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.diagnosis.time_series.whitening import Neighbours, StateSpace, _steps, smoothed, whiten

RUNS, COUNT, CHANNELS, STATES, WIDTH = 3, 25, 2, 5, 4


def drawn(seed: int, missing: float) -> tuple[StateSpace, np.ndarray, np.ndarray, np.ndarray]:
    """Return a state space with uneven steps, gaps and missing numbers; its columns, times, and correlation times."""
    rng = np.random.default_rng(seed)
    at = np.cumsum(rng.choice([0.2, 0.2, 0.5, 20.0], (RUNS, COUNT)), axis=1)
    times = rng.uniform(0.1, 5.0, STATES)
    times[-1] = 1e-6  # white
    steps = np.diff(at, axis=1, prepend=0.0)
    present = rng.random((RUNS, COUNT, CHANNELS)) >= missing
    present[1, 15:] = False  # a shorter run
    loadings = np.where(present[..., None], rng.standard_normal((RUNS, COUNT, CHANNELS, STATES)), 0.0)
    white = np.where(present, rng.uniform(0.01, 1.0, present.shape), 1.0)
    columns = np.where(present[..., None], rng.standard_normal((*present.shape, WIDTH)), 0.0)
    space = StateSpace(loadings, np.exp(-steps[..., None] / times), rng.uniform(0.3, 3.0, STATES), white)
    return space, columns, at, times


def dense(space: StateSpace, at: np.ndarray, times: np.ndarray, run: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of a run's numbers, and of its states with them."""
    lag = np.abs(at[run][:, None] - at[run])
    kernel = np.exp(-lag[..., None] / times) * space.variance
    h = space.loadings[run]
    full = np.einsum("ics,jds,ijs->icjd", h, h, kernel).reshape(COUNT * CHANNELS, -1)
    across = np.einsum("ijs,jds->isjd", kernel, h).reshape(COUNT * STATES, -1)
    return full + np.diag(space.white[run].ravel()), across


@given(seed=st.integers(0, 10_000), missing=st.sampled_from([0.0, 0.2]))
@settings(max_examples=15, deadline=None)
def test_it_is_the_inverse_cholesky_factor(seed: int, missing: float) -> None:
    space, columns, at, times = drawn(seed, missing)
    found = whiten(space, columns)
    for run in range(RUNS):
        root = np.linalg.cholesky(dense(space, at, times, run)[0])
        expected = np.linalg.solve(root, columns[run].reshape(-1, WIDTH))
        assert np.allclose(found.columns[run], expected, atol=1e-8)
        assert found.log_determinants[run] == pytest.approx(2 * np.log(np.diag(root)).sum(), abs=1e-8)


def test_the_smoother_gives_the_conditional_normal() -> None:
    space, columns, at, times = drawn(3, 0.1)
    means, covariances = smoothed(space, columns[..., 0])
    for run in range(RUNS):
        full, across = dense(space, at, times, run)
        expected = across @ np.linalg.solve(full, columns[run, ..., 0].ravel())
        left = np.tile(space.variance, COUNT) - np.einsum("ij,ji->i", across, np.linalg.solve(full, across.T))
        assert np.allclose(means[run].ravel(), expected, atol=1e-8)
        assert np.allclose(np.diagonal(covariances[run], axis1=1, axis2=2).ravel(), left, atol=1e-8)


BLOCK_S, MEMORIES_S = 0.2, np.array([1.3, 0.0])


def sloped(seed: int) -> tuple[StateSpace, np.ndarray, np.ndarray]:
    """Return a space of one run whose two processes are seen now, a block later and a block before, with gaps."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([BLOCK_S, BLOCK_S, BLOCK_S, 0.4, 0.5, 3.0], COUNT)
    later, shares, block = _steps(MEMORIES_S, steps[:, None], BLOCK_S)
    at = np.arange(2)
    loadings = rng.standard_normal((1, COUNT, CHANNELS, 6))
    columns = rng.standard_normal((1, COUNT, CHANNELS, WIDTH))
    decay = np.zeros((1, COUNT, 6))
    decay[0, :, :2] = later
    near = Neighbours(at, at + 2, at + 4, shares[None], block)
    variance = np.tile([0.7, 1.9], 3)
    return (
        StateSpace(loadings, decay, variance, rng.uniform(0.1, 1.0, columns.shape[:3]), near),
        columns,
        np.cumsum(steps),
    )


def dense_with_slopes(space: StateSpace, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of the run's numbers and of the present values with them, by the times of all values."""
    when = at[:, None] + BLOCK_S * np.array([1.0, 0.0, -1.0])
    apart = np.abs(when[..., None, None] - when)
    full, across = np.zeros((COUNT, CHANNELS, COUNT, CHANNELS)), []
    for i, memory in enumerate(MEMORIES_S):
        kernel = np.exp(-apart / memory) if memory else (apart < 1e-9).astype(float)
        kernel = kernel * space.variance[i]
        h = space.loadings[0][..., [i, i + 2, i + 4]]
        full += np.einsum("icp,ipjq,jdq->icjd", h, kernel, h)
        across.append(np.einsum("ijq,jdq->ijd", kernel[:, 1], h).reshape(COUNT, -1))
    whole = full.reshape(COUNT * CHANNELS, -1) + np.diag(space.white[0].ravel())
    return whole, np.stack(across)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_a_slope_sees_the_values_a_block_later_and_before(seed: int) -> None:
    space, columns, at = sloped(seed)
    full, across = dense_with_slopes(space, at)
    root = np.linalg.cholesky(full)
    assert np.allclose(
        whiten(space, columns).columns[0], np.linalg.solve(root, columns[0].reshape(-1, WIDTH)), atol=1e-8
    )
    means, covariances = smoothed(space, columns[..., 0])
    data = columns[0, ..., 0].ravel()
    for i in range(2):
        assert np.allclose(means[0, :, 2 + i], across[i] @ np.linalg.solve(full, data), atol=1e-6)
        left = space.variance[i] - np.einsum("ij,ji->i", across[i], np.linalg.solve(full, across[i].T))
        assert np.allclose(covariances[0, :, 2 + i, 2 + i], left, atol=1e-6)
