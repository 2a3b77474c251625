"""Everything beside writing frames: inspection, health, events, the panel and its commands, the service manager.

The service manager (systemd) is notified of ready, alive and stopping by the sd_notify protocol, without its library.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from daq import Fault, VehicleConfig
from daq.host_clock import HostClock
from daq.logger.health.monitor import statuses
from daq.logger.health.report import HealthReport, Level, Reason, reason
from daq.logger.health.report import worst as worst_level
from daq.logger.host_monitor import DiskGuard, HostMonitor
from daq.logger.inspection import Feed, Findings, Inspector
from daq.logger.panel import Command, Panel
from daq.logger.recorder import Recorder
from daq.logger.snapshot import RunState, Samples, SessionState, snapshot, worst
from daq.sources.can_source import SourceCounters
from daq.sources.reconnect import ReconnectingSource

Ending = Literal["duration", "signal", "stop", "disk"]

_RUN_EVERY_S = 0.05
_INSPECT_EVERY_S = 0.4
_SHOW_EVERY_S = 0.2
_INSPECTION_STUCK_S = 5.0
_LAST_INSPECTION_S = 2.0
_FAILURE_STANDS_S = 10.0
_LOST_FILE_STANDS_S = 60.0
_SWITCH_EVERY_S = 1.0
"""Least duration of a run between two commands."""
_MARKS_AT_ONCE = 4
_MOST_ASKED = 32
_MOST_REMARKS = 50


class Notifier:
    """Sends states to the socket that the service manager gave; without one it sends nothing.

    The address is the path of a datagram socket; with a leading ``@`` it is in the abstract namespace.
    """

    def __init__(self, address: str = "") -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Notifier:
        """Return the one that ``NOTIFY_SOCKET`` asks for."""
        return cls(environment.get("NOTIFY_SOCKET", ""))

    def ready(self, status: str = "") -> None:
        """Report that the service has started."""
        self._send("READY=1", f"STATUS={status}")

    def alive(self) -> None:
        """Report that the service still works."""
        self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Report in a line what the service does."""
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """Report that the service is about to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, *lines: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # a manager that does not listen is no reason to stop recording
                self._socket.sendto("\n".join(line.replace("\n", " ") for line in lines).encode(), self._address)


@dataclass(frozen=True)
class LogStatus:
    """The logger now."""

    buses: Mapping[str, SourceCounters]
    run: str
    """Id of the run; empty between runs."""
    path: Path
    """The file that is written."""
    level: str
    """``"green"``, ``"amber"`` or ``"red"``."""
    what: str
    """The worst reason; empty when it is green."""


Progress = Callable[[LogStatus], None]


@dataclass(frozen=True)
class LogSummary:
    """What was recorded, and how it ended.

    Attributes
    ----------
    path : Path
        The first file.
    paths : tuple of Path
        All files, in the order in which they were begun; those between runs too.
    runs : tuple of str
        Ids of the runs.
    frames, error_frames : dict of str to int
        Per bus, 0 for one that was silent.
    drops : dict of str to int
        Frames that the kernel lost, of the buses that count them.
    losses : dict of str to int
        Everything that was lost: ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>`` (the rolling counter
        jumped), ``wrapped.<bus>.<message>`` (gaps so long that it may have wrapped around) and
        ``missing.<bus>.<message>`` (against the learned rate).
    ended_by : str
        ``"duration"``, ``"signal"`` (see `signal_number`), ``"stop"`` or ``"disk"``: it is full, or failed.
    faults : tuple of Fault
        Of the disk, and of the buses that were down at the end.
    """

    path: Path
    paths: tuple[Path, ...]
    runs: tuple[str, ...]
    frames: dict[str, int]
    error_frames: dict[str, int]
    drops: dict[str, int]
    losses: dict[str, int]
    duration_s: float
    ended_by: Ending
    signal_number: int | None
    faults: tuple[Fault, ...]
    remarks: tuple[str, ...]

    @property
    def silent(self) -> tuple[str, ...]:
        """Buses of which no frame came."""
        return tuple(bus for bus, count in self.frames.items() if not count)


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


class SessionMonitor:
    """Health, page, commands and remarks of a running session; called between two writes, in the thread that writes."""

    def __init__(self, parts: SessionParts, host_monitor: HostMonitor, feed: Feed) -> None:
        self._parts = parts
        self._recorder = parts.recorder
        self._inspector = parts.inspector
        self._host_monitor = host_monitor
        self._feed = feed
        self._started_ns = parts.clock.now_ns()
        self._run_at = self._inspect_at = self._show_at = 0.0
        self._report: HealthReport | None = None
        self._traces: dict[str, Samples] = {}
        self._failures_reported = 0
        self._failed_at = -_FAILURE_STANDS_S
        self._file_lost, self._file_lost_at = "", -math.inf
        self._folder_fault = ""
        self._disk_fault: Fault | None = None
        self._stuck_reported = False
        self._stopping = False
        self._asked: list[Command] = []
        self._switch_at = 0.0

    def run_due(self, now_s: float) -> None:
        """Do what is due."""
        if now_s < self._run_at:
            return
        self._run_at = now_s + _RUN_EVERY_S
        self._obey_some(now_s)
        self._take_findings(self._inspector.fetch())
        self._host_monitor.skipped_frames = self._feed.skipped_frames
        if self._host_monitor.refresh(now_s, self._recorder.bytes_written):
            self._each_second()
        for name, text, severity in self._host_monitor.events(self._feed.behind):
            self._recorder.event(name, text, severity)
        self._report_inspection(now_s)
        if now_s >= self._inspect_at and self._inspector.idle:
            self._inspect_at = now_s + _INSPECT_EVERY_S
            self._inspector.give(self._feed.task(self._parts.clock.now_ns(), self._host_monitor.host()))
        if now_s >= self._show_at:
            self._show_at = now_s + _SHOW_EVERY_S
            self._parts.panel.show(snapshot(self._state()))
            self._traces = {}

    def conclude(self) -> None:
        """Inspect and write the remaining frames, and show the final state."""
        self._stopping = True
        self._take_findings(self._inspector.fetch(_LAST_INSPECTION_S) if not self._inspector.idle else None)
        if self._inspector.idle:
            self._inspector.give(self._feed.task(self._parts.clock.now_ns(), self._host_monitor.host()))
            self._take_findings(self._inspector.fetch(_LAST_INSPECTION_S))
        self._write_health()
        self._note_clock()
        self._parts.panel.show(snapshot(self._state()))

    def show_failed_disk(self, fault: Fault) -> None:
        """Show that the disk has ended the recording."""
        self._disk_fault = fault
        self._parts.panel.show(snapshot(self._state()))

    def note_losses(self) -> None:
        """Pass the counts of lost frames to the recorder."""
        drops = {bus: status.kernel_drops for bus, status in self._host_monitor.buses().items()}
        self._recorder.note_losses({bus: n for bus, n in drops.items() if n is not None}, self.losses())

    def losses(self) -> dict[str, int]:
        """Return the counts of lost frames by cause; see `LogSummary`."""
        lost = dict(self._report.losses) if self._report else {}
        for bus, status in self._host_monitor.buses().items():
            lost |= {f"kernel.{bus}": status.kernel_drops or 0, f"queue.{bus}": status.queue_drops}
        return {key: count for key, count in lost.items() if count > 0}

    def remarks(self) -> tuple[str, ...]:
        """Return the remarks for the user."""
        opened = (remark for source in self._parts.sources for remark in source.remarks)
        return tuple(dict.fromkeys((*opened, *self._parts.remarks)))

    def status(self) -> LogStatus:
        """Return the state for a terminal."""
        found = worst(self._state())
        return LogStatus(
            {source.name: source.counters for source in self._parts.sources},
            self._recorder.run_id,
            self._recorder.path,
            worst_level(found).name.lower(),
            f"{found[0].where}: {found[0].what}" if found else "",
        )

    def _each_second(self) -> None:
        if not self._host_monitor.hopeless():
            self._parts.notifier.alive()
        text = self._recorder.replace_lost_file()
        if text:
            self._file_lost, self._file_lost_at = text, time.monotonic()
            self._remark(text)
        # Record an event when no other file can be made any more, and when one can be again.
        before, self._folder_fault = self._folder_fault, self._recorder.folder_fault()
        if self._folder_fault and not before:
            self._recorder.event("folder", self._folder_words(), "warning")
        elif before and not self._folder_fault:
            self._recorder.event("folder", "files can be made again")
        self.note_losses()
        self._write_health()
        self._note_clock()
        now = self.status()
        self._parts.notifier.status(f"{now.level}, {f'run {now.run}' if now.run else 'between runs'} {now.what}")

    def _folder_words(self) -> str:
        return f"{self._folder_fault}; recording continues in {self._recorder.path.name}"

    def _write_health(self) -> None:
        if self._report is not None:
            self._recorder.write_health(self._report.time_ns, statuses(self._report))

    def _note_clock(self) -> None:
        """Pass the state of the host's clock to the recorder."""
        fit = self._report.gnss.clock if self._report and self._report.gnss else None
        uncertain = {
            f"unsure_frames.{bus}": str(count) for bus, count in self._host_monitor.uncertain_frames().items() if count
        }
        self._recorder.note_clock(fit, uncertain)

    def _take_findings(self, found: Findings | None) -> None:
        if found is None:
            return
        self._report = found.report
        for role, (times, values) in found.traces.items():
            known = self._traces.setdefault(role, ([], []))
            known[0].extend(times)
            known[1].extend(values)
        self._inspector.shield.run(lambda: self._recorder.write_decoded(found.decoded))

    def _obey_some(self, now_s: float) -> None:
        """Carry out commands of the user, only a few at a time, so that writing frames is not delayed."""
        self._asked += self._parts.panel.commands()
        del self._asked[_MOST_ASKED:]
        for _ in range(_MARKS_AT_ONCE):
            if not self._asked or (self._asked[0].kind != "mark" and now_s < self._switch_at):
                return
            command = self._asked.pop(0)
            if command.kind != "mark":
                self._switch_at = now_s + _SWITCH_EVERY_S
            self._obey(command)

    def _remark(self, text: str) -> None:
        """Keep a remark for the user; only the newest `_MOST_REMARKS` are kept."""
        self._parts.remarks[:] = [*(known for known in self._parts.remarks if known != text), text][-_MOST_REMARKS:]

    def _obey(self, command: Command) -> None:
        text = ""
        self.note_losses()
        if command.kind == "start":
            text = self._recorder.start(command.text.strip())
        elif command.kind == "stop":
            text = self._recorder.stop()
        else:
            self._recorder.mark(command.text.strip())
        if text:
            self._remark(text)

    def _report_inspection(self, now_s: float) -> None:
        """Record an event for each new failure of the inspection, and one when it takes too long."""
        shield = self._inspector.shield
        if shield.failures != self._failures_reported:
            if now_s - self._failed_at >= _FAILURE_STANDS_S:
                text = f"frames are recorded, but could not be inspected: {shield.last}"
                self._recorder.event("logger", text, "error")
                self._remark(text)
            self._failures_reported, self._failed_at = shield.failures, now_s
        stuck = self._inspector.busy_s > _INSPECTION_STUCK_S
        if stuck and not self._stuck_reported:
            text = "the inspection of frames is stuck: they are recorded, but not decoded any more"
            self._recorder.event("logger", text, "error")
            self._remark(text)
        self._stuck_reported = stuck

    def _reasons(self) -> tuple[Reason, ...]:
        """Return the current reasons that the last report, which may be old, does not contain."""
        found = self._host_monitor.stuck()
        if self._disk_fault is not None:
            what = f"recording has ended: {self._disk_fault.what} ({self._disk_fault.found})"
            found.append(reason("disk_failed", Level.RED, "disk", what))
        if self._folder_fault:
            found.append(reason("folder_closed", Level.AMBER, "recording", self._folder_words()))
        if time.monotonic() - self._file_lost_at < _LOST_FILE_STANDS_S:
            found.append(reason("file_gone", Level.RED, "recording", self._file_lost))
        if self._stuck_reported:
            what = f"busy for {self._inspector.busy_s:.0f} s: frames are not decoded any more"
            found.append(reason("inspection_stuck", Level.RED, "inspection", what))
        elif time.monotonic() - self._failed_at < _FAILURE_STANDS_S:
            found.append(reason("inspection_failed", Level.AMBER, "inspection", self._inspector.shield.last))
        return tuple(found)

    def _state(self) -> SessionState:
        recorder, now_ns = self._recorder, self._recorder.now_ns()
        run = RunState(
            id=recorder.run_id,
            file=recorder.path.name,
            since_s=(now_ns - recorder.begun_ns) * 1e-9,
            part=recorder.part,
            frames=recorder.run_frames,
            mb=recorder.run_bytes * 1e-6,
        )
        return SessionState(
            vehicle=self._parts.vehicle,
            state="stopping" if self._stopping else "between" if recorder.between else "recording",
            file_ns=now_ns,
            started_ns=self._started_ns,
            session_ns=self._parts.clock.now_ns(),
            run=run,
            report=self._report,
            host=self._host_monitor.host(),
            disk=self._host_monitor.disk,
            reasons=self._reasons(),
            traces=self._traces,
            losses=self.losses(),
            marks=recorder.marks,
            remarks=self.remarks(),
        )
