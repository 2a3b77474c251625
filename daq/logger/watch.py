"""State of the buses, the machine and the logger's own process, and the events that follow from it."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from pathlib import Path

from daq.host_clock import HostClock
from daq.logger.disk_guard import DiskGuard, DiskState
from daq.logger.health.report import BusStatus, HostStatus, Level, Reason, reason
from daq.logger.listener import Arrival, ByteQueue, Listener
from daq.recording.events import Severity

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_STATM = Path("/proc/self/statm")


class CpuClock:
    """The share of one core that this process takes."""

    def __init__(self) -> None:
        self._wall_s, self._cpu_s = time.monotonic(), time.process_time()
        self.share = math.nan

    def measure(self) -> float:
        """Return the share since the last call; NaN the first time."""
        wall_s, cpu_s = time.monotonic(), time.process_time()
        if wall_s > self._wall_s:
            self.share = (cpu_s - self._cpu_s) / (wall_s - self._wall_s)
        self._wall_s, self._cpu_s = wall_s, cpu_s
        return self.share


def resident_bytes() -> int:
    """Return the resident memory of this process; 0 where the system does not report it."""
    try:
        return int(_STATM.read_text(encoding="ascii").split()[1]) * _PAGE_BYTES
    except OSError:
        return 0


_REFRESH_EVERY_S = 1.0
_STUCK_S = 5.0
"""A thread without an iteration for so long is stuck."""
_PATIENCE_S = 60.0
"""How long the other buses are recorded on beside one that is stuck, before a restart is asked for."""

EventText = tuple[str, str, Severity]
"""Name, text and severity of an event."""


class Watch:
    """Collects the state of buses, disk, processor, memory and clock.

    Attributes
    ----------
    disk : DiskState
        As of the last refresh.
    skipped_frames : int
        See `HostStatus`; to be kept up to date by the session.
    """

    def __init__(
        self, clock: HostClock, listeners: Sequence[Listener], queue: ByteQueue[Arrival], guard: DiskGuard
    ) -> None:
        self._clock = clock
        self._listeners = listeners
        self._queue = queue
        self._guard = guard
        self._cpu = CpuClock()
        self._rss_bytes = resident_bytes()
        self._refresh_at = 0.0
        self._steps_reported = 0
        self._disk_reported = Level.GREEN
        self._behind_reported = False
        self.skipped_frames = 0
        self.disk: DiskState = guard.check(time.monotonic(), 0)

    def refresh(self, now_s: float, written_bytes: int) -> bool:
        """Measure disk, processor and memory if it is time to; return whether it was."""
        if now_s < self._refresh_at:
            return False
        self._refresh_at = now_s + _REFRESH_EVERY_S
        self.disk = self._guard.check(now_s, written_bytes)
        self._cpu.measure()
        self._rss_bytes = resident_bytes()
        return True

    def buses(self) -> dict[str, BusStatus]:
        """Return what is known of every bus."""
        return {one.source.name: one.status() for one in self._listeners}

    def uncertain_frames(self) -> dict[str, int]:
        """Return per bus the number of frames whose time is uncertain, because the clock was set when they came."""
        return {one.source.name: one.uncertain_frames for one in self._listeners}

    def host(self) -> HostStatus:
        """Return what is known of the machine and the logger."""
        steps = self._clock.steps
        return HostStatus(
            self.buses(),
            queue_share=min(self._queue.share, 1.0),
            skipped_frames=self.skipped_frames,
            disk_free_bytes=self.disk.free_bytes,
            disk_reserve_bytes=self.disk.reserve_bytes,
            disk_bytes_per_s=self.disk.bytes_per_s,
            cpu_share=self._cpu.share,
            rss_bytes=self._rss_bytes,
            clock_steps=len(steps),
            last_step_s=steps[-1].step_s if steps else math.nan,
        )

    def stuck(self) -> list[Reason]:
        """Return a reason for each thread that is stuck."""
        return [
            reason("source_stuck", Level.RED, one.source.name, f"no answer for {one.stuck_s:.0f} s")
            for one in self._listeners
            if one.stuck_s > _STUCK_S
        ]

    def hopeless(self) -> bool:
        """Return whether only a restart helps: every source is stuck, or one has been for a minute."""
        stuck_s = [one.stuck_s for one in self._listeners]
        return min(stuck_s) > _STUCK_S or max(stuck_s) > _PATIENCE_S

    def events(self, behind: bool) -> list[EventText]:
        """Return what has happened since the last call."""
        events: list[EventText] = [
            ("bus", change.text, change.severity) for one in self._listeners for change in one.source.changes()
        ]
        for step in self._clock.steps[self._steps_reported :]:
            self._steps_reported += 1
            text = f"the host's clock was set by {step.step_s:+.6f} s; time in the recording advances evenly"
            events.append(("clock", text, "warning"))
        if self.disk.level is not self._disk_reported:
            self._disk_reported = self.disk.level
            events.append(("disk", self.disk.text(), "info" if self.disk.level is Level.GREEN else "warning"))
        if behind is not self._behind_reported:
            self._behind_reported = behind
            text = "the disk is slow: frames are recorded, but not decoded" if behind else "frames are decoded again"
            events.append(("logger", text, "warning" if behind else "info"))
        return events
