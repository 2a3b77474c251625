"""Replay of recordings and logs: frames are sent at their times, N times faster, or as fast as the bus takes them.

The kernel is asked to wake the thread shortly before a frame is due; the rest is spent polling the clock.
Lateness and processor time are measured.
"""

from __future__ import annotations

import ctypes
import sys
import time
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import count
from math import isfinite
from pathlib import Path

import numpy as np

from daq import BusSection, ConfigError, DataError, Fault, FloatArray, nearest
from daq.can.frames import FrameArray, FrameBatch, FrameFlag, frames_between
from daq.logs import read_log
from daq.recording import RunRecording
from daq.runs.open import is_recording
from daq.sources import Sink, open_sink

SPIN_S = 40e-6
"""Spent looking at the clock at the end of a wait: about what a wake-up costs once the kernel does not put it off."""

_TOGETHER_S = 20e-6
"""Frames that are due within this are sent in one call."""
_LONELY_NS = 1_000_000_000
"""From round to round of a recording of one frame, which has no interval."""
_BINS_A_DECADE = 100
_FIRST_DECADE_S = 1e-6
_DECADES = 9

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
    """Sends frames to open buses, by name, at their times; see `replay_batches`. Every frame's bus must be there."""

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


class Looping:
    """Frames repeated in a loop with increasing times; `begun` counts the passes.

    `once` returns the frames of one round, read anew; `loops` is None for ever.
    """

    def __init__(self, once: Callable[[], Iterable[FrameBatch]], loops: int | None) -> None:
        self._once = once
        self._loops = loops
        self.begun = 0

    def __iter__(self) -> Iterator[FrameBatch]:
        shift_ns = 0
        for number in count(1) if self._loops is None else range(1, self._loops + 1):
            self.begun = number
            frames, first_ns, last_ns = 0, 0, 0
            for batch in self._once():
                if not len(batch):
                    continue
                time_ns = batch.frames["time_ns"]
                first_ns, last_ns = (first_ns, last_ns) if frames else (int(time_ns[0]), int(time_ns[0]))
                last_ns = max(last_ns, int(time_ns.max()))
                frames += len(batch)
                yield _later(batch, shift_ns) if shift_ns else batch
            if not frames:
                return
            span_ns = last_ns - first_ns
            shift_ns += span_ns + (span_ns // (frames - 1) if frames > 1 else _LONELY_NS)


def _later(batch: FrameBatch, shift_ns: int) -> FrameBatch:
    frames = batch.frames.copy()
    frames["time_ns"] += shift_ns
    return FrameBatch(frames, batch.buses)


def replay(
    recording: str | Path,
    interface: str = "socketcan",
    *,
    channels: Mapping[str, str] | None = None,
    speed: float | None = 1.0,
    from_s: float = 0.0,
    to_s: float | None = None,
    loops: int | None = 1,
    fd: bool = False,
    send_error_frames: bool = False,
) -> ReplaySummary:
    """Send the frames of a recording, or of a log, to CAN buses.

    Ctrl-C ends it; `ReplaySummary.interrupted` is then True.

    Parameters
    ----------
    recording : str or Path
        An MCAP recording, or a log that `read_log` knows.
    interface : str
        One that python-can knows.
    channels : mapping str -> str, optional
        Recorded bus -> channel to send its frames to; other buses are left out. All buses under their own names
        where nothing is given.
    speed : float or None
        1 is the recorded timing, 10 ten times faster, None as fast as the buses take the frames.
    from_s, to_s : float
        Part of the recording, in seconds after its first frame.
    loops : int or None
        How often it is sent, None for ever. Time goes on: the next round begins one mean interval of the frames after
        the last one ended. The data bytes stay as they are, so rolling counters and GNSS time jump there.
    fd : bool
        Whether to open the interface for CAN FD (SocketCAN always is).
    send_error_frames : bool
        Whether to send error frames, which only virtual buses carry.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `channels` names a bus that is not in it, `speed` or `loops` is not positive, or `from_s` or `to_s` no
        finite number.
    DataError
        If there is nothing to send.
    HardwareError
        If a bus cannot be opened or does not take the frames.
    """
    _check(speed, loops, from_s, to_s)
    opened = _opened(Path(recording))
    names = {bus: bus for bus in opened.buses} if channels is None else dict(channels)
    step = "`wheelsoil info` lists the buses"
    ConfigError.stop_if_any(
        Fault(f"no bus is called {bus!r}", str(recording), expected=nearest(bus, opened.buses), next_step=step)
        for bus in names
        if bus not in opened.buses
    )
    low = opened.start_ns + round(from_s * 1e9)
    high = None if to_s is None else opened.start_ns + round(to_s * 1e9)
    rounds = Looping(lambda: _on(opened.between(low, high), names), loops)
    with ExitStack() as stack:
        sinks = {}
        for bus, channel in names.items():
            sinks[bus] = open_sink(BusSection(channel=channel, interface=interface, fd=fd))
            stack.callback(sinks[bus].close)
        summary = replay_batches(rounds, sinks, speed=speed, send_error_frames=send_error_frames)
    if not sum(summary.frames.values()) and not summary.interrupted:
        raise DataError.of("no frame lies in this part of the recording", recording, next_step="change from and to")
    return replace(summary, rounds=rounds.begun)


def replay_batches(
    batches: Iterable[FrameBatch],
    sinks: Mapping[str, Sink],
    *,
    speed: float | None = 1.0,
    send_error_frames: bool = False,
    timeout_s: float = 2.0,
) -> ReplaySummary:
    """Send frames to buses that are already open; see `replay`.

    Parameters
    ----------
    sinks : mapping str -> Sink
        Bus name -> where its frames go; frames of other buses are left out.
    timeout_s : float
        How long to wait for a bus that takes no frames.
    """
    _check(speed)
    player = Player(sinks, speed, timeout_s)
    skipped, interrupted = 0, False
    try:
        with precise_timing():
            for batch in _on(batches, sinks):
                if not send_error_frames:
                    is_error = (batch.frames["flags"] & FrameFlag.ERROR) != 0
                    skipped += int(np.count_nonzero(is_error))
                    batch = batch[~is_error] if is_error.any() else batch
                player.play(batch)
    except KeyboardInterrupt:
        interrupted = True
    return player.summary(skipped, interrupted=interrupted)


def _check(speed: float | None, loops: int | None = None, *seconds: float | None) -> None:
    if speed is not None and not 0 < speed < float("inf"):
        raise ConfigError.of("speed must be positive", found=f"{speed}", expected="e.g. 1, or 10 for ten times faster")
    if loops is not None and loops < 1:
        raise ConfigError.of("a recording is sent at least once", found=f"{loops} loops", expected="1 or more")
    if any(bound is not None and not isfinite(bound) for bound in seconds):
        found = " to ".join(f"{bound}" for bound in seconds)
        raise ConfigError.of("from and to must be numbers of seconds", found=found)


@dataclass(frozen=True)
class _Opened:
    """A recording or log that can be read again and again."""

    between: Callable[[int, int | None], Iterator[FrameBatch]]
    buses: tuple[str, ...]
    start_ns: int


def _opened(path: Path) -> _Opened:
    if is_recording(path):
        recording = RunRecording.open(path)
        span = recording.time_range_ns
        if span is None:
            raise DataError.of(
                "the recording holds no frames", path, next_step="give another one; `wheelsoil info` lists frames"
            )
        return _Opened(lambda low, high: recording.frame_batches(None, low, high), recording.buses, span[0])
    buses: set[str] = set()
    first: int | None = None
    for batch in read_log(path):  # a log says only at its end which buses it holds
        buses.update(batch.buses)
        first = int(batch.frames["time_ns"][0]) if first is None else first
    return _Opened(lambda low, high: frames_between(read_log(path), low, high), tuple(sorted(buses)), first or 0)


def _on(batches: Iterable[FrameBatch], names: Mapping[str, object]) -> Iterator[FrameBatch]:
    """Yield the frames of some buses."""
    for batch in batches:
        keep = [number for number, bus in enumerate(batch.buses) if bus in names]
        yield batch if len(keep) == len(batch.buses) else batch[np.isin(batch.frames["bus"], keep)]
