"""Sends frames at their times, and measures their lateness and the processor time.

The kernel is asked to wake the thread shortly before a frame is due; the rest is spent polling the clock.
"""

from __future__ import annotations

import ctypes
import sys
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from daq.arrays import FloatArray
from daq.can.frames import FrameArray, FrameBatch
from daq.sources.can_source import Sink

SPIN_S = 40e-6
"""Spent looking at the clock at the end of a wait: about what a wake-up costs once the kernel does not put it off."""

# linux/prctl.h
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_SHORTEST_SLACK_NS = 1


@contextmanager
def precise_timing() -> Iterator[None]:
    """Wake this thread at the requested time: by default Linux may delay a wake-up by 50 us to save power."""
    if sys.platform != "linux":
        yield
        return
    libc = ctypes.CDLL(None)
    before = int(libc.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))
    libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(_SHORTEST_SLACK_NS), 0, 0, 0)
    try:
        yield
    finally:
        libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(before), 0, 0, 0)


def wait_until(moment_s: float) -> float:
    """Wait, and return the time: `moment_s` of `time.perf_counter`, or a little later."""
    while (now := time.perf_counter()) < moment_s:
        if moment_s - now > SPIN_S:
            time.sleep(moment_s - now - SPIN_S)
    return now


_TOGETHER_S = 20e-6
"""Frames that are due within this are sent in one call."""
_BINS_A_DECADE = 100
_FIRST_DECADE_S = 1e-6
_DECADES = 9


@dataclass(frozen=True)
class ReplaySummary:
    """Result of a replay.

    Attributes
    ----------
    frames : dict of str to int
        Frames sent, by the channel they were sent to.
    skipped_error_frames : int
        Error frames are made by controllers and cannot be sent on a real bus.
    recorded_duration_s : float
        Time from the first to the last frame that was sent, over all rounds.
    lateness_p50_s, lateness_p99_s, lateness_max_s : float
        How much later than due a frame was handed to the bus; NaN when sent as fast as the bus takes them.
    cpu_s : float
        Processor time that this process took meanwhile, reading and decompressing included.
    rounds : int
        How often the recording was begun.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    frames: dict[str, int]
    skipped_error_frames: int
    duration_s: float
    recorded_duration_s: float
    lateness_p50_s: float
    lateness_p99_s: float
    lateness_max_s: float
    cpu_s: float
    rounds: int = 1
    interrupted: bool = False

    @property
    def cpu_percent(self) -> float:
        """Processor time of one core; NaN where nothing was sent."""
        return 100 * self.cpu_s / self.duration_s if self.duration_s > 0 else float("nan")


class Player:
    """Sends frames to open buses at their times.

    Parameters
    ----------
    sinks : mapping str -> Sink
        Bus name -> where its frames go; every frame's bus must be there.
    speed : float or None
        None: as fast as the buses take them.
    timeout_s : float
        How long to wait for a bus that takes no frames.
    """

    def __init__(self, sinks: Mapping[str, Sink], speed: float | None, timeout_s: float) -> None:
        self._sinks = sinks
        self._speed = speed
        self._timeout_s = timeout_s
        self._sent = dict.fromkeys((sink.name for sink in sinks.values()), 0)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._started_at = time.perf_counter()
        self._cpu_before_s = time.process_time()
        self._lateness = _Histogram()

    def play(self, batch: FrameBatch) -> None:
        """Send a batch, waiting before each group of frames that are due at the same moment."""
        if not len(batch):
            return
        time_ns = batch.frames["time_ns"]
        if self._first_ns is None:
            self._first_ns = self._last_ns = int(time_ns[0])
            self._started_at = time.perf_counter()
        if self._speed is None:
            self._send(batch)
            self._last_ns = max(self._last_ns, int(time_ns.max()))
            return
        due_s = np.maximum.accumulate(time_ns - self._first_ns) / (1e9 * self._speed)
        self._lateness.add(self._send_when_due(batch, due_s) - due_s)

    def _send_when_due(self, batch: FrameBatch, due_s: FloatArray) -> FloatArray:
        """Return when each frame was sent, in seconds after the first."""
        due, sent_at = due_s.tolist(), np.empty(len(due_s))
        start, started_at = 0, self._started_at
        try:
            while start < len(due):
                now_s = wait_until(started_at + due[start]) - started_at
                end = bisect_right(due, now_s + _TOGETHER_S, lo=start)  # all that are due, after a delay too
                self._send(batch[start:end])
                sent_at[start:end] = now_s
                start = end
        finally:  # Ctrl-C comes in the middle of a batch
            self._last_ns = max(self._last_ns, int(batch.frames["time_ns"][:start].max(initial=0)))
        return sent_at

    def _send(self, batch: FrameBatch) -> None:
        for bus, frames in _runs(batch):
            sink = self._sinks[bus]
            sink.send(frames, self._timeout_s)
            self._sent[sink.name] += len(frames)

    def summary(self, skipped_error_frames: int, *, interrupted: bool) -> ReplaySummary:
        """Return what has been done so far."""
        return ReplaySummary(
            frames=dict(self._sent),
            skipped_error_frames=skipped_error_frames,
            duration_s=time.perf_counter() - self._started_at,
            recorded_duration_s=(self._last_ns - self._first_ns) / 1e9 if self._first_ns is not None else 0.0,
            lateness_p50_s=self._lateness.quantile(0.5),
            lateness_p99_s=self._lateness.quantile(0.99),
            lateness_max_s=self._lateness.largest,
            cpu_s=time.process_time() - self._cpu_before_s,
            interrupted=interrupted,
        )


class _Histogram:
    """Quantiles of any number of delays in bounded memory, to 2.4 percent; below a microsecond all are one."""

    def __init__(self) -> None:
        self._counts = np.zeros(_DECADES * _BINS_A_DECADE + 1, np.int64)
        self.largest = float("nan")

    def add(self, seconds: FloatArray) -> None:
        """Count delays."""
        scaled = np.maximum(seconds, _FIRST_DECADE_S) / _FIRST_DECADE_S
        place = np.minimum(np.ceil(np.log10(scaled) * _BINS_A_DECADE), len(self._counts) - 1).astype(np.intp)
        np.add.at(self._counts, place, 1)
        self.largest = float(np.fmax(self.largest, seconds.max()))

    def quantile(self, share: float) -> float:
        """Return the delay that `share` of all do not exceed; NaN when there are none."""
        total = int(self._counts.sum())
        if not total:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return float(_FIRST_DECADE_S * 10 ** (place / _BINS_A_DECADE))


def _runs(batch: FrameBatch) -> Iterator[tuple[str, FrameArray]]:
    """Yield consecutive frames of one bus."""
    if len(batch) == 1 or len(batch.buses) == 1:
        yield batch.buses[int(batch.frames["bus"][0])], batch.frames
        return
    bus = batch.frames["bus"]
    cuts = np.flatnonzero(np.diff(bus)) + 1
    for start, end in zip([0, *cuts], [*cuts, len(bus)], strict=True):
        yield batch.buses[int(bus[start])], batch.frames[start:end]
