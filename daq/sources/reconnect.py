"""A source that reconnects: a failed bus is opened again until it works.

An interface that is taken down keeps its socket, which hands out frames again once the interface is up. One that is
gone (pulled out, deleted) is closed and opened anew: after half a second, then every two. Controllers that leave the
bus report it in error frames, which are trusted.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from daq import BusSection, ConfigError, Fault, HardwareError
from daq.can.frames import ErrorClass, FrameBatch, FrameFlag
from daq.recording.events import Severity
from daq.sources.can_source import BusState, BusStatus, InterfaceDownError, Source, SourceCounters

FIRST_RETRY_S = 0.5
RETRY_S = 2.0
_CHECK_EVERY_S = 0.2


@dataclass(frozen=True)
class BusChange:
    """A bus that went down or came back."""

    bus: str
    state: BusState
    text: str

    @property
    def severity(self) -> Severity:
        """Severity of its event."""
        return "info" if self.state == "up" else "error"


class ReconnectingSource:
    """A source that survives its interface; see `daq.sources.can_source.Source`.

    It is read by one thread; `status`, `counters` and `changes` may be asked for by another. `fault` is why the bus is
    not up now.

    `opener` opens the bus, as `daq.sources.open_source` does; ConfigError or HardwareError if it cannot the first time.
    """

    def __init__(self, bus: BusSection, opener: Callable[[BusSection], Source]) -> None:
        self.name = bus.channel
        self._bus = bus
        self._opener = opener
        self._lock = threading.Lock()
        self._source: Source | None = opener(bus)
        self._remarks = dict.fromkeys(self._source.remarks)
        self._before = SourceCounters(0, None, 0, None)
        self._state: BusState = "up"
        self.fault: Fault | None = None
        self._changes: list[BusChange] = []
        self._reconnects = 0
        self._retry_at = self._look_at = 0.0
        self._down_since = 0.0
        self.opening = False
        if not self._source.is_up():
            step = f"ip link set {self.name} up"
            self._go("down", Fault("the interface is down", f"bus {self.name}", next_step=step))
            self._remarks[f"{self.name} is down; it is recorded from when it is up: {step}"] = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `daq.sources.can_source.Source`; of all openings."""
        return tuple(self._remarks)

    @property
    def counters(self) -> SourceCounters:
        """See `daq.sources.can_source.Source`; over all openings."""
        with self._lock:
            return self._before if self._source is None else _added(self._before, self._source.counters)

    def status(self) -> BusStatus:
        """Return what is known of the bus now."""
        counters, fault = self.counters, self.fault
        detail = "" if fault is None else _fault_text(fault)
        return BusStatus(self._state, counters.received, counters.dropped, reconnects=self._reconnects, detail=detail)

    def changes(self) -> list[BusChange]:
        """Return what has happened since the last call."""
        with self._lock:
            changes, self._changes = self._changes, []
        return changes

    def read(self, timeout_s: float) -> FrameBatch:
        """See `daq.sources.can_source.Source`; a bus that is down has no frames, and never raises."""
        if self._source is None and not self._reopened(timeout_s):
            return FrameBatch.empty((self.name,))
        assert self._source is not None
        try:
            batch = self._source.read(timeout_s)
        except InterfaceDownError as error:
            self._go("down", error.faults[0])
            return FrameBatch.empty((self.name,))
        except Exception as error:  # noqa: BLE001 - a bug in a driver must cost no more than a reconnection
            self._give_up(_fault_of(self.name, error))
            return FrameBatch.empty((self.name,))
        if self._state != "up" or (len(batch) and bool((batch.frames["flags"] & FrameFlag.ERROR).any())):
            self._judge(batch)
        return batch

    def is_up(self) -> bool:
        """See `daq.sources.can_source.Source`."""
        return self._state == "up"

    def close(self) -> None:
        """See `daq.sources.can_source.Source`."""
        with self._lock:
            source = self._source
        if source is not None:
            _close(source)

    def _judge(self, batch: FrameBatch) -> None:
        """Read from frames, or from the interface, whether the bus is up."""
        frames = batch.frames
        is_error = (frames["flags"] & FrameFlag.ERROR) != 0
        left = _last(is_error & ((frames["can_id"] & ErrorClass.BUS_OFF) != 0))
        back = _last(~is_error | ((frames["can_id"] & ErrorClass.RESTARTED) != 0))
        if left >= 0:
            step = f"check wiring, termination and bit rate; ip link set {self.name} type can restart-ms 100"
            self._go("bus_off", Fault("the controller has left the bus (bus-off)", f"bus {self.name}", next_step=step))
        if back > left or (self._state == "down" and self._answers()):
            self._go("up", None)

    def _answers(self) -> bool:
        now = time.monotonic()
        if now < self._look_at:
            return False
        self._look_at = now + _CHECK_EVERY_S
        return self._source is not None and self._source.is_up()

    def _reopened(self, timeout_s: float) -> bool:
        """Open the bus again if it is time to, else wait a little."""
        wait_s = self._retry_at - time.monotonic()
        if wait_s > 0 or not timeout_s:
            time.sleep(max(min(wait_s, timeout_s), 0.0))
            return False
        self.opening = True
        try:
            source = self._opener(self._bus)
        except Exception as error:  # noqa: BLE001 - as in `read`
            self.fault = _fault_of(self.name, error)
            self._retry_at = time.monotonic() + RETRY_S
            return False
        finally:
            self.opening = False
        with self._lock:
            self._source = source
            self._reconnects += 1
            self._remarks |= dict.fromkeys(source.remarks)
        if source.is_up():
            self._go("up", None)
        return True

    def _give_up(self, fault: Fault) -> None:
        """Close a source that failed, and keep what it counted; nothing waits for its driver meanwhile."""
        with self._lock:
            source, self._source = self._source, None
            assert source is not None
            self._before = _added(self._before, source.counters)
        self._go("down", fault)
        _close(source)
        self._retry_at = time.monotonic() + FIRST_RETRY_S

    def _go(self, state: BusState, fault: Fault | None) -> None:
        self.fault = fault
        if state == self._state:
            return
        now = time.monotonic()
        if state == "up":
            text = f"{self.name} is back after {now - self._down_since:.1f} s"
        else:
            assert fault is not None
            text = f"{self.name}: {_fault_text(fault)}"
        if self._state == "up":
            self._down_since = now
        self._state = state
        with self._lock:
            self._changes.append(BusChange(self.name, state, text))


def _close(source: Source) -> None:
    """Close a source; a driver whose adapter was pulled out may fail at that too."""
    with contextlib.suppress(Exception):
        source.close()


def _fault_of(name: str, error: Exception) -> Fault:
    if isinstance(error, ConfigError | HardwareError):
        return error.faults[0]
    found, step = f"{type(error).__name__}: {error}", "check the adapter and its cable"
    return Fault("the interface's driver failed", f"bus {name}", found, next_step=step)


def _fault_text(fault: Fault) -> str:
    return fault.what + (f" ({fault.found})" if fault.found else "")


def _last(rows: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int:
    """Return the position of the last True, -1 without one."""
    found = np.flatnonzero(rows)
    return int(found[-1]) if len(found) else -1


def _added(earlier: SourceCounters, later: SourceCounters) -> SourceCounters:
    dropped = [count for count in (earlier.dropped, later.dropped) if count is not None]
    return SourceCounters(
        earlier.received + later.received,
        sum(dropped) if dropped else None,
        earlier.error_frames + later.error_frames,
        later.buffer_bytes,
    )
