"""What is found out about frames while they are recorded; in a thread of its own, so that it can stop nothing."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from daq.channel import Channel
from daq.config import VehicleConfig
from daq.databases import Database
from daq.decode import Decoder
from daq.frames import FrameBatch, concatenate
from daq.health.monitor import HealthMonitor
from daq.health.report import HealthReport, HostFacts
from daq.session.shield import Shield
from daq.session.traces import Samples, Traces


@dataclass(frozen=True)
class Task:
    """Frames to inspect.

    Attributes
    ----------
    batches : list of FrameBatch
        To decode.
    skipped : list of FrameBatch
        Were recorded before `batches`, and are only counted.
    now_ns : int
        File time.
    host : HostFacts
    """

    batches: list[FrameBatch]
    skipped: list[FrameBatch]
    now_ns: int
    host: HostFacts


@dataclass(frozen=True)
class Findings:
    """What was found.

    Attributes
    ----------
    report : HealthReport
    decoded : mapping (bus, "Message.Signal") -> Channel
    traces : mapping role -> samples
    """

    report: HealthReport
    decoded: Mapping[tuple[str, str], Channel]
    traces: Mapping[str, Samples]


class Inspection:
    """Decodes frames once, for everyone who wants to know what they say.

    Parameters
    ----------
    vehicle : VehicleConfig
    traced : VehicleConfig
        The same with only those roles that can be resolved.
    databases : mapping bus -> databases
    started_ns : int
        File time.

    Raises
    ------
    ConfigError
        The databases contradict each other.
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
        """Find out what frames say."""
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
    """The thread: one task at a time, its findings to be fetched.

    Parameters
    ----------
    inspection : Inspection

    Attributes
    ----------
    shield : Shield
        Knows what went wrong.
    """

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
        """For how long it has been at work on a task."""
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
        """Inspect until told to end."""
        while (task := self._tasks.get()) is not None:
            self._found.put(self.shield.run(partial(self._inspection.inspect, task)))
