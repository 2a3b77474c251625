r"""The one low-pass filter that every channel passes on its way to the time base.

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
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np

from processing.timebase import FloatArray, IntArray, stretch_of, stretches

CUTOFF_PER_RATE = 0.2
"""Highest cut-off as a share of a channel's own rate."""
_REACH = 4.0
_EDGE = 2.0
_BLOCK = 1 << 16


def kernel_sigma_s(cutoff_hz: float) -> float:
    """Return the standard deviation in s of the Gaussian kernel whose gain is -3 dB at `cutoff_hz`."""
    return sqrt(log(2.0)) / (2.0 * pi * cutoff_hz)


def white_noise_bandwidth(sigma_s: float) -> float:
    """Return the integral of the squared kernel in 1/s: filtered variance over density of white noise."""
    return 1.0 / (2.0 * sqrt(pi) * sigma_s)


@dataclass(frozen=True)
class Smoothed:
    """A filtered channel on the time base; arrays of shape (n,).

    Attributes
    ----------
    values, slope : float64 arrays
        NaN in gaps; `slope` per second.
    covered : bool array
        Inside a gap-free stretch.
    edge : bool array
        Within two kernel deviations of an end of the stretch: the kernel is cut off there.
    """

    values: FloatArray
    slope: FloatArray
    covered: np.ndarray[tuple[int], np.dtype[np.bool_]]
    edge: np.ndarray[tuple[int], np.dtype[np.bool_]]


def smooth(
    at_s: FloatArray,
    time_s: FloatArray,
    values: FloatArray,
    sigma_s: float,
    max_gap_s: float,
    spread_s2: float = 0.0,
) -> Smoothed:
    """Filter one channel and put it on the time base; nothing is carried across a gap.

    Parameters
    ----------
    at_s : float64 array, shape (n,)
        Time base, ascending.
    time_s, values : float64 arrays, shape (m,)
        Samples, stamps strictly ascending, values finite.
    sigma_s : float
        Of the kernel, see `kernel_sigma_s`.
    max_gap_s : float
        A longer interval between samples is a gap.
    spread_s2 : float
        Variance in s^2 of the instants that one sample already averages (see `processing.collect.thin`); the kernel is
        narrowed by as much, so that the whole transfer function stays the same.
    """
    pairs = stretches(time_s, max_gap_s, least=3)
    which = stretch_of(at_s, time_s, pairs)
    out, slope = np.full(len(at_s), np.nan), np.full(len(at_s), np.nan)  # apart: not everybody keeps the slope
    edge = np.zeros(len(at_s), np.bool_)
    inside = np.flatnonzero(which >= 0)
    weight = _time_weight(time_s, pairs)
    narrowed = sqrt(max(sigma_s**2 - spread_s2, 0.25 * sigma_s**2))
    for start in range(0, len(inside), _BLOCK):
        rows = inside[start : start + _BLOCK]
        bounds = pairs[which[rows]]
        out[rows], slope[rows] = _line_under_kernel(at_s[rows], time_s, values, weight, bounds, narrowed)
        first, last = time_s[bounds[:, 0]], time_s[bounds[:, 1] - 1]
        edge[rows] = np.minimum(at_s[rows] - first, last - at_s[rows]) < _EDGE * sigma_s
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
    low = np.maximum(np.searchsorted(time_s, at_s - _REACH * sigma_s), bounds[:, 0])
    high = np.minimum(np.searchsorted(time_s, at_s + _REACH * sigma_s), bounds[:, 1])
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
