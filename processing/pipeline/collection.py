"""Chunks of channels in, one ordered series per role out; kilohertz channels are thinned on the way.

A recording may be larger than memory, so raw samples are not kept where they come much faster than the time base:
`thin` shares each sample between the two nearest nodes of a grid, the nearer node taking the larger part. That is a
triangular kernel two nodes wide: tones near the node rate are damped by 50 dB before they could fold, and what the
kernel adds to the filter is a variance of time, which is measured and taken off the filter again (`filters.smooth`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from daq import BoolArray, Channel, FloatArray, IntArray, Sampling, SamplingEstimator, mean_interval_ns, sampling_of
from processing.robust import roughness
from processing.timebase import LATE_NS, in_order, merge_equal_stamps

_FIRST_ROOM = 1 << 14
_GROWTH = 8
_FLUSH = 1 << 14
_LOOK = 1 << 12
"""So many samples of a piece are looked at for resolution and roughness."""
_LONG_AGO_NS = -(2**62)
_ROGUE_NS = 60_000_000_000
"""A last stamp this far from the one before may be rogue: what follows is not held against it."""
_THIN_BELOW = 0.5
"""Thin where the sampling interval is less than this share of a node."""


class GrowingSeries:
    """Stamps and values, appended to. Room is added by an eighth, which the system does without copying."""

    def __init__(self) -> None:
        self._time_ns: IntArray = np.zeros(0, np.int64)
        self._values: FloatArray = np.zeros(0)
        self._count = 0

    def append(self, time_ns: IntArray, values: FloatArray) -> None:
        """Copy samples to the end."""
        end = self._count + len(values)
        if end > len(self._values):
            self._resize(end + max(_FIRST_ROOM, end // _GROWTH))
        self._time_ns[self._count : end] = time_ns
        self._values[self._count : end] = values
        self._count = end

    def release(self) -> tuple[IntArray, FloatArray]:
        """Return everything appended, and hold it no longer."""
        self._resize(self._count)
        time_ns, values = self._time_ns, self._values
        self._time_ns, self._values, self._count = np.zeros(0, np.int64), np.zeros(0), 0
        return time_ns, values

    def _resize(self, room: int) -> None:
        self._time_ns.resize(room, refcheck=False)
        self._values.resize(room, refcheck=False)


@dataclass(frozen=True)
class Samples:
    """One role's samples in order, its declared latency removed.

    Attributes
    ----------
    time_ns, values : arrays, shape (n,)
        Stamps strictly ascending, values finite.
    absent_ns : int64 array
        Where frames came without a value (NaN).
    invalid_ns : int64 array
        Where the sensor itself called its value invalid.
    distrusted_ns : int64 array
        Where the transducer's status was not 0, on the grid of the thinning.
    faulty_ns : int64 array
        Where the sensor gave no measurement; see `processing.pipeline.sensor_faults`.
    sampling : Sampling
        How the raw samples came.
    spread_s2 : float
        Variance of the instants that one entry averages; 0 where nothing was thinned.
    node_s : float
        Grid of the thinning; 0 where nothing was thinned.
    step : float
        Resolution of the raw values; 0 where they look continuous.
    rough : float
        One-sigma of what differs from one raw sample to the next; 0 with less than three.
    count, late : int
        Raw finite samples; samples excluded because their stamps ran backward.
    """

    time_ns: IntArray
    values: FloatArray
    absent_ns: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    invalid_ns: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    distrusted_ns: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    faulty_ns: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    sampling: Sampling = field(default_factory=Sampling)
    spread_s2: float = 0.0
    node_s: float = 0.0
    step: float = 0.0
    rough: float = 0.0
    count: int = 0
    late: int = 0

    def received_ns(self) -> IntArray:
        """Return the stamps of everything that came, usable or not, ascending."""
        kinds = (self.absent_ns, self.invalid_ns, self.distrusted_ns, self.faulty_ns)
        others = [stamps for stamps in kinds if len(stamps)]
        return np.unique(np.concatenate([self.time_ns, *others])) if others else self.time_ns


@dataclass(frozen=True)
class Nodes:
    """Sums over the triangle of each node.

    Attributes
    ----------
    number : int64 array, shape (m,)
        Ascending; the node's instant is `number` times the grid.
    sums : float64 array, shape (4, m)
        Of the weights, and weighted: instants less the node's in units of the grid, their squares, values.
    """

    number: IntArray
    sums: FloatArray

    def plus(self, other: Nodes) -> Nodes:
        """Return both together."""
        number = np.union1d(self.number, other.number)
        sums = np.zeros((4, len(number)))
        for nodes in (self, other):
            sums[:, np.searchsorted(number, nodes.number)] += nodes.sums
        return Nodes(number, sums)

    def part(self, rows: BoolArray) -> Nodes:
        """Return some of the nodes."""
        return Nodes(self.number[rows], self.sums[:, rows])

    def entries(self, node_ns: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return mean instant (ns), mean value and variance of the instants (s^2) of each node."""
        ahead, square, value = self.sums[1:] / self.sums[0]
        time_ns = self.number * node_ns + np.round(ahead * node_ns).astype(np.int64)
        return time_ns, value, np.maximum(square - ahead**2, 0.0) * (node_ns * 1e-9) ** 2


def thin(time_ns: IntArray, values: FloatArray, node_ns: int) -> Nodes:
    """Share each sample, one at least, between the two nearest nodes of a grid; stamps must not decrease."""
    interval, remainder = np.divmod(time_ns, node_ns)
    share = remainder / node_ns
    first = np.flatnonzero(np.diff(interval, prepend=interval[0] - 1))
    left = interval[first]
    node = np.union1d(left, left + 1)
    sums = np.zeros((4, len(node)))
    for place, weight, ahead in ((left, 1.0 - share, share), (left + 1, share, share - 1.0)):
        weighted = weight * np.stack([np.ones_like(ahead), ahead, ahead * ahead, values])
        sums[:, np.searchsorted(node, place)] += np.add.reduceat(weighted, first, axis=1)
    return Nodes(node, sums).part(sums[0] > 1e-9)


class Collector:
    """Takes one role's chunks as they come and gives its `Samples` at the end."""

    def __init__(self, node_ns: int) -> None:
        self._node_ns = node_ns
        self._waiting: list[tuple[IntArray, FloatArray]] = []
        self._done = GrowingSeries()
        self._absent: list[IntArray] = []
        self._sampling = SamplingEstimator()
        self._spread_sum, self._entries = 0.0, 0
        self._open: Nodes | None = None
        self._steps: list[float] = []
        self._roughness: list[float] = []
        self._peak_ns = _LONG_AGO_NS
        self._thinned = False
        self._count = 0
        self._late = 0

    def add(self, time_ns: IntArray, values: FloatArray) -> None:
        """Take a chunk; NaN and infinite values are kept as stamps only."""
        finite = np.isfinite(values)
        if not finite.all():
            self._absent.append(np.unique(time_ns[~finite] // self._node_ns) * self._node_ns + self._node_ns // 2)
            time_ns, values = time_ns[finite], values[finite]
        if len(values):
            self._waiting.append((time_ns, values))
            if sum(len(piece) for piece, _ in self._waiting) >= _FLUSH:
                self._flush()

    def finish(self) -> Samples:
        """Return everything taken."""
        self._flush()
        self._close(None)
        time_ns, values = self._done.release()
        if np.any(np.diff(time_ns) < 0):
            order = np.argsort(time_ns, kind="stable")
            time_ns, values = time_ns[order], values[order]
        time_ns, values = merge_equal_stamps(time_ns, values)
        absent_ns = np.unique(np.concatenate([np.zeros(0, np.int64), *self._absent]))
        return Samples(
            time_ns,
            values,
            absent_ns,
            sampling=self._sampling.estimate() if self._count else sampling_of(absent_ns),
            spread_s2=self._spread_sum / max(self._entries, 1),
            node_s=self._node_ns * 1e-9 if self._thinned else 0.0,
            step=min((step for step in self._steps if step > 0), default=0.0),
            rough=float(np.median(self._roughness)) if self._roughness else 0.0,
            count=self._count,
            late=self._late,
        )

    def _flush(self) -> None:
        if not self._waiting:
            return
        stamps, pieces = zip(*self._waiting, strict=True)
        time_ns, values = self._ordered(np.concatenate(stamps), np.concatenate(pieces))
        self._waiting = []
        self._count += len(values)
        self._steps.append(resolution(values[:_LOOK]))
        if len(values) > 2:
            self._roughness.append(roughness(values[:_LOOK]))
        self._sampling.take(time_ns)
        fast = mean_interval_ns(np.diff(time_ns)) < _THIN_BELOW * self._node_ns
        time_ns, values = merge_equal_stamps(time_ns, values)
        if fast:
            self._thinned = True
            nodes = thin(time_ns, values, self._node_ns)
            nodes = nodes if self._open is None else nodes.plus(self._open)
            self._open = nodes
            self._close(int(time_ns[-1]) // self._node_ns)
        elif len(time_ns):
            self._close(None)
            self._done.append(time_ns, values)
            self._entries += len(values)

    def _close(self, growing: int | None) -> None:
        """Turn nodes into entries, but for those from `growing` on, which the next samples still add to."""
        if self._open is None:
            return
        closed = np.full(len(self._open.number), True) if growing is None else self._open.number < growing
        time_ns, values, spread = self._open.part(closed).entries(self._node_ns)
        self._done.append(time_ns, values)
        self._spread_sum += float(spread.sum())
        self._entries += len(values)
        self._open = None if growing is None else self._open.part(~closed)

    def _ordered(self, time_ns: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
        """Order what was gathered; what is behind all that came before it is excluded."""
        before = len(values)
        fresh = time_ns >= self._peak_ns - LATE_NS
        time_ns, values = time_ns[fresh], values[fresh]
        keep = in_order(time_ns)
        time_ns, values = time_ns[keep], values[keep]
        self._late += before - len(values)
        if len(time_ns):
            rogue = len(time_ns) > 1 and time_ns[-1] - time_ns[-2] > _ROGUE_NS
            self._peak_ns = max(self._peak_ns, int(time_ns[-2 if rogue else -1]))
        return time_ns, values


def rethin(samples: Samples, node_s: float) -> Samples:
    """Thin samples further, for a filter so low that the present grid wastes time; the few that come slower stay."""
    typical = max(samples.sampling.interval_s, samples.node_s)
    if not len(samples.time_ns) or not typical < _THIN_BELOW * node_s:
        return samples
    time_ns, values, spread = thin(samples.time_ns, samples.values, round(node_s * 1e9)).entries(round(node_s * 1e9))
    time_ns, values = merge_equal_stamps(time_ns, values)
    spread_s2 = samples.spread_s2 + float(spread.mean())
    return replace(samples, time_ns=time_ns, values=values, spread_s2=spread_s2, node_s=node_s)


def resolution(values: FloatArray) -> float:
    """Return the smallest step between values that occur; 0 where hardly a value occurs twice."""
    levels = np.unique(values)
    if len(levels) > 0.9 * len(values):
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.abs(levels).max()]
    return float(steps.min()) if len(steps) else 0.0


def collect(chunks: Iterable[Mapping[str, Channel]], node_ns: int) -> dict[str, Samples]:
    """Collect every role of a stream of chunks, fast channels thinned to the interval of the time base, `node_ns`."""
    collectors: dict[str, Collector] = {}
    for chunk in chunks:
        for role, channel in chunk.items():
            collectors.setdefault(role, Collector(node_ns)).add(channel.time_ns, channel.values)
    return {role: collectors.pop(role).finish() for role in list(collectors)}
