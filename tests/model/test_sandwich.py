"""The block-sandwich covariance where the samples tell nothing: the prior stands, and nothing is divided by zero."""

from __future__ import annotations

import numpy as np
import pytest

from model.fit.intervals import Blocks, sandwich


@pytest.mark.parametrize("samples", [0, 6])
def test_samples_that_tell_nothing_leave_the_prior(samples: int) -> None:
    label = np.repeat(np.arange(3), samples // 3)
    blocks = Blocks(label, 3, float("nan"), float("nan"))
    found = sandwich(np.zeros((samples, 1, 2)), np.zeros((samples, 2)), blocks, np.diag([1.0, 4.0]))
    assert np.allclose(found.covariance, np.diag([1.0, 0.25]))
    assert np.allclose(found.naive, found.covariance)
    assert found.degrees == 1.0


@pytest.mark.parametrize("count", [2, 5])
def test_of_few_blocks_each_residual_is_freed_of_its_own_pull(count: int) -> None:
    """Variance of a mean: each residual over 1 - 1/n, as the jackknife has it (Bell & McCaffrey 2002)."""
    x = np.arange(count) ** 2.0
    residual = x - x.mean()
    blocks = Blocks(np.arange(count), count, float("nan"), float("nan"))
    found = sandwich(np.ones((count, 1, 1)), residual[:, None], blocks)
    jackknife = np.array([np.delete(x, i).mean() for i in range(count)])
    assert found.covariance[0, 0] == pytest.approx(np.sum((jackknife - x.mean()) ** 2))
    assert found.naive[0, 0] == pytest.approx(1 / count)
    assert found.degrees == pytest.approx(count - 1)
