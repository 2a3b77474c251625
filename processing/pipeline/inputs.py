"""Channels as they come, made ready: latency off, invalid fixes out, GNSS stamps without jitter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from daq import ON_TIME_BASE, Channel, ClockFit, DataError, FloatArray, VehicleConfig, fit_clock
from processing.pipeline.collection import Samples
from processing.timebase import as_of

MODEL_ROLES = tuple(channel.role for channel in ON_TIME_BASE if channel.required)
"""Channels that a used sample must have, where the run carries them at all."""
_AIDS = ("ground_speed_valid", "latitude", "longitude", "gnss_time")
_STALE_INTERVALS = 1.75


def ready(
    chunks: Iterable[Mapping[str, Channel]], vehicle: VehicleConfig, seen: set[str], *, with_angle: bool
) -> Iterator[dict[str, Channel]]:
    """Take each role's declared latency off its stamps and drop roles that processing has no use for.

    Parameters
    ----------
    chunks : iterable of mapping role -> Channel
    seen : set of str
        Gets every role that came.
    with_angle : bool
        Whether the wheel angle is of use.
    """
    roles = (*(channel.role for channel in ON_TIME_BASE), *_AIDS, *(("wheel_angle",) if with_angle else ()))
    for chunk in chunks:
        seen |= set(chunk)
        yield {role: _on_time(role, chunk[role], vehicle) for role in roles if role in chunk}


def _on_time(role: str, channel: Channel, vehicle: VehicleConfig) -> Channel:
    return Channel(role, channel.unit, channel.time_ns - latency_ns(vehicle, role), channel.values)


def latency_ns(vehicle: VehicleConfig, role: str) -> int:
    """Return a role's declared latency; the validity flag travels with its ground speed."""
    return round(vehicle.latency_s("ground_speed" if role == "ground_speed_valid" else role) * 1e9)


def without_invalid_fixes(speed: Samples, flags: Samples) -> Samples:
    """Take out the ground speeds that the receiver calls invalid, or of which it says nothing.

    The flag is joined as of each speed's stamp and may be 1.75 of its own intervals old; 0 is invalid.
    """
    if not len(flags.time_ns):
        return replace(_keep(speed, np.zeros(len(speed.time_ns), np.bool_)), invalid_ns=speed.time_ns)
    interval_s = flags.interval_s if np.isfinite(flags.interval_s) else 0.0
    index = as_of(speed.time_ns, flags.time_ns, round(_STALE_INTERVALS * interval_s * 1e9))
    valid = (index >= 0) & (flags.values[np.maximum(index, 0)] > 0.5)
    return replace(_keep(speed, valid), invalid_ns=speed.time_ns[~valid])


def fit_gnss_clock(gnss_time: Samples) -> ClockFit | None:
    """Fit GNSS time to the host's clock; None with too few epochs."""
    try:
        return fit_clock(gnss_time.time_ns, gnss_time.values)
    except DataError:
        return None


def without_jitter(speed: Samples, gnss_time: Samples, clock: ClockFit, lag_ns: int) -> Samples:
    """Move each speed's stamp by what the GNSS time of the same fix says it came too late.

    Done only where GNSS time is steadier than the arrival stamps, and only for stamps that have the GNSS time of their
    own epoch within half an interval.

    Parameters
    ----------
    clock : ClockFit
        Of `gnss_time`.
    lag_ns : int
        Latency taken off the stamps of `speed` less that of `gnss_time`.
    """
    fresh = np.diff(gnss_time.values, prepend=np.nan) != 0
    host_ns, gnss_s = gnss_time.time_ns[fresh], gnss_time.values[fresh]
    if len(host_ns) < 3 or not _scatter(np.diff(gnss_s)) < _scatter(np.diff(host_ns) * 1e-9):
        return speed
    arrival = speed.time_ns + lag_ns
    after = np.clip(np.searchsorted(host_ns, arrival), 1, len(host_ns) - 1)
    nearest = after - (arrival - host_ns[after - 1] < host_ns[after] - arrival)
    close = np.abs(arrival - host_ns[nearest]) < 0.5e9 * speed.interval_s
    late_s = clock.delays_s(host_ns[nearest], gnss_s[nearest])
    move = close & (np.abs(late_s) < 0.5 * speed.interval_s)
    time_ns = speed.time_ns - np.where(move, np.round(late_s * 1e9), 0).astype(np.int64)
    if np.any(np.diff(time_ns) <= 0):
        return speed
    return replace(speed, time_ns=time_ns)


def without_null_island(latitude: Samples, longitude: Samples) -> tuple[Samples, Samples]:
    """Take out the positions at exactly 0 N 0 E: what receivers send without a fix."""
    return _without_zero(latitude, longitude), _without_zero(longitude, latitude)


def _without_zero(one: Samples, other: Samples) -> Samples:
    index = as_of(one.time_ns, other.time_ns, round(1e9 * np.nan_to_num(one.interval_s)))
    if not len(other.time_ns):
        return one
    return _keep(one, ~((one.values == 0) & (index >= 0) & (other.values[np.maximum(index, 0)] == 0)))


def _keep(samples: Samples, rows: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Samples:
    return replace(samples, time_ns=samples.time_ns[rows], values=samples.values[rows], count=int(rows.sum()))


def _scatter(values: FloatArray) -> float:
    return float(np.median(np.abs(values - np.median(values))))
