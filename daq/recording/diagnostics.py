"""Diagnostics of a recording: topic ``/diagnostics``, diagnostic_msgs/msg/DiagnosticArray, as Foxglove shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from daq.errors import DataError, Fault
from daq.recording.cdr import CdrEncoder
from daq.recording.format import DEFINITION_RULE, HEADER_DEFINITIONS

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


@dataclass(frozen=True)
class DiagnosticStatus:
    """How one thing is: a bus, a message, a signal, the disk.

    Attributes
    ----------
    level : int
        0 ok, 1 warning, 2 error, 3 stale.
    name : str
        Unique among the statuses of one moment; slashes make a tree of it, e.g. ``"bus/can0"``.
    message : str
    hardware_id : str
    values : mapping str -> str
    """

    level: int
    name: str
    message: str = ""
    hardware_id: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


def encode_diagnostics(time_ns: int, statuses: Sequence[DiagnosticStatus]) -> bytes:
    """Return the CDR bytes of a diagnostic_msgs/msg/DiagnosticArray.

    Raises
    ------
    DataError
        If a level is none of 0 to 3.
    """
    message = CdrEncoder()
    message.stamp(time_ns)
    message.text("")
    message.uint32(len(statuses))
    for status in statuses:
        if status.level not in range(4):
            raise DataError(Fault(f"{status.name}: level {status.level}", expected="0 to 3"))
        message.uint8(status.level)
        message.text(status.name)
        message.text(status.message)
        message.text(status.hardware_id)
        message.uint32(len(status.values))
        for key, value in status.values.items():
            message.text(key)
            message.text(value)
    return message.message()
