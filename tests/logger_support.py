"""What tests of the logger share: a vehicle on virtual buses, a logger in a thread, and sources that can fail."""

from __future__ import annotations

import json
import queue
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from frames_support import some_frames

from daq import BusSection, Fault, HardwareError, VehicleConfig, WheelsoilError
from daq.can import FrameBatch
from daq.logger import Command, LogSummary, log
from daq.sources import Source, SourceCounters, open_source


class Clocks:
    """The host's clocks, which advance only when a test moves them."""

    def __init__(self) -> None:
        self.monotonic_ns = 5_000 * 10**9
        self.offset_ns = 1_780_000_000 * 10**9

    def pass_s(self, seconds: float) -> None:
        self.monotonic_ns += round(seconds * 1e9)

    def monotonic(self) -> int:
        return self.monotonic_ns

    def seconds(self) -> float:
        return self.monotonic_ns * 1e-9

    def realtime(self) -> int:
        return self.monotonic_ns + self.offset_ns


def virtual_bus() -> BusSection:
    return BusSection(channel=f"bus-{uuid.uuid4().hex}", interface="virtual", fd=True)


def wait_until(condition: Callable[[], object], timeout_s: float = 20.0) -> None:
    """Wait until something has come true."""
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "it did not come true"
        time.sleep(0.01)


class Recorder:
    """`log` in a thread, started when its sources are open."""

    def __init__(self, vehicle: VehicleConfig, out: Path, **options: Any) -> None:
        self.stop = threading.Event()
        self._ready = threading.Event()
        self._result: queue.Queue[LogSummary | WheelsoilError] = queue.Queue()
        self._thread = threading.Thread(target=self._run, args=(vehicle, out), kwargs=options)
        self._thread.start()
        assert self._ready.wait(30)

    def _run(self, vehicle: VehicleConfig, out: Path, **options: Any) -> None:
        try:
            self._result.put(log(vehicle, out, stop=self.stop, progress=lambda _: self._ready.set(), **options))
        except WheelsoilError as error:
            self._result.put(error)
        finally:
            self._ready.set()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def result(self) -> LogSummary:
        self._thread.join(30)
        result = self._result.get(timeout=1)
        assert isinstance(result, LogSummary), result
        return result

    def end(self) -> LogSummary:
        self.stop.set()
        return self.result()


class Handset:
    """A panel in the test's hand."""

    def __init__(self) -> None:
        self.snapshots: list[dict[str, Any]] = []
        self._commands: list[Command] = []
        self.closed = False

    def press(self, kind: str, text: str = "") -> None:
        self.snapshots.clear()
        self._commands.append(Command(kind, text))  # type: ignore[arg-type]

    def storm(self, commands: list[Command]) -> None:
        self._commands += commands

    def show(self, snapshot: Any) -> None:
        self.snapshots.append(json.loads(json.dumps(snapshot, allow_nan=False)))

    def commands(self) -> list[Command]:
        pressed, self._commands = self._commands, []
        return pressed

    def close(self) -> None:
        self.closed = True

    def wait_for(self, condition: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Wait for a snapshot that is as wanted, and return it."""
        found: list[dict[str, Any]] = []

        def is_there() -> bool:
            found[:] = [snapshot for snapshot in self.snapshots if condition(snapshot)][-1:]
            return bool(found)

        wait_until(is_there)
        return found[0]


class ScriptedSource:
    """A source that hands out what a test gives it, and fails on request."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.remarks: tuple[str, ...] = ()
        self.closed = 0
        self.dropped = 0
        self.up = True
        self._given = self._received = 0
        self._waiting: queue.Queue[FrameBatch | HardwareError] = queue.Queue()

    def give(self, item: FrameBatch | HardwareError) -> None:
        if isinstance(item, FrameBatch):
            self._given += len(item)
        self._waiting.put(item)

    def drain(self) -> None:
        """Wait until all that was given has been read: it is recorded then, however soon the logger ends."""
        wait_until(lambda: self._received == self._given)

    def fail(self, what: str = "the interface failed") -> None:
        self.give(HardwareError(Fault(what, f"bus {self.name}")))

    @property
    def counters(self) -> SourceCounters:
        return SourceCounters(self._received, self.dropped, 0, None)

    def read(self, timeout_s: float) -> FrameBatch:
        try:
            item = self._waiting.get(timeout=max(timeout_s, 0.001))
        except queue.Empty:
            return FrameBatch.empty((self.name,))
        if isinstance(item, HardwareError):
            raise item
        self._received += len(item)
        return FrameBatch(item.frames.copy(), (self.name,))

    def is_up(self) -> bool:
        return self.up

    def close(self) -> None:
        self.closed += 1


class Opener:
    """Opens scripted sources under their names, and everything else as the logger does."""

    def __init__(self, *names: str) -> None:
        self.names = names
        self.opened: dict[str, list[ScriptedSource]] = {name: [] for name in names}
        self.refused: dict[str, str] = {}

    def __call__(self, bus: BusSection) -> Source:
        if bus.channel not in self.opened:
            return open_source(bus)
        if bus.channel in self.refused:
            raise HardwareError(Fault(self.refused[bus.channel], f"bus {bus.channel}"))
        self.opened[bus.channel].append(ScriptedSource(bus.channel))
        return self.opened[bus.channel][-1]

    def source(self, name: str) -> ScriptedSource:
        return self.opened[name][-1]


def recent_frames(seed: int, count: int, bus: str = "x") -> FrameBatch:
    """Return frames that have just come in."""
    batch = some_frames(np.random.default_rng(seed), count, buses=(bus,))
    batch.frames["time_ns"] = time.time_ns() - np.arange(count, 0, -1) * 1000
    return batch
