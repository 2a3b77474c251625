r"""Expected log Bayes factors: the smallest detectable size of every cause, and the worth of further data.

One parameter of information :math:`\lambda = x'Px` (soil integrated out) and size a has, if it is alone, the expected
log Bayes factor over nothing

.. math:: \tfrac12 \frac{a^2\lambda^2 + \lambda}{1 + \lambda} - \tfrac12\ln(1 + \lambda) + [\ln 2]

with ln 2 where it is one-sided. It is detected where that makes the odds against "none" as long as a name asks for.
Which family it is may still be open: `one_of`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from daq import FloatArray
from model.diagnosis.core.hypotheses import Hypotheses
from model.diagnosis.core.result import Detectable, NextRun

_LEAST_INFORMATION = 1e-6

PARTS = 2.0
"""Expected nats, whichever of both is the cause, from which on data are said to part two members: odds of 7 to 1."""
WORTH_SAYING = 0.05
"""Expected nats below which further data are not proposed."""
ENOUGH = 6.9
"""Expected nats from which on more tell no more, odds of 1000 to 1: beyond, not noise is the limit, but the models."""
_ALIKE = 0.8
"""Share of the expected nats of another step that tells as much."""
_LEAST_WEIGHT = 1e-9


@dataclass(frozen=True)
class Direction:
    """One parameter of an effect, and what the data say of it.

    Attributes
    ----------
    scale : float
        Prior one-sigma, with the sign of the plausible side.
    information : float
        On its coefficient, in units of the scale, with the soil integrated out.
    """

    parameter: str
    unit: str
    neutral: float
    scale: float
    one_sided: bool
    information: float


def minimum_detectable(
    listed: Hypotheses, directions: Mapping[str, Sequence[Direction]], name_at: float
) -> dict[str, Detectable]:
    """Return the smallest detectable size of every effect, by its key; the parameter that shows first.

    A size beyond the parameter's bounds says that nothing plausible would be seen. `listed` has every effect alone, for
    the prior; `name_at` is the probability asked for.
    """
    found = {}
    for key, own in directions.items():
        wanted = log(name_at / (1.0 - name_at)) + listed.log_prior[0] - listed.log_prior[listed.index_of((key,))]
        sizes = [(least_coefficient(d.information, d.one_sided, wanted), d) for d in own]
        coefficient, first = min(sizes, key=lambda pair: pair[0])
        found[key] = Detectable(first.parameter, first.neutral + coefficient * first.scale, first.unit)
    return found


def least_coefficient(information: float, one_sided: bool, wanted: float) -> float:
    """Return the coefficient whose expected log Bayes factor is `wanted` nats; infinite where nothing shows."""
    if information < _LEAST_INFORMATION:
        return float("inf")
    needed = wanted + 0.5 * log(1.0 + information) - (log(2.0) if one_sided else 0.0)
    square = (2.0 * needed * (1.0 + information) - information) / information**2
    return sqrt(max(square, 0.0))


def expected_nats(nats: FloatArray, probabilities: Sequence[float]) -> float:
    """Return the expected log Bayes factor of the true member over the rest, averaged over which is true.

    `nats`, shape (members, members), is what the data add to the expected log Bayes factor of the row's member, if it
    is true, over the column's. The probabilities are weights and need not sum to 1.
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

    `nats` is that against each, `weights` are their probabilities, shape (members,) both.
    """
    rest = np.arange(len(weights)) != i
    share = weights[rest] / weights[rest].sum()
    least = float(nats[rest].min())
    return least - float(np.log(share @ np.exp(least - nats[rest])))


def best_first(runs: Iterable[NextRun]) -> list[NextRun]:
    """Return runs or tests by what they are expected to tell; of those that tell as much the cheapest first.

    What they tell is the right name where one of them may well end in it, else what they part.
    """
    found: list[NextRun] = []
    left = list(runs)
    by_name = any(run.decides for run in left)

    def told(run: NextRun) -> float:
        return (run.naming_chance or 0.0) if by_name else min(run.expected_log_bayes_factor, ENOUGH)

    left.sort(key=lambda run: -told(run))
    while left:
        alike = [left[0], *(run for run in left[1:] if told(run) >= _ALIKE * told(left[0]))]
        found += sorted(alike, key=lambda run: (run.cost_runs, -run.expected_log_bayes_factor))
        left = left[len(alike) :]
    return found
