r"""GNSS time against the host's clock: offset, drift and jitter by a robust straight line.

Frames are stamped by the host when they arrive; GNSS says when they were measured. With e = GNSS - host,

.. math:: e_i = a + b (h_i - h_0) + \text{jitter}_i ,

-a is the offset of the host's clock plus the mean delay of the frames (the two are not separable), -b its drift. A
few frames that queued, or a receiver that starts with a wrong time, do not move the line. GNSS time may count from
midnight, from the start of the week or from an epoch, and may roll over: everything is taken modulo a day.

The jitter is correlated (a busy bus delays many frames in a row) and one-sided, so that the line's uncertainty comes
from refits with one sixteenth of the run excluded at a time, see ``docs/decisions/time.md``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from daq import DataError, FloatArray, IntArray

_DAY_S = 86_400.0
_TUKEY = 4.685
_MAD_TO_SIGMA = 1.4826
_LEAST_EPOCHS = 5
_LEAST_SPREAD_S = 1e-7
_BLOCKS = 16
_KEPT_EPOCHS = 2048
_LEAST_STIFFNESS = 0.2
_STEP = 1.25
_Z95 = 1.96


@dataclass(frozen=True)
class ClockFit:
    """The host's clock against GNSS time.

    Attributes
    ----------
    offset_s : float
        Host minus GNSS at `reference_ns`, modulo a day: the host's error plus the mean delay of the frames.
    drift_ppm : float
        How much faster the host's clock runs.
    residual_s : float
        Robust one-sigma of the jitter of the arrival stamps.
    epochs, outliers : int
        GNSS epochs used; those so far off that they got no weight.
    reference_ns : int
        Host time at which `offset_s` holds.
    offset_sigma_s, drift_sigma_ppm : float
        One-sigma of the line. That the mean delay of the frames is in the offset is not in its sigma.
    """

    offset_s: float
    drift_ppm: float
    residual_s: float
    epochs: int
    outliers: int
    reference_ns: int
    offset_sigma_s: float
    drift_sigma_ppm: float

    def as_metadata(self) -> dict[str, str]:
        """Return the fields as text, for a recording's ``clock`` record."""
        return {field.name: str(getattr(self, field.name)) for field in fields(self)}

    def delays_s(self, host_ns: IntArray, gnss_s: FloatArray) -> FloatArray:
        """Return how much later than usual each frame arrived, by its arrival stamp and the GNSS time in it."""
        elapsed = (host_ns - self.reference_ns) * 1e-9
        apart = elapsed + (self.reference_ns * 1e-9) % _DAY_S - gnss_s - self.offset_s
        return np.asarray(_wrapped(apart) - self.drift_ppm * 1e-6 * elapsed)


def fit_clock(host_ns: IntArray, gnss_s: FloatArray) -> ClockFit:
    """Fit the host's clock to GNSS time.

    Parameters
    ----------
    host_ns : int64 array, shape (n,)
        Arrival stamps, UTC nanoseconds.
    gnss_s : float64 array, shape (n,)
        GNSS time in the frames; NaN is excluded, of repeats the first counts.

    Raises
    ------
    DataError
        Fewer than five different epochs.
    """
    host_ns, gnss_s = _fresh(host_ns, gnss_s, np.nan)
    if len(gnss_s) < _LEAST_EPOCHS:
        raise DataError.of(
            "GNSS time cannot be fitted", found=f"{len(gnss_s)} epochs", expected=f"{_LEAST_EPOCHS} or more"
        )
    reference_ns = int(host_ns[len(host_ns) // 2])
    elapsed = (host_ns - reference_ns) * 1e-9
    apart: FloatArray = elapsed + (reference_ns * 1e-9) % _DAY_S - gnss_s
    centre = _circular_centre(apart)
    near = _wrapped(apart - centre)
    offset, drift, weight, spread = _robust_line(np.asarray(elapsed), near)
    offset_sigma, drift_sigma = _line_sigma(np.asarray(elapsed), near - offset - drift * elapsed, spread)
    return ClockFit(
        offset_s=float(_wrapped(np.array(offset + centre))),
        drift_ppm=drift * 1e6,
        residual_s=spread,
        epochs=len(gnss_s),
        outliers=int(np.sum(weight == 0)),
        reference_ns=reference_ns,
        offset_sigma_s=offset_sigma,
        drift_sigma_ppm=drift_sigma * 1e6,
    )


class GnssClock:
    """The same fit while frames come in, in bounded memory: of a long run it keeps 1,024 to 2,048 epochs.

    They are spread evenly over the run, each drawn at random from those it stands for, so that jitter which repeats
    itself is not mistaken for an offset.
    """

    def __init__(self) -> None:
        self._host_ns = np.zeros(0, np.int64)
        self._gnss_s = np.zeros(0)
        self._waiting_ns = np.zeros(0, np.int64)
        self._waiting_s = np.zeros(0)
        self._stride = 1
        self._last_s = np.nan
        self._draw = np.random.default_rng(0)

    def take(self, time_ns: IntArray, gnss_s: FloatArray) -> None:
        """Take GNSS time as it came in: arrival stamps in their order (see `fit_clock`) and times, shape (n,) each."""
        time_ns, gnss_s = _fresh(time_ns, gnss_s, self._last_s)
        if not len(gnss_s):
            return
        self._last_s = float(gnss_s[-1])
        self._waiting_ns = np.concatenate([self._waiting_ns, time_ns])
        self._waiting_s = np.concatenate([self._waiting_s, gnss_s])
        self._keep(len(self._waiting_s) // self._stride)
        while len(self._gnss_s) > _KEPT_EPOCHS:
            pairs = len(self._gnss_s) // 2
            picked = 2 * np.arange(pairs) + self._draw.integers(0, 2, pairs)
            self._host_ns, self._gnss_s = self._host_ns[picked], self._gnss_s[picked]
            self._stride *= 2

    def fit(self) -> ClockFit | None:
        """Fit what was kept; None before the fifth epoch. Takes a few milliseconds."""
        return fit_clock(self._host_ns, self._gnss_s) if len(self._gnss_s) >= _LEAST_EPOCHS else None

    def _keep(self, groups: int) -> None:
        """Keep one epoch of each full group of those that wait."""
        if groups:
            picked = np.arange(groups) * self._stride + self._draw.integers(0, self._stride, groups)
            self._host_ns = np.concatenate([self._host_ns, self._waiting_ns[picked]])
            self._gnss_s = np.concatenate([self._gnss_s, self._waiting_s[picked]])
            self._waiting_ns = self._waiting_ns[groups * self._stride :]
            self._waiting_s = self._waiting_s[groups * self._stride :]


def _fresh(host_ns: IntArray, gnss_s: FloatArray, last_s: float) -> tuple[IntArray, FloatArray]:
    """Exclude NaN, and of repeats all but the first."""
    known = np.isfinite(gnss_s)
    host_ns, gnss_s = host_ns[known], gnss_s[known]
    fresh = np.diff(gnss_s, prepend=last_s) != 0
    return host_ns[fresh], gnss_s[fresh]


def _wrapped(seconds: FloatArray) -> FloatArray:
    """Return the seconds modulo a day, between minus and plus half a day."""
    return (seconds + _DAY_S / 2) % _DAY_S - _DAY_S / 2


def _circular_centre(seconds: FloatArray) -> float:
    """Return a centre of values known modulo a day that a minority of wrong ones cannot move far."""
    angle = np.angle(np.mean(np.exp(2j * np.pi * seconds / _DAY_S)))
    rough = float(angle) * _DAY_S / (2 * np.pi)
    return rough + float(np.median(_wrapped(seconds - rough)))


def _robust_line(x: FloatArray, y: FloatArray) -> tuple[float, float, FloatArray, float]:
    """Return intercept, slope, bisquare weights and robust spread; start: median slope over half the length."""
    half = len(x) // 2
    run = np.maximum(x[-half:] - x[:half], 1e-9)
    slope = float(np.median((y[-half:] - y[:half]) / run))
    intercept = float(np.median(y - slope * x))
    weight = np.ones(len(x))
    for _ in range(20):
        residual = y - intercept - slope * x
        spread = _MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        weight = np.clip(1 - (residual / (_TUKEY * max(spread, _LEAST_SPREAD_S))) ** 2, 0, None) ** 2
        x_mean, y_mean = np.average(x, weights=weight), np.average(y, weights=weight)
        variance = np.average((x - x_mean) ** 2, weights=weight)
        if variance <= 0:
            break
        slope = float(np.average((x - x_mean) * (y - y_mean), weights=weight) / variance)
        intercept = float(y_mean - slope * x_mean)
    return intercept, slope, weight, spread


def _line_sigma(x: FloatArray, residual: FloatArray, spread: float) -> tuple[float, float]:
    """Return the one-sigma of a robust line's intercept and slope, by leaving out one block of time after another.

    The sigma is widened by Student's t, as there are few blocks.
    """
    level, tilt = _influence(residual, max(spread, _LEAST_SPREAD_S))
    blocks = min(_BLOCKS, len(x))
    starts = np.arange(blocks) * len(x) // blocks
    of_block = np.add.reduceat(np.stack([np.ones(len(x)), x, x * x, level, tilt, x * tilt]), starts, axis=1)
    n, sx, sxx, s_level, s_tilt, sx_tilt = of_block.sum(axis=1, keepdims=True) - of_block
    determinant = n * sxx - sx * sx
    if np.any(determinant <= 0):
        return np.inf, np.inf
    slope = (n * sx_tilt - sx * s_tilt) / determinant
    intercept = (s_level - slope * sx) / n
    freedom = blocks - 2
    widening = 1 + (_Z95**2 + 1) / (4 * freedom) + (5 * _Z95**4 + 16 * _Z95**2 + 3) / (96 * freedom**2)
    jackknife = widening * np.sqrt((blocks - 1) * np.array([np.var(intercept), np.var(slope)]))
    return float(jackknife[0]), float(jackknife[1])


def _influence(residual: FloatArray, spread: float) -> tuple[FloatArray, FloatArray]:
    """Return what each epoch does to the level and to the tilt of a robust line, were all weights 1 (Huber).

    The bisquare's psi moves both. Where the jitter is one-sided the spread moves the level too: a wider bisquare looks
    further into the tail.
    """
    u2 = np.clip((residual / (_TUKEY * spread)) ** 2, 0, 1)
    psi = residual * (1 - u2) ** 2
    stiffness = max(float(np.mean((1 - u2) * (1 - 5 * u2))), _LEAST_STIFFNESS)
    pull = float(np.mean(4 * residual * u2 * (1 - u2)))  # of psi, by the logarithm of the spread
    half = spread / _MAD_TO_SIGMA
    size = np.abs(residual)
    spacing = np.mean(size < _STEP * half) - np.mean(size < half / _STEP)
    growth = max(float(spacing) / (2 * np.log(_STEP)), _LEAST_STIFFNESS)
    shift = (_STEP - 1) * half
    lean = float(np.mean(np.abs(residual - shift) < half) - np.mean(np.abs(residual + shift) < half)) / (2 * shift)
    level = psi - pull / growth * ((size < half) - 0.5)
    return level / max(stiffness + pull * lean / growth, _LEAST_STIFFNESS), psi / stiffness
