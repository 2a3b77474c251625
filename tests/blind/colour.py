"""Spectra of noise: several memories at once, or the spectrum of a real recording."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from daq import FloatArray

_STEP_S, _LONGEST_S = 0.005, 120.0


@dataclass(frozen=True)
class Colour:
    """Spectrum of a noise of unit variance.

    Attributes
    ----------
    memories : tuple of (share of the variance, memory in s)
        Ornstein-Uhlenbeck processes that are added; a memory of 0 is white noise from sample to sample.
    spectrum : tuple of (frequency in Hz, relative power)
        In place of memories: power between these frequencies by straight lines in the logarithms, constant below the
        first, none above the last.
    """

    memories: tuple[tuple[float, float], ...] = ()
    spectrum: tuple[tuple[float, float], ...] = ()

    def drawn(self, count: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
        """Draw noise of unit variance, stationary from the start."""
        if self.spectrum:
            return self._shaped(count, rate_hz, rng)
        noise = np.zeros(count)
        for share, memory_s in self.memories:
            noise += np.sqrt(share) * coloured(count, rate_hz, memory_s, rng)
        return noise

    def _shaped(self, count: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
        size = 2 * count  # a Fourier series is periodic: the second half is not used
        gain = np.sqrt(self._power(np.fft.rfftfreq(size, 1 / rate_hz)))
        gain[0] = 0.0
        whole = np.fft.irfft(gain * np.fft.rfft(rng.standard_normal(size)), size)
        weight = np.full(len(gain), 2.0)
        weight[-1] = 1.0
        return np.asarray(whole[:count] / np.sqrt(np.sum(weight * gain**2) / size))

    def _power(self, frequency_hz: FloatArray) -> FloatArray:
        known, power = np.array(self.spectrum).T
        at = np.clip(frequency_hz, known[0], known[-1])
        return np.where(frequency_hz > known[-1], 0.0, np.exp(np.interp(np.log(at), np.log(known), np.log(power))))

    def correlation(self, tau_s: FloatArray) -> FloatArray:
        """Return the correlation at distances in time; white noise has none here."""
        if self.spectrum:
            return np.interp(np.abs(tau_s), *_correlation_of(self))
        apart = np.abs(tau_s)
        return sum(
            (share * np.exp(-apart / memory) for share, memory in self.memories if memory > 0), np.zeros_like(apart)
        )

    @property
    def white(self) -> float:
        """Share of the variance that is white from sample to sample."""
        return sum(share for share, memory in self.memories if not memory)


@lru_cache(maxsize=8)
def _correlation_of(colour: Colour) -> tuple[FloatArray, FloatArray]:
    size = round(2 * _LONGEST_S / _STEP_S)
    power = colour._power(np.fft.rfftfreq(size, _STEP_S))
    power[0] = 0.0
    values = np.fft.irfft(power, size)[: size // 2]
    return np.arange(size // 2) * _STEP_S, values / values[0]


def coloured(count: int, rate_hz: float, memory_s: float, rng: np.random.Generator) -> FloatArray:
    """Return Ornstein-Uhlenbeck noise of unit variance, stationary from the start; white without a memory."""
    keep = np.exp(-1 / (rate_hz * memory_s)) if memory_s else 0.0
    white = rng.standard_normal(count) * np.sqrt(1 - keep**2)
    state = [keep * rng.standard_normal()]
    return np.asarray(lfilter([1.0], [1.0, -keep], white, zi=state)[0], np.float64)


REAL_FORCES = Colour(
    spectrum=(
        (0.22, 0.323),
        (0.36, 0.326),
        (0.57, 0.214),
        (0.91, 0.212),
        (1.46, 0.153),
        (2.34, 0.141),
        (3.75, 0.096),
        (6.0, 0.0402),
        (9.6, 0.0106),
        (15.4, 0.0042),
        (24.7, 0.0019),
        (39.5, 0.00105),
    )
)
"""Horizontal forces of a six-axis transducer while plates and wheels are pressed into sand, rms .2 to 1.2 N at 100 Hz.

Median over 15 recordings of both axes, a curve of fourth degree taken off each: robomechanics/3d-terramechanics (MIT),
commit 55a6e92b, ``cmu-terramech-testbed/pressure_sinkage/*_ft.csv`` of WHEELSOIL_DATA.
"""

REAL_SPEED = Colour(
    spectrum=(
        (0.045, 1.48),
        (0.074, 1.17),
        (0.12, 1.20),
        (0.2, 1.30),
        (0.33, 1.28),
        (0.54, 0.76),
        (0.88, 0.76),
        (1.45, 1.31),
        (2.4, 1.14),
        (3.9, 1.31),
    )
)
"""GNSS speed less wheel speed of a car on a road, .076 m/s rms at 10 Hz over 60 s: commaai/comma2k19 (MIT), commit
4c7f1a6e, ``comma2k19-example1`` of WHEELSOIL_DATA; the lag of .16 s and the scale of 1.0097 are taken out.
"""


def drawn_forces(rng: np.random.Generator) -> Colour:
    """Draw the noise of forces: two or three memories and white, or the spectrum of real recordings in one of four."""
    if rng.random() < 0.25:
        return REAL_FORCES
    bands = ((0.05, 0.2), (0.5, 1.5), (3.0, 8.0))
    kept = bands if rng.random() < 0.5 else bands[:2]
    shares = rng.dirichlet((4.0, 2.0, 1.0)[: len(kept)])
    white = rng.uniform(0.01, 0.1)
    slow = [(float(s * (1 - white)), _log_uniform(rng, *b)) for s, b in zip(shares, kept, strict=True)]
    return Colour(memories=(*slow, (float(white), 0.0)))


def drawn_speed(rng: np.random.Generator) -> Colour:
    """Draw the error of the ground speed: a memory of .1 to 4 s, or the spectrum of a real receiver in one of four."""
    if rng.random() < 0.25:
        return REAL_SPEED
    return Colour(memories=((1.0, _log_uniform(rng, 0.1, 4.0)),))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
