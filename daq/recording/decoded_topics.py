"""Decoded topics: physical values as fixed-size messages, beside the raw frames they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from daq.errors import DataError, Fault, nearest
from daq.frames import joined
from daq.recording.format import NAVSATFIX_SCHEMA, NAVSATFIX_TEXT, fill_prefix, fixed_message_dtype
from daq.recording.sink import McapSink, MessageGroup
from daq.recording.topics import DecodedLayout, TopicNames, decoded_layout

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


@dataclass
class _Topic:
    channel_id: int
    layout: DecodedLayout | None
    sequence: int = 0
    kept_ns: int | None = None
    pending: list[NDArray[np.void]] = field(default_factory=list)


class DecodedTopics:
    """The decoded topics of a recording that is being written.

    Parameters
    ----------
    sink : McapSink
    names : TopicNames
    rate_hz : float or None
        Samples are thinned to this rate; None: all are kept.
    """

    def __init__(self, sink: McapSink, names: TopicNames, rate_hz: float | None) -> None:
        self._sink = sink
        self._names = names
        self._rate_hz = rate_hz
        self._topics: dict[tuple[str, str | None], _Topic] = {}
        self.pending_bytes = 0

    def write(
        self,
        message: str,
        bus: str,
        time_ns: NDArray[np.int64],
        signals: Mapping[str, NDArray[np.float64]],
        units: Mapping[str, str],
        publish_ns: NDArray[np.int64],
    ) -> None:
        """Gather samples of a DBC message; see `RecordingWriter.write_decoded`."""
        topic = self._topics.get((bus, message)) or self._new_topic(message, bus, units)
        assert topic.layout is not None
        _check(message, topic.layout, time_ns, signals)
        rows = self._thinned(topic, time_ns)
        values = {name: column[rows] for name, column in signals.items()}
        self._gather(
            topic, topic.layout.records(topic.channel_id, topic.sequence, time_ns[rows], publish_ns[rows], values)
        )

    def write_position(
        self,
        bus: str,
        time_ns: NDArray[np.int64],
        latitude_deg: NDArray[np.float64],
        longitude_deg: NDArray[np.float64],
        altitude_m: NDArray[np.float64] | None,
    ) -> None:
        """Gather positions; see `RecordingWriter.write_position`."""
        topic = self._topics.get((bus, None))
        if topic is None:
            schema_id = self._sink.add_schema(NAVSATFIX_SCHEMA, NAVSATFIX_TEXT)
            channel_id = self._sink.add_channel(self._names.topic(bus, "position"), schema_id, {"bus": bus})
            topic = self._topics[bus, None] = _Topic(channel_id, None)
        rows = self._thinned(topic, time_ns)
        records = np.zeros(len(rows), NAVSATFIX_DTYPE)
        fill_prefix(records, topic.channel_id, topic.sequence, time_ns[rows], time_ns[rows])
        records["latitude"], records["longitude"] = latitude_deg[rows], longitude_deg[rows]
        records["altitude"] = np.nan if altitude_m is None else altitude_m[rows]
        found = np.isfinite(records["latitude"]) & np.isfinite(records["longitude"])
        records["status"] = np.where(found, _FIX, _NO_FIX)
        records["service"] = _SERVICE_GPS
        self._gather(topic, records)

    def write_chunk(self) -> None:
        """Write what is gathered, in a chunk of its own: readers of raw frames skip it whole."""
        self._sink.write_chunk(_group(topic) for topic in self._topics.values() if topic.pending)
        self.pending_bytes = 0

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
            self.pending_bytes += records.nbytes

    def _thinned(self, topic: _Topic, time_ns: NDArray[np.int64]) -> NDArray[np.intp]:
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


def _check(
    message: str, layout: DecodedLayout, time_ns: NDArray[np.int64], signals: Mapping[str, NDArray[np.float64]]
) -> None:
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
    if faults:
        raise DataError(*faults)


def _group(topic: _Topic) -> MessageGroup:
    records = joined(topic.pending)
    topic.pending = []
    offsets = np.arange(len(records), dtype=np.int64) * records.dtype.itemsize
    return MessageGroup(topic.channel_id, [records.tobytes()], offsets, records["log_time"].astype(np.int64))
