"""What a session is made of."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from daq.config import VehicleConfig
from daq.disk_guard import DiskGuard
from daq.host_clock import HostClock
from daq.notify import Notifier
from daq.panel import Panel
from daq.reconnect import ReconnectingSource
from daq.session.inspection import Inspector
from daq.session.recorder import Recorder
from daq.session.summary import Progress


@dataclass
class SessionParts:
    """What a session is made of; everything is open and checked."""

    vehicle: VehicleConfig
    clock: HostClock
    sources: list[ReconnectingSource]
    recorder: Recorder
    inspector: Inspector
    guard: DiskGuard
    panel: Panel
    notifier: Notifier
    asked_to_stop: threading.Event
    caught: list[int]
    """Numbers of the signals that came."""
    progress: Progress | None = None
    remarks: list[str] = field(default_factory=list)
