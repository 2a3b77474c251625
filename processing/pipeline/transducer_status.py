"""The transducer's own word on its samples: those whose status is not 0 are left out, for a reason of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from daq import TRANSDUCER_ROLES, Channel, FloatArray, IntArray, Note, VehicleConfig
from processing.notes import RunCode
from processing.pipeline.collection import Samples
from processing.pipeline.inputs import latency_ns
from processing.pipeline.resampling import OnBase

_HELD_INTERVALS = 5
_HELD_NS = 100_000_000
_REMEMBERED = 1000
_NOTABLE_SHARE = 0.001


def status_at(time_ns: IntArray, stamps_ns: IntArray, values: FloatArray, intervals_ns: IntArray) -> FloatArray:
    """Return the status that is nearest to each instant, minus infinity where none is near enough.

    A status holds for five of its median intervals, and 0.1 s at the least, for frames may arrive late.

    Parameters
    ----------
    time_ns : int64 array, shape (n,)
    stamps_ns, values : int64 and float64 arrays, shape (k,)
        The status, in order of time.
    intervals_ns : int64 array
        Between its stamps.

    Returns
    -------
    float64 array, shape (n,)
    """
    if not len(stamps_ns):
        return np.full(len(time_ns), -np.inf)
    after = np.clip(np.searchsorted(stamps_ns, time_ns), 0, len(stamps_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(time_ns - stamps_ns[before] < stamps_ns[after] - time_ns, before, after)
    usual_ns = float(np.median(intervals_ns)) if len(intervals_ns) else 0.0
    held = np.abs(time_ns - stamps_ns[nearer]) <= max(_HELD_INTERVALS * usual_ns, _HELD_NS)
    return np.where(held, values[nearer], -np.inf)


class StatusGate:
    """Takes distrusted samples out of a stream and remembers where and why.

    A sample has the status whose stamp is nearest to its own: in the same frame it is exact, and so it is where a
    sample's messages follow each other. Where none is near (see `status_at`) nothing is known, and the sample is kept
    and counted. Rolling counters are not looked at: what is missing shows as a gap.

    Parameters
    ----------
    node_ns : int
        Grid on which the instants of distrusted samples are kept.
    declared : bool
        Whether vehicle.toml names a status, so that it is missed where it does not come.
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
        self._left_out: dict[str, int] = {}
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
        """Return the roles with the number of samples left out in their facts."""
        return roles | {
            role: replace(roles[role], facts=replace(roles[role].facts, distrusted=count))
            for role, count in self._left_out.items()
            if role in roles
        }

    def notes(self) -> list[Note]:
        """Return notes on what was left out, and on what the status did not tell."""
        notes = []
        if self._left_out:
            count = max(self._left_out.values())
            notes.append(Note(RunCode.DISTRUSTED, values={"count": count, "statuses": dict(self.words)}))
        unknown, seen = (max(counts.values(), default=0) for counts in (self._unknown, self._seen))
        if seen and not self._came:
            notes.append(Note(RunCode.STATUS_NEVER_CAME))
        elif unknown > _NOTABLE_SHARE * seen:
            notes.append(Note(RunCode.STATUS_UNKNOWN, values={"count": unknown, "total": seen}))
        return notes

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
        self._left_out[role] = self._left_out.get(role, 0) + len(stamps)
        return replace(channel, time_ns=channel.time_ns[~bad], values=channel.values[~bad])
