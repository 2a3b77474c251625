"""State of the machine, of the buses and of the logger's own process, and the events that follow from it.

The free space of the recording's disk decides how long it lasts, and when recording must end so that the file can be
closed.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.errors import Fault, HardwareError
from daq.host_clock import HostClock
from daq.logger.health.report import HostStatus, Level, Reason, reason
from daq.logger.listener import Arrival, ByteQueue, Listener
from daq.recording.events import Severity
from daq.sources.can_source import BusStatus

_MB = 1_000_000
_GROWTH_OVER_S = 60.0
_GROWTH_FROM_S = 2.0
"""The growth is that of the last minute, and known when it has been measured for `_GROWTH_FROM_S`."""

_CALM = 1.25
"""The warning ends when the disk lasts so many times longer than where it began."""

_REFRESH_EVERY_S = 1.0
_STUCK_S = 5.0
"""A thread without an iteration for so long is stuck."""
_PATIENCE_S = 60.0
"""How long the other buses are recorded on beside one that is stuck, before a restart is asked for."""

EventText = tuple[str, str, Severity]
"""Name, text and severity of an event."""


@dataclass(frozen=True)
class DiskState:
    """State of the disk now."""

    free_bytes: int
    reserve_bytes: int
    """Free space at which recording ends."""
    bytes_per_s: float
    """How fast the recording grows; NaN until it is known."""
    minutes: float
    """Until recording ends, at this growth; NaN until it is known."""
    level: Level
    """Amber under the vehicle's ``disk_warn_min``, red when recording must end."""

    def text(self) -> str:
        """Return it as a sentence."""
        lasts = "" if math.isnan(self.minutes) else f", {self.minutes:.0f} minutes at {self.bytes_per_s / _MB:.2f} MB/s"
        return f"{megabytes(self.free_bytes)} MB free, {megabytes(self.reserve_bytes)} MB of them in reserve{lasts}"


class DiskGuard:
    """Watches the free space of a folder; `HardwareError` if less than the reserve is free from the beginning."""

    def __init__(self, folder: Path, *, warn_min: float, reserve_mb: float) -> None:
        self._folder = folder
        self._warn_min = warn_min
        self._reserve_bytes = round(reserve_mb * _MB)
        self._history: deque[tuple[float, int]] = deque()
        self._warned = False
        self._free = self._reserve_bytes + 1
        state = self.check(0.0, 0)
        self._history.clear()
        if state.level is Level.RED:
            raise HardwareError(disk_fault(folder, state))

    def check(self, now_s: float, written_bytes: int) -> DiskState:
        """Return the state of the disk, at a monotonic time and with what the logger has recorded until then."""
        with contextlib.suppress(OSError):  # a failed disk is reported by the next write
            self._free = shutil.disk_usage(self._folder).free
        free = self._free
        self._history.append((now_s, written_bytes))
        while len(self._history) > 2 and now_s - self._history[1][0] >= _GROWTH_OVER_S:
            self._history.popleft()
        since_s, before = self._history[0]
        growth = (written_bytes - before) / (now_s - since_s) if now_s - since_s >= _GROWTH_FROM_S else math.nan
        minutes = max(free - self._reserve_bytes, 0) / growth / 60.0 if growth > 0 else math.nan
        return DiskState(free, self._reserve_bytes, growth, minutes, self._level(free, minutes))

    def _level(self, free: int, minutes: float) -> Level:
        if free <= self._reserve_bytes:
            return Level.RED
        self._warned = minutes < self._warn_min * (_CALM if self._warned else 1.0)
        return Level.AMBER if self._warned else Level.GREEN


def megabytes(size: int) -> str:
    """Return a size in MB: whole ones from 10 on, else as many digits as it was given with."""
    return f"{size / _MB:,.0f}" if size >= 10 * _MB else f"{size / _MB:.6g}"


def disk_fault(folder: Path, state: DiskState) -> Fault:
    """Return the fault of a disk that is full up to the reserve."""
    return Fault(
        "the disk is full up to the reserve",
        str(folder),
        f"{megabytes(state.free_bytes)} MB free",
        f"more than [logger] disk_reserve_mb = {megabytes(state.reserve_bytes)}",
        "free the disk, or record elsewhere: --out",
    )


class HostMonitor:
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
        self._wall_s, self._cpu_s = time.monotonic(), time.process_time()
        self._cpu_share = math.nan
        self._rss_bytes = _resident_bytes()
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
        wall_s, cpu_s = time.monotonic(), time.process_time()
        if wall_s > self._wall_s:
            self._cpu_share = (cpu_s - self._cpu_s) / (wall_s - self._wall_s)
        self._wall_s, self._cpu_s = wall_s, cpu_s
        self._rss_bytes = _resident_bytes()
        return True

    def buses(self) -> dict[str, BusStatus]:
        """Return what is known of every bus."""
        return {listener.source.name: listener.status() for listener in self._listeners}

    def uncertain_frames(self) -> dict[str, int]:
        """Return per bus the number of frames whose time is uncertain, because the clock was set when they came."""
        return {listener.source.name: listener.uncertain_frames for listener in self._listeners}

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
            cpu_share=self._cpu_share,
            rss_bytes=self._rss_bytes,
            clock_steps=len(steps),
            last_step_s=steps[-1].step_s if steps else math.nan,
        )

    def stuck(self) -> list[Reason]:
        """Return a reason for each thread that is stuck."""
        return [
            reason("source_stuck", Level.RED, listener.source.name, f"no answer for {listener.stuck_s:.0f} s")
            for listener in self._listeners
            if listener.stuck_s > _STUCK_S
        ]

    def hopeless(self) -> bool:
        """Return whether only a restart helps: every source is stuck, or one has been for a minute."""
        stuck_s = [listener.stuck_s for listener in self._listeners]
        return min(stuck_s) > _STUCK_S or max(stuck_s) > _PATIENCE_S

    def events(self, behind: bool) -> list[EventText]:
        """Return what has happened since the last call."""
        events: list[EventText] = [
            ("bus", change.text, change.severity)
            for listener in self._listeners
            for change in listener.source.changes()
        ]
        for step in self._clock.steps[self._steps_reported :]:
            self._steps_reported += 1
            text = f"the host's clock was set by {step.step_s:+.6f} s; time in the recording advances evenly"
            events.append(("clock", text, "warning"))
        events += [("logger", text, "warning") for text in self._silences()]
        if self.disk.level is not self._disk_reported:
            self._disk_reported = self.disk.level
            events.append(("disk", self.disk.text(), "info" if self.disk.level is Level.GREEN else "warning"))
        if behind is not self._behind_reported:
            self._behind_reported = behind
            text = "the disk is slow: frames are recorded, but not decoded" if behind else "frames are decoded again"
            events.append(("logger", text, "warning" if behind else "info"))
        return events

    def _silences(self) -> list[str]:
        """Return a sentence for each time in which sources were not read; those of several buses are joined."""
        found: list[tuple[int, int, str]] = []
        for listener in self._listeners:
            while listener.silences:
                found.append((*listener.silences.popleft(), listener.source.name))
        joined: list[tuple[int, int, list[str]]] = []
        for begin_ns, end_ns, bus in sorted(found):
            if joined and begin_ns < joined[-1][1]:
                begin_ns, until_ns, buses = joined.pop()
                joined.append((begin_ns, max(until_ns, end_ns), [*buses, bus]))
            else:
                joined.append((begin_ns, end_ns, [bus]))
        return [
            f"{', '.join(dict.fromkeys(buses))} not read for {(end_ns - begin_ns) * 1e-9:.1f} s: the logger was "
            "stopped, the machine slept or a driver hung; what the kernel could not keep of this time is lost"
            for begin_ns, end_ns, buses in joined
        ]


def _resident_bytes() -> int:
    """Return the resident memory of this process; 0 where the system does not report it."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
