"""Topics of the logger itself: events, diagnostics and the host's clock, in chunks that readers of frames skip.

Events are marks, clock steps, lost and returned buses: topic ``/events``, rcl_interfaces/msg/Log. Diagnostics are on
topic ``/diagnostics``, diagnostic_msgs/msg/DiagnosticArray, as Foxglove shows them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Literal, Protocol, TypeVar, get_args

import numpy as np
from mcap.opcode import Opcode

from daq.errors import DataError
from daq.recording.chunks import MESSAGE_HEAD_SIZE, ChunkEntry, DamagedError, content_records, message_head, read_chunk
from daq.recording.contents import Contents, opened
from daq.recording.format import (
    DEFINITION_RULE,
    HEADER_DEFINITIONS,
    MESSAGE_ENCODING,
    MESSAGE_OPCODE,
    PACKAGE,
    RECORD_HEAD_SIZE,
    TIME_DEFINITION,
    CdrDecoder,
    CdrEncoder,
)
from daq.recording.sink import McapSink, MessageGroup, index_entries

Severity = Literal["info", "warning", "error"]

EVENT_TOPIC = "/events"
EVENT_SCHEMA = "rcl_interfaces/msg/Log"
EVENT_TEXT = f"""\
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
{TIME_DEFINITION}"""
_LEVELS: dict[Severity, int] = dict(zip(get_args(Severity), (20, 30, 40), strict=True))

DIAGNOSTIC_TOPIC = "/diagnostics"
DIAGNOSTIC_SCHEMA = "diagnostic_msgs/msg/DiagnosticArray"
DIAGNOSTIC_TEXT = f"""\
std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
{HEADER_DEFINITIONS}{DEFINITION_RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
{DEFINITION_RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
"""

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


@dataclass(frozen=True)
class Event:
    """Something that happened while recording.

    Attributes
    ----------
    time_ns : int
        On the recording's time base.
    name : str
        Kind: ``"mark"``, ``"run"``, ``"part"``, ``"clock"``, ``"bus"``, ``"disk"``, ``"health"`` or ``"logger"``.
    text : str
        What people read.
    severity : {"info", "warning", "error"}
    """

    time_ns: int
    name: str
    text: str
    severity: Severity = "info"


def encode_event(event: Event) -> bytes:
    """Return an event as the CDR bytes of a rcl_interfaces/msg/Log; file, function and line stay empty."""
    message = CdrEncoder()
    message.stamp(event.time_ns)
    message.uint8(_LEVELS[event.severity])
    for text in (event.name, event.text, "", ""):
        message.text(text)
    message.uint32(0)
    return message.message()


def decode_event(data: bytes, time_ns: int) -> Event:
    """Return the event that `encode_event` wrote.

    `time_ns` is the message's log time, which does not end in 2038, as the stamp does; 0 for a time before 1970.
    Raises DamagedError if the bytes are no such message.
    """
    message = CdrDecoder(data)
    stamp_ns = message.stamp()
    level = message.uint8()
    severity: Severity = "error" if level >= _LEVELS["error"] else "warning" if level >= _LEVELS["warning"] else "info"
    return Event(time_ns or stamp_ns, message.text(), message.text(), severity)


@dataclass(frozen=True)
class DiagnosticStatus:
    """How one thing is: a bus, a message, a signal, the disk.

    Attributes
    ----------
    level : int
        0 ok, 1 warning, 2 error, 3 stale.
    name : str
        Unique among the statuses of one moment; slashes make a tree of it, e.g. ``"bus/can0"``.
    values : mapping str -> str
    """

    level: int
    name: str
    message: str = ""
    hardware_id: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


def encode_diagnostics(time_ns: int, statuses: Sequence[DiagnosticStatus]) -> bytes:
    """Return the CDR bytes of a diagnostic_msgs/msg/DiagnosticArray; DataError if a level is none of 0 to 3."""
    message = CdrEncoder()
    message.stamp(time_ns)
    message.text("")
    message.uint32(len(statuses))
    for status in statuses:
        if status.level not in range(4):
            raise DataError.of(f"{status.name}: level {status.level}", expected="0 to 3")
        message.uint8(status.level)
        message.text(status.name)
        message.text(status.message)
        message.text(status.hardware_id)
        message.uint32(len(status.values))
        for key, value in status.values.items():
            message.text(key)
            message.text(value)
    return message.message()


class GatheredTopic(Protocol):
    """A topic with messages that are gathered for a chunk."""

    def release(self) -> MessageGroup | None:
        """Return the gathered messages and forget them; None where there are none."""


TopicT = TypeVar("TopicT", bound=GatheredTopic)


class GatheredTopics(Generic[TopicT]):
    """Topics beside the raw ones, in chunks of their own: readers of raw frames skip them whole.

    A chunk is written at an uncompressed size of `chunk_bytes`; `tick` is called after every message.
    """

    def __init__(self, sink: McapSink, chunk_bytes: int, tick: Callable[[], None]) -> None:
        self._sink = sink
        self._chunk_bytes = chunk_bytes
        self._tick = tick
        self._topics: dict[object, TopicT] = {}
        self._pending_bytes = 0

    def write_chunk(self) -> None:
        """Write what is gathered."""
        groups = [topic.release() for topic in self._topics.values()]
        self._sink.write_chunk(group for group in groups if group is not None)
        self._pending_bytes = 0

    def _count(self, gathered_bytes: int) -> None:
        self._pending_bytes += gathered_bytes
        if self._pending_bytes >= self._chunk_bytes:
            self.write_chunk()
        self._tick()


@dataclass
class _HostTopic:
    channel_id: int
    sequence: int = 0
    records: list[bytes] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)

    def release(self) -> MessageGroup | None:
        records, times_ns = self.records, self.times_ns
        if not records:
            return None
        self.records, self.times_ns = [], []
        sizes = np.array([0, *map(len, records[:-1])], np.int64)
        return MessageGroup(self.channel_id, records, index_entries(np.array(times_ns), np.cumsum(sizes)))


class HostTopics(GatheredTopics[_HostTopic]):
    """The topics of a recording about the logger and its machine."""

    def __init__(self, sink: McapSink, chunk_bytes: int, tick: Callable[[], None]) -> None:
        super().__init__(sink, chunk_bytes, tick)
        self._clocks: dict[str, tuple[int, int, int]] = {}

    def write_event(self, event: Event) -> None:
        """Write an event, topic ``/events``."""
        self._gather(EVENT_TOPIC, EVENT_SCHEMA, EVENT_TEXT, event.time_ns, encode_event(event))

    def write_diagnostics(self, time_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Write the statuses of one moment, topic ``/diagnostics``; DataError if a level is none of 0 to 3."""
        data = encode_diagnostics(time_ns, statuses)
        self._gather(DIAGNOSTIC_TOPIC, DIAGNOSTIC_SCHEMA, DIAGNOSTIC_TEXT, time_ns, data)

    def write_clock(
        self, time_ns: int, bus: str, realtime_minus_monotonic_ns: int, file_minus_realtime_ns: int
    ) -> None:
        """Write the clock offsets of the frames of a bus, topic ``/clock/host``.

        To be called with every batch: it is written when an offset differs by more than 1 ms from what was written
        last, and once a second. `time_ns` is on the recording's time base; the host's monotonic clock is
        `daq.host_clock.monotonic_ns` (on Linux CLOCK_BOOTTIME), and realtime is its CLOCK_REALTIME.
        """
        written = self._clocks.get(bus)
        if (
            written is not None
            and 0 <= time_ns - written[0] < _CLOCK_EVERY_NS
            and abs(realtime_minus_monotonic_ns - written[1]) <= _CLOCK_CHANGE_NS
            and abs(file_minus_realtime_ns - written[2]) <= _CLOCK_CHANGE_NS
        ):
            return
        self._clocks[bus] = (time_ns, realtime_minus_monotonic_ns, file_minus_realtime_ns)
        message = CdrEncoder()
        message.stamp(time_ns)
        message.text(bus)
        for number in self._clocks[bus]:
            message.int64(number)
        self._gather(CLOCK_TOPIC, CLOCK_SCHEMA, CLOCK_TEXT, time_ns, message.message())

    def _gather(self, name: str, schema: str, text: str, time_ns: int, data: bytes) -> None:
        topic = self._topics.get(name)
        if topic is None:
            schema_id = self._sink.add_schema(schema, text)
            topic = self._topics[name] = _HostTopic(self._sink.add_channel(name, schema_id, {}))
        length = _HEAD.size - RECORD_HEAD_SIZE + len(data)
        sequence, unsigned_ns = topic.sequence & 0xFFFFFFFF, max(time_ns, 0)
        head = _HEAD.pack(MESSAGE_OPCODE, length, topic.channel_id, sequence, unsigned_ns, unsigned_ns)
        topic.sequence += 1
        topic.records.append(head + data)
        topic.times_ns.append(unsigned_ns)
        self._count(len(head) + len(data))


def read_events(path: Path, contents: Contents, damaged: Callable[[ChunkEntry, str], None]) -> tuple[Event, ...]:
    """Return the events of a file, in its order; `damaged` is called with each chunk that cannot be read, and why.

    Raises RecordingError if the file is gone, or the disk fails.
    """
    channels = {
        channel.id
        for channel in contents.channels.values()
        if channel.topic == EVENT_TOPIC
        and channel.message_encoding == MESSAGE_ENCODING
        and channel.schema_id in contents.schemas
        and contents.schemas[channel.schema_id].name == EVENT_SCHEMA
    }
    found: list[Event] = []
    with opened(path) as file:
        for entry in contents.chunks if channels else ():
            # only a summary is sure to name all channels of a chunk
            if contents.has_summary and entry.channel_ids is not None and entry.channel_ids.isdisjoint(channels):
                continue
            try:
                found += _events(read_chunk(file, entry), channels)
            except DamagedError as damage:
                damaged(entry, str(damage))
    return tuple(found)


def _events(content: bytes, channels: set[int]) -> list[Event]:
    found = []
    for opcode, start, length in content_records(content):
        if opcode == Opcode.MESSAGE:
            channel_id, log_time_ns = message_head(content, start, length)
            if channel_id in channels:
                found.append(decode_event(content[start + MESSAGE_HEAD_SIZE : start + length], log_time_ns))
    return found
