r"""How far the final parameters may be off.

The noise model's own covariance :math:`H^{-1}` is too short: its hyper-parameters are estimated, runs differ by more
than it knows, and other sets of causes are possible. So each variance is put together from

- the model's, and the sandwich over runs :math:`H^{-1} (\sum_r g_r g_r' + I) H^{-1}`, which needs no noise model but
  has only as many degrees of freedom as there are runs. Each stands for as many observations as it has degrees: the
  model's for `TRUST`. The ratio of both to the model's never narrows an interval;
- what the estimate moves when each hyper-parameter moves by its own one-sigma;
- what it moves between the sets of causes that hold it, weighted by their probabilities.

The interval is Student's with the degrees of freedom of the first.

Source: Bell & McCaffrey (2002), Survey Methodology 28:169; Efron & Morris (1973), J. Am. Stat. Assoc. 68:117
(shrinkage); Kass & Steffey (1989), J. Am. Stat. Assoc. 84:717 (hyper-parameters); Hoeting et al. (1999), Stat. Sci.
14:382 (sets of causes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import estimate, posterior
from model.diagnosis.look import Look
from model.diagnosis.set_problem import SetProblem
from model.intervals import Blocks, sandwich

FloatArray = NDArray[np.float64]

TRUST = 20.0
"""Degrees of freedom that the noise model's own covariance stands for; see docs/decisions/diagnosis-intervals.md."""
CONFIDENCE = 0.95
_LEAST_SHARE = 0.01
"""Of the likeliest set's probability, below which a set is not asked."""
_MOST_SETS = 40


@dataclass(frozen=True)
class Spread:
    """Spread of the p numbers of a fitted set.

    Attributes
    ----------
    covariance : array, shape (p, p)
        Everything together.
    naive : array, shape (p, p)
        The noise model's own.
    robust : array, shape (p, p)
        Of the sandwich over runs.
    degrees : array, shape (p,)
        Of freedom.
    by_noise, by_choice : array, shape (p,)
        Variances for the hyper-parameters and for the choice of the set.
    """

    covariance: FloatArray
    naive: FloatArray
    robust: FloatArray
    degrees: FloatArray
    by_noise: FloatArray
    by_choice: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma of each, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def correlation(self, i: int, j: int) -> float:
        """Return the correlation of two of them by the noise model alone."""
        return float(self.naive[i, j] / np.sqrt(self.naive[i, i] * self.naive[j, j]))

    def along(self, direction: FloatArray) -> tuple[float, float, float]:
        """Return one-sigma of a combination, the noise model's own, and its degrees of freedom."""
        weight = direction != 0
        variance, naive = (float(direction @ x @ direction) for x in (self.covariance, self.naive))
        return float(np.sqrt(variance)), float(np.sqrt(naive)), float(self.degrees[weight].min())


def spread_of(problem: SetProblem, x: FloatArray, look: Look, keys: tuple[str, ...]) -> Spread:
    """Return the spread of a fitted set.

    Parameters
    ----------
    problem : SetProblem
        Whitened at the estimate.
    x : array, shape (p,)
        The estimate.
    look : Look
    keys : tuple of str
        Effects of the set.
    """
    count = len(x)
    if not count:
        nothing = np.zeros((0, 0))
        return Spread(nothing, nothing, nothing, np.zeros(0), np.zeros(0), np.zeros(0))
    rows = problem.runs(x)
    everything = np.concatenate(rows)
    run = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
    jacobian, scores = everything[:, 1:], everything[:, 1:] * everything[:, :1]
    found = sandwich(jacobian[:, None], scores, Blocks(run, len(rows), float("nan"), float("nan")), np.eye(count))
    degrees = max(min(found.degrees, len(rows) - 1.0), 0.0)
    share = degrees / (degrees + TRUST)
    both = (1.0 - share) * found.naive + share * found.covariance
    widening = np.maximum(np.sqrt(np.diag(both) / np.diag(found.naive)), 1.0)
    by_noise = ((problem.score_changes(x) @ found.naive) ** 2).sum(axis=0)
    by_choice = _by_choice(look, keys, count)
    combined = found.naive * np.outer(widening, widening)
    extra = np.sqrt(1.0 + (by_noise + by_choice) / np.diag(combined))
    return Spread(
        covariance=combined * np.outer(extra, extra),
        naive=found.naive,
        robust=found.covariance,
        degrees=np.full(count, degrees + TRUST),
        by_noise=by_noise,
        by_choice=by_choice,
    )


def interval(value: float, sigma: float, degrees: float) -> tuple[float, float]:
    """Return Student's 95 % interval."""
    from scipy.stats import t

    reach = float(t.ppf(0.5 + 0.5 * CONFIDENCE, degrees)) * sigma
    return value - reach, value + reach


def _by_choice(look: Look, keys: tuple[str, ...], count: int) -> FloatArray:
    """Return the variance of the set's coefficients between the sets that hold it, shape (p,); 0 for the soil."""
    total = np.zeros(count)
    if not keys:
        return total
    weighed = posterior(look.grams, look.excluded, look.most_causes)
    listed = weighed.hypotheses
    own = [listed.effects.index(key) for key in keys if key in listed.effects]
    holding = np.flatnonzero(listed.has_effect[:, own].all(axis=1))
    order = holding[np.argsort(-weighed.probability[holding])][:_MOST_SETS]
    order = order[weighed.probability[order] > _LEAST_SHARE * weighed.probability[order[0]]]
    alone = estimate(look.grams, keys)
    columns = list(alone.columns)
    sizes = np.array([estimate(look.grams, listed.keys_of(int(i))).coefficients[columns] for i in order])
    weights = weighed.probability[order] / weighed.probability[order].sum()
    total[count - len(columns) :] = weights @ (sizes - alone.coefficients[columns]) ** 2
    return total
