"""Topics of the logger itself: events, diagnostics and the host's clock, in chunks that readers of frames skip."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from daq.recording.cdr import CdrEncoder
from daq.recording.diagnostics import (
    DIAGNOSTIC_SCHEMA,
    DIAGNOSTIC_TEXT,
    DIAGNOSTIC_TOPIC,
    DiagnosticStatus,
    encode_diagnostics,
)
from daq.recording.events import EVENT_SCHEMA, EVENT_TEXT, EVENT_TOPIC, Event, encode_event
from daq.recording.format import HEADER_DEFINITIONS, MESSAGE_OPCODE, PACKAGE, RECORD_HEAD_SIZE
from daq.recording.sink import McapSink, MessageGroup

CLOCK_TOPIC = "/clock/host"
CLOCK_SCHEMA = f"{PACKAGE}/msg/HostClock"
CLOCK_TEXT = f"""\
std_msgs/Header header
int64 time_ns
int64 realtime_minus_monotonic_ns
int64 file_minus_realtime_ns
{HEADER_DEFINITIONS}"""
_CLOCK_CHANGE_NS = 1_000_000
_CLOCK_EVERY_NS = 1_000_000_000
_HEAD = struct.Struct("<BQHIQQ")


@dataclass
class _Topic:
    channel_id: int
    sequence: int = 0
    records: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)


class HostTopics:
    """The topics of a recording that tell of the logger and its machine.

    Parameters
    ----------
    sink : McapSink
    """

    def __init__(self, sink: McapSink) -> None:
        self._sink = sink
        self._topics: dict[str, _Topic] = {}
        self._clocks: dict[str, tuple[int, int, int]] = {}
        self.pending_bytes = 0

    def write_event(self, event: Event) -> None:
        """Gather an event."""
        self._gather(EVENT_TOPIC, EVENT_SCHEMA, EVENT_TEXT, event.time_ns, encode_event(event))

    def write_diagnostics(self, time_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Gather the statuses of one moment."""
        data = encode_diagnostics(time_ns, statuses)
        self._gather(DIAGNOSTIC_TOPIC, DIAGNOSTIC_SCHEMA, DIAGNOSTIC_TEXT, time_ns, data)

    def write_clock(
        self, time_ns: int, bus: str, realtime_minus_monotonic_ns: int, file_minus_realtime_ns: int
    ) -> None:
        """Gather a bus's clock offsets if they are news; see `RecordingWriter.write_clock`."""
        told = self._clocks.get(bus)
        if (
            told is not None
            and 0 <= time_ns - told[0] < _CLOCK_EVERY_NS
            and abs(realtime_minus_monotonic_ns - told[1]) <= _CLOCK_CHANGE_NS
            and abs(file_minus_realtime_ns - told[2]) <= _CLOCK_CHANGE_NS
        ):
            return
        self._clocks[bus] = (time_ns, realtime_minus_monotonic_ns, file_minus_realtime_ns)
        message = CdrEncoder()
        message.stamp(time_ns)
        message.text(bus)
        for number in self._clocks[bus]:
            message.int64(number)
        self._gather(CLOCK_TOPIC, CLOCK_SCHEMA, CLOCK_TEXT, time_ns, message.message())

    def write_chunk(self) -> None:
        """Write what is gathered."""
        self._sink.write_chunk(_group(topic) for topic in self._topics.values() if topic.records)
        self.pending_bytes = 0

    def _gather(self, name: str, schema: str, text: str, time_ns: int, data: bytes) -> None:
        topic = self._topics.get(name)
        if topic is None:
            schema_id = self._sink.add_schema(schema, text)
            topic = self._topics[name] = _Topic(self._sink.add_channel(name, schema_id, {}))
        length = _HEAD.size - RECORD_HEAD_SIZE + len(data)
        sequence, unsigned_ns = topic.sequence & 0xFFFFFFFF, max(time_ns, 0)
        head = _HEAD.pack(MESSAGE_OPCODE, length, topic.channel_id, sequence, unsigned_ns, unsigned_ns)
        topic.sequence += 1
        topic.records.append(head + data)
        topic.times_ns.append(unsigned_ns)
        self.pending_bytes += len(head) + len(data)


def _group(topic: _Topic) -> MessageGroup:
    records, times_ns = topic.records, topic.times_ns
    topic.records, topic.times_ns = [], []
    sizes = np.array([0, *map(len, records[:-1])], np.int64)
    return MessageGroup(topic.channel_id, records, np.cumsum(sizes), np.array(times_ns, np.int64))
