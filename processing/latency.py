r"""Residual latency of ground speed against wheel speed, with its uncertainty.

.. math:: V_m(t) = g(t - \tau), \qquad g = \alpha r \omega (1 - c T)

on samples that hardly slip (`rolling_radius.hardly_slipping`; the term with the torque only where it is measured).
Near zero slip everything is steep in the speeds and a false latency confirms itself, so that tau is first scanned over
a wide range, the cheapest kept, and refined by Gauss-Newton from there; the samples are chosen without looking at
ground speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np
from numpy.typing import NDArray

from processing.robust import RobustFit, robust_linear
from processing.rolling_radius import LEAST_SECONDS, speed_basis
from processing.timebase import FloatArray

SCAN_S = (-0.5, 1.5)
_SCAN_STEP_S = 0.05
_SCAN_ROWS = 3000
_FIT_ROWS = 20_000
_LARGEST_SIGMA_S = 0.5


@dataclass(frozen=True)
class LatencyEstimate:
    """Delay of ground speed (positive: it is late) and its one-sigma in s; NaN where it cannot be told."""

    latency_s: float = nan
    sigma_s: float = nan


def residual_latency(
    ground_speed_mps: FloatArray,
    rim_speed_mps: FloatArray,
    torque_nm: FloatArray,
    chosen: NDArray[np.bool_],
    rate_hz: float,
) -> LatencyEstimate:
    """Estimate the delay of ground speed against the wheel.

    Parameters
    ----------
    ground_speed_mps, rim_speed_mps, torque_nm : float64 arrays, shape (n,)
        On the time base; NaN where not to be used (torque all NaN: not measured).
    chosen : bool array, shape (n,)
        Samples that hardly slip, on the wheel's clock.
    rate_hz : float

    Returns
    -------
    LatencyEstimate
        NaN with less than 3 s of samples, a minimum at the end of the scan, or a sigma above 0.5 s.
    """
    basis = np.where(chosen[:, None], speed_basis(rim_speed_mps, np.where(chosen, torque_nm, nan)), nan)
    problem = _Problem(ground_speed_mps, basis, _slope(basis, rate_hz), rate_hz)
    rows = np.flatnonzero(np.isfinite(ground_speed_mps) & np.isfinite(basis).all(axis=1))
    if len(rows) < LEAST_SECONDS * rate_hz:
        return LatencyEstimate()
    delays = np.arange(SCAN_S[0], SCAN_S[1] + 1e-9, _SCAN_STEP_S)
    sparse = rows[:: -(-len(rows) // _SCAN_ROWS)]
    costs = [problem.cost(sparse, delay) for delay in delays]
    best = int(np.argmin(costs))
    if not 0 < best < len(delays) - 1:
        return LatencyEstimate()
    delay, fit = problem.refine(rows[:: -(-len(rows) // _FIT_ROWS)], float(delays[best]))
    sigma = sqrt(fit.covariance[-1, -1]) / abs(fit.coefficients[0]) if fit else nan
    if not (sigma < _LARGEST_SIGMA_S and SCAN_S[0] < delay < SCAN_S[1]):
        return LatencyEstimate()
    return LatencyEstimate(delay, sigma)


@dataclass(frozen=True)
class _Problem:
    ground: FloatArray
    basis: FloatArray
    slope: FloatArray
    rate_hz: float

    def cost(self, rows: NDArray[np.int64], delay_s: float) -> float:
        """Return the robust spread that the best coefficients leave at this delay."""
        rows, basis, _ = self._shifted(rows, delay_s)
        if len(rows) < 4 * basis.shape[1]:
            return float("inf")
        return robust_linear(basis, self.ground[rows], iterations=6).spread

    def refine(self, rows: NDArray[np.int64], delay_s: float) -> tuple[float, RobustFit | None]:
        """Gauss-Newton in the delay; the coefficients are linear and solved for at every step."""
        fit = None
        coefficients: FloatArray | None = None
        for _ in range(8):
            at, basis, slope = self._shifted(rows, delay_s)
            if len(at) < 4 * basis.shape[1]:
                return nan, None
            if coefficients is None:
                coefficients = robust_linear(basis, self.ground[at]).coefficients
            matrix = np.column_stack([basis, -(slope @ coefficients)])
            fit = robust_linear(matrix, self.ground[at], np.append(coefficients, 0.0))
            coefficients, step = fit.coefficients[:-1], float(np.clip(fit.coefficients[-1], -0.1, 0.1))
            delay_s += step
            if abs(step) < 1e-5:
                break
        return delay_s, fit

    def _shifted(self, rows: NDArray[np.int64], delay_s: float) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Return the rows that are usable at this delay, and the basis and its slope at t - delay."""
        position = rows - delay_s * self.rate_hz
        low = np.floor(position).astype(np.int64)
        inside = (low >= 0) & (low + 1 < len(self.ground))
        rows, low = rows[inside], low[inside]
        share = (position[inside] - low)[:, None]
        basis = (1 - share) * self.basis[low] + share * self.basis[low + 1]
        slope = (1 - share) * self.slope[low] + share * self.slope[low + 1]
        good = np.isfinite(basis).all(axis=1) & np.isfinite(slope).all(axis=1)
        return rows[good], basis[good], slope[good]


def _slope(basis: FloatArray, rate_hz: float) -> FloatArray:
    return np.asarray(np.gradient(basis, 1.0 / rate_hz, axis=0))
