"""Inspection of frames while they are recorded, in a thread of its own.

Frames are gathered for it, and not inspected while the writer is behind. Whatever fails in here, recording goes on.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from daq import Channel, HardwareError, VehicleConfig
from daq.can import Database, Decoder, FrameBatch, concatenate
from daq.logger.health.monitor import HealthMonitor
from daq.logger.health.report import HealthReport, HostStatus
from daq.logger.snapshot import Samples, Traces

T = TypeVar("T")

_BEHIND, _CAUGHT_UP = 0.25, 0.05
_MOST_BYTES = 4 << 20


class Shield:
    """Runs what must not end a recording, and keeps what went wrong: how often, and what the last time."""

    def __init__(self) -> None:
        self.failures = 0
        self.last = ""

    def run(self, act: Callable[[], T]) -> T | None:
        """Return what `act` returns, or None where it fails.

        `HardwareError` if the disk fails: that is no matter of looking at frames.
        """
        try:
            return act()
        except HardwareError:
            raise
        except Exception as error:  # noqa: BLE001 - a bug in looking at frames must not cost the frames
            self.failures += 1
            self.last = f"{type(error).__name__}: {error}"
            return None


@dataclass(frozen=True)
class Task:
    """Frames to inspect, and the file time and the state of the host that go with them."""

    batches: list[FrameBatch]
    """To decode."""
    skipped: list[FrameBatch]
    """Were recorded before `batches`, and are only counted."""
    now_ns: int
    host: HostStatus


@dataclass(frozen=True)
class Findings:
    """Result of an inspection; channels by bus and "Message.Signal", samples by role."""

    report: HealthReport
    decoded: Mapping[tuple[str, str], Channel]
    traces: Mapping[str, Samples]


class Inspection:
    """Decodes frames once, for health, traces and decoded topics.

    `traced` is the vehicle with only those roles that can be resolved; `started_ns` is file time. `ConfigError` where
    the databases of a bus contradict each other.
    """

    def __init__(
        self,
        vehicle: VehicleConfig,
        traced: VehicleConfig,
        databases: Mapping[str, tuple[Database, ...]],
        *,
        started_ns: int,
    ) -> None:
        self._decoder = Decoder(databases)
        self._monitor = HealthMonitor(vehicle, databases, started_ns=started_ns)
        self._traces = Traces(traced, databases)

    def inspect(self, task: Task) -> Findings:
        """Decode frames and evaluate their health."""
        decoded: Mapping[tuple[str, str], Channel] = {}
        if task.skipped:
            self._monitor.skip(concatenate(task.skipped))
        if task.batches:
            batch = concatenate(task.batches)
            decoded = self._decoder.decode(batch)
            self._monitor.take(batch, decoded)
            self._traces.take(decoded)
        return Findings(self._monitor.report(task.now_ns, task.host), decoded, self._traces.fetch())


class Inspector(threading.Thread):
    """The thread: one task at a time, its findings to be fetched; `shield` knows what went wrong."""

    def __init__(self, inspection: Inspection) -> None:
        super().__init__(name="inspection", daemon=True)
        self.shield = Shield()
        self._inspection = inspection
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._found: queue.SimpleQueue[Findings | None] = queue.SimpleQueue()
        self._busy_since: float | None = None

    @property
    def idle(self) -> bool:
        """Whether it may be given a task."""
        return self._busy_since is None

    @property
    def busy_s(self) -> float:
        """For how long it has been busy with a task."""
        return 0.0 if self._busy_since is None else time.monotonic() - self._busy_since

    def give(self, task: Task) -> None:
        """Have it inspect something; it must be idle."""
        self._busy_since = time.monotonic()
        self._tasks.put(task)

    def fetch(self, timeout_s: float = 0.0) -> Findings | None:
        """Return findings that were not fetched yet, and make it idle."""
        try:
            found = self._found.get(timeout=timeout_s) if timeout_s else self._found.get_nowait()
        except queue.Empty:
            return None
        self._busy_since = None
        return found

    def end(self) -> None:
        """Have it end when its task is done."""
        self._tasks.put(None)

    def run(self) -> None:
        """Inspect until `end` is called."""
        while (task := self._tasks.get()) is not None:
            self._found.put(self.shield.run(partial(self._inspection.inspect, task)))


class Feed:
    """Frames that were recorded and wait for their inspection."""

    def __init__(self) -> None:
        self.skipped_frames = 0
        """Frames that were recorded and not inspected so far."""
        self.behind = False
        """Whether the queue was more than a quarter full, and has not drained since."""
        self._fresh: deque[FrameBatch] = deque()
        self._skipped: deque[FrameBatch] = deque()
        self._bytes = 0
        self._skipped_bytes = 0

    def take(self, batch: FrameBatch, queue_share: float) -> None:
        """Take recorded frames."""
        if queue_share > _BEHIND:
            self.behind = True
        elif queue_share < _CAUGHT_UP:
            self.behind = False
        self._fresh.append(batch)
        self._bytes += batch.frames.nbytes
        while self._fresh and (self.behind or self._bytes > _MOST_BYTES):
            self._skip()

    def task(self, now_ns: int, host: HostStatus) -> Task:
        """Return what is to be inspected now."""
        task = Task(list(self._fresh), list(self._skipped), now_ns, host)
        self._fresh.clear()
        self._skipped.clear()
        self._bytes = self._skipped_bytes = 0
        return task

    def _skip(self) -> None:
        """Give up the inspection of the oldest frames; the newest of those are kept to be counted."""
        batch = self._fresh.popleft()
        self._bytes -= batch.frames.nbytes
        self.skipped_frames += len(batch)
        self._skipped.append(batch)
        self._skipped_bytes += batch.frames.nbytes
        while self._skipped_bytes > _MOST_BYTES and len(self._skipped) > 1:
            self._skipped_bytes -= self._skipped.popleft().frames.nbytes
