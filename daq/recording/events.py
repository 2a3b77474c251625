"""Events of a recording: marks, clock steps, lost and returned buses; topic ``/events``, rcl_interfaces/msg/Log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["info", "warning", "error"]


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
