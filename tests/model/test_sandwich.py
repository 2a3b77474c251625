"""The block-sandwich covariance where the samples tell nothing: the prior stands, and nothing is divided by zero."""

from __future__ import annotations

import numpy as np
import pytest

from model.intervals import Blocks, sandwich


@pytest.mark.parametrize("samples", [0, 6])
def test_samples_that_tell_nothing_leave_the_prior(samples: int) -> None:
    label = np.repeat(np.arange(3), samples // 3)
    blocks = Blocks(label, 3, float("nan"), float("nan"))
    found = sandwich(np.zeros((samples, 1, 2)), np.zeros((samples, 2)), blocks, np.diag([1.0, 4.0]))
    assert np.allclose(found.covariance, np.diag([1.0, 0.25]))
    assert np.allclose(found.naive, found.covariance)
    assert found.degrees == 1.0
