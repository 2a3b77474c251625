"""The thread of one bus: fetches frames, brings their stamps to the session's time base, and queues them.

The queue between these threads and the one that writes has a limit in bytes.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from daq.can.frames import FrameBatch, concatenate
from daq.host_clock import HostClock, StampTracker, monotonic_ns
from daq.sources.can_source import BusStatus
from daq.sources.reconnect import ReconnectingSource

T = TypeVar("T")

SILENCE_S = 2.0
"""A thread that takes no turn for so long was held up: the process was stopped, the machine slept, or a driver hung.
A usual turn takes `_READ_TIMEOUT_S` and a rest."""

_READ_TIMEOUT_S = 0.1
_WAIT_FOR_ROOM_S = 0.1
_FAIR_BUFFER_BYTES, _LARGE_BUFFER_BYTES = 1 << 20, 4 << 20
"""Sizes of the kernel's buffer of a bus; a large one has room for a second of a busy bus."""
_REST_S, _BUSY_REST_S, _SHORT_REST_S = 0.2, 0.03, 0.005
"""Rests after a reading, so that one reading, which costs CPU, brings hundreds of frames: with a large buffer; with a
fair one, or after `_MANY_FRAMES`; with a small one. A flush ends the rest."""
_MANY_FRAMES = 3000
_LAST_FRAMES = 1024
"""A reading that brings fewer has emptied the source."""
_OPENING_S = 60.0
"""What opening an interface may take."""
_SILENCES_KEPT = 100
_LAST_FETCHES_S = 2.0
"""Time after the end in which a source is emptied; what it still brings then was sent after the end."""


class ByteQueue(Generic[T]):
    """Hands items from several threads to one, in order.

    A put waits beyond the limit. A single item may be larger: it is taken when the queue is empty.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._items: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    @property
    def share(self) -> float:
        """How full it is, 0 to 1 (an item beyond the limit makes it more than 1)."""
        return self._bytes / self._limit

    def put(self, item: T, size: int, timeout_s: float) -> bool:
        """Put an item of `size` bytes; return whether there was room for it within `timeout_s`."""
        with self._changed:
            if not self._changed.wait_for(lambda: not self._items or self._bytes + size <= self._limit, timeout_s):
                return False
            self._items.append((item, size))
            self._bytes += size
            self._changed.notify_all()
            return True

    def wait(self, timeout_s: float) -> None:
        """Wait until there is an item, at most `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._items, timeout_s)

    def take_some(self, most_bytes: int) -> list[T]:
        """Return the items that are there, in order, without waiting; at least one, if there is one."""
        with self._changed:
            taken: list[T] = []
            left = most_bytes
            while self._items and (left >= self._items[0][1] or not taken):
                item, size = self._items.popleft()
                taken.append(item)
                left -= size
            self._bytes -= most_bytes - left
            self._changed.notify_all()
            return taken


@dataclass(frozen=True)
class Arrival:
    """Frames of one bus as the writer takes them, and the offset of the host's clock that they came with."""

    batch: FrameBatch
    bus: str
    realtime_minus_monotonic_ns: int


def together(arrivals: Sequence[Arrival]) -> list[Arrival]:
    """Join what came from the same bus with the same offset, so that it is written at once."""
    groups: dict[tuple[str, int], list[FrameBatch]] = {}
    for arrival in arrivals:
        groups.setdefault((arrival.bus, arrival.realtime_minus_monotonic_ns), []).append(arrival.batch)
    return [Arrival(concatenate(batches), bus, offset_ns) for (bus, offset_ns), batches in groups.items()]


class Listener(threading.Thread):
    """Reads one source until `stop` is set and the source is empty.

    `number` is the position of the bus among `buses`. `alive_at` is the monotonic time of the last iteration, s, for
    the watchdog. Of the frames `fetched`, those `unwritten` were not recorded; they are counted when the recording is
    closed. `silences` are the monotonic times, ns, between which it took no turn for longer than `SILENCE_S`;
    `HostMonitor` takes them.
    """

    def __init__(
        self,
        number: int,
        source: ReconnectingSource,
        buses: tuple[str, ...],
        clock: HostClock,
        queue: ByteQueue[Arrival],
        stop: threading.Event,
    ) -> None:
        super().__init__(name=f"source {source.name}", daemon=True)
        self.source = source
        self.alive_at = time.monotonic()
        self.fetched = 0
        self.unwritten = 0
        self.silences: deque[tuple[int, int]] = deque(maxlen=_SILENCES_KEPT)
        self._turn_ns = monotonic_ns()
        self._number = number
        self._buses = buses
        self._stamps = StampTracker(clock, source.name)
        self._queue = queue
        self._asked_to_stop = stop
        self._abandoned = False
        self._wanted = threading.Event()

    @property
    def uncertain_frames(self) -> int:
        """Frames whose time is uncertain, because the clock was set when they came."""
        return self._stamps.uncertain

    @property
    def stuck_s(self) -> float:
        """Time since the last iteration; the time that opening an interface may take is subtracted."""
        return max(time.monotonic() - self.alive_at - (_OPENING_S if self.source.opening else 0.0), 0.0)

    def status(self) -> BusStatus:
        """Return what is known of the bus now."""
        return replace(self.source.status(), queue_drops=self.unwritten)

    def abandon(self) -> None:
        """Make it drop frames for which there is no room, because nothing is written any more."""
        self._abandoned = True

    def hurry(self) -> None:
        """Make it fetch now, before a flush."""
        self._wanted.set()

    def run(self) -> None:
        """Fetch frames."""
        self._turn_ns = monotonic_ns()
        while not self._asked_to_stop.is_set():
            count = self._fetch(_READ_TIMEOUT_S)
            if count:
                self._rest(count)
        until = time.monotonic() + _LAST_FETCHES_S
        while self._fetch(0.0) >= _LAST_FRAMES and time.monotonic() < until and not self._abandoned:
            pass

    def _rest(self, count: int) -> None:
        room_bytes = self.source.counters.buffer_bytes or 0
        if room_bytes < _FAIR_BUFFER_BYTES:
            rest_s = _SHORT_REST_S
        else:
            rest_s = _BUSY_REST_S if room_bytes < _LARGE_BUFFER_BYTES or count >= _MANY_FRAMES else _REST_S
        self._wanted.wait(rest_s)
        self._wanted.clear()

    def _note_turn(self) -> None:
        """Note the time of this turn, and a silence before it."""
        before_ns, self._turn_ns = self._turn_ns, monotonic_ns()
        self.alive_at = time.monotonic()
        if self._turn_ns - before_ns > SILENCE_S * 1e9 and self.source.fault is None:  # a fault has its own events
            self.silences.append((before_ns, self._turn_ns))

    def _fetch(self, timeout_s: float) -> int:
        self._note_turn()
        self._stamps.before_read()
        batch = self._stamps.after_read(self.source.read(timeout_s))
        if not len(batch):
            return 0
        self.fetched += len(batch)
        batch.frames["bus"] = self._number
        arrival = Arrival(
            FrameBatch(batch.frames, self._buses), self.source.name, self._stamps.realtime_minus_monotonic_ns
        )
        while not self._queue.put(arrival, batch.frames.nbytes, _WAIT_FOR_ROOM_S):
            self._note_turn()
            if self._abandoned:
                break
        return len(batch)
