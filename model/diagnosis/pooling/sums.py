r"""Campaigns' information added up in time: what any constant or drifting parameters together say of them.

With :math:`\Lambda_c, h_c` what campaign c says of k parameters and :math:`s_c` its time, constants and slopes are 2k
numbers, with

.. math:: \Lambda = \sum_c \begin{pmatrix} 1 & s_c \\ s_c & s_c^2 \end{pmatrix} \otimes \Lambda_c,
          \quad h = \sum_c (1, s_c) \otimes h_c

A hypothesis is a choice of their rows. Source: Gelman et al. (2013), Bayesian Data Analysis, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from daq import FloatArray, IntArray


def with_scatter(moments: FloatArray, tau: float, count: int) -> FloatArray:
    """Return moments, shape (1 + k, 1 + k), with a scatter of the first `count` parameters integrated out.

    They have the score in the first row and column and the precision in the rest; `tau` is the scatter's one-sigma in
    prior scales. The first number of the result is -2 times what the scatter adds to the log evidence.
    """
    variance = tau**2
    inner = np.eye(count) + variance * moments[1 : 1 + count, 1 : 1 + count]
    across = moments[:, 1 : 1 + count]
    found: FloatArray = moments - variance * across @ np.linalg.solve(inner, across.T)
    found[0, 0] += np.linalg.slogdet(inner)[1]
    return found


@dataclass(frozen=True)
class Sums:
    """What campaigns say of k constants, then of k slopes.

    Attributes
    ----------
    precision : array, shape (2 k, 2 k)
    score : array, shape (2 k,)
    left : float
        Log evidence of no parameter at all, less that of no scatter.
    """

    precision: FloatArray
    score: FloatArray
    left: float

    @classmethod
    def of(cls, moments: Sequence[FloatArray], times: Sequence[float]) -> Self:
        """Add campaigns up, each with its time in the slopes' unit."""
        if not moments:
            return cls.none(0)
        each, at = np.stack(moments), np.array([np.ones(len(times)), times])
        k = each.shape[1] - 1
        precision = np.einsum("ac,bc,cij->aibj", at, at, each[:, 1:, 1:]).reshape(2 * k, 2 * k)
        return cls(precision, (at @ each[:, 1:, 0]).ravel(), -0.5 * float(each[:, 0, 0].sum()))

    @classmethod
    def none(cls, size: int) -> Self:
        """Return the sums of no campaign."""
        return cls(np.zeros((2 * size, 2 * size)), np.zeros(2 * size), 0.0)

    def without(self, other: Sums) -> Sums:
        """Return the sums less those of some of their campaigns."""
        return Sums(self.precision - other.precision, self.score - other.score, self.left - other.left)

    @property
    def size(self) -> int:
        """Return k."""
        return len(self.score) // 2

    def evidences(self, places: IntArray) -> FloatArray:
        """Return log evidences, shape (...), of parameters that are normal with their prior scale.

        `places`, shape (..., d), are the rows of each hypothesis.
        """
        precision = np.eye(places.shape[-1]) + self.precision[places[..., :, None], places[..., None, :]]
        score = self.score[places]
        gained = (score * np.linalg.solve(precision, score[..., None])[..., 0]).sum(axis=-1)
        found: FloatArray = self.left + 0.5 * gained - 0.5 * np.linalg.slogdet(precision)[1]
        return found

    def fit(self, places: Sequence[int], prior: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Return mean, shape (d,), and covariance, shape (d, d), of the parameters in some rows.

        The prior precision is in units of their scales.
        """
        at = np.array(places, np.intp)
        covariance: FloatArray = np.asarray(np.linalg.inv(prior * np.eye(at.size) + self.precision[np.ix_(at, at)]))
        return covariance @ self.score[at], covariance

    def design(self, places: Sequence[int], time: float) -> FloatArray:
        """Return what the parameters in some rows are at a time, shape (k, d)."""
        both = np.concatenate([np.eye(self.size), time * np.eye(self.size)], axis=1)
        found: FloatArray = both[:, list(places)]
        return found
