"""The decoded view of a recording: physical values beside the raw frames, for people and other tools."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from daq.buses import messages_by_bus
from daq.channel import Channel
from daq.config import VehicleConfig
from daq.databases import Database
from daq.recording.topic_writer import TopicWriter
from daq.roles import resolve_roles

_SAME_FIX_NS = 100_000_000


class DecodedView:
    """Writes decoded topics, and positions where latitude and longitude have roles.

    Parameters
    ----------
    writer : TopicWriter
    vehicle : VehicleConfig
    databases : mapping bus -> databases

    Raises
    ------
    ConfigError
        A position's role names no signal, or one with an unknown unit.
    """

    def __init__(
        self, writer: TopicWriter, vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]
    ) -> None:
        self._writer = writer
        self._units = {
            (bus, name): {signal.name: signal.unit for signal in message.signals}
            for bus, messages in messages_by_bus(databases).items()
            for name, message in messages.items()
        }
        self._position = resolve_roles(vehicle, databases, (), ("latitude", "longitude"))

    def write(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Write what `daq.decode.Decoder` made of a batch of frames."""
        messages: dict[tuple[str, str], dict[str, Channel]] = {}
        for (bus, name), channel in decoded.items():
            message, _, signal = name.rpartition(".")
            messages.setdefault((bus, message), {})[signal] = channel
        for (bus, message), signals in messages.items():
            time_ns = next(iter(signals.values())).time_ns
            values = {name: channel.values for name, channel in signals.items()}
            self._writer.write_decoded(message, bus, time_ns, values, self._units[bus, message])
        self._write_position(decoded)

    def _write_position(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Join each latitude to the longitude of its own fix, which may travel in another message."""
        found = {role: decoded.get(reference.key) for role, reference in self._position.items()}
        latitude, longitude = found.get("latitude"), found.get("longitude")
        if latitude is None or longitude is None or not len(latitude) or not len(longitude):
            return
        after = np.clip(np.searchsorted(longitude.time_ns, latitude.time_ns), 1, max(len(longitude) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(longitude) - 1)
        late = latitude.time_ns - longitude.time_ns[before] < longitude.time_ns[after] - latitude.time_ns
        nearest = np.where(late, before, after)
        rows = np.abs(longitude.time_ns[nearest] - latitude.time_ns) < _SAME_FIX_NS
        in_si = {role: self._position[role].to_si(channel) for role, channel in found.items() if channel is not None}
        self._writer.write_position(
            self._position["latitude"].bus,
            latitude.time_ns[rows],
            np.degrees(in_si["latitude"].values[rows]),
            np.degrees(in_si["longitude"].values[nearest[rows]]),
        )
