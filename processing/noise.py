r"""One-sigma of one filtered sample, from the declared sigma, the data, or both.

Of white noise of density S the filter lets through S B, with B its `white_noise_bandwidth`; slow noise (a receiver's
own filter, wheel-order ripple, quantisation of a quiet signal) passes whole. A declared sigma d is of one raw sample
and holds both. The data show the white part w: by what the filter takes out and by what differs from one raw sample to
the next, whichever is less (the first holds signal beyond the cut-off, too); the rest is slow. With the sampling
interval D:

.. math:: \sigma_f^2 = \min(d, w)^2 D B + \max(d^2 - 1.2 w^2, 0)

(w is known to some ten percent only: without the 1.2 white noise would seem to have a slow part.) Where no sigma is
declared, d is the larger of w and q/sqrt(12) of the resolution q. Slow noise cannot be told from signal then, but at
standstill there is no signal: what a force still does there is a lower bound.
"""

from __future__ import annotations

from math import isfinite, nan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from processing.collect import Samples
from processing.filters import white_noise_bandwidth
from processing.processed_run import Segment
from processing.robust import robust_spread
from processing.segments import runs_of
from processing.timebase import FloatArray

_LEAST_STANDSTILL_SAMPLES = 10
_LEAST_SAMPLES = 20
_MARGIN = 1.2


def filtered_sigma(
    samples: Samples, residuals: FloatArray, kernel_sigma_s: float, declared: float | None
) -> tuple[float, str]:
    """Return the one-sigma of one filtered sample and where it is from.

    Parameters
    ----------
    samples : Samples
    residuals : float64 array
        Samples (thinned as they are) less the filtered signal at their instants; NaN is left out.
    kernel_sigma_s : float
    declared : float or None
        One-sigma of one raw sample.

    Returns
    -------
    sigma : float
        NaN where nothing is declared and there are too few samples.
    source : str
        ``"declared"`` or ``"estimated"``.
    """
    source = "estimated" if declared is None else "declared"
    interval_s = samples.interval_s
    if not isfinite(interval_s):
        return (nan if declared is None else declared), source
    white = _white_variance(samples, residuals, kernel_sigma_s)
    if declared is None:
        if not isfinite(white) and not samples.step:
            return nan, source
        white = white if isfinite(white) else 0.0
        total = max(white, samples.step**2 / 12)
    else:
        total = declared**2
        white = samples.rough**2 if samples.node_s else min(white, samples.rough**2)
        white = min(white, total) if isfinite(white) else total
    passed = white * min(interval_s * white_noise_bandwidth(kernel_sigma_s), 1.0)
    return sqrt(passed + max(total - _MARGIN * white, 0.0)), source


def standstill_sigma(values: FloatArray, segments: NDArray[np.uint8], rate_hz: float, cutoff_hz: float) -> float:
    """Return the robust spread of a filtered signal about its median of each standstill; NaN with too few samples.

    Robust, because torque builds up before the wheel moves and fades after it has stopped.

    Parameters
    ----------
    values : float64 array, shape (n,)
    segments : uint8 array, shape (n,)
        See `Segment`.
    rate_hz, cutoff_hz : float
        The filter leaves about 2.5 cutoff_hz independent samples a second.
    """
    parts = [values[start:stop] for start, stop in runs_of(segments) if segments[start] == Segment.STANDSTILL]
    parts = [part[np.isfinite(part)] for part in parts]
    apart = np.concatenate([np.zeros(0), *(part - np.median(part) for part in parts if len(part))])
    if len(apart) * 2.5 * cutoff_hz / rate_hz < _LEAST_STANDSTILL_SAMPLES:
        return nan
    return robust_spread(apart)


def _white_variance(samples: Samples, residuals: FloatArray, kernel_sigma_s: float) -> float:
    """Return the variance w^2 of a raw sample whose white noise would leave these residuals.

    Their variance is w^2 D times the integral of |N(f) - H(f)|^2, with N of the thinning and H of the filter.
    """
    residuals = residuals[np.isfinite(residuals)]
    if len(residuals) < _LEAST_SAMPLES:
        return nan
    spread = robust_spread(residuals - np.median(residuals))
    raw = 2 / (3 * samples.node_s) if samples.node_s else 1 / samples.interval_s
    peak = 1 / (sqrt(2 * pi) * kernel_sigma_s)
    density = spread**2 / max(raw - 2 * peak + white_noise_bandwidth(kernel_sigma_s), 0.1 * raw)
    return density / samples.interval_s
