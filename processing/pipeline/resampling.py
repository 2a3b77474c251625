"""Every role through the common filter onto the common time base, with a reason where it cannot be."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from daq import BRIDGED_INTERVALS, BoolArray, FloatArray, Note
from processing import Reason, RunCode, SensorFacts
from processing.options import HIGHEST_AUTOMATIC_CUTOFF_HZ, ProcessOptions
from processing.pipeline.collection import Samples, rethin
from processing.pipeline.filters import CUTOFF_PER_RATE, Smoothed, filtered_sigma, kernel_sigma_s, smooth
from processing.timebase import interpolate, nearest, seconds_since, stretches

_RETHIN_PER_SIGMA = 1 / 6


@dataclass(frozen=True)
class OnBase:
    """One role on the time base; arrays of shape (n,).

    Attributes
    ----------
    values, slope : float64 arrays
        Filtered signal and its derivative per second (kept of speeds only, else all NaN); NaN in gaps.
    reason : uint8 array
        `Reason.USED`, or why there is no value, or `Reason.FILTER_EDGE`.
    """

    values: FloatArray
    slope: FloatArray
    reason: NDArray[np.uint8]
    facts: SensorFacts


def choose_cutoff(samples: dict[str, Samples], options: ProcessOptions) -> tuple[float, list[Note]]:
    """Return the cut-off in Hz that every given channel can bear, and a note if that is not what was asked."""
    spacings = {role: s.sampling.spacing_s for role, s in samples.items() if isfinite(s.sampling.spacing_s)}
    asked = options.cutoff_hz or min(HIGHEST_AUTOMATIC_CUTOFF_HZ, options.rate_hz / 10)
    if not spacings:
        return asked, []
    slowest = max(spacings, key=lambda role: spacings[role])
    bearable = CUTOFF_PER_RATE / spacings[slowest]
    if bearable >= asked:
        return asked, []
    of = samples[slowest].sampling
    facts = {
        "role": slowest,
        "rate_hz": of.rate_hz,
        "held_s": of.spacing_s if of.in_bursts else 0.0,
        "cutoff_hz": bearable,
        "asked_hz": options.cutoff_hz,
    }
    return bearable, [Note(RunCode.CUTOFF_LOWERED, values=facts)]


def gap_limit_s(samples: Samples, kernel_s: float, options: ProcessOptions) -> float:
    """Return the longest hole in s that is bridged: 1.75 own intervals, or what the options or the kernel allow."""
    own = BRIDGED_INTERVALS * max(float(np.nan_to_num(samples.sampling.spacing_s)), samples.node_s)
    return max(own, options.max_gap_s or kernel_s)


def received_span_ns(samples: Samples, limit_s: float) -> tuple[int, int]:
    """Return first and last stamp of what was received, leaving out one or two stamps far from all others."""
    received = samples.received_ns()
    pairs = stretches(seconds_since(received, int(received[0])), limit_s, least=3)
    if not len(pairs):
        return int(received[0]), int(received[-1])
    return int(received[pairs[0, 0]]), int(received[pairs[-1, 1] - 1])


def put_on_base(
    samples: Samples,
    start_ns: int,
    time_s: FloatArray,
    cutoff_hz: float,
    options: ProcessOptions,
    declared: tuple[float, float | None],
    *,
    keep_slope: bool,
) -> OnBase:
    """Filter one role onto the time base; `declared` is latency (s) and sigma of the sensor."""
    kernel_s = kernel_sigma_s(cutoff_hz)
    limit_s = gap_limit_s(samples, kernel_s, options)
    samples = rethin(samples, kernel_s * _RETHIN_PER_SIGMA)
    at = seconds_since(samples.time_ns, start_ns)
    smoothed = smooth(time_s, at, samples.values, kernel_s, limit_s, samples.spread_s2)
    residuals = samples.values - np.interp(at, time_s, smoothed.values, nan, nan)
    sigma, source = filtered_sigma(samples, residuals, kernel_s, declared[1])
    return OnBase(
        smoothed.values,
        smoothed.slope if keep_slope else np.broadcast_to(np.float64(nan), time_s.shape),
        _reasons(samples, smoothed, start_ns, time_s, limit_s),
        _facts(samples, at, limit_s, declared[0], sigma, source),
    )


def interpolated_on_base(
    samples: Samples, start_ns: int, time_s: FloatArray, *, turn: float | None = None
) -> FloatArray:
    """Interpolate linearly between samples, not across gaps; `turn` is the period of an angle (longitude: 360)."""
    at = seconds_since(samples.time_ns, start_ns)
    values = samples.values if turn is None else np.unwrap(samples.values, period=turn)
    out = interpolate(time_s, at, values, BRIDGED_INTERVALS * np.nan_to_num(samples.sampling.spacing_s))
    return out if turn is None else (out + turn / 2) % turn - turn / 2


def _reasons(
    samples: Samples, smoothed: Smoothed, start_ns: int, time_s: FloatArray, limit_s: float
) -> NDArray[np.uint8]:
    reason = np.where(smoothed.edge, Reason.FILTER_EDGE, Reason.USED).astype(np.uint8)
    empty = np.flatnonzero(~smoothed.covered)
    reason[empty] = Reason.GAP
    for stamps_ns, why in (
        (samples.invalid_ns, Reason.INVALID_FIX),
        (samples.absent_ns, Reason.NOT_MEASURED),
        (samples.faulty_ns, Reason.SENSOR_FAULT),
        (samples.distrusted_ns, Reason.TRANSDUCER),
    ):
        stamps = seconds_since(stamps_ns, start_ns)
        reason[empty[_near(time_s[empty], stamps, limit_s)]] = why
    return reason


def _near(at_s: FloatArray, stamps_s: FloatArray, limit_s: float) -> BoolArray:
    """Return which instants have a stamp within the limit."""
    if not len(stamps_s):
        return np.zeros(len(at_s), np.bool_)
    return np.asarray(np.abs(stamps_s[nearest(at_s, stamps_s)] - at_s) <= limit_s)


def _facts(
    samples: Samples, at: FloatArray, limit_s: float, latency_s: float, sigma: float, source: str
) -> SensorFacts:
    steps = np.diff(at)
    return SensorFacts(
        samples=samples.count,
        late=samples.late,
        rate_hz=samples.sampling.rate_hz,
        gaps=int(np.sum(steps > limit_s)),
        longest_gap_s=float(steps.max()) if len(steps) else nan,
        latency_s=latency_s,
        sigma=sigma,
        sigma_source=source,
    )
