"""Decoded topics of a recording: physical values as fixed-size messages beside the raw frames, for viewers."""

from __future__ import annotations

import json
import keyword
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq import Channel, DataError, Fault, FloatArray, IndexArray, IntArray, VehicleConfig, nearest
from daq.can import Database, messages_by_bus, resolve_roles
from daq.can.frames import joined
from daq.formatting import numbered
from daq.recording.events import GatheredTopics
from daq.recording.format import (
    HEADER_DEFINITIONS,
    NAVSATFIX_SCHEMA,
    NAVSATFIX_TEXT,
    PACKAGE,
    TopicNames,
    fill_prefix,
    fixed_message_dtype,
    snake_case,
)
from daq.recording.sink import McapSink, MessageGroup, index_entries

NAVSATFIX_DTYPE = fixed_message_dtype(
    [
        ("status", "i1"),
        ("padding", "u1"),
        ("service", "<u2"),
        ("latitude", "<f8"),
        ("longitude", "<f8"),
        ("altitude", "<f8"),
        ("covariance", "<f8", (9,)),
        ("covariance_type", "u1"),
    ]
)
_NO_FIX, _FIX, _SERVICE_GPS = -1, 0, 1
_SLACK = 1.2
"""Up to so many times the rate, all samples are kept."""

_SAME_FIX_NS = 100_000_000


@dataclass(frozen=True)
class DecodedLayout:
    """How one DBC message on one bus is written as a topic.

    Attributes
    ----------
    metadata : dict str -> str
        Of the MCAP channel: ``bus``, ``message``, and ``signals``: a JSON object
        field -> {"name": the DBC's signal name, "unit": its unit}.
    signals, fields : tuple of str
        The DBC's names and the field of each.
    dtype : structured dtype
        Of a whole MCAP message record.
    """

    schema_name: str
    schema_text: str
    metadata: dict[str, str]
    signals: tuple[str, ...]
    fields: tuple[str, ...]
    dtype: np.dtype[np.void]

    def records(
        self,
        channel_id: int,
        sequence: int,
        time_ns: IntArray,
        values: Mapping[str, FloatArray],
    ) -> NDArray[np.void]:
        """Return whole MCAP message records, one a sample; a signal that `values` lacks is NaN."""
        records = np.zeros(len(time_ns), self.dtype)
        fill_prefix(records, channel_id, sequence, time_ns)
        for signal, name in zip(self.signals, self.fields, strict=True):
            records[f"field_{name}"] = values.get(signal, np.nan)
        return records


def decoded_layout(type_name: str, bus: str, message: str, units: Mapping[str, str]) -> DecodedLayout:
    """Lay out a DBC message: a header and one float64 a signal, in the order of `units`.

    `type_name` is the unique CamelCase name of the ROS 2 type; `bus` and `message` are as in vehicle.toml and the DBC.
    """
    signals = tuple(units)
    fields = tuple(field_names(signals))
    described = {field: {"name": name, "unit": units[name]} for field, name in zip(fields, signals, strict=True)}
    return DecodedLayout(
        schema_name=f"{PACKAGE}/msg/{type_name}",
        schema_text="std_msgs/Header header\n" + "".join(f"float64 {f}\n" for f in fields) + HEADER_DEFINITIONS,
        metadata={"bus": bus, "message": message, "signals": json.dumps(described, ensure_ascii=False)},
        signals=signals,
        fields=fields,
        dtype=layout_of(fields),
    )


def layout_of(fields: Sequence[str]) -> np.dtype[np.void]:
    """Return the layout of a whole MCAP message record with these fields, each a float64."""
    padding: list[tuple[str, str]] = [("padding", "<u4")] if fields else []
    return fixed_message_dtype([*padding, *((f"field_{field}", "<f8") for field in fields)])


def field_names(signals: Sequence[str]) -> list[str]:
    """Return a unique ROS 2 field name for each signal, in order."""
    names: list[str] = []
    taken = {"header", *keyword.kwlist, *keyword.softkwlist}
    for signal in signals:
        names.append(numbered(snake_case(signal), taken))
        taken.add(names[-1])
    return names


@dataclass
class _Topic:
    channel_id: int
    layout: DecodedLayout | None
    sequence: int = 0
    kept_ns: int | None = None
    pending: list[NDArray[np.void]] = field(default_factory=list)

    def release(self) -> MessageGroup | None:
        if not self.pending:
            return None
        records, self.pending = joined(self.pending), []
        offsets = np.arange(len(records), dtype=np.int64) * records.dtype.itemsize
        return MessageGroup(self.channel_id, [records.tobytes()], index_entries(records["log_time"], offsets))


class DecodedTopics(GatheredTopics[_Topic]):
    """The decoded topics of a recording that is being written, thinned to `rate_hz`; None: all samples are kept."""

    def __init__(
        self, sink: McapSink, chunk_bytes: int, tick: Callable[[], None], names: TopicNames, rate_hz: float | None
    ) -> None:
        super().__init__(sink, chunk_bytes, tick)
        self._names = names
        self._rate_hz = rate_hz

    def write(
        self,
        message: str,
        bus: str,
        time_ns: IntArray,
        signals: Mapping[str, FloatArray],
        units: Mapping[str, str],
    ) -> None:
        """Write a DBC message's physical values as a topic of its own.

        The times are those of receipt by the host. The signals, shape (n,) each, are NaN where a frame did not carry
        them. `units` has every signal of the message; the first call for a message fixes the set of signals.
        """
        topic = self._topics.get((bus, message)) or self._new_topic(message, bus, units)
        assert topic.layout is not None
        _check(message, topic.layout, time_ns, signals)
        rows = self._thinned(topic, time_ns)
        values = {name: column[rows] for name, column in signals.items()}
        self._gather(topic, topic.layout.records(topic.channel_id, topic.sequence, time_ns[rows], values))

    def write_position(self, bus: str, time_ns: IntArray, latitude_deg: FloatArray, longitude_deg: FloatArray) -> None:
        """Write positions as a ROS 2 NavSatFix topic, for map panels; NaN is written as "no fix"."""
        topic = self._topics.get((bus, None))
        if topic is None:
            schema_id = self._sink.add_schema(NAVSATFIX_SCHEMA, NAVSATFIX_TEXT)
            channel_id = self._sink.add_channel(self._names.topic(bus, "position"), schema_id, {"bus": bus})
            topic = self._topics[bus, None] = _Topic(channel_id, None)
        rows = self._thinned(topic, time_ns)
        records = np.zeros(len(rows), NAVSATFIX_DTYPE)
        fill_prefix(records, topic.channel_id, topic.sequence, time_ns[rows])
        records["latitude"], records["longitude"] = latitude_deg[rows], longitude_deg[rows]
        records["altitude"] = np.nan
        found = np.isfinite(records["latitude"]) & np.isfinite(records["longitude"])
        records["status"] = np.where(found, _FIX, _NO_FIX)
        records["service"] = _SERVICE_GPS
        self._gather(topic, records)

    def _new_topic(self, message: str, bus: str, units: Mapping[str, str]) -> _Topic:
        layout = decoded_layout(self._names.type_name(bus, message), bus, message, units)
        schema_id = self._sink.add_schema(layout.schema_name, layout.schema_text)
        channel_id = self._sink.add_channel(self._names.topic(bus, message), schema_id, layout.metadata)
        topic = self._topics[bus, message] = _Topic(channel_id, layout)
        return topic

    def _gather(self, topic: _Topic, records: NDArray[np.void]) -> None:
        if len(records):
            topic.sequence += len(records)
            topic.pending.append(records)
        self._count(records.nbytes)

    def _thinned(self, topic: _Topic, time_ns: IntArray) -> IndexArray:
        """Return the rows to keep: all where the rate allows, else the first of each period."""
        rows = np.arange(len(time_ns))
        if self._rate_hz is None or not len(rows):
            return rows
        since_ns = topic.kept_ns
        if since_ns is None or time_ns[-1] < since_ns:  # the first samples, or the clock was put back
            since_ns, first = int(time_ns[0]), True
        else:
            first = False
        periods = (time_ns - since_ns) * 1e-9 * self._rate_hz
        if len(rows) > _SLACK * periods[-1] + first:
            rows = np.flatnonzero(np.diff(np.floor(periods), prepend=-1 if first else 0) > 0)
        if len(rows):
            topic.kept_ns = int(time_ns[rows[-1]])
        return rows


def _check(message: str, layout: DecodedLayout, time_ns: IntArray, signals: Mapping[str, FloatArray]) -> None:
    faults = [
        Fault(f"{message} has no signal {name!r}", expected=nearest(name, layout.signals))
        for name in signals
        if name not in layout.signals
    ]
    faults += [
        Fault(f"{message}.{name} has another length than its time", found=f"{column.shape} for {time_ns.shape}")
        for name, column in signals.items()
        if column.shape != time_ns.shape
    ]
    DataError.stop_if_any(faults)


class DecodingWriter(Protocol):
    """A writer of a recording with decoded topics."""

    @property
    def decoded(self) -> DecodedTopics:
        """Decoded topics of the file that is written now."""


class DecodedWriter:
    """Writes decoded topics by the databases of each bus, and positions where latitude and longitude have roles.

    Raises
    ------
    ConfigError
        A position's role names no signal, or one with an unknown unit.
    """

    def __init__(
        self, writer: DecodingWriter, vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]
    ) -> None:
        self._writer = writer
        self._units = {
            (bus, name): {signal.name: signal.unit for signal in message.signals}
            for bus, messages in messages_by_bus(databases).items()
            for name, message in messages.items()
        }
        self._position = resolve_roles(vehicle, databases, (), ("latitude", "longitude"))

    def write(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Write what `daq.can.codec.Decoder` made of a batch of frames."""
        messages: dict[tuple[str, str], dict[str, Channel]] = {}
        for (bus, name), channel in decoded.items():
            message, _, signal = name.rpartition(".")
            messages.setdefault((bus, message), {})[signal] = channel
        for (bus, message), signals in messages.items():
            time_ns = next(iter(signals.values())).time_ns
            values = {name: channel.values for name, channel in signals.items()}
            self._writer.decoded.write(message, bus, time_ns, values, self._units[bus, message])
        self._write_position(decoded)

    def _write_position(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Join each latitude to the longitude closest in time: that of its fix, which may travel in another message."""
        found = {role: decoded.get(reference.key) for role, reference in self._position.items()}
        latitude, longitude = found.get("latitude"), found.get("longitude")
        if latitude is None or longitude is None or not len(latitude) or not len(longitude):
            return
        after = np.clip(np.searchsorted(longitude.time_ns, latitude.time_ns), 1, max(len(longitude) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(longitude) - 1)
        before_is_closer = latitude.time_ns - longitude.time_ns[before] < longitude.time_ns[after] - latitude.time_ns
        closest = np.where(before_is_closer, before, after)
        rows = np.abs(longitude.time_ns[closest] - latitude.time_ns) < _SAME_FIX_NS
        in_si = {role: self._position[role].to_si(channel) for role, channel in found.items() if channel is not None}
        self._writer.decoded.write_position(
            self._position["latitude"].bus,
            latitude.time_ns[rows],
            np.degrees(in_si["latitude"].values[rows]),
            np.degrees(in_si["longitude"].values[closest[rows]]),
        )
