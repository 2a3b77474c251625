"""Why samples are excluded, by hand too, in which shares, and what is to be noted of the run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from daq import REACTIONS, ROLES, BoolArray, ConfigError, Fault, FloatArray, Note, Severity
from processing import ProcessedRun, Reason, RunCode, Segment, SensorFacts, Standstill
from processing.pipeline.latency import SpeedComparison

_RING_DELAY_S = 0.015
"""One-sigma of what the estimate owes to a toothed ring, which at low speed is later than its declared delay."""
_NOTABLE_GAP_SHARE = 0.1
_MOSTLY = 0.5

Interval = tuple[float, float]
"""First and last second, since the time base of the run begins."""
_ROUNDED_S = 1.0
"""People round a run's end up."""


def combine_reasons(
    channels: Iterable[NDArray[np.uint8]],
    segments: NDArray[np.uint8],
    slip: FloatArray,
    vertical_load_n: FloatArray,
    *,
    slip_is_measured: bool = True,
    steered: BoolArray | None = None,
) -> NDArray[np.uint8]:
    """Return the first `Reason` that holds for each sample; all arrays of shape (n,).

    `channels` are the reasons of each channel that a used sample must have. The slip is NaN where both speeds are too
    small (or unknown, which the channels' reasons say); it is measured where the run carries both speeds. `steered` is
    where the ground speed is that of an antenna in a curve and not that of the wheel.
    """
    of_channels = np.stack(list(channels))
    hold = {
        why: (of_channels == why).any(axis=0)
        for why in (
            Reason.GAP,
            Reason.INVALID_FIX,
            Reason.TRANSDUCER,
            Reason.SENSOR_FAULT,
            Reason.NOT_MEASURED,
            Reason.FILTER_EDGE,
        )
    }
    hold[Reason.STANDSTILL] = segments == Segment.STANDSTILL
    hold[Reason.TOO_SLOW if slip_is_measured else Reason.SLIP_NOT_MEASURED] = ~np.isfinite(slip)
    hold[Reason.NEGATIVE_LOAD] = vertical_load_n <= 0
    hold[Reason.SLIP_OUT_OF_RANGE] = np.abs(slip) > 1
    if steered is not None:
        hold[Reason.STEERED] = steered
    out = np.zeros(len(slip), np.uint8)
    for why in sorted(hold, key=_precedence, reverse=True):
        out[hold[why]] = why
    return out


def _precedence(why: Reason) -> float:
    """Return the place of a reason: that of its number, but what a sensor says or shows comes before what it causes."""
    early = {Reason.TRANSDUCER: 0.4, Reason.SENSOR_FAULT: 0.6}
    return Reason.INVALID_FIX + early[why] if why in early else float(why)


def shares_of(reason: NDArray[np.uint8]) -> dict[str, float]:
    """Return the share of samples per `Reason` name, those that occur and USED; they sum to 1."""
    counts = np.bincount(reason, minlength=len(Reason))
    return {why.name: float(counts[why] / len(reason)) for why in Reason if counts[why] or why is Reason.USED}


def keep_only(run: ProcessedRun, keep: Sequence[Interval], where: str = "") -> ProcessedRun:
    """Return the run with what lies outside `keep` excluded by hand.

    A used sample outside becomes `Reason.BY_HAND`; one that was excluded anyway keeps its reason. A standstill counts
    only where it lies inside as a whole. Both ends of an interval belong to it; `where` says who asks, for messages.

    Raises
    ------
    ConfigError
        Intervals that reach beyond the run.
    """
    check_within(keep, float(run.time_s[-1]), where)
    reason = with_by_hand(run.reason, run.time_s, keep)
    standstills = tuple(
        stand
        for stand in run.quality.standstills
        if any(first <= stand.start_s and stand.start_s + stand.duration_s <= last for first, last in keep)
    )
    quality = replace(run.quality, shares=shares_of(reason), standstills=standstills)
    return replace(run, reason=reason, quality=quality)


def without_frozen(run: ProcessedRun, frozen: Mapping[str, BoolArray]) -> ProcessedRun:
    """Return the run with frozen rows, shape (n,) by role, excluded as a fault of the sensor, which is noted."""
    rows = np.any([*frozen.values(), np.zeros(len(run), np.bool_)], axis=0)
    reason = np.where((run.reason == Reason.USED) & rows, np.uint8(Reason.SENSOR_FAULT), run.reason)
    notes = []
    for role, held in frozen.items():
        facts = {"role": role, "kind": "frozen", "value": float(np.median(run.column(ROLES[role].field)[held]))}
        seconds = {"time_s": float(held.sum()) / run.rate_hz, "share": float(held.mean())}
        notes.append(Note(RunCode.SENSOR_FAULT, Severity.DOUBT, facts | seconds))
    quality = replace(run.quality, shares=shares_of(reason), notes=(*run.quality.notes, *notes))
    return replace(run, reason=reason, quality=quality)


def check_within(keep: Sequence[Interval], end_s: float, where: str = "") -> None:
    """See that intervals lie within a run whose time base ends at `end_s`, but for a rounded last end.

    Raises
    ------
    ConfigError
        Those that do not.
    """
    beyond = [(first, last) for first, last in keep if first < 0 or first > end_s or last > end_s + _ROUNDED_S]
    ConfigError.stop_if_any(_beyond(interval, end_s, where) for interval in beyond)


def with_by_hand(reason: NDArray[np.uint8], time_s: FloatArray, keep: Sequence[Interval]) -> NDArray[np.uint8]:
    """Return the reasons, shape (n,), with used samples outside `keep` excluded by hand."""
    inside = np.zeros(len(time_s), np.bool_)
    for first, last in keep:
        inside |= (time_s >= first) & (time_s <= last)
    return np.where((reason == Reason.USED) & ~inside, np.uint8(Reason.BY_HAND), reason)


def _beyond(interval: Interval, end_s: float, where: str) -> Fault:
    return Fault(
        "what is to be kept reaches beyond the run",
        where,
        found=f"{interval[0]:g} to {interval[1]:g} s",
        expected=f"within 0 to {end_s:.2f} s",
        next_step="mend keep; the seconds count from the first sample of the run's time base",
    )


def sensor_notes(sensors: dict[str, SensorFacts]) -> Iterator[Note]:
    """Yield notes on channels whose stamps or samples are poor."""
    for role, facts in sensors.items():
        if facts.late:
            yield Note(RunCode.LATE_STAMPS, Severity.DOUBT, {"role": role, "count": facts.late})
        if not facts.samples:
            yield Note(RunCode.NEVER_USABLE, Severity.DOUBT, {"role": role})
        elif not np.isfinite(facts.sigma):
            yield Note(RunCode.NOISE_UNKNOWN, values={"role": role})


def speed_notes(speeds: SpeedComparison, sensors: dict[str, SensorFacts]) -> Iterator[Note]:
    """Yield notes on ground speed against wheel speed.

    A late ground speed has one likely cause, a delay that is not declared; an early one has several, so that no number
    is proposed.
    """
    latency_s, sigma_s = speeds.latency_s, speeds.latency_sigma_s
    if abs(latency_s) > 3 * hypot(_RING_DELAY_S, sigma_s):
        declared_s = {role: sensors[role].latency_s for role in ("ground_speed", "wheel_speed")}
        values = {"latency_s": latency_s, "sigma_s": sigma_s, "declared_s": declared_s["ground_speed"]}
        if latency_s > 0:
            whole_s = declared_s["ground_speed"] + latency_s
            yield Note(RunCode.GROUND_SPEED_LATE, Severity.DOUBT, values | {"whole_s": whole_s})
        else:
            values["wheel_declared_s"] = declared_s["wheel_speed"]
            yield Note(RunCode.GROUND_SPEED_EARLY, Severity.DOUBT, values)


def run_notes(
    segments: NDArray[np.uint8], gaps: dict[str, NDArray[np.uint8]], standing: tuple[Standstill, ...]
) -> Iterator[Note]:
    """Yield notes on the run as a whole; `gaps` are the reasons of each channel."""
    if not standing:
        yield Note(RunCode.NO_STANDSTILL)
    yield from _zero_notes(standing)
    for role, channel in gaps.items():
        share = float(np.mean((channel == Reason.GAP) | (channel == Reason.NOT_MEASURED)))
        if share > _NOTABLE_GAP_SHARE:
            yield Note(RunCode.CHANNEL_GAPS, Severity.DOUBT, {"role": role, "share": share})
    standing_share = float(np.mean(segments == Segment.STANDSTILL))
    if standing_share > _MOSTLY:
        yield Note(RunCode.MOSTLY_STANDING, values={"share": standing_share})


def _zero_notes(standing: tuple[Standstill, ...]) -> Iterator[Note]:
    for channel in REACTIONS.values():
        role = channel.role
        seen = [(s.levels[role], s.sigmas[role]) for s in standing if role in s.levels]
        if seen and all(abs(level) > 3 * sigma for level, sigma in seen):
            levels, sigmas = zip(*seen, strict=True)
            brakes = tuple(sorted({s.brakes for s in standing if role in s.levels}))
            facts = {"role": role, "levels": levels, "sigmas": sigmas, "brakes": brakes}
            yield Note(RunCode.ZERO_AT_STANDSTILL, values=facts)
