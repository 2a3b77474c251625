"""A session: sources -> queue -> files, until its time is up or it is ended (docs/decisions/logger.md)."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping

from daq.errors import Fault, HardwareError
from daq.logger.health.report import Level
from daq.logger.host_monitor import HostMonitor, disk_fault
from daq.logger.inspection import Feed
from daq.logger.listener import Arrival, ByteQueue, Listener, together
from daq.logger.session_monitor import Ending, LogSummary, SessionMonitor, SessionParts
from daq.sources.can_source import SourceCounters

_WAIT_S = 0.05
_GATHER_S = 0.2
"""Frames wait this long in the queue, or until the next flush, and are written together, which takes less CPU."""
_FETCH_S = 0.01
"""So long before the end of that wait, the listeners fetch what the kernel still holds."""
_MOST_AT_ONCE = 4 << 20
_PROGRESS_EVERY_S = 1.0
_JOIN_S = 5.0
_MB = 1_000_000
_STATUS = {"signal": "interrupted", "duration": "ok", "stop": "ok", "disk": "disk full or failed"}


class Session:
    """Records until it ends, and closes the files however it ends."""

    def __init__(self, parts: SessionParts) -> None:
        self._parts = parts
        self._recorder = parts.recorder
        self._buses = tuple(source.name for source in parts.sources)
        self._queue: ByteQueue[Arrival] = ByteQueue(int(parts.vehicle.logger.queue_mb * _MB))
        self._stop = threading.Event()
        self._listeners = [
            Listener(number, source, self._buses, parts.clock, self._queue, self._stop)
            for number, source in enumerate(parts.sources)
        ]
        self._feed = Feed()
        self._host_monitor = HostMonitor(parts.clock, self._listeners, self._queue, parts.guard)
        self._shield = parts.inspector.shield
        self._monitor = SessionMonitor(parts, self._host_monitor, self._feed)
        self._caught = parts.caught
        self._disk_faults: tuple[Fault, ...] = ()

    def record(self, duration_s: float | None) -> LogSummary:
        """Record until `duration_s` is over, a signal or a command ends it, or the disk is full."""
        began_at = time.monotonic()
        deadline = None if duration_s is None else began_at + duration_s
        status = "failed"
        try:
            for listener in self._listeners:
                listener.start()
            self._parts.inspector.start()
            self._parts.notifier.ready("recording")
            ending = self._write_until(deadline)
            self._finish(ending)
            status = _STATUS[ending]
        except HardwareError as error:
            ending, self._disk_faults = "disk", error.faults
            status = _STATUS[ending]
        finally:
            self._end(status)
        return self._summary(ending, time.monotonic() - began_at)

    def _write_until(self, deadline: float | None) -> Ending:
        report_at = time.monotonic()
        while (ending := self._ending(deadline)) is None:
            now = time.monotonic()
            if self._parts.progress is not None and now >= report_at:
                self._parts.progress(self._monitor.status())
                report_at = now + _PROGRESS_EVERY_S
            left_s = math.inf if deadline is None else max(deadline - now, 0.0)
            if self._write_queued(min(_WAIT_S, left_s)):
                self._gather(min(_GATHER_S, left_s, self._recorder.flush_due_s))
        return ending

    def _gather(self, seconds: float) -> None:
        """Let frames gather in the queue; at the end have the listeners fetch the newest."""
        time.sleep(max(seconds - _FETCH_S, 0.0))
        for listener in self._listeners:
            listener.hurry()
        time.sleep(max(min(seconds, _FETCH_S), 0.0))

    def _write_queued(self, wait_s: float) -> bool:
        """Write what is in the queue, then do all else that is due; return whether something was in it."""
        self._queue.wait(wait_s)
        share = self._queue.share
        came = together(self._queue.take_some(_MOST_AT_ONCE))
        for arrival in came:
            self._recorder.write(arrival)
            self._feed.take(arrival.batch, share)
        self._recorder.tick()
        self._shield.run(lambda: self._monitor.run_due(time.monotonic()))
        return bool(came)

    def _ending(self, deadline: float | None) -> Ending | None:
        """Return why it ends now, if it does."""
        if self._caught:
            return "signal"
        if self._parts.asked_to_stop.is_set():
            return "stop"
        if self._host_monitor.disk.level is Level.RED:
            self._disk_faults = (disk_fault(self._recorder.path.parent, self._host_monitor.disk),)
            return "disk"
        return "duration" if deadline is not None and time.monotonic() >= deadline else None

    def _finish(self, ending: Ending) -> None:
        """Stop the listeners, and write what they still fetched."""
        self._parts.notifier.stopping()
        self._stop.set()
        for listener in self._listeners:
            listener.hurry()
        until = time.monotonic() + _JOIN_S
        while any(listener.is_alive() for listener in self._listeners) and time.monotonic() < until:
            self._write_queued(0.01)
        while self._write_queued(0.0):
            pass
        self._shield.run(self._monitor.conclude)
        if ending == "disk":
            self._recorder.event("disk", str(self._disk_faults[0]), "error")

    def _end(self, status: str) -> None:
        """Close everything; a thread that does not end is left behind."""
        self._stop.set()
        for listener in self._listeners:
            listener.abandon()
        self._parts.inspector.end()
        until = time.monotonic() + _JOIN_S
        for listener in self._listeners:
            if listener.ident is not None:
                listener.join(max(until - time.monotonic(), 0.0))
            if listener.is_alive():
                self._parts.remarks.append(f"the driver of {listener.source.name} does not answer; it was left behind")
        try:
            self._count_unwritten()
            try:
                self._monitor.note_losses()
            finally:
                self._recorder.close(status)
        except HardwareError as error:
            self._disk_faults = self._disk_faults or error.faults
        finally:
            self._count_unwritten()
        if self._disk_faults:
            self._shield.run(lambda: self._monitor.show_failed_disk(self._disk_faults[0]))
        for listener in self._listeners:
            if not listener.is_alive():
                listener.source.close()

    def _count_unwritten(self) -> None:
        recorded = self._recorder.frame_counts
        for listener in self._listeners:
            listener.unwritten = listener.fetched - recorded.get(listener.source.name, 0)

    def _summary(self, ending: Ending, duration_s: float) -> LogSummary:
        counters: Mapping[str, SourceCounters] = {
            listener.source.name: listener.source.counters for listener in self._listeners
        }
        down = tuple(listener.source.fault for listener in self._listeners if listener.source.fault is not None)
        if self._disk_faults:
            ending = "disk"
        return LogSummary(
            path=self._recorder.paths[0],
            paths=tuple(self._recorder.paths),
            runs=tuple(self._recorder.runs),
            frames=dict.fromkeys(self._buses, 0) | self._recorder.frame_counts,
            error_frames={bus: count.error_frames for bus, count in counters.items()},
            drops={bus: count.dropped for bus, count in counters.items() if count.dropped is not None},
            losses=self._monitor.losses(),
            duration_s=duration_s,
            ended_by=ending,
            signal_number=self._caught[0] if self._caught and ending == "signal" else None,
            faults=(*self._disk_faults, *down),
            remarks=self._monitor.remarks(),
        )
