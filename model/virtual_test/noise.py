"""Noise of instruments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def coloured_noise(
    count: int, rate_hz: float, sigma: float, correlation_time_s: float, rng: np.random.Generator
) -> FloatArray:
    """Return a stationary Ornstein-Uhlenbeck process: autocorrelation sigma^2 exp(-|lag|/correlation time).

    Parameters
    ----------
    count : int
        Number of samples.
    rate_hz : float
        Samples per second.
    sigma : float
        Standard deviation, in the unit of the result.
    correlation_time_s : float
    rng : numpy.random.Generator
        Gives `count` normal numbers, whatever `sigma` is.
    """
    from scipy.signal import lfilter

    white = rng.standard_normal(count)
    memory = float(np.exp(-1.0 / (rate_hz * correlation_time_s)))
    white[1:] *= np.sqrt(1.0 - memory**2)
    return np.asarray(sigma * lfilter([1.0], [1.0, -memory], white), np.float64)
