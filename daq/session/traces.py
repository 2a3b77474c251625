"""What a page plots: the latest samples of some roles in SI units, thinned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from daq.channel import Channel
from daq.config import VehicleConfig
from daq.databases import Database
from daq.roles import resolve_roles

TRACE_ROLES = ("drawbar_pull", "wheel_speed", "ground_speed", "vertical_load", "driving_torque")
TRACE_RATE_HZ = 20.0
_KEPT = 600

Samples = tuple[list[int], list[float]]
"""File times in ns, and the values."""


class Traces:
    """Gathers samples until they are fetched; the oldest give way.

    Parameters
    ----------
    vehicle : VehicleConfig
    databases : mapping bus -> databases

    Raises
    ------
    ConfigError
        A role names no signal, or one with an unknown unit.
    """

    def __init__(self, vehicle: VehicleConfig, databases: Mapping[str, Sequence[Database]]) -> None:
        self._references = resolve_roles(vehicle, databases, (), TRACE_ROLES)
        self._period_ns = round(1e9 / TRACE_RATE_HZ)
        self._last: dict[str, int] = {}
        self._samples: dict[str, Samples] = {}

    def take(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take the newest sample of each twentieth of a second."""
        for role, reference in self._references.items():
            channel = decoded.get(reference.key)
            if channel is None or not len(channel):
                continue
            period = channel.time_ns // self._period_ns
            rows = np.flatnonzero(np.diff(period, append=period[-1] + 1))
            rows = rows[period[rows] > self._last.get(role, -1)]
            if len(rows):
                self._last[role] = int(period[rows[-1]])
                chosen = Channel(channel.name, channel.unit, channel.time_ns[rows], channel.values[rows])
                self._gather(role, reference.to_si(chosen))

    def fetch(self) -> dict[str, Samples]:
        """Return the samples since the last call, by role."""
        samples, self._samples = self._samples, {}
        return samples

    def _gather(self, role: str, channel: Channel) -> None:
        times, values = self._samples.setdefault(role, ([], []))
        times += channel.time_ns.tolist()
        values += channel.values.tolist()
        del times[:-_KEPT], values[:-_KEPT]
