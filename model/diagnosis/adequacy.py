r"""Whether soil and causes leave more than noise: what the catch-all shapes still explain.

With soil and the set's causes integrated out, the shapes' coefficients have score v and information K, and

.. math:: T = v'(I + K)^{-1}v, \qquad T \sim \sum_i w_i \chi^2_1, \quad w_i = \lambda_i/(1 + \lambda_i)

if the noise model holds, with :math:`\lambda_i` the eigenvalues of K: a shape that the data can hardly show counts for
little. The statistic is T over its expected value. Its threshold is a quantile of that distribution, drawn for the
campaign at hand, times what a noise model that was itself estimated is off by (`SLACK`, from campaigns of a generator
that shares no numerics with this engine: sixteen without a cause had statistics of .97 to 2.10, mean 1.53), and what a
formula may be off by that is right in kind (`FORM`, of all that the causes explain).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.grams import Grams
from model.diagnosis.result import Adequacy

FloatArray = NDArray[np.float64]

LEVEL = 0.995
"""Quantile of the statistic where the noise model is exact."""
SLACK = 1.7
"""Factor on that quantile."""
FORM = 0.15
"""Share of its size by which a cause's formula may miss nature's."""
_DRAWS = 2000


@dataclass(frozen=True)
class LeftOver:
    """What the catch-all shapes see once soil and a set of causes are integrated out.

    Attributes
    ----------
    misfit : float
        r'Pr: whitened residual, whose expected value is the number of samples.
    score : array, shape (b,)
    information : array, shape (b, b)
    """

    misfit: float
    score: FloatArray
    information: FloatArray


def left_over(grams: Grams, keys: tuple[str, ...] = ()) -> LeftOver:
    """Integrate soil and a set of causes out of the catch-all's cross products."""
    total = grams.total()
    out = np.r_[grams.soil_columns, [p for key in keys for p in grams.columns_of(key)]].astype(np.intp)
    kept = np.r_[0, grams.basis_columns]
    across = total[np.ix_(out, kept)]
    inner = total[np.ix_(out, out)] + np.eye(out.size)
    found = total[np.ix_(kept, kept)] - across.T @ np.linalg.solve(inner, across)
    return LeftOver(float(found[0, 0]), found[1:, 0], found[1:, 1:])


def adequacy(grams: Grams, keys: tuple[str, ...], rng: np.random.Generator) -> Adequacy:
    """Judge whether a set of causes is an explanation.

    Parameters
    ----------
    grams : Grams
    keys : tuple of str
        Of the set's effects.
    rng : Generator
        For the threshold.
    """
    left = left_over(grams, keys)
    if not left.score.size:
        return Adequacy(0.0, SLACK, ok=True)
    values, vectors = np.linalg.eigh(left.information)
    values = np.maximum(values, 0.0)
    weights = values / (1.0 + values)
    expected = max(float(weights.sum()), 1e-9)
    along = vectors.T @ left.score
    statistic = float((along**2 / (1.0 + values)).sum()) / expected
    drawn = rng.chisquare(1.0, (_DRAWS, weights.size)) @ weights / expected
    threshold = SLACK * float(np.quantile(drawn, LEVEL))
    if keys:
        explained = max(left_over(grams).misfit - left.misfit, 0.0)
        threshold += FORM**2 * explained / expected
    return Adequacy(statistic, threshold, ok=statistic <= threshold)


def excess(judged: Adequacy) -> float:
    """Return the factor on the noise's variance that the left-over asks for, where it is still taken as noise.

    A noise model that is a little too small shows in the catch-all, and would make every probability too sure of
    itself: the evidence is taken with a variance that is larger by this (Birge's ratio).
    """
    return float(np.clip(judged.statistic, 1.0, judged.threshold))
