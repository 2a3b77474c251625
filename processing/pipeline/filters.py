r"""The one low-pass filter that every channel passes on its way to the time base, and the sigma of a filtered sample.

Channels come at 1 kHz, 100 Hz, 20 Hz or 1 Hz, with jitter and lost frames. Eq. 6 and the model divide and compare them,
so that all must have been through *the same* transfer function. A recursive filter cannot give that: its coefficients
belong to one rate, and bringing a 20 Hz channel to 100 Hz first is itself a low-pass that the others do not see.
Therefore the filter is a kernel in continuous time, evaluated from each channel's own samples at the instants of the
time base. The kernel is Gaussian, the fit under it a straight line:

.. math:: \min_{a, b} \sum_i w_i e^{-(t_i - t)^2 / 2 \sigma^2} (x_i - a - b (t_i - t))^2 , \qquad
          |H(f)| = e^{-2 \pi^2 \sigma^2 f^2}, \qquad \sigma = \sqrt{\ln 2} / (2 \pi f_c),

with w_i the time that sample i stands for. a is the filtered value, b the derivative of the filtered signal. The phase
is zero, a ramp passes unchanged whatever the jitter, also at the ends of a stretch, and there is no overshoot.
Common bandwidth: the sum over samples equals the integral (to 4e-4) as long as f_c is at most a fifth of the channel's
rate; the slowest channel therefore sets f_c for all.

The one-sigma of one filtered sample is from the declared sigma, the data, or both.
Of white noise of density S the filter lets through S B, with B its `white_noise_bandwidth`; slow noise (a receiver's
own filter, wheel-order ripple, quantisation of a quiet signal) passes whole. A declared sigma d is of one raw sample
and holds both. The data show the white part w: by what the filter takes out and by what differs from one raw sample to
the next, whichever is less (the first holds signal beyond the cut-off, too); the rest is slow. With the sampling
interval D:

.. math:: \sigma_f^2 = \min(d, w)^2 D B + \max(d^2 - 1.2 w^2, 0)

(w is known to some ten percent only: without the 1.2 white noise would seem to have a slow part.) Where no sigma is
declared, d is the larger of w and q/sqrt(12) of the resolution q. Slow noise is not separable from signal then, but at
standstill there is no signal: what a force still does there is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, log, nan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from daq import BoolArray, FloatArray, IntArray
from processing.pipeline.collection import Samples
from processing.pipeline.kinematics import runs_of
from processing.processed_run import Segment
from processing.robust import robust_spread
from processing.timebase import stretch_of, stretches

CUTOFF_PER_RATE = 0.2
"""Highest cut-off as a share of a channel's own rate."""
KERNEL_REACH_SIGMAS = 4.0
EDGE_SIGMAS = 2.0
_ROWS_AT_ONCE = 1 << 16
_LEAST_STANDSTILL_SAMPLES = 10
_LEAST_SAMPLES = 20
WHITE_NOISE_MARGIN = 1.2


def kernel_sigma_s(cutoff_hz: float) -> float:
    """Return the standard deviation in s of the Gaussian kernel whose gain is -3 dB at `cutoff_hz`."""
    return sqrt(log(2.0)) / (2.0 * pi * cutoff_hz)


def white_noise_bandwidth(sigma_s: float) -> float:
    """Return the integral of the squared kernel in 1/s: filtered variance over density of white noise."""
    return 1.0 / (2.0 * sqrt(pi) * sigma_s)


@dataclass(frozen=True)
class Smoothed:
    """A filtered channel on the time base; arrays of shape (n,), NaN in gaps.

    Attributes
    ----------
    slope : float64 array
        Per second.
    covered : bool array
        Inside a gap-free stretch.
    edge : bool array
        Within two kernel deviations of an end of the stretch: the kernel is cut off there.
    """

    values: FloatArray
    slope: FloatArray
    covered: BoolArray
    edge: BoolArray


def smooth(
    at_s: FloatArray,
    time_s: FloatArray,
    values: FloatArray,
    sigma_s: float,
    max_gap_s: float,
    spread_s2: float = 0.0,
) -> Smoothed:
    """Filter one channel and put it on the time base; nothing is carried across a gap.

    `at_s`, shape (n,), is the time base, ascending. The samples, shape (m,), have strictly ascending stamps and finite
    values; an interval longer than `max_gap_s` is a gap. `sigma_s` is that of the kernel (`kernel_sigma_s`).

    `spread_s2` is the variance in s^2 of the instants that one sample already averages
    (`processing.pipeline.collection.thin`); the kernel is narrowed by as much, so that the whole transfer function
    stays the same.
    """
    pairs = stretches(time_s, max_gap_s, least=3)
    which = stretch_of(at_s, time_s, pairs)
    out, slope = np.full(len(at_s), np.nan), np.full(len(at_s), np.nan)  # apart: not everybody keeps the slope
    edge = np.zeros(len(at_s), np.bool_)
    inside = np.flatnonzero(which >= 0)
    weight = _time_weight(time_s, pairs)
    narrowed = sqrt(max(sigma_s**2 - spread_s2, 0.25 * sigma_s**2))
    for start in range(0, len(inside), _ROWS_AT_ONCE):
        rows = inside[start : start + _ROWS_AT_ONCE]
        bounds = pairs[which[rows]]
        out[rows], slope[rows] = _line_under_kernel(at_s[rows], time_s, values, weight, bounds, narrowed)
        first, last = time_s[bounds[:, 0]], time_s[bounds[:, 1] - 1]
        edge[rows] = np.minimum(at_s[rows] - first, last - at_s[rows]) < EDGE_SIGMAS * sigma_s
    return Smoothed(out, slope, np.isfinite(out), edge)


def _time_weight(time_s: FloatArray, pairs: IntArray) -> FloatArray:
    """Return the time each sample stands for: half the distance between its neighbours in the stretch."""
    weight = np.zeros(len(time_s))
    if len(time_s) > 1:
        step = np.diff(time_s)
        weight[1:-1] = (step[:-1] + step[1:]) / 2
        starts, ends = pairs[:, 0], pairs[:, 1] - 1
        weight[starts], weight[ends] = step[starts], step[ends - 1]
    return weight


def _line_under_kernel(
    at_s: FloatArray, time_s: FloatArray, values: FloatArray, weight: FloatArray, bounds: IntArray, sigma_s: float
) -> FloatArray:
    """Return value and slope of the weighted straight line at each instant, shape (2, n)."""
    low = np.maximum(np.searchsorted(time_s, at_s - KERNEL_REACH_SIGMAS * sigma_s), bounds[:, 0])
    high = np.minimum(np.searchsorted(time_s, at_s + KERNEL_REACH_SIGMAS * sigma_s), bounds[:, 1])
    s0, s1, s2, m0, m1 = np.zeros((5, len(at_s)))
    for tap in range(int((high - low).max(initial=0))):
        index = np.minimum(low + tap, len(time_s) - 1)
        u = (time_s[index] - at_s) / sigma_s
        h = weight[index] * np.exp(-0.5 * u * u)
        h[low + tap >= high] = 0.0
        hu, x = h * u, values[index]
        s0 += h
        s1 += hu
        s2 += hu * u
        m0 += h * x
        m1 += hu * x
    determinant = s0 * s2 - s1 * s1
    determinant[determinant <= 1e-6 * s0 * s0] = np.nan  # all weight on one instant: no line to draw
    return np.stack([s2 * m0 - s1 * m1, (s0 * m1 - s1 * m0) / sigma_s]) / determinant


def filtered_sigma(
    samples: Samples, residuals: FloatArray, kernel_sigma_s: float, declared: float | None
) -> tuple[float, str]:
    """Return the one-sigma of one filtered sample, and ``"declared"`` or ``"estimated"``.

    `residuals` are the samples (thinned as they are) less the filtered signal at their instants, NaN excluded;
    `declared` is the one-sigma of one raw sample. NaN where nothing is declared and there are too few samples.
    """
    source = "estimated" if declared is None else "declared"
    interval_s = samples.sampling.interval_s
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
    return sqrt(passed + max(total - WHITE_NOISE_MARGIN * white, 0.0)), source


def standstill_sigma(values: FloatArray, segments: NDArray[np.uint8], rate_hz: float, cutoff_hz: float) -> float:
    """Return the robust spread of a filtered signal about its median of each standstill; NaN with too few samples.

    Robust, because torque builds up before the wheel moves and fades after it has stopped. Arrays of shape (n,); the
    filter leaves about 2.5 cutoff_hz independent samples a second.
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
    raw = 2 / (3 * samples.node_s) if samples.node_s else 1 / samples.sampling.interval_s
    peak = 1 / (sqrt(2 * pi) * kernel_sigma_s)
    density = spread**2 / max(raw - 2 * peak + white_noise_bandwidth(kernel_sigma_s), 0.1 * raw)
    return density / samples.sampling.interval_s
