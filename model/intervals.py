r"""Covariance of an estimate from correlated samples: block sandwich.

Least squares with weights gives :math:`\hat\beta - \beta \approx H^{-1} \sum_i g_i` with
:math:`g_i = w_i J_i' e_i`. The :math:`g_i` of neighbouring samples are correlated - the filter, coloured transducer
noise and the speed error, which enters every channel through the slip, all see to that. They are summed over blocks
several correlation times long; block sums are as good as independent, so that
:math:`\mathrm{cov} = H^{-1} \left(\sum_b G_b G_b'\right) H^{-1}` (`sandwich`: with its corrections for few blocks).
No parametric model of the noise is needed; that the slip is measured is in it because its error is in the residual.

Source: Cameron & Miller (2015), J. Human Resources 50:317 (cluster-robust inference); Carlstein (1986), Ann. Stat. 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_HOLLOW = 1e3
"""Condition above which a block holds all that is known of a direction: nothing is left to correct it by."""
MIN_BLOCKS = 12
"""As many blocks as the shortest usable record gives, so that t does not explode."""
_LONGEST_S = 8.0
_SHORTEST_S = 0.5
_CORRELATION_TIMES = 6.0


@dataclass(frozen=True)
class Blocks:
    """Samples grouped into blocks that are as good as independent.

    Attributes
    ----------
    label : int array, shape (n,)
        Block of each sample, 0 to count - 1.
    count : int
    length_s : float
        Of a block; NaN for independent rows.
    correlation_time_s : float
        Integral of the residual's autocorrelation, both sides; NaN for independent rows.
    """

    label: NDArray[np.intp]
    count: int
    length_s: float
    correlation_time_s: float


def correlation_time(residual: FloatArray, time_s: FloatArray, run: NDArray[np.intp]) -> float:
    """Return the integrated autocorrelation time of a residual in seconds.

    Pairs of samples are taken within runs by their time difference, so that gaps (braking in between) do no harm.
    The sum stops at the first lag where the autocorrelation falls below 0.05.
    """
    step = _spacing(time_s, run)
    centred = residual - np.mean(residual)
    power = float(np.mean(centred**2))
    if not power > 0 or not np.isfinite(step):
        return 0.0
    grids = [_on_grid(centred[run == r], time_s[run == r], step) for r in np.unique(run)]
    total, lag = 1.0, 1
    while lag * step < _LONGEST_S:
        products = np.concatenate([g[:-lag] * g[lag:] for g in grids])
        products = products[np.isfinite(products)]
        rho = float(np.mean(products)) / power if len(products) > 10 else 0.0
        if rho < 0.05:
            break
        total += 2.0 * rho
        lag += 1
    return total * step


def _on_grid(values: FloatArray, time_s: FloatArray, step: float) -> FloatArray:
    """Return the values on a regular grid, NaN where there is no sample."""
    index = np.round((time_s - time_s[0]) / step).astype(np.intp)
    grid = np.full(int(index[-1]) + 1, np.nan)
    grid[index] = values
    return grid


def _spacing(time_s: FloatArray, run: NDArray[np.intp]) -> float:
    step = np.diff(time_s)[np.diff(run) == 0]
    step = step[step > 0]
    return float(np.median(step)) if len(step) else float("nan")


def blocks_of(residual: FloatArray, time_s: FloatArray, run: NDArray[np.intp], independent: bool) -> Blocks:
    """Group samples: rows of a table singly, a time series in blocks of six correlation times."""
    if independent:
        return Blocks(np.arange(len(residual)), len(residual), float("nan"), float("nan"))
    tau = correlation_time(residual, time_s, run)
    span = len(residual) * _spacing(time_s, run)
    longest = max(span / MIN_BLOCKS, _SHORTEST_S) if np.isfinite(span) else _SHORTEST_S
    length = float(np.clip(_CORRELATION_TIMES * tau, _SHORTEST_S, min(longest, _LONGEST_S)))
    key = np.stack([run, np.floor(_driven_time(time_s, run) / length).astype(np.intp)], axis=1)
    label = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    return Blocks(label, int(label.max()) + 1 if len(label) else 0, length, tau)


def _driven_time(time_s: FloatArray, run: NDArray[np.intp]) -> FloatArray:
    """Return time counted over the samples that are there, so that blocks hold about equally many."""
    step = _spacing(time_s, run)
    counted = np.zeros(len(time_s))
    for r in np.unique(run):
        rows = run == r
        counted[rows] = np.arange(int(rows.sum())) * step
    return counted


@dataclass(frozen=True)
class Sandwich:
    """How far an estimate of p parameters may be off.

    Attributes
    ----------
    covariance : array, shape (p, p)
    naive : array, shape (p, p)
        H^-1: what the covariance would be if whitened samples were independent.
    degrees : float
        Of freedom, for Student's t.
    """

    covariance: FloatArray
    naive: FloatArray
    degrees: float


def sandwich(jacobian: FloatArray, scores: FloatArray, blocks: Blocks, prior: FloatArray | None = None) -> Sandwich:
    """Return the block-sandwich covariance with the jackknife's correction for leverage.

    A block that holds much of the information pulls the fit towards itself, so that its residual is too small:
    its summed score is multiplied by (I - H_b H^-1)^-1. Few blocks with much of the information leave few degrees of
    freedom, 1/sum(h_b^2) - 1 with h_b the block's share of the information.

    Parameters
    ----------
    jacobian : array, shape (n, c, p)
        Whitened sensitivities of each sample's c channels.
    scores : array, shape (n, p)
        w_i J_i' e_i.
    blocks : Blocks
    prior : array, shape (p, p), optional
        Information of a prior: part of H, and of what varies.

    Source
    ------
    Bell & McCaffrey (2002), Survey Methodology 28:169 (leverage, degrees of freedom).
    """
    p = scores.shape[1]
    known = np.zeros((p, p)) if prior is None else prior
    rows = jacobian.reshape(-1, p)
    bread = rows.T @ rows + known
    size = np.sqrt(np.diag(bread))
    size[size == 0] = 1.0  # parameters differ by powers of ten in size: everything below is in units of their own sigma
    unit = np.outer(size, size)
    jacobian, scores = jacobian / size, scores / size
    inverse = _inverse(bread / unit)
    meat = known / unit
    shares = []
    for block in np.split(np.argsort(blocks.label, kind="stable"), np.cumsum(np.bincount(blocks.label))[:-1]):
        part = jacobian[block].reshape(-1, p)
        information = part.T @ part @ inverse
        score = scores[block].sum(axis=0)
        keep = np.eye(p) - information
        if np.linalg.cond(keep) < _HOLLOW:
            score = np.linalg.solve(keep, score)
        meat = meat + np.outer(score, score)
        shares.append(float(np.trace(information)) / p)
    held = float(np.sum(np.square(shares)))
    degrees = max(1.0 / held - 1.0, 1.0) if held > 0 else 1.0
    return Sandwich(inverse @ meat @ inverse / unit, inverse / unit, degrees)


def _inverse(matrix: FloatArray) -> FloatArray:
    """Invert an information matrix; a direction without information gets a huge variance, never none."""
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, np.finfo(float).eps * max(float(values[-1]), 1e-300))
    return np.asarray((vectors / values) @ vectors.T)
