r"""Residual latency and scale of ground speed against wheel speed, with uncertainty.

.. math:: V_m(t) = g(t - \tau), \qquad g = r \omega (c_0 + c_1 u + c_2 u^2 + c_3 u^3), \qquad u = T / (r W)

The bracket is 1 - s as a smooth function of the traction; without torque (a road vehicle) it is a constant. Samples are
those of low slip (below 0.3) by the curve of slip over traction, not by their own measured slip: near zero slip
everything is steep in the speeds, and a choice by measured slip would confirm a false latency. tau is scanned over a
wide range, the cheapest kept, and refined by Gauss-Newton. The uncertainty joins two parts: leaving out stretches of
the run, and what other choices of degree and slip limit would have said.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite, nan, sqrt

import numpy as np

from daq import BoolArray, FloatArray, IndexArray, IntArray
from processing.robust import RobustFit, block_covariance, robust_linear

LEAST_SPEED_MPS = 1.0
SCAN_S = (-0.5, 1.5)
_SCAN_STEP_S = 0.05
_SCAN_ROWS = 600
_FIT_ROWS = 3000
_LEAST_SECONDS = 3.0
_LARGEST_SIGMA_S = 0.25
_FIRST_CHOICE = (3, 0.3)
_OTHER_CHOICES = ((2, 0.2), (5, 0.4))
_CURVE_BINS = 25
_FREE_SHARE = 0.06
_LEAST_SAMPLES = 20
_MOST_SIGMA = 0.02
"""Relative one-sigma of a radius beyond which it is none: a wheel that rolls freely keeps its radius to a percent."""
_SCALE_ROWS = 10_000


@dataclass(frozen=True)
class SpeedSignals:
    """What the estimate looks at; arrays of shape (n,) on the time base, NaN where not to be used or not measured.

    The traction is T / (r W), or T / r where the load is not measured; all NaN without torque. Slower samples than
    `least_mps` are no use.
    """

    ground_speed_mps: FloatArray
    rim_speed_mps: FloatArray
    traction: FloatArray
    rate_hz: float
    least_mps: float = LEAST_SPEED_MPS


def residual_latency(signals: SpeedSignals) -> tuple[float, float]:
    """Estimate the delay of ground speed against the wheel, s, and its sigma; positive where ground speed is late.

    NaN with less than 3 s of samples, a minimum at the end of the scan, or a sigma above 0.25 s.
    """
    delay, sigma = _scan_and_refine(_Problem.of(signals, *_FIRST_CHOICE))
    if np.isfinite(signals.traction).any() and np.isfinite(delay):
        others = [_Problem.of(signals, *choice).refine(delay)[0] for choice in _OTHER_CHOICES]
        sigma = hypot(sigma, float(np.sqrt(np.mean((np.array(others) - delay) ** 2))))
    inside = SCAN_S[0] + _SCAN_STEP_S < delay < SCAN_S[1] - _SCAN_STEP_S
    good = sigma < _LARGEST_SIGMA_S and inside
    return (delay, sigma) if good else (nan, nan)


def _scan_and_refine(problem: _Problem) -> tuple[float, float]:
    if len(problem.rows) < _LEAST_SECONDS * problem.rate_hz:
        return nan, nan
    delays = np.arange(SCAN_S[0], SCAN_S[1] + 1e-9, _SCAN_STEP_S)
    best = int(np.argmin([problem.cost(float(delay)) for delay in delays]))
    return problem.refine(float(delays[best]))


@dataclass(frozen=True)
class _Problem:
    """One choice of samples and of degree; rim speed is NaN where not chosen, traction centred.

    Slopes are taken where they are needed: a run of hours has more samples than are ever looked at. `between` tells
    where a value between a sample and the next is known with its slope, shape (n,).
    """

    ground: FloatArray
    rim: FloatArray
    traction: FloatArray
    between: BoolArray
    degree: int
    rows: IntArray
    rate_hz: float

    @staticmethod
    def of(signals: SpeedSignals, degree: int, slip_limit: float) -> _Problem:
        rim, traction = signals.rim_speed_mps, signals.traction
        if np.isfinite(traction).any():
            chosen = _low_slip(signals, slip_limit)
            seen = traction[chosen]
            middle, size = (float(np.median(seen)), float(np.std(seen))) if len(seen) else (0.0, 1.0)
            traction = (traction - middle) / max(size, 1e-12)
        else:
            chosen, traction, degree = rim > signals.least_mps, np.zeros_like(rim), 0
        rim = np.where(chosen, rim, nan)
        known = np.isfinite(rim) & np.isfinite(traction)
        known[1:-1] &= known[:-2] & known[2:]
        rows = np.flatnonzero(known & np.isfinite(signals.ground_speed_mps))
        between = known & np.append(known[1:], False)
        return _Problem(signals.ground_speed_mps, rim, traction, between, degree, rows, signals.rate_hz)

    def cost(self, delay_s: float) -> float:
        """Return the robust spread that the best coefficients leave at this delay."""
        rows, low, share = self._shifted(delay_s, _SCAN_ROWS)
        if len(rows) < 4 * (self.degree + 1):
            return float("inf")
        rim, traction = (_interpolated(signal, low, share) for signal in (self.rim, self.traction))
        basis = rim[:, None] * np.vander(traction, self.degree + 1, increasing=True)
        return robust_linear(basis, self.ground[rows], iterations=4).spread

    def refine(self, delay_s: float) -> tuple[float, float]:
        """Gauss-Newton in the delay; the coefficients are linear and solved for at every step."""
        coefficients: FloatArray | None = None
        for _ in range(10):
            at, low, share = self._shifted(delay_s, _FIT_ROWS)
            if len(at) < 4 * (self.degree + 1):
                return nan, nan
            y = self.ground[at]
            basis, slope = self._basis(low, share)
            if coefficients is None:
                coefficients = robust_linear(basis, y).coefficients
            matrix = np.column_stack([basis, -(slope @ coefficients)])
            fit: RobustFit = robust_linear(matrix, y, np.append(coefficients, 0.0), iterations=5)
            coefficients, step = fit.coefficients[:-1], float(np.clip(fit.coefficients[-1], -0.1, 0.1))
            delay_s += step
            if abs(step) < 1e-4:
                break
        return delay_s, sqrt(block_covariance(matrix, y, fit.weights)[-1, -1])

    def _shifted(self, delay_s: float, most: int) -> tuple[IntArray, IntArray, FloatArray]:
        """Return at most so many usable rows, and where t - delay is: the sample before, and the share to the next."""
        rows = self.rows[:: max(1, -(-len(self.rows) // most))]
        position = rows - delay_s * self.rate_hz
        low = np.floor(position).astype(np.int64)
        inside = (low >= 1) & (low + 2 < len(self.ground))
        inside[inside] = self.between[low[inside]]
        return rows[inside], low[inside], position[inside] - low[inside]

    def _basis(self, low: IntArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the basis at places between samples, and its slope in time, shape (n, degree + 1) each."""
        rim, traction = (_interpolated(signal, low, share) for signal in (self.rim, self.traction))
        rim_slope, traction_slope = (self._slope(signal, low, share) for signal in (self.rim, self.traction))
        powers = np.vander(traction, self.degree + 1, increasing=True)
        slope = rim_slope[:, None] * powers
        slope[:, 1:] += (rim * traction_slope)[:, None] * powers[:, :-1] * np.arange(1, self.degree + 1)
        return rim[:, None] * powers, slope

    def _slope(self, signal: FloatArray, low: IntArray, share: FloatArray) -> FloatArray:
        """Return the central differences of a signal, interpolated."""
        before, here, there, after = (signal[low + step] for step in (-1, 0, 1, 2))
        return np.asarray(((1 - share) * (there - before) + share * (after - here)) * (0.5 * self.rate_hz))


def _interpolated(signal: FloatArray, low: IntArray, share: FloatArray) -> FloatArray:
    return np.asarray((1 - share) * signal[low] + share * signal[low + 1])


def _low_slip(signals: SpeedSignals, limit: float) -> BoolArray:
    """Return the moving samples whose traction goes with a slip below the limit, by the median slip of each bin."""
    rim, ground, traction = signals.rim_speed_mps, signals.ground_speed_mps, signals.traction
    larger = np.maximum(rim, ground)
    moving = (larger > signals.least_mps) & np.isfinite(traction)
    if moving.sum() < 4 * _CURVE_BINS:
        return moving
    edges = np.quantile(traction[moving], np.linspace(0, 1, _CURVE_BINS + 1))
    which = np.clip(np.searchsorted(edges, traction[moving]) - 1, 0, _CURVE_BINS - 1)
    slip = (rim[moving] - ground[moving]) / larger[moving]
    there = np.unique(which)
    curve = np.array([np.median(slip[which == k]) for k in there])
    centres = 0.5 * (edges[there] + edges[there + 1])
    return np.asarray(moving & (np.abs(np.interp(traction, centres, curve)) < limit))


def rolls_freely(
    rim_speed_mps: FloatArray,
    torque_nm: FloatArray,
    load_n: FloatArray,
    drawbar_pull_n: FloatArray,
    radius_m: float,
    least_mps: float = LEAST_SPEED_MPS,
) -> BoolArray:
    """Return the moving samples on which the wheel hardly slips.

    Chosen without looking at ground speed: a choice by measured slip would confirm whatever error the speeds have.
    Where torque and drawbar pull are measured, neither |T|/r nor |Dp| may exceed 6 % of the load: on soft soil no
    sample passes, since a wheel without torque is dragged there and skids. Where neither is measured every moving
    sample passes (a road vehicle); where one of them is not, none: nobody can tell then. Arrays of shape (n,), all NaN
    where not measured.
    """
    moving = rim_speed_mps > least_mps
    measured = [bool(np.isfinite(force).any()) for force in (torque_nm, drawbar_pull_n)]
    if not all(measured):
        return moving & (not any(measured))
    force = np.maximum(np.abs(torque_nm) / radius_m, np.abs(drawbar_pull_n))
    known = moving & np.isfinite(force)
    load = load_n[known & (load_n > 0)]
    scale = float(np.median(load) if len(load) else force[known].max(initial=0.0))
    return np.asarray(known & (force <= _FREE_SHARE * scale))


def speed_scale(ground_speed_mps: FloatArray, rim_speed_mps: FloatArray) -> tuple[float, float]:
    """Return ground speed over rim speed and its one-sigma; NaN below 20 samples, or where the wheel slips after all.

    Latency is removed from both, shape (n,); NaN is left out.
    """
    rows = np.isfinite(ground_speed_mps) & np.isfinite(rim_speed_mps)
    if rows.sum() < _LEAST_SAMPLES:
        return nan, nan
    matrix, y = rim_speed_mps[rows, None], ground_speed_mps[rows]
    fit = robust_linear(matrix, y)
    scale, sigma = float(fit.coefficients[0]), sqrt(block_covariance(matrix, y, fit.weights)[0, 0])
    return (scale, sigma) if sigma <= _MOST_SIGMA * abs(scale) else (nan, nan)


@dataclass(frozen=True)
class SpeedComparison:
    """Delay of ground speed (positive: late) in s, ground speed over rim speed, and their sigmas; NaN where unknown."""

    latency_s: float = nan
    latency_sigma_s: float = nan
    scale: float = nan
    scale_sigma: float = nan


def compare_speeds(
    ground_speed_mps: FloatArray,
    rim_speed_mps: FloatArray,
    torque_nm: FloatArray,
    load_n: FloatArray,
    drawbar_pull_n: FloatArray,
    radius_m: float,
    rate_hz: float,
    pace: float = 1.0,
) -> SpeedComparison:
    """Estimate the residual latency on low slip, and the scale where the wheel rolls freely.

    Arrays of shape (n,) on the time base, NaN where not to be used or not measured. Where torque is not, slip goes by
    drawbar pull. `pace` scales the least speed.
    """
    least_mps = LEAST_SPEED_MPS * pace
    measured = np.isfinite(torque_nm).any()
    traction = torque_nm / radius_m if measured else drawbar_pull_n
    if np.isfinite(load_n).any():
        traction = np.where(load_n > 0, traction / np.where(load_n > 0, load_n, 1.0), nan)
    latency, sigma = residual_latency(SpeedSignals(ground_speed_mps, rim_speed_mps, traction, rate_hz, least_mps))
    free = np.flatnonzero(rolls_freely(rim_speed_mps, torque_nm, load_n, drawbar_pull_n, radius_m, least_mps))
    free = free[:: max(1, -(-len(free) // _SCALE_ROWS))]
    ground = _later(ground_speed_mps, free, (latency if isfinite(latency) else 0.0) * rate_hz)
    return SpeedComparison(latency, sigma, *speed_scale(ground, rim_speed_mps[free]))


def _later(values: FloatArray, rows: IndexArray, lag: float) -> FloatArray:
    """Return the values `lag` samples after the rows, interpolated; NaN beyond the ends."""
    low = np.floor(rows + lag).astype(np.int64)
    share = rows + lag - low
    inside = (low >= 0) & (low + 1 < len(values))
    low = np.where(inside, low, 0)
    out = (1 - share) * values[low] + share * values[np.minimum(low + 1, len(values) - 1)]
    return np.where(inside, out, nan)
