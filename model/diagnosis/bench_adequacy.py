r"""Whether a hypothesis is right enough to be weighed at all: a gate that stands before all probabilities.

A probability compares explanations with each other; the best of bad ones gets a high one too. So each is first
compared with what a right model leaves: with the scatter of repeats and the error of form that a right model may have
(`model.diagnosis.bench_noise.FORM_PER_SCATTER`), both fixed, the least

.. math:: Q = \sum_{channels, groups} \frac{\bar e^2}{\sigma^2/m + a^2} + |v|^2

over the coordinates v (soil and causes, standard normal beforehand) is chi-squared with as many degrees of freedom as
there are group means, if the hypothesis is true. The threshold is the 99 % point of simulated Q, in which the scatter
is estimated from as few repeats as in the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_noise import ChannelNoise, scatter_of_repeats
from model.diagnosis.bench_problem import BenchProblem
from model.diagnosis.bench_search import Optimum, search

FloatArray = NDArray[np.float64]

_LEVEL = 0.99
_SIMULATIONS = 20_000


def misfits(problem: BenchProblem, optima: Sequence[Optimum], rows: FloatArray | None = None) -> FloatArray:
    """Return Q of hypotheses, each searched for from where it fits best otherwise.

    Parameters
    ----------
    problem : BenchProblem
    optima : sequence of Optimum
    rows : array, shape (n,), optional
        1 for rows that count, 0 for rows that are left out.
    """
    fixed = with_usual_form(problem)
    found = search(fixed, [o.hypothesis for o in optima], [o.standard for o in optima], rows)
    return np.array([_misfit(fixed, optimum, rows) for optimum in found])


def with_usual_form(problem: BenchProblem) -> BenchProblem:
    """Return the problem with fixed noise: the scatter of repeats, and the error of form of a right model."""
    return replace(problem, noises=tuple(_fixed(noise) for noise in problem.noises))


def threshold(problem: BenchProblem, rng: np.random.Generator, rows: FloatArray | None = None) -> float:
    """Return the Q above which a hypothesis is not right enough."""
    total: FloatArray = np.zeros(_SIMULATIONS)
    for noise, chosen in zip(problem.noises, problem.rows, strict=True):
        counted = np.ones(len(chosen)) if rows is None else rows[chosen]
        size = noise.members.T @ counted
        size = size[size > 0]
        variance, freedom = _scatter(noise) ** 2, int((size - 1).sum())
        seen = variance * (
            rng.chisquare(freedom, _SIMULATIONS) / freedom if freedom and len(noise.scatter) > 1 else 1.0
        )
        true = variance / size + noise.form_scale**2
        said = np.reshape(seen, (-1, 1)) / size + noise.form_scale**2
        total += (rng.standard_normal((_SIMULATIONS, len(size))) ** 2 * true / said).sum(axis=1)
    return float(np.quantile(total, _LEVEL))


def _scatter(noise: ChannelNoise) -> float:
    known = len(np.unique(noise.scatter)) == 1
    return float(noise.scatter[0]) if known else scatter_of_repeats(noise.measured, noise.groups)


def _fixed(noise: ChannelNoise) -> ChannelNoise:
    scatter = max(_scatter(noise), 1e-3 * noise.form_scale)
    return replace(noise, scatter=np.array([scatter]), form=np.array([noise.form_scale]), log_weight=np.zeros(1))


def _misfit(fixed: BenchProblem, optimum: Optimum, rows: FloatArray | None) -> float:
    if not np.isfinite(optimum.log_likelihood):
        return np.inf
    total = float(optimum.standard @ optimum.standard)
    for noise, chosen in zip(fixed.noises, fixed.rows, strict=True):
        counted = np.ones(len(chosen)) if rows is None else rows[chosen]
        error = (noise.measured - optimum.said[noise.channel][chosen]) * counted
        size = noise.members.T @ counted
        there = size > 0
        mean = (noise.members.T @ error)[there] / size[there]
        total += float((mean**2 / (noise.scatter[0] ** 2 / size[there] + noise.form[0] ** 2)).sum())
    return total
