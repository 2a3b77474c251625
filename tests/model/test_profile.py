"""The profile interval of a sum where the cost is a parabola, so that its ends are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from model.fit.intervals import profile_of_sum


@dataclass(frozen=True)
class Range:
    lower: float
    upper: float


@dataclass(frozen=True)
class Line:
    """Residual A x - y."""

    matrix: np.ndarray
    y: np.ndarray
    free: tuple[Range, ...]

    def residual_and_jacobian(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.matrix @ x - self.y, self.matrix


@pytest.mark.parametrize("pair", [(0, 1), (2, 0)])
def test_the_ends_are_where_the_refitted_parabola_has_risen(pair: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(30, 3))
    matrix[:, 1] = matrix[:, 0] + 0.1 * matrix[:, 1]  # hardly separable
    problem = Line(matrix, matrix @ [1.0, 2.0, 3.0] + rng.normal(size=30), (Range(-50.0, 50.0),) * 3)
    x = np.linalg.lstsq(matrix, problem.y, rcond=None)[0]
    summed = np.isin(np.arange(3), pair).astype(float)
    half = np.sqrt(4.2 * summed @ np.linalg.inv(matrix.T @ matrix) @ summed)
    centre = x @ summed
    found = profile_of_sum(problem, x, pair, 4.2, precision=1e-5)
    np.testing.assert_allclose(found, [centre - half, centre + half], rtol=1e-3)


def test_it_ends_at_the_bounds() -> None:
    problem = Line(np.eye(2), np.array([1.0, 1.0]), (Range(0.9, 1.1), Range(0.9, 1.1)))
    assert profile_of_sum(problem, np.ones(2), (0, 1), 100.0) == pytest.approx((1.8, 2.2))
