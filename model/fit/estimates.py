"""From a converged fit to its parameters: intervals, correlations, and notes of what is not separable."""

from __future__ import annotations

from math import sqrt

import numpy as np
import scipy

from daq import BoolArray, FloatArray, Note
from model.fit.covariance import covariance
from model.fit.gauss_newton import GaussNewtonResult
from model.fit.intervals import Blocks, Sandwich, profile_of_sum, sandwich
from model.fit.problem import FitProblem, Free
from model.fit.result import Estimate
from model.notes import FitCode

SUM_OF = ("m1", "m2")
"""Lyasko's coefficients, of which only the sum p is determined."""


def spread_of(problem: FitProblem, x: FloatArray, result: GaussNewtonResult, blocks: Blocks) -> Sandwich:
    """Return the block sandwich: NaN for a parameter that a bound holds, infinite for one that is not determined."""
    undetermined = ~np.isfinite(result.covariance.diagonal()) & ~result.at_bound
    free = ~result.at_bound & ~undetermined
    covariance, naive = (np.full(result.covariance.shape, np.nan) for _ in range(2))
    covariance[undetermined, undetermined] = np.inf
    if not free.any():
        return Sandwich(covariance, naive, 1.0)
    found = _of(problem, x, blocks, free)
    inner = np.ix_(free, free)
    covariance[inner], naive[inner] = found.covariance, found.naive
    return Sandwich(covariance, naive, found.degrees)


def _of(problem: FitProblem, x: FloatArray, blocks: Blocks, chosen: BoolArray) -> Sandwich:
    sensitivities, scores = problem.sensitivities_and_scores(x)
    scores = scores - scores.mean(axis=0)  # zero at a minimum already, but not where a bound holds
    prior = problem.prior_information()[np.ix_(chosen, chosen)]
    return sandwich(sensitivities[:, :, chosen], scores[:, chosen], blocks, prior)


def estimates_of(
    problem: FitProblem, x: FloatArray, result: GaussNewtonResult, found: Sandwich, blocks: Blocks, confidence: float
) -> tuple[Estimate, ...]:
    """Return the parameters with their intervals, and p = m1 + m2 where both are fitted.

    An interval ends at the parameter's bounds. One that a bound holds has the bound and a limit on the other side.
    """
    t = float(scipy.special.stdtrit(found.degrees, 0.5 + 0.5 * confidence))
    estimates = []
    for i, parameter in enumerate(problem.free):
        if result.at_bound[i]:
            estimates.append(_held(problem, x, i, blocks, t))
        else:
            estimates.append(_free(parameter, float(x[i]), float(found.covariance[i, i]), t))
    if set(SUM_OF) <= set(problem.names):
        estimates.append(_sum(problem, x, found, t))
    return tuple(estimates)


def _free(parameter: Free, value: float, variance: float, t: float) -> Estimate:
    sigma = sqrt(variance) if variance >= 0 else float("nan")
    interval = (max(value - t * sigma, parameter.lower), min(value + t * sigma, parameter.upper))
    return Estimate(parameter.name, parameter.unit, value, sigma, interval)


def _held(problem: FitProblem, x: FloatArray, i: int, blocks: Blocks, t: float) -> Estimate:
    """Return a held parameter: how far from its bound it might still be, the others as they are."""
    parameter, value = problem.free[i], float(x[i])
    alone = np.arange(len(x)) == i
    sigma = sqrt(float(_of(problem, x, blocks, alone).covariance[0, 0]))
    at_lower = value - parameter.lower <= parameter.upper - value
    interval = (value, min(value + t * sigma, parameter.upper))
    if not at_lower:
        interval = (max(value - t * sigma, parameter.lower), value)
    return Estimate(parameter.name, parameter.unit, value, float("nan"), interval, at_bound=True)


def _sum(problem: FitProblem, x: FloatArray, found: Sandwich, t: float) -> Estimate:
    """Return p = m1 + m2 with its profile interval: singly they are not separable, and the valley is curved."""
    pair = [problem.names.index(m) for m in SUM_OF]
    total = float(x[pair].sum())
    free = np.isfinite(np.diag(found.covariance))
    rows = [k for k in pair if free[k]]
    if not rows:  # both are held, or neither is determined: their sum says nothing of the soil
        return Estimate("p", "1", total, np.nan, (np.nan, np.nan), derived=True, at_bound=True)
    variance, expected = (float(matrix[np.ix_(rows, rows)].sum()) for matrix in (found.covariance, found.naive))
    allowed = t**2 * (variance / expected if expected > 0 else 1.0)
    interval = profile_of_sum(problem, x, (pair[0], pair[1]), allowed)
    return Estimate("p", "1", total, sqrt(max(variance, 0.0)), interval, derived=True)


def correlations(names: tuple[str, ...], matrix: FloatArray) -> dict[tuple[str, str], float]:
    """Return each pair's correlation once."""
    sigma = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore"):
        return {
            (names[i], names[j]): float(matrix[i, j] / (sigma[i] * sigma[j]))
            for i in range(len(names))
            for j in range(i + 1, len(names))
        }


def warnings_of(
    problem: FitProblem, result: GaussNewtonResult, found: Sandwich, estimates: tuple[Estimate, ...]
) -> tuple[Note, ...]:
    """Return what a reader must know before the numbers, with the numbers that the table shows."""
    notes = []
    if not result.converged:
        notes.append(Note(FitCode.NOT_CONVERGED, values={"stop_reason": str(result.stop_reason)}))
    notes += [
        Note(FitCode.HELD_BY_BOUND, values={"names": (e.name,), "value": e.value})
        for e in estimates
        if e.at_bound and not e.derived
    ]
    notes += [Note(FitCode.SUM_NEGATIVE, values={"value": e.value}) for e in estimates if e.name == "p" and e.value < 0]
    return (*notes, *_inseparable(problem.names, result, found.covariance))


def _inseparable(names: tuple[str, ...], result: GaussNewtonResult, matrix: FloatArray) -> tuple[Note, ...]:
    """List the parameters that are not separable, by the covariance that the intervals are from."""
    free = np.isfinite(np.diag(matrix))
    if not free.all() and not result.at_bound.all() and bool((~free & ~result.at_bound).any()):
        return result.warnings  # some are not determined at all: Gauss-Newton names them
    if free.sum() < 2:
        return ()
    inner = matrix[np.ix_(free, free)]
    size = np.sqrt(np.diag(inner))
    try:
        root = np.linalg.cholesky(np.linalg.inv(inner / np.outer(size, size)))
    except np.linalg.LinAlgError:
        return result.warnings
    return covariance(root.T / size, names=[n for n, f in zip(names, free, strict=True) if f]).warnings
