"""The parts of a recording that give a zero: steady revolutions, or a standstill, of a lifted wheel.

Of each signal come the offset and the amplitudes once and twice per revolution, with sigmas for correlated noise.

A robust fit (bisquare: spikes do not count) gives the coefficients. Their covariance is the jackknife over blocks of
time of a second or more, which are nearly independent however the samples within them depend on each other; blocks
twice as long show what is left of that, and the larger sigma holds. From n blocks a sigma is itself uncertain, so that
it is widened by Student's quantile for n - 1 degrees of freedom. Between 64 and 82 % of the errors of noise correlated
over 0.02 to 0.2 s lie within +-1 sigma, of spins from 2 to 40 s.

What rounding to the DBC's resolution q hides is added: q/sqrt(12) for a signal that does not move,
exp(-2 pi^2 s^2/q^2) of it where noise of standard deviation s shakes it through the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, nan, pi, sqrt
from typing import Literal

import numpy as np

from daq import BoolArray, FloatArray
from processing.pipeline.kinematics import runs_of
from processing.robust import bisquare, robust_linear, robust_spread

_BLOCK_S = 1.0
_FEWEST_BLOCKS, _MOST_BLOCKS = 4, 16
_REFINEMENTS = 4
_FEWEST_REVOLUTIONS = 2
_LONGEST_REVOLUTION_S = 30.0
_EVEN = 1.6
"""Slowest over quickest quarter of a revolution, at the most."""
_STEADY = ((0.04, 5), (0.25, _FEWEST_REVOLUTIONS))
"""Change from one revolution to the next, as a share, and how many such revolutions are enough: the steadier first."""
_BIN_S = 0.25
_EDGE_BINS = 2
_SHORTEST_STANDSTILL_S = 1.0
_STILL_RAD = 0.02
_STILL_RADPS = 0.05


@dataclass(frozen=True)
class Harmonics:
    """A fit of y = a + b cos psi + c sin psi + d cos 2 psi + e sin 2 psi.

    Attributes
    ----------
    coefficients, sigmas : float64 arrays, shape (5,), or (1,) without an angle
    spread : float
        Robust standard deviation of the residuals.
    outliers : int
        Samples that do not count at all.
    """

    coefficients: FloatArray
    sigmas: FloatArray
    spread: float
    outliers: int


def fit_harmonics(time_s: FloatArray, y: FloatArray, angle_rad: FloatArray | None, resolution: float) -> Harmonics:
    """Fit one signal whose samples are finite and in order of time.

    Without the angle psi, shape (n,) as time and signal, the offset alone is fitted; `resolution` is the step of the
    signal in its unit.
    """
    matrix = _design(len(y), angle_rad)
    p = robust_linear(matrix, y).coefficients
    for _ in range(_REFINEMENTS):  # a signal that hardly moves has no spread to weigh by: half a step is the least
        weights = bisquare(y - matrix @ p, max(resolution / 2, 1e-12))
        p = np.asarray(np.linalg.lstsq((matrix * weights[:, None]).T @ matrix, matrix.T @ (weights * y), rcond=None)[0])
    residual = y - matrix @ p
    spread = robust_spread(residual)
    # The one-sigma of each coefficient, the weights kept: the larger of two block lengths'.
    span_s = float(time_s[-1] - time_s[0])
    most = int(np.clip(span_s / _BLOCK_S, _FEWEST_BLOCKS, _MOST_BLOCKS))
    place = (time_s - time_s[0]) / max(span_s, 1e-9)
    weighted = matrix * weights[:, None]
    seen = np.maximum(*(_jackknife(place, weighted, matrix, y, count) for count in (most, max(most // 2, 3))))
    hidden = resolution / sqrt(12) * exp(-2 * (pi * spread / resolution) ** 2) if resolution > 0 else 0.0
    return Harmonics(p, np.hypot(seen, hidden), spread, int(np.sum(weights == 0)))


def _design(count: int, angle_rad: FloatArray | None) -> FloatArray:
    if angle_rad is None:
        return np.ones((count, 1))
    ones = np.ones(count)
    return np.column_stack([ones, np.cos(angle_rad), np.sin(angle_rad), np.cos(2 * angle_rad), np.sin(2 * angle_rad)])


def _jackknife(place: FloatArray, weighted: FloatArray, matrix: FloatArray, y: FloatArray, count: int) -> FloatArray:
    """Return what the coefficients change when one of `count` blocks is left out, as one-sigma; `place` is 0 to 1."""
    block = np.minimum((place * count).astype(np.int64), count - 1)
    blocks = [block == number for number in range(count)]
    parts = [(weighted[rows].T @ matrix[rows], weighted[rows].T @ y[rows]) for rows in blocks]
    gram, right = (np.sum(part, axis=0) for part in zip(*parts, strict=True))
    without = np.array([np.linalg.lstsq(gram - g, right - r, rcond=None)[0] for g, r in parts])
    variance = (count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    return np.asarray(_student(count - 1) * np.sqrt(variance))


def _student(freedom: int) -> float:
    """Return the quantile of Student's t that one sigma of a normal distribution has (Cornish and Fisher's series)."""
    return 1 + 1 / (2 * freedom) + 1 / (4 * freedom**2)


@dataclass(frozen=True)
class Part:
    """What is used of a recording.

    Attributes
    ----------
    method : "spin" or "standstill"
    revolutions : int
        Whole ones; 0 of a standstill.
    speed : (time_s, omega_radps), each of shape (k,)
        Mean angular speed over the revolution about each instant; empty of a standstill.
    angle_rad : float
        psi of a standstill; NaN where not known.
    """

    method: Literal["spin", "standstill"]
    start_s: float
    stop_s: float
    revolutions: int
    speed: tuple[FloatArray, FloatArray]
    angle_rad: float = nan

    @property
    def mean_speed_radps(self) -> float:
        """Mean angular speed, negative backward; NaN of a standstill."""
        if not self.revolutions:
            return nan
        return float(np.sign(self.speed[1][0]) * 2 * pi * self.revolutions / (self.stop_s - self.start_s))

    def acceleration_at(self, time_s: FloatArray) -> FloatArray:
        """Return the angular acceleration in rad/s2, smoothed over a revolution."""
        return np.interp(time_s, self.speed[0], np.gradient(self.speed[1], self.speed[0]))


@dataclass(frozen=True)
class Motion:
    """Load in vehicle axes, unwrapped angle and speed of the wheel; each with stamps of its own in s, SI.

    `angle` and `speed` are None where the recording has no such signal.
    """

    load: tuple[FloatArray, FloatArray]
    angle: tuple[FloatArray, FloatArray] | None
    speed: tuple[FloatArray, FloatArray] | None


def find_spin(motion: Motion, lifted_below_n: float) -> Part | None:
    """Return the longest steady spin of a lifted wheel by whole revolutions, two at the least; None without one.

    The mean load of every revolution is below `lifted_below_n`, either sign.
    """
    if motion.angle is None or len(motion.angle[0]) < 2:
        return None
    quarter_s = _quarter_instants(*motion.angle)
    if len(quarter_s) < 4 * _FEWEST_REVOLUTIONS + 1:
        return None
    turn_s = quarter_s[4:] - quarter_s[:-4]
    quarters = np.lib.stride_tricks.sliding_window_view(np.diff(quarter_s), 4)
    even = quarters.max(axis=1) < _EVEN * quarters.min(axis=1)
    load = _means(*motion.load, quarter_s[:-4], quarter_s[4:])
    possible = even & (turn_s < _LONGEST_REVOLUTION_S) & (np.abs(load) < lifted_below_n)
    for change, enough in _STEADY:
        start, count = _longest(possible & (_changes(turn_s) < change))
        if count >= enough:
            break
    else:
        return None
    middle_s = (quarter_s[:-4] + quarter_s[4:]) / 2
    sense = 1.0 if motion.angle[1][-1] > motion.angle[1][0] else -1.0
    speed = (middle_s[start : start + 4 * count - 3], sense * 2 * pi / turn_s[start : start + 4 * count - 3])
    return Part("spin", float(quarter_s[start]), float(quarter_s[start + 4 * count]), count, speed)


def find_standstill(motion: Motion, load_range_n: tuple[float, float]) -> Part | None:
    """Return the longest standstill with a mean load (either sign) in a range; None where none lasts a second.

    Without an angle the wheel's speed tells; without either, the wheel is taken to stand.
    """
    start_s, stop_s = float(motion.load[0][0]), float(motion.load[0][-1])
    count = int((stop_s - start_s) / _BIN_S)
    if count < 1:
        return None
    edges = np.asarray(start_s + _BIN_S * np.arange(count + 1), np.float64)
    load = np.abs(_means(*motion.load, edges[:-1], edges[1:]))
    good = _still(motion, edges) & (load >= load_range_n[0]) & (load < load_range_n[1])
    found = [
        (start + _EDGE_BINS * (start > 0), stop - _EDGE_BINS * (stop < count))
        for start, stop in runs_of(good)
        if good[start]
    ]
    first, last = max(found, key=lambda pair: pair[1] - pair[0], default=(0, 0))
    if (last - first) * _BIN_S < _SHORTEST_STANDSTILL_S:
        return None
    angle = nan
    if motion.angle is not None:
        angle = float(_means(*motion.angle, edges[first : first + 1], edges[last : last + 1])[0])
    return Part("standstill", float(edges[first]), float(edges[last]), 0, (np.zeros(0), np.zeros(0)), angle)


def _quarter_instants(time_s: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return when the wheel had turned k quarters on, in its main sense; rocking back does not count."""
    sense = 1.0 if angle_rad[-1] > angle_rad[0] else -1.0
    turned = np.maximum.accumulate(sense * (angle_rad - angle_rad[0]))
    new = np.flatnonzero(np.diff(turned, prepend=-1.0) > 0)
    return np.interp(np.arange(int(turned[-1] / (pi / 2)) + 1) * pi / 2, turned[new], time_s[new])


def _longest(good: BoolArray) -> tuple[int, int]:
    """Return the first quarter of the longest stretch of good revolutions, and how many whole ones it holds."""
    stretches = [(int(start), int(stop - start + 3) // 4) for start, stop in runs_of(good) if good[start]]
    return max(stretches, key=lambda pair: pair[1], default=(0, 0))


def _changes(turn_s: FloatArray) -> FloatArray:
    """Return how much longer or shorter the next revolution takes, as a share (the last: than the one before)."""
    change = np.zeros(len(turn_s))
    change[4:] = np.abs(turn_s[4:] / turn_s[:-4] - 1)
    change[:-4] = change[4:]
    return change


def _still(motion: Motion, edges: FloatArray) -> BoolArray:
    if motion.angle is not None and len(motion.angle[0]) > 1:
        angle = _means(*motion.angle, edges[:-1], edges[1:])
        around = np.pad(angle, 4, mode="edge")
        return np.asarray(np.abs(around[8:] - around[:-8]) < _STILL_RAD)
    if motion.speed is not None:
        return np.asarray(np.abs(_means(*motion.speed, edges[:-1], edges[1:])) < _STILL_RADPS)
    return np.full(len(edges) - 1, True)


def _means(time_s: FloatArray, values: FloatArray, from_s: FloatArray, to_s: FloatArray) -> FloatArray:
    """Return the mean of the samples in each span; NaN where there is none."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first, last = np.searchsorted(time_s, from_s), np.searchsorted(time_s, to_s)
    count = last - first
    return np.where(count > 0, (total[last] - total[first]) / np.maximum(count, 1), nan)
