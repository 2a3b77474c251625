"""Clocks: the sensors' sampling clocks and the host clock that stamps their messages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class HostClock:
    """The logger's clock against UTC, and what happens between a sensor's message and its time stamp.

    Attributes
    ----------
    offset_s : float
        Host minus UTC at the start of the campaign; positive: the host is ahead.
    drift_ppm : float
        How much faster than UTC the host runs.
    jitter_s : float
        Mean of the exponential delay between the end of a measurement's latency and its message.
    """

    offset_s: float = 0.25
    drift_ppm: float = 8.0
    jitter_s: float = 60e-6

    def stamps_ns(
        self,
        time_s: FloatArray,
        start_ns: int,
        elapsed_s: float,
        rng: np.random.Generator,
    ) -> NDArray[np.int64]:
        """Return host time stamps of messages; whole microseconds, never decreasing.

        Parameters
        ----------
        time_s : float64 array, shape (n,)
            True time at which each message is ready, since the start of the run.
        start_ns : int
            UTC of the start of the run.
        elapsed_s : float
            From the start of the campaign to the start of the run.
        rng : numpy.random.Generator
        """
        late = time_s + rng.exponential(self.jitter_s, len(time_s)) if self.jitter_s else time_s
        error = self.offset_s + self.drift_ppm * 1e-6 * (elapsed_s + late)
        microseconds = np.round((late + error) * 1e6).astype(np.int64)
        return np.maximum.accumulate(start_ns + microseconds * 1000)


def sample_times_s(duration_s: float, rate_hz: float, clock_ppm: float, rng: np.random.Generator) -> FloatArray:
    """Return the instants at which a free-running sensor samples within a run: random phase, own clock error.

    Parameters
    ----------
    duration_s, rate_hz : float
    clock_ppm : float
        How much faster than true time the sensor's clock runs.
    rng : numpy.random.Generator
        Draws the phase.
    """
    period = 1.0 / (rate_hz * (1.0 + clock_ppm * 1e-6))
    phase = rng.uniform(0.0, period)
    count = int((duration_s - 1.0 / rate_hz - phase) / period) + 1
    return np.asarray(phase + period * np.arange(count), np.float64)
