r"""Whitening of many columns at once by a Kalman filter, linear in the number of samples.

The noise of a run is a sum of independent first-order Markov processes seen through known loadings, and white noise:

.. math:: y_{ic} = \sum_s h_{ics} x_{is} + w_{ic}, \qquad
          x_{is} = a_{is} x_{i-1,s} + \sqrt{1 - a_{is}^2}\, \sigma_s u_{is},

stationary from the start. The filter's innovations over their deviations are independent and of unit variance, and they
are a linear map of the data: applied to residual and columns alike it is multiplication by the inverse Cholesky factor
of the covariance, to rounding. Channels are taken one after the other within a sample, so that no matrix is inverted.
Runs are a leading axis. Runs of different length are padded; what is not there has no loading, unit white noise and
zeros in every column, and so counts for nothing.

Source: Durbin & Koopman (2012), Time Series Analysis by State Space Methods, 4.3, 4.4 and 6.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StateSpace:
    """Noise of R runs of up to N samples in C channels by S processes.

    Attributes
    ----------
    loadings : array, shape (R, N, C, S)
        Zero where a channel is missing.
    decay : array, shape (R, N, S)
        a of the step to a sample from the one before; of the first sample it does not matter.
    variance : array, shape (S,)
        Stationary variances.
    white : array, shape (R, N, C)
        Variances of the white noise; 1 where a channel is missing.
    """

    loadings: FloatArray
    decay: FloatArray
    variance: FloatArray
    white: FloatArray


@dataclass(frozen=True)
class Whitened:
    """Columns of shape (R, N C, M) with independent noise of unit variance, and ln det of each run's covariance."""

    columns: FloatArray
    log_determinants: FloatArray


def whiten(space: StateSpace, columns: FloatArray) -> Whitened:
    """Whiten columns.

    Parameters
    ----------
    space : StateSpace
    columns : array, shape (R, N, C, M)
        Zero where a channel is missing.
    """
    runs, count, channels, width = columns.shape
    states = len(space.variance)
    stationary = np.diag(space.variance)
    covariance = np.repeat(stationary[None], runs, axis=0)
    state = np.zeros((runs, states, width))
    out = np.zeros_like(columns)
    log_determinants = np.zeros(runs)
    for i in range(count):
        a = space.decay[:, i]
        state = state * a[:, :, None]
        if i:
            covariance = _ahead(covariance, stationary, a)
        for c in range(channels):
            h = space.loadings[:, i, c]
            seen = (covariance @ h[:, :, None])[..., 0]
            variance = (seen * h).sum(axis=-1) + space.white[:, i, c]
            gain = seen / variance[:, None]
            innovation = columns[:, i, c] - (h[:, None, :] @ state)[:, 0]
            state = state + gain[:, :, None] * innovation[:, None, :]
            covariance = covariance - gain[:, :, None] * seen[:, None, :]
            out[:, i, c] = innovation / np.sqrt(variance)[:, None]
            log_determinants += np.log(variance)
    return Whitened(out.reshape(runs, count * channels, width), log_determinants)


def smoothed(space: StateSpace, data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the processes' means given all the data of a run, and their covariances.

    Parameters
    ----------
    space : StateSpace
    data : array, shape (R, N, C)
        Zero where a channel is missing.

    Returns
    -------
    means : array, shape (R, N, S)
    covariances : array, shape (R, N, S, S)

    Notes
    -----
    The fixed-interval smoother of Rauch, Tung & Striebel (1965).
    """
    runs, count, channels = data.shape
    states = len(space.variance)
    stationary = np.diag(space.variance)
    mean, covariance = np.zeros((runs, states)), np.repeat(stationary[None], runs, axis=0)
    means, covariances = np.zeros((count, runs, states)), np.zeros((count, runs, states, states))
    for i in range(count):
        if i:
            mean = space.decay[:, i] * mean
            covariance = _ahead(covariance, stationary, space.decay[:, i])
        for c in range(channels):
            h = space.loadings[:, i, c]
            seen = (covariance @ h[:, :, None])[..., 0]
            gain = seen / ((seen * h).sum(axis=-1) + space.white[:, i, c])[:, None]
            mean = mean + gain * (data[:, i, c] - (h * mean).sum(axis=-1))[:, None]
            covariance = covariance - gain[:, :, None] * seen[:, None, :]
        means[i], covariances[i] = mean, covariance
    for i in range(count - 2, -1, -1):
        a = space.decay[:, i + 1]
        ahead = _ahead(covariances[i], stationary, a)
        back = np.linalg.solve(ahead, a[:, :, None] * covariances[i]).swapaxes(1, 2)
        means[i] += (back @ (means[i + 1] - a * means[i])[..., None])[..., 0]
        covariances[i] += back @ (covariances[i + 1] - ahead) @ back.swapaxes(1, 2)
    return means.swapaxes(0, 1), covariances.swapaxes(0, 1)


def _ahead(covariance: FloatArray, stationary: FloatArray, decay: FloatArray) -> FloatArray:
    """Return the states' covariance one sample later."""
    return np.asarray(stationary + (covariance - stationary) * (decay[:, :, None] * decay[:, None, :]))
