"""The transducer's own word on its samples: those whose status is not 0 are left out, for a reason of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.channel import Channel
from daq.config import VehicleConfig
from processing.collect import Samples
from processing.inputs import latency_ns
from processing.on_base import OnBase
from processing.timebase import FloatArray, IntArray

FORCE_ROLES = ("vertical_load", "drawbar_pull", "driving_torque")
"""Channels that the status speaks of."""


class StatusGate:
    """Takes distrusted samples out of a stream and remembers where and why.

    A sample has the status whose stamp is nearest to its own: in the same frame it is exact, and so it is where a
    sample's messages follow each other. Rolling counters are not looked at: what is missing shows as a gap.

    Parameters
    ----------
    node_ns : int
        Grid on which the instants of distrusted samples are kept.
    """

    def __init__(self, node_ns: int) -> None:
        self._node_ns = node_ns
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
            if len(self._last[0]):
                kept |= {role: self._trusted(role, chunk[role]) for role in FORCE_ROLES if role in chunk}
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

    def notes(self) -> list[str]:
        """Return a sentence on what was left out."""
        if not self._left_out:
            return []
        count = max(self._left_out.values())
        why = ", ".join(f"{word} {number:,}" for word, number in sorted(self.words.items(), key=lambda i: -i[1]))
        return [f"the transducer distrusts {count:,} samples, which are left out; its status: {why}"]

    def _take(self, status: Channel) -> None:
        time_ns = np.concatenate([self._last[0], status.time_ns])
        values = np.concatenate([self._last[1], status.values])
        order = np.argsort(time_ns, kind="stable")
        self._last = (time_ns[order], values[order])
        numbers, counts = np.unique(status.values[status.values != 0], return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            word = "no status" if number != number else status.labels.get(int(number), f"{number:g}")
            self.words[word] = self.words.get(word, 0) + count

    def _trusted(self, role: str, channel: Channel) -> Channel:
        bad = self._values_at(channel.time_ns) != 0
        if not bad.any():
            return channel
        stamps = channel.time_ns[bad]
        nodes = np.unique(stamps // self._node_ns) * self._node_ns + self._node_ns // 2
        self._where.setdefault(role, []).append(nodes)
        self._left_out[role] = self._left_out.get(role, 0) + len(stamps)
        return replace(channel, time_ns=channel.time_ns[~bad], values=channel.values[~bad])

    def _values_at(self, time_ns: IntArray) -> NDArray[np.float64]:
        stamps, values = self._last
        after = np.clip(np.searchsorted(stamps, time_ns), 0, len(stamps) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.where(time_ns - stamps[before] < stamps[after] - time_ns, before, after)
        return values[nearer]
