r"""One-sigma of one filtered sample, from the declared sigma, the data, or both.

What the filter takes out of a channel shows the density S of its white noise; of that the filter lets through S B, with
B its `white_noise_bandwidth`. A declared sigma d (of one raw sample, all of its noise) may be larger than the white
noise seen: the rest is slow (a GNSS receiver's own filter, wheel-order ripple, quantisation of a quiet signal) and no
filter lessens it. With the sampling interval D:

.. math:: \sigma_f^2 = \min(d^2 D, S) B + \max(d^2 - 1.2 S / D, 0)

(S is known to some ten percent only: without the 1.2 white noise would seem to have a slow part.)

Where no sigma is declared, d is the larger of the white noise and q/sqrt(12) of the resolution q. Slow noise cannot be
told from signal then, but at standstill there is no signal: what a force still does there is a lower bound.
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
    density = _white_density(samples, residuals, kernel_sigma_s)
    seen = density / interval_s if isfinite(density) else 0.0
    total = max(seen, samples.step**2 / 12) if declared is None else declared**2
    if declared is None and not total and not isfinite(density):
        return nan, source
    density = min(density, total * interval_s) if isfinite(density) else total * interval_s
    passed = density * min(white_noise_bandwidth(kernel_sigma_s), 1 / interval_s)
    return sqrt(passed + max(total - _MARGIN * density / interval_s, 0.0)), source


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


def _white_density(samples: Samples, residuals: FloatArray, kernel_sigma_s: float) -> float:
    """Return S from the spread of the residuals, which is S times the integral of |N(f) - H(f)|^2."""
    residuals = residuals[np.isfinite(residuals)]
    if len(residuals) < _LEAST_SAMPLES:
        return nan
    spread = robust_spread(residuals - np.median(residuals))
    raw = 2 / (3 * samples.node_s) if samples.node_s else 1 / samples.interval_s
    peak = 1 / (sqrt(2 * pi) * kernel_sigma_s)
    return spread**2 / max(raw - 2 * peak + white_noise_bandwidth(kernel_sigma_s), 0.1 * raw)
