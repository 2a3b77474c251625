"""Events of a recording: marks, clock steps, lost and returned buses; topic ``/events``, rcl_interfaces/msg/Log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from daq.recording.cdr import CdrDecoder, CdrEncoder
from daq.recording.format import TIME_DEFINITION

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

    Parameters
    ----------
    data : bytes
    time_ns : int
        The message's log time, which does not end in 2038, as the stamp does; 0 for a time before 1970.

    Raises
    ------
    DamagedError
        If the bytes are no such message.
    """
    message = CdrDecoder(data)
    stamp_ns = message.stamp()
    level = message.uint8()
    severity: Severity = "error" if level >= _LEVELS["error"] else "warning" if level >= _LEVELS["warning"] else "info"
    return Event(time_ns or stamp_ns, message.text(), message.text(), severity)
