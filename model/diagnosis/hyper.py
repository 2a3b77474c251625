r"""Hyper-parameters of the noise by marginal likelihood.

The likelihood is that of the saturated model: soil, every cause and the catch-all are columns with their priors, so
that an effect which nobody has named yet does not pass for noise and hide itself. With V the covariance of a run's
noise, X the columns, :math:`A = I + \sum_{runs} X'V^{-1}X`, :math:`P = V^{-1} - V^{-1}XA^{-1}X'V^{-1}`:

.. math:: -2 \ln L = \ln\det V + \ln\det A + r'Pr, \qquad
          \frac{\partial}{\partial\theta}(-2 \ln L) = \mathrm{tr}(P \dot V) - r'P \dot V P r.

Maximised by scoring with the average information :math:`\tfrac12 r'P\dot V_i P \dot V_j P r`, in logarithms, with
log-normal beliefs. Covariances are formed in blocks of a run, so that the cost is linear in its length.

Source: Patterson & Thompson (1971), Biometrika 58:545; Gilmour, Thompson & Cullis (1995), Biometrics 51:1440.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.noise import Belief, Noise
from model.diagnosis.noise_blocks import Block, derivatives

FloatArray = NDArray[np.float64]

OF_FEW = ("_run_to_run", "_at_rest_n", "_at_rest_nm", "_of_run_n", "_of_run_nm", "_of_run_m")
"""Ends of the names of deviations that only as many values as there are runs or standstills tell of. Of them the root
mean square of what is likely is taken, not the likeliest, or else what differs from run to run is believed too firmly.
"""
_MOST_STEPS = 12
_LARGEST_STEP = 1.0
_ENOUGH = 0.05
"""Gain of log likelihood by a step, nats, that is not worth it."""


@dataclass(frozen=True)
class Found:
    """Minus the log posterior, its gradient and information by the logarithms of the hyper-parameters."""

    value: float
    gradient: FloatArray
    information: FloatArray


def estimated(
    blocks: Sequence[Block], beliefs: Mapping[str, Belief], start: Mapping[str, float] | None = None
) -> Noise:
    """Return the likeliest hyper-parameters; of those in `OF_FEW` the root mean square.

    Parameters
    ----------
    blocks : sequence of Block
    beliefs : mapping name -> Belief
        Of every hyper-parameter.
    start : mapping, optional
        Where to start; the beliefs' centres by default.
    """
    names = list(beliefs)
    centre = np.log([beliefs[name].centre for name in names])
    weight = np.array([beliefs[name].log_sigma for name in names]) ** -2.0
    at = np.log([start[name] for name in names]) if start else centre
    found = _posterior(blocks, names, at, centre, weight)
    damping = 0.0
    for _ in range(_MOST_STEPS):
        step = -np.linalg.solve(found.information + damping * np.diag(np.diag(found.information)), found.gradient)
        if -0.5 * float(step @ found.gradient) < _ENOUGH:
            break
        step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-300))
        tried = _posterior(blocks, names, at + step, centre, weight)
        if tried.value <= found.value:
            at, found, damping = at + step, tried, damping / 4.0
        else:
            damping = max(4.0 * damping, 0.5)
    spread = np.sqrt(np.diag(np.linalg.inv(found.information)))
    of_few = np.array([name.endswith(OF_FEW) for name in names])
    values = np.exp(at + np.where(of_few, spread**2, 0.0))
    return Noise(
        {name: float(x) for name, x in zip(names, values, strict=True)},
        {name: float(s) for name, s in zip(names, spread, strict=True)},
    )


def _posterior(
    blocks: Sequence[Block], names: list[str], at: FloatArray, centre: FloatArray, weight: FloatArray
) -> Found:
    values = {name: float(np.exp(x)) for name, x in zip(names, at, strict=True)}
    data = likelihood(blocks, values, names)
    off = at - centre
    return Found(
        data.value + 0.5 * float(weight @ off**2),
        data.gradient + weight * off,
        data.information + np.diag(weight),
    )


def likelihood(blocks: Sequence[Block], values: Mapping[str, float], names: list[str]) -> Found:
    """Return minus the log marginal likelihood, and its gradient and information by the logarithms of `names`."""
    width = blocks[0].columns.shape[1] if blocks else 1
    inner = np.eye(width - 1)
    side, square, log_determinant = np.zeros(width - 1), 0.0, 0.0
    parts = []
    for block in blocks:
        covariance, slopes = derivatives(block, values)
        inverse, own = _inverse(covariance)
        solved = inverse @ block.columns
        inner += block.columns[:, 1:].T @ solved[:, 1:]
        side += block.columns[:, 1:].T @ solved[:, 0]
        square += float(block.columns[:, 0] @ solved[:, 0])
        log_determinant += own
        parts.append((slopes, inverse, solved))
    root = np.linalg.cholesky(inner)
    best = np.linalg.solve(inner, side)
    back = np.linalg.inv(root).T
    place = {name: i for i, name in enumerate(names)}
    gradient, information = np.zeros(len(names)), np.zeros((len(names), len(names)))
    across = np.zeros((width - 1, len(names)))
    for slopes, inverse, solved in parts:
        left = solved[:, 0] - solved[:, 1:] @ best
        shared = solved[:, 1:] @ back
        moved = np.zeros((len(left), len(names)))
        for slope in slopes:
            moved[:, place[slope.name]] += slope.times(left)
        information += 0.5 * moved.T @ inverse @ moved
        across += solved[:, 1:].T @ moved
        inverse -= shared @ shared.T
        inverse -= np.outer(left, left)
        for slope in slopes:
            gradient[place[slope.name]] += 0.5 * slope.trace_with(inverse)
    information -= 0.5 * across.T @ np.linalg.solve(inner, across)
    value = 0.5 * (log_determinant + 2.0 * float(np.log(np.diag(root)).sum()) + square - float(side @ best))
    return Found(value, gradient, information)


def _inverse(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a covariance, and its log determinant."""
    from scipy.linalg.lapack import dpotrf, dpotri

    root, failed = dpotrf(covariance.T, lower=1)
    if failed:
        raise np.linalg.LinAlgError("a covariance of the noise is not positive definite")
    inverse, _ = dpotri(root, lower=1)
    lower = np.tril(inverse, -1)
    return lower + lower.T + np.diag(np.diag(inverse)), 2.0 * float(np.log(np.diag(root)).sum())
