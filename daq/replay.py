"""Recording -> bus, at the recorded timing, N times faster, or as fast as the bus takes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.can_source import Sink, open_sink
from daq.config import BusSection
from daq.errors import ConfigError, DataError, Fault, nearest
from daq.frames import FrameArray, FrameBatch, FrameFlag
from daq.logs import read_log
from daq.open import is_recording
from daq.recording import Recording

_SPIN_S = 0.0003
"""The last part of a wait is spent looking at the clock: a sleeping process wakes up a little late."""
_TOGETHER_S = 20e-6
"""Frames that are due within this are sent in one call."""
_BINS_A_DECADE = 100
_FIRST_DECADE_S = 1e-6
_DECADES = 9


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay did.

    Attributes
    ----------
    frames : dict of str to int
        Frames sent, by the channel they were sent to.
    skipped_error_frames : int
        Error frames are made by controllers and cannot be sent on a real bus.
    duration_s : float
    recorded_duration_s : float
        Time from the first to the last frame in the recording.
    lateness_p50_s, lateness_p99_s, lateness_max_s : float
        How much later than due a frame was handed to the bus; NaN when sent as fast as the bus takes them.
    """

    frames: dict[str, int]
    skipped_error_frames: int
    duration_s: float
    recorded_duration_s: float
    lateness_p50_s: float
    lateness_p99_s: float
    lateness_max_s: float


def replay(
    recording: str | Path,
    interface: str = "socketcan",
    *,
    channels: Mapping[str, str] | None = None,
    speed: float | None = 1.0,
    from_s: float = 0.0,
    to_s: float | None = None,
    fd: bool = False,
    send_error_frames: bool = False,
) -> ReplaySummary:
    """Send the frames of a recording, or of a log, to CAN buses.

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
    fd : bool
        Whether to open the interface for CAN FD (SocketCAN always is).
    send_error_frames : bool
        Whether to send error frames, which only virtual buses carry.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `channels` names a bus that is not in it, or `speed` is not positive.
    DataError
        If there is nothing to send.
    HardwareError
        If a bus cannot be opened or does not take the frames.
    """
    _check_speed(speed)
    batches, buses, start_ns = _opened(Path(recording))
    names = {bus: bus for bus in buses} if channels is None else dict(channels)
    if unknown := [bus for bus in names if bus not in buses]:
        raise ConfigError(
            *(Fault(f"no bus is called {bus!r}", str(recording), expected=nearest(bus, buses)) for bus in unknown)
        )
    low = start_ns + round(from_s * 1e9)
    high = None if to_s is None else start_ns + round(to_s * 1e9)
    with ExitStack() as stack:
        sinks = {}
        for bus, channel in names.items():
            sinks[bus] = open_sink(BusSection(channel=channel, interface=interface, fd=fd))
            stack.callback(sinks[bus].close)
        summary = replay_batches(_between(batches, low, high), sinks, speed=speed, send_error_frames=send_error_frames)
    if not sum(summary.frames.values()):
        raise DataError(
            Fault("no frame lies in this part of the recording", str(recording), next_step="change from and to")
        )
    return summary


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
    batches : iterable of FrameBatch
    sinks : mapping str -> Sink
        Bus name -> where its frames go; frames of other buses are left out.
    speed, send_error_frames
        See `replay`.
    timeout_s : float
        How long to wait for a bus that takes no frames.
    """
    _check_speed(speed)
    player = _Player(sinks, speed, timeout_s)
    skipped = 0
    for batch in batches:
        keep = np.isin(batch.frames["bus"], [i for i, bus in enumerate(batch.buses) if bus in sinks])
        if not send_error_frames:
            is_error = (batch.frames["flags"] & FrameFlag.ERROR) != 0
            skipped += int(np.count_nonzero(is_error & keep))
            keep &= ~is_error
        player.play(batch[keep])
    return player.summary(skipped)


def _check_speed(speed: float | None) -> None:
    if speed is not None and not 0 < speed < float("inf"):
        expected = "e.g. 1, or 10 for ten times faster"
        raise ConfigError(Fault("speed must be positive", found=f"{speed}", expected=expected))


class _Player:
    """Sends frames when they are due and keeps count of how late it was."""

    def __init__(self, sinks: Mapping[str, Sink], speed: float | None, timeout_s: float) -> None:
        self._sinks = sinks
        self._speed = speed
        self._timeout_s = timeout_s
        self._sent = dict.fromkeys((sink.name for sink in sinks.values()), 0)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._started_at = time.perf_counter()
        self._lateness = _Histogram()

    def play(self, batch: FrameBatch) -> None:
        """Send a batch, waiting before each group of frames that are due at the same moment."""
        if not len(batch):
            return
        time_ns = batch.frames["time_ns"]
        if self._first_ns is None:
            self._first_ns = self._last_ns = int(time_ns[0])
            self._started_at = time.perf_counter()
        self._last_ns = max(self._last_ns, int(time_ns.max()))
        if self._speed is None:
            self._send(batch)
            return
        due_s = np.maximum.accumulate(time_ns - self._first_ns) / (1e9 * self._speed)
        start = 0
        while start < len(batch):
            now_s = _wait_until(self._started_at + due_s[start]) - self._started_at
            end = int(np.searchsorted(due_s, now_s + _TOGETHER_S, side="right"))  # all that are due, after a delay too
            self._send(batch[start:end])
            self._lateness.add(now_s - due_s[start:end])
            start = end

    def _send(self, batch: FrameBatch) -> None:
        for bus, frames in _runs(batch):
            sink = self._sinks[bus]
            sink.send(frames, self._timeout_s)
            self._sent[sink.name] += len(frames)

    def summary(self, skipped_error_frames: int) -> ReplaySummary:
        """Return what has been done so far."""
        return ReplaySummary(
            frames=dict(self._sent),
            skipped_error_frames=skipped_error_frames,
            duration_s=time.perf_counter() - self._started_at,
            recorded_duration_s=(self._last_ns - (self._first_ns or 0)) / 1e9 if self._first_ns is not None else 0.0,
            lateness_p50_s=self._lateness.quantile(0.5),
            lateness_p99_s=self._lateness.quantile(0.99),
            lateness_max_s=self._lateness.largest,
        )


class _Histogram:
    """Quantiles of any number of delays in bounded memory, to 2.4 percent; below a microsecond all are one."""

    def __init__(self) -> None:
        self._counts = np.zeros(_DECADES * _BINS_A_DECADE + 1, np.int64)
        self.largest = float("nan")

    def add(self, seconds: NDArray[np.float64]) -> None:
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
    bus = batch.frames["bus"]
    cuts = np.flatnonzero(np.diff(bus)) + 1
    for start, end in zip([0, *cuts], [*cuts, len(bus)], strict=True):
        yield batch.buses[int(bus[start])], batch.frames[start:end]


def _wait_until(moment_s: float) -> float:
    """Wait, and return the time: `moment_s` or a little later."""
    while (now := time.perf_counter()) < moment_s:
        if moment_s - now > _SPIN_S:
            time.sleep(moment_s - now - _SPIN_S)
    return now


def _opened(path: Path) -> tuple[Iterator[FrameBatch], tuple[str, ...], int]:
    """Return the frames, the buses and the time of the first frame of a recording or log."""
    if is_recording(path):
        recording = Recording.open(path)
        span = recording.time_range_ns
        if span is None:
            raise DataError(Fault("the recording holds no frames", str(path)))
        return recording.frame_batches(), recording.buses, span[0]
    buses: set[str] = set()
    first: int | None = None
    for batch in read_log(path):  # a log says only at its end which buses it holds
        buses.update(batch.buses)
        first = int(batch.frames["time_ns"][0]) if first is None else first
    return read_log(path), tuple(sorted(buses)), first or 0


def _between(batches: Iterable[FrameBatch], low: int, high: int | None) -> Iterator[FrameBatch]:
    for batch in batches:
        time_ns = batch.frames["time_ns"]
        inside = time_ns >= low if high is None else (time_ns >= low) & (time_ns < high)
        yield batch[inside]
