"""The time of a recording: the host's monotonic clock plus the UTC offset that held when the session began.

The kernel stamps frames with CLOCK_REALTIME, which can be set at any moment. On Linux the difference between it and
the monotonic clock changes in steps only (``docs/decisions/time.md``), so that a stamp can be brought back exactly when
it is known which difference held when it was made: `HostClock` keeps them, a `StampTracker` applies them to the frames
of one source. Frames that came in while the clock was set have an uncertain time; they are counted with its bound.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from daq import BoolArray, IntArray, Note, RecordingCode
from daq.can.frames import FrameBatch, FrameFlag

_TRIES = 7
_GOOD_BRACKET_NS = 2_000
_SLEW_NS = 0 if sys.platform == "linux" else 20_000_000
"""Change of the difference that is not called a step; elsewhere the two clocks are slewed apart, or coarse."""
EARLY_NS = 10_000_000
"""How long a frame may be between its stamp and the queue that it is read from, and how far out of order."""
LATE_NS = 1_000_000
"""How far a stamp may lie in the future; stamps through python-can are estimates."""
_WAITING_NS = 60 * 10**9
_NEVER_NS = 2**62


def realtime_ns() -> int:
    """Return CLOCK_REALTIME."""
    return time.time_ns()


def monotonic_ns() -> int:
    """Return CLOCK_BOOTTIME, the monotonic clock that goes on while the machine sleeps; else CLOCK_MONOTONIC."""
    if sys.platform == "linux":
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return time.monotonic_ns()


@dataclass(frozen=True)
class ClockStep:
    """The host's clock was set."""

    time_ns: int
    """File time by which it had been set."""
    since_ns: int
    """File time until which it had not."""
    step_s: float
    """By how much; positive is forward."""


@dataclass(frozen=True)
class Offset:
    """Realtime minus monotonic, and the monotonic time within which it can have held."""

    offset_ns: int
    from_ns: int
    """When the previous one was last observed."""
    until_ns: int
    """When the next one was first observed."""
    observed_ns: int
    """When it was first observed."""


class HostClock:
    """The time base of a session: file time is monotonic time plus `base_ns`. May be used from several threads.

    `base_ns` is added to monotonic time to have file time. `steps` has every step since the session began, by file time
    when it was observed.
    """

    def __init__(self, realtime: Callable[[], int] = realtime_ns, monotonic: Callable[[], int] = monotonic_ns) -> None:
        self._realtime = realtime
        self._monotonic = monotonic
        self._lock = threading.Lock()
        before, difference, after = self._bracket()
        self._low, self._high = difference - after, difference - before
        self._offsets = [Offset((self._low + self._high) // 2, -_NEVER_NS, _NEVER_NS, after)]
        self._last_observed = before
        self.base_ns = self._offsets[0].offset_ns
        self.steps: tuple[ClockStep, ...] = ()

    @property
    def realtime_minus_monotonic_ns(self) -> int:
        """The difference that was observed last."""
        return self._offsets[-1].offset_ns

    def now_ns(self) -> int:
        """Return file time."""
        return self._monotonic() + self.base_ns

    def monotonic_ns(self) -> int:
        """Return monotonic time; file time less `base_ns`."""
        return self._monotonic()

    def observe(self) -> int:
        """Check whether the clock was set; return the monotonic time of the check.

        One check reads realtime between two readings of monotonic time, which bounds the difference by an interval.
        There was no step as long as all intervals have a point in common. A thread that loses the processor during a
        check gets a wide interval, and so reports no step.
        """
        with self._lock:
            before, realtime, after = self._bracket()
            low, high = realtime - after, realtime - before
            if low > self._high + _SLEW_NS or high < self._low - _SLEW_NS:
                self._step((low + high) // 2, after)
                self._low, self._high = low, high
            elif max(low, self._low) <= min(high, self._high):
                self._low, self._high = max(low, self._low), min(high, self._high)
            self._last_observed = before
        return after

    def realtime_at_ns(self, monotonic: IntArray) -> IntArray:
        """Return what CLOCK_REALTIME was at monotonic times, as far as the clock has been observed."""
        known = self._offsets[:]
        held = np.searchsorted([offset.observed_ns for offset in known[1:]], monotonic, side="right")
        return np.asarray(monotonic + np.array([offset.offset_ns for offset in known])[held])

    def offsets_since(self, monotonic: int) -> tuple[Offset, ...]:
        """Return the differences that may have held at some time since; the newest last."""
        with self._lock:
            first = len(self._offsets) - 1
            while first > 0 and self._offsets[first].observed_ns > monotonic:
                first -= 1
            return tuple(self._offsets[first:])

    def _step(self, offset_ns: int, observed_ns: int) -> None:
        old = self._offsets[-1]
        self._offsets[-1] = Offset(old.offset_ns, old.from_ns, observed_ns, old.observed_ns)
        self._offsets.append(Offset(offset_ns, self._last_observed, _NEVER_NS, observed_ns))
        step_s = (offset_ns - old.offset_ns) * 1e-9
        self.steps += (ClockStep(observed_ns + self.base_ns, self._last_observed + self.base_ns, step_s),)

    def _bracket(self) -> tuple[int, int, int]:
        """Return the narrowest of a few readings: monotonic before, realtime, monotonic after."""
        best = (0, 0, _NEVER_NS)
        for _ in range(_TRIES):
            tried = (self._monotonic(), self._realtime(), self._monotonic())
            if tried[2] - tried[0] <= best[2] - best[0]:
                best = tried
            if best[2] - best[0] <= _GOOD_BRACKET_NS:
                break
        return best


class StampTracker:
    """Brings the stamps of one source to file time; for use in the thread that reads the source.

    A stamp is tried with every difference of the clocks that can have held since the source was last known to be empty.
    A stamp that fits exactly one of them gets that time. A stamp that fits several, or none, is flagged
    `FrameFlag.UNCERTAIN_TIME` and gets a time that is not later than the true one.
    """

    def __init__(self, clock: HostClock, name: str) -> None:
        self.name = name
        self.uncertain = 0
        """Frames that were flagged so far."""
        self._clock = clock
        self._began_ns = clock.monotonic_ns()
        self._empty_ns = self._last_ns = self._began_ns - _WAITING_NS

    @property
    def realtime_minus_monotonic_ns(self) -> int:
        """The difference by which the newest stamps were brought back."""
        return self._clock.realtime_minus_monotonic_ns

    def before_read(self) -> None:
        """Read the clocks before the source is read."""
        self._began_ns = self._clock.observe()

    def after_read(self, batch: FrameBatch) -> FrameBatch:
        """Bring the times of the frames that were just read to file time, in place, and return the batch.

        They come as CLOCK_REALTIME when each frame came in, and in that order. They never decrease, from batch to batch
        neither.
        """
        now = self._clock.observe()
        if not len(batch):
            self._empty_ns = max(self._empty_ns, self._began_ns)
            return batch
        stamps = batch.frames["time_ns"].astype(np.int64)
        offsets = self._clock.offsets_since(self._empty_ns - EARLY_NS)
        if len(offsets) == 1:
            times = stamps - offsets[0].offset_ns
            uncertain = times > now + LATE_NS
            times[uncertain] = -_NEVER_NS
        else:
            times, uncertain = self._matched(stamps, offsets, now)
        ordered = np.maximum.accumulate(np.maximum(times, self._last_ns))
        uncertain |= ordered - times > EARLY_NS
        self._last_ns = int(ordered[-1])
        self._empty_ns = max(self._empty_ns, self._last_ns)
        batch.frames["time_ns"] = ordered + self._clock.base_ns
        if uncertain.any():
            self.uncertain += int(uncertain.sum())
            batch.frames["flags"][uncertain] |= np.uint8(FrameFlag.UNCERTAIN_TIME)
        return batch

    def _matched(self, stamps: IntArray, offsets: tuple[Offset, ...], now: int) -> tuple[IntArray, BoolArray]:
        """Return monotonic times and whether they are uncertain; of several that fit, the earliest."""
        tried = stamps - np.array([[offset.offset_ns] for offset in offsets])
        earliest = [[max(self._empty_ns, offset.from_ns) - EARLY_NS] for offset in offsets]
        latest = [[min(now, offset.until_ns) + LATE_NS] for offset in offsets]
        fits = (tried >= np.array(earliest)) & (tried <= np.array(latest))
        times = np.where(fits, tried, _NEVER_NS).min(axis=0)
        count = fits.sum(axis=0)
        times[count == 0] = -_NEVER_NS
        return times, count != 1


class UncertainTimestamps:
    """Counts the flagged frames of a run while its batches come by.

    The time of a flagged frame is never late (`daq.host_clock.StampTracker`), and the next unflagged frame of its bus
    came after it: the difference of the two times is the largest possible error.
    """

    def __init__(self) -> None:
        self.frames = 0
        """Flagged frames so far."""
        self._within_ns = 0
        self._waiting_ns: dict[str, int] = {}

    @property
    def within_s(self) -> float:
        """Largest possible error of the flagged times, s; NaN while no unflagged frame has followed a flagged one."""
        return float("nan") if self._waiting_ns else self._within_ns * 1e-9

    def take(self, batch: FrameBatch) -> None:
        """Count the flagged frames of a batch; batches come in the order of reception."""
        uncertain = (batch.frames["flags"] & FrameFlag.UNCERTAIN_TIME) != 0
        if not self._waiting_ns and not uncertain.any():
            return
        self.frames += int(np.count_nonzero(uncertain))
        for number, bus in enumerate(batch.buses):
            rows = batch.frames["bus"] == number
            self._take_bus(bus, batch.frames["time_ns"][rows], uncertain[rows])

    def notes(self) -> tuple[Note, ...]:
        """Return a note on them; nothing where no frame was flagged."""
        if not self.frames:
            return ()
        return (Note(RecordingCode.CLOCK_SET, values={"count": self.frames, "within_s": self.within_s}),)

    def _take_bus(self, bus: str, time_ns: IntArray, uncertain: BoolArray) -> None:
        sure, flagged = np.flatnonzero(~uncertain), np.flatnonzero(uncertain)
        if len(sure) and bus in self._waiting_ns:
            self._bound(time_ns[sure[:1]] - self._waiting_ns.pop(bus))
        following = np.searchsorted(sure, flagged)
        followed = following < len(sure)
        self._bound(time_ns[sure[following[followed]]] - time_ns[flagged[followed]])
        if not followed.all():
            self._waiting_ns.setdefault(bus, int(time_ns[flagged[~followed]].min()))

    def _bound(self, apart_ns: IntArray) -> None:
        self._within_ns = max(self._within_ns, int(apart_ns.max(initial=0)))
