"""What further data would do to explanations that are still open, and which further data are best."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from daq import FloatArray
from model.diagnosis.core.result import NextRun

PARTS = 2.0
"""Expected nats, whichever of both is the cause, from which on data are said to part two members: odds of 7 to 1."""
WORTH_SAYING = 0.05
"""Expected nats below which further data are not proposed."""
_LEAST_WEIGHT = 1e-9


def expected_nats(nats: FloatArray, probabilities: Sequence[float]) -> float:
    """Return the expected log Bayes factor of the true member over the rest, averaged over which is true.

    Parameters
    ----------
    nats : array, shape (members, members)
        What the data add to the expected log Bayes factor of the row's member, if it is true, over the column's.
    probabilities : sequence of float
        Weights; need not sum to 1.
    """
    weights = np.maximum(probabilities, _LEAST_WEIGHT)
    weights = weights / weights.sum()
    gained = [against_rest(nats[i], weights, i) for i in range(len(weights))] if len(weights) > 1 else [0.0]
    return float(weights @ gained)


def comes_apart(nats: FloatArray) -> list[bool]:
    """Return which members come apart from at least one other; see `expected_nats`."""
    found: list[bool] = np.any(0.5 * (nats + nats.T) >= PARTS, axis=1).tolist()
    return found


def against_rest(nats: FloatArray, weights: FloatArray, i: int) -> float:
    """Return the expected log Bayes factor of member i against all others together.

    Parameters
    ----------
    nats : array, shape (members,)
        Against each.
    weights : array, shape (members,)
        Probabilities.
    """
    rest = np.arange(len(weights)) != i
    share = weights[rest] / weights[rest].sum()
    least = float(nats[rest].min())
    return least - float(np.log(share @ np.exp(least - nats[rest])))


def best_first(runs: Iterable[NextRun]) -> list[NextRun]:
    """Return runs or tests by what they are expected to tell."""
    return sorted(runs, key=lambda run: -run.expected_log_bayes_factor)
