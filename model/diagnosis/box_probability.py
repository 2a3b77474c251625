r"""Probability that a normal vector lies in a box: what bounds and one-sided priors do to an evidence.

One coordinate after the other is cut to its interval; the others are then taken as normal again, with the mean and
covariance that the cut leaves them. For one coordinate this is exact; for several it is an approximation whose error
in the logarithm is a few hundredths where the box holds much of the mass, and some tenths far out
(`tests/model/test_evidence_box.py` holds it against sampling).

Source: Mendell & Elston (1974), Biometrics 30:41; Joe (1995), J. Am. Stat. Assoc. 90:957.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

FloatArray = NDArray[np.float64]

_LOG_SQRT_2PI = 0.5 * float(np.log(2.0 * np.pi))
_FAR = 30.0


def log_box_probability(mean: FloatArray, covariance: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the log probability of a box.

    Parameters
    ----------
    mean : array, shape (m, ...)
    covariance : array, shape (m, m, ...)
    lower, upper : array, shape (m, ...)
        Bounds, infinite where there is none.
    """
    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(mean.shape[1:])
    for i in range(len(mean)):
        sigma = np.sqrt(covariance[i, i])
        a, b = (lower[i] - mean[i]) / sigma, (upper[i] - mean[i]) / sigma
        log_p, shift, variance = _interval(a, b)
        total += log_p
        gain = covariance[i, i + 1 :] / sigma
        mean[i + 1 :] += gain * shift
        covariance[i + 1 :, i + 1 :] -= gain[:, None] * gain[None, :] * (1.0 - variance)
    return total


def log_interval_probability(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the log probability that a standard normal number lies between two bounds."""
    return _interval(np.asarray(lower, float), np.asarray(upper, float))[0]


def _interval(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the log probability of [a, b] under a standard normal, and mean and variance within."""
    flip = a > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    a, b = np.maximum(a, -_FAR * 100), np.minimum(b, _FAR)
    high, low = log_ndtr(b), log_ndtr(a)
    log_p = high + np.log1p(-np.exp(np.minimum(low - high, -1e-12)))
    at_a, at_b = (np.exp(-0.5 * x * x - _LOG_SQRT_2PI - log_p) for x in (a, b))
    mean = at_a - at_b
    variance = np.clip(1.0 + a * at_a - b * at_b - mean * mean, 1e-6, 1.0)
    return log_p, np.where(flip, -mean, mean), variance
