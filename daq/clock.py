r"""GNSS time against the host's clock: offset, drift and jitter by a robust straight line.

Frames are stamped by the host when they arrive; GNSS says when they were measured. With e = GNSS - host,

.. math:: e_i = a + b (h_i - h_0) + \text{jitter}_i ,

-a is the offset of the host's clock plus the mean delay of the frames (the two cannot be told apart), -b its drift. A
few frames that queued, or a receiver that starts with a wrong time, do not move the line. GNSS time may count from
midnight, from the start of the week or from an epoch, and may roll over: everything is taken modulo a day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_DAY_S = 86_400.0
_TUKEY = 4.685
_MAD_TO_SIGMA = 1.4826
_LEAST_EPOCHS = 5


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
    """

    offset_s: float
    drift_ppm: float
    residual_s: float
    epochs: int
    outliers: int
    reference_ns: int

    def delays_s(self, host_ns: IntArray, gnss_s: FloatArray) -> FloatArray:
        """Return how much later than usual each frame arrived; shape of the inputs.

        Parameters
        ----------
        host_ns : int64 array
            Arrival stamps.
        gnss_s : float64 array
            GNSS time in the same frames.
        """
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
        GNSS time in the frames; NaN is left out, of repeats the first counts.

    Raises
    ------
    DataError
        Fewer than five different epochs.
    """
    fresh = np.isfinite(gnss_s)
    host_ns, gnss_s = host_ns[fresh], gnss_s[fresh]
    fresh = np.diff(gnss_s, prepend=np.nan) != 0
    host_ns, gnss_s = host_ns[fresh], gnss_s[fresh]
    if len(gnss_s) < _LEAST_EPOCHS:
        raise DataError(
            Fault("GNSS time cannot be fitted", found=f"{len(gnss_s)} epochs", expected=f"{_LEAST_EPOCHS} or more")
        )
    reference_ns = int(host_ns[len(host_ns) // 2])
    elapsed = (host_ns - reference_ns) * 1e-9
    apart: FloatArray = elapsed + (reference_ns * 1e-9) % _DAY_S - gnss_s
    centre = _circular_centre(apart)
    offset, drift, weight, spread = _robust_line(np.asarray(elapsed), _wrapped(apart - centre))
    return ClockFit(
        offset_s=float(_wrapped(np.array(offset + centre))),
        drift_ppm=drift * 1e6,
        residual_s=spread,
        epochs=len(gnss_s),
        outliers=int(np.sum(weight == 0)),
        reference_ns=reference_ns,
    )


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
        weight = np.clip(1 - (residual / (_TUKEY * max(spread, 1e-7))) ** 2, 0, None) ** 2
        x_mean, y_mean = np.average(x, weights=weight), np.average(y, weights=weight)
        variance = np.average((x - x_mean) ** 2, weights=weight)
        if variance <= 0:
            break
        slope = float(np.average((x - x_mean) * (y - y_mean), weights=weight) / variance)
        intercept = float(y_mean - slope * x_mean)
    return intercept, slope, weight, spread
