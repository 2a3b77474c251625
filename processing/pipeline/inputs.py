"""Channels made ready: latency off, invalid fixes and distrusted samples out, GNSS stamps without jitter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from daq import (
    BRIDGED_INTERVALS,
    ON_TIME_BASE,
    TRANSDUCER_ROLES,
    BoolArray,
    Channel,
    ClockFit,
    DataError,
    FloatArray,
    IntArray,
    Note,
    VehicleConfig,
    fit_clock,
    mean_interval_ns,
)
from processing.notes import RunCode
from processing.pipeline.collection import Samples
from processing.pipeline.resampling import OnBase
from processing.robust import robust_spread
from processing.timebase import as_of, nearest

MODEL_ROLES = tuple(channel.role for channel in ON_TIME_BASE if channel.required)
"""Channels that a used sample must have, where the run carries them at all."""
_AIDS = ("ground_speed_valid", "latitude", "longitude", "gnss_time", "brake")
_HELD_INTERVALS = 5
_HELD_NS = 100_000_000
_REMEMBERED = 1000
_NOTABLE_SHARE = 0.001


def ready(
    chunks: Iterable[Mapping[str, Channel]], vehicle: VehicleConfig, seen: set[str], *, with_angle: bool
) -> Iterator[dict[str, Channel]]:
    """Take each role's declared latency off its stamps and drop roles that processing has no use for.

    `seen` gets every role that came; `with_angle` is whether the wheel angle is of use.
    """
    roles = (*(channel.role for channel in ON_TIME_BASE), *_AIDS, *(("wheel_angle",) if with_angle else ()))
    for chunk in chunks:
        seen |= set(chunk)
        yield {
            role: Channel(role, chunk[role].unit, chunk[role].time_ns - latency_ns(vehicle, role), chunk[role].values)
            for role in roles
            if role in chunk
        }


def latency_ns(vehicle: VehicleConfig, role: str) -> int:
    """Return a role's declared latency; the validity flag travels with its ground speed."""
    return round(vehicle.latency_s("ground_speed" if role == "ground_speed_valid" else role) * 1e9)


def without_invalid_fixes(speed: Samples, flags: Samples) -> Samples:
    """Take out the ground speeds that the receiver calls invalid, or of which it says nothing.

    The flag is joined as of each speed's stamp and may be 1.75 of its own intervals old; 0 is invalid.
    """
    if not len(flags.time_ns):
        return replace(_keep(speed, np.zeros(len(speed.time_ns), np.bool_)), invalid_ns=speed.time_ns)
    stale_s = BRIDGED_INTERVALS * float(np.nan_to_num(flags.sampling.spacing_s))
    index = as_of(speed.time_ns, flags.time_ns, round(stale_s * 1e9))
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
    own epoch within half an interval. `lag_ns` is the latency taken off the stamps of `speed` less that of `gnss_time`.
    """
    fresh = np.diff(gnss_time.values, prepend=np.nan) != 0
    host_ns, gnss_s = gnss_time.time_ns[fresh], gnss_time.values[fresh]
    if len(host_ns) < 3 or not _scatter(np.diff(gnss_s)) < _scatter(np.diff(host_ns) * 1e-9):
        return speed
    arrival = speed.time_ns + lag_ns
    epoch = nearest(arrival, host_ns)
    close = np.abs(arrival - host_ns[epoch]) < 0.5e9 * speed.sampling.interval_s
    late_s = clock.delays_s(host_ns[epoch], gnss_s[epoch])
    move = close & (np.abs(late_s) < 0.5 * speed.sampling.interval_s)
    time_ns = speed.time_ns - np.where(move, np.round(late_s * 1e9), 0).astype(np.int64)
    if np.any(np.diff(time_ns) <= 0):
        return speed
    return replace(speed, time_ns=time_ns)


def without_null_island(latitude: Samples, longitude: Samples) -> tuple[Samples, Samples]:
    """Take out the positions at exactly 0 N 0 E: what receivers send without a fix."""
    return _without_zero(latitude, longitude), _without_zero(longitude, latitude)


def _without_zero(samples: Samples, other: Samples) -> Samples:
    index = as_of(samples.time_ns, other.time_ns, round(1e9 * np.nan_to_num(samples.sampling.spacing_s)))
    if not len(other.time_ns):
        return samples
    return _keep(samples, ~((samples.values == 0) & (index >= 0) & (other.values[np.maximum(index, 0)] == 0)))


def _keep(samples: Samples, rows: BoolArray) -> Samples:
    return replace(samples, time_ns=samples.time_ns[rows], values=samples.values[rows], count=int(rows.sum()))


def _scatter(values: FloatArray) -> float:
    return robust_spread(values - np.median(values))


def status_at(time_ns: IntArray, stamps_ns: IntArray, values: FloatArray, intervals_ns: IntArray) -> FloatArray:
    """Return the status that is nearest to each instant, minus infinity where none is near enough.

    A status holds for five of its mean intervals, and 0.1 s at the least, for frames may arrive late. Its stamps and
    values, shape (k,), are in order of time.
    """
    if not len(stamps_ns):
        return np.full(len(time_ns), -np.inf)
    nearer = nearest(time_ns, stamps_ns)
    usual_ns = float(np.nan_to_num(mean_interval_ns(intervals_ns)))
    held = np.abs(time_ns - stamps_ns[nearer]) <= max(_HELD_INTERVALS * usual_ns, _HELD_NS)
    return np.where(held, values[nearer], -np.inf)


class StatusGate:
    """Takes distrusted samples out of a stream and remembers where and why.

    A sample has the status whose stamp is nearest to its own: in the same frame it is exact, and so it is where a
    sample's messages follow each other. Where none is near (see `status_at`) nothing is known, and the sample is kept
    and counted. Rolling counters are not looked at: what is missing shows as a gap. `node_ns` is the grid on which the
    instants of distrusted samples are kept. A `declared` status (vehicle.toml names one) is missed where it does not
    come.
    """

    def __init__(self, node_ns: int, *, declared: bool) -> None:
        self._node_ns = node_ns
        self._declared = declared
        self._came = False
        self._intervals_ns = np.zeros(0, np.int64)
        self._seen: dict[str, int] = {}
        self._unknown: dict[str, int] = {}
        self._last: tuple[IntArray, FloatArray] = (np.zeros(0, np.int64), np.zeros(0))
        self._where: dict[str, list[IntArray]] = {}
        self._excluded: dict[str, int] = {}
        self.words: dict[str, int] = {}
        """Status samples that are not 0, by what the value table calls them."""

    def without_distrusted(self, chunks: Iterable[Mapping[str, Channel]]) -> Iterator[dict[str, Channel]]:
        """Yield the chunks without the distrusted samples; stamps as they were received."""
        for chunk in chunks:
            kept = dict(chunk)
            if "transducer_status" in chunk:
                self._take(chunk["transducer_status"])
            if self._came or self._declared:
                kept |= {role: self._trusted(role, chunk[role]) for role in TRANSDUCER_ROLES if role in chunk}
            yield kept
            self._last = (self._last[0][-1:], self._last[1][-1:])

    def marked(self, samples: dict[str, Samples], vehicle: VehicleConfig) -> dict[str, Samples]:
        """Return the samples with the instants at which the transducer distrusted them, declared latency taken off."""
        marked = dict(samples)
        for role in self._where.keys() & samples.keys():
            stamps = np.unique(np.concatenate(self._where[role])) - latency_ns(vehicle, role)
            marked[role] = replace(samples[role], distrusted_ns=stamps)
        return marked

    def with_counts(self, roles: dict[str, OnBase]) -> dict[str, OnBase]:
        """Return the roles with the number of samples excluded in their facts."""
        return roles | {
            role: replace(roles[role], facts=replace(roles[role].facts, distrusted=count))
            for role, count in self._excluded.items()
            if role in roles
        }

    def notes(self) -> Iterator[Note]:
        """Yield notes on what was excluded, and on what the status did not tell."""
        if self._excluded:
            count = max(self._excluded.values())
            yield Note(RunCode.DISTRUSTED, values={"count": count, "statuses": dict(self.words)})
        unknown, seen = (max(counts.values(), default=0) for counts in (self._unknown, self._seen))
        if seen and not self._came:
            yield Note(RunCode.STATUS_NEVER_CAME)
        elif unknown > _NOTABLE_SHARE * seen:
            yield Note(RunCode.STATUS_UNKNOWN, values={"count": unknown, "total": seen})

    def _take(self, status: Channel) -> None:
        time_ns = np.concatenate([self._last[0], status.time_ns])
        values = np.concatenate([self._last[1], status.values])
        order = np.argsort(time_ns, kind="stable")
        self._last = (time_ns[order], values[order])
        self._came |= bool(len(time_ns))
        self._intervals_ns = np.concatenate([self._intervals_ns, np.diff(time_ns[order])])[-_REMEMBERED:]
        numbers, counts = np.unique(status.values[status.values != 0], return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            word = "no status" if number != number else status.labels.get(int(number), f"{number:g}")
            self.words[word] = self.words.get(word, 0) + count

    def _trusted(self, role: str, channel: Channel) -> Channel:
        values = status_at(channel.time_ns, *self._last, self._intervals_ns)
        unknown = np.isneginf(values)
        bad = (values != 0) & ~unknown
        self._seen[role] = self._seen.get(role, 0) + len(values)
        self._unknown[role] = self._unknown.get(role, 0) + int(np.count_nonzero(unknown))
        if not bad.any():
            return channel
        stamps = channel.time_ns[bad]
        nodes = np.unique(stamps // self._node_ns) * self._node_ns + self._node_ns // 2
        self._where.setdefault(role, []).append(nodes)
        self._excluded[role] = self._excluded.get(role, 0) + len(stamps)
        return replace(channel, time_ns=channel.time_ns[~bad], values=channel.values[~bad])
