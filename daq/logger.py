"""The field logger: the vehicle's buses into a recording, until the time is up or it is told to stop.

Each source has a thread that does nothing but fetch frames; they meet in a queue, and one thread writes. When the
disk is slow the queue fills, then the kernel's buffers, and then the kernel counts what is lost.
"""

from __future__ import annotations

import queue
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Literal

from daq.can_source import Source, SourceCounters, open_source
from daq.config import BusSection, RunInfo, VehicleConfig
from daq.databases import Database
from daq.decode import Decoder
from daq.errors import ConfigError, Fault, HardwareError
from daq.frames import FrameBatch
from daq.recording import RecordingWriter
from daq.view import DecodedView

_READ_TIMEOUT_S = 0.1
_GATHER_S = 0.005
"""A source rests this long after each reading, so that frames come by the dozen."""
_QUEUE_BATCHES = 1024
_PROGRESS_EVERY_S = 1.0

Progress = Callable[[Mapping[str, SourceCounters]], None]


@dataclass(frozen=True)
class LogSummary:
    """What was recorded, and how it ended.

    Attributes
    ----------
    path : Path
    frames, error_frames : dict of str to int
        Per bus, 0 for one that was silent.
    drops : dict of str to int
        Frames that the kernel lost, of the buses that count them.
    duration_s : float
    ended_by : str
        ``"duration"``, ``"signal"`` (see `signal_number`), ``"stop"`` or ``"fault"``: no source was left.
    signal_number : int or None
    faults : tuple of Fault
        Of sources that failed on the way; the others went on.
    remarks : tuple of str
    """

    path: Path
    frames: dict[str, int]
    error_frames: dict[str, int]
    drops: dict[str, int]
    duration_s: float
    ended_by: Literal["duration", "signal", "stop", "fault"]
    signal_number: int | None
    faults: tuple[Fault, ...]
    remarks: tuple[str, ...]

    @property
    def silent(self) -> tuple[str, ...]:
        """Buses of which no frame came."""
        return tuple(bus for bus, count in self.frames.items() if not count)


def log(
    vehicle: VehicleConfig,
    out: str | Path,
    *,
    duration_s: float | None = None,
    run: RunInfo | None = None,
    attachments: Mapping[str, bytes] | None = None,
    databases: Mapping[str, tuple[Database, ...]] | None = None,
    metadata: Mapping[str, str] | None = None,
    stop: threading.Event | None = None,
    progress: Progress | None = None,
) -> LogSummary:
    """Record every bus of a vehicle.

    SIGINT and SIGTERM end it like the end of `duration_s`: what is there is written, and the recording is closed.

    Parameters
    ----------
    vehicle : VehicleConfig
    out : str or Path
        The recording (``*.mcap``), or a folder for one that is named after the vehicle and the time.
    duration_s : float, optional
        Without it, until a signal.
    run : RunInfo, optional
    attachments : mapping str -> bytes, optional
        What the recording shall carry, see `daq.run.Configuration`.
    databases : mapping bus -> databases, optional
        Where they are given, decoded topics are written beside the raw frames.
    metadata : mapping str -> str, optional
        Goes into the ``run_start`` record.
    stop : threading.Event, optional
        Ends it when it is set, for callers outside of the main thread.
    progress : callable, optional
        Called with each bus's counters when all sources are open, and then about once a second.

    Raises
    ------
    ConfigError
        If the vehicle names no bus, or an interface that python-can does not know.
    HardwareError
        If a source cannot be opened (nothing is written then), or the disk fails.
    RecordingError
        If the recording cannot be made.
    """
    sections = {bus.channel: bus for bus in vehicle.bus}
    if not sections:
        raise ConfigError(Fault("the vehicle has no bus to record", next_step="add a [[bus]] to vehicle.toml"))
    with ExitStack() as stack:
        sources = _open_all(list(sections.values()), stack)
        path = _path(vehicle, Path(out))
        told = {f"interface.{name}": section.interface or "socketcan" for name, section in sections.items()}
        told |= {f"remark.{i}": text for i, text in enumerate(_remarks(sources))}
        run = run or RunInfo(file=path.name, id=path.stem)
        writer = RecordingWriter(path, run=run, attachments=attachments, metadata={**told, **(metadata or {})})
        view = DecodedView(writer, vehicle, databases) if databases else None
        return _Session(path, sources, writer, view, databases, stop or threading.Event(), progress).record(duration_s)


class _Session:
    """One recording while it is made."""

    def __init__(
        self,
        path: Path,
        sources: list[Source],
        writer: RecordingWriter,
        view: DecodedView | None,
        databases: Mapping[str, tuple[Database, ...]] | None,
        asked_to_stop: threading.Event,
        progress: Progress | None,
    ) -> None:
        self._path = path
        self._sources = sources
        self._writer = writer
        self._view = view
        self._decoder = Decoder(databases or {})
        self._asked_to_stop = asked_to_stop
        self._progress = progress
        self._buses = tuple(source.name for source in sources)
        self._stop = threading.Event()
        self._queue: queue.Queue[FrameBatch | HardwareError] = queue.Queue(_QUEUE_BATCHES)
        self._failures: list[HardwareError] = []

    def record(self, duration_s: float | None) -> LogSummary:
        """Record until `duration_s` is over or a signal comes; close the recording in any case."""
        started_at = time.monotonic()
        status = "failed"
        listeners = [
            threading.Thread(target=self._listen, args=(number, source), name=f"source {source.name}", daemon=True)
            for number, source in enumerate(self._sources)
        ]
        try:
            with _signals() as caught:
                for listener in listeners:
                    listener.start()
                self._write_until(None if duration_s is None else started_at + duration_s, caught, listeners)
                self._finish(listeners)
            status = "interrupted" if caught else "failed" if self._all_failed() else "ok"
        finally:
            self._abandon(listeners)
            for source in self._sources:
                source.close()
            self._writer.close(status, self._drops())
        counters = {source.name: source.counters for source in self._sources}
        return LogSummary(
            path=self._path,
            frames=dict.fromkeys(self._buses, 0) | self._writer.frame_counts,
            error_frames={bus: count.error_frames for bus, count in counters.items()},
            drops=self._drops(),
            duration_s=time.monotonic() - started_at,
            ended_by=self._end(caught),
            signal_number=caught[0] if caught else None,
            faults=tuple(fault for failure in self._failures for fault in failure.faults),
            remarks=_remarks(self._sources),
        )

    def _listen(self, number: int, source: Source) -> None:
        """Fetch the frames of one source; runs in a thread of its own."""
        try:
            while not self._stop.is_set():
                if self._hand_over(number, source.read(_READ_TIMEOUT_S)):
                    time.sleep(_GATHER_S)
            self._hand_over(number, source.read(0.0))
        except HardwareError as error:
            self._queue.put(error)

    def _hand_over(self, number: int, batch: FrameBatch) -> bool:
        if len(batch):
            batch.frames["bus"] = number
            self._queue.put(FrameBatch(batch.frames, self._buses))
        return len(batch) > 0

    def _write_until(self, deadline: float | None, caught: list[int], listeners: list[threading.Thread]) -> None:
        report_at = time.monotonic()
        while not caught and not self._asked_to_stop.is_set() and any(one.is_alive() for one in listeners):
            now = time.monotonic()
            if deadline is not None and now >= deadline:
                return
            if self._progress is not None and now >= report_at:
                self._progress({source.name: source.counters for source in self._sources})
                report_at = now + _PROGRESS_EVERY_S
            wait_s = 0.05 if deadline is None else min(0.05, deadline - now)
            try:
                self._take(self._queue.get(timeout=wait_s))
            except queue.Empty:
                self._writer.tick()

    def _finish(self, listeners: list[threading.Thread]) -> None:
        """Have the sources stop, and write what they still had."""
        self._stop.set()
        while any(listener.is_alive() for listener in listeners) or not self._queue.empty():
            with suppress(queue.Empty):
                self._take(self._queue.get(timeout=0.01))

    def _abandon(self, listeners: list[threading.Thread]) -> None:
        """Make sure that no thread reads a source or waits for room in the queue any more."""
        self._stop.set()
        while any(listener.is_alive() for listener in listeners):
            with suppress(queue.Empty):
                self._queue.get(timeout=0.01)

    def _take(self, item: FrameBatch | HardwareError) -> None:
        if isinstance(item, HardwareError):
            self._failures.append(item)
            return
        self._writer.write_frames(item)
        if self._view is not None:
            self._view.write(self._decoder.decode(item))

    def _end(self, caught: list[int]) -> Literal["duration", "signal", "stop", "fault"]:
        if caught:
            return "signal"
        if self._all_failed():
            return "fault"
        return "stop" if self._asked_to_stop.is_set() else "duration"

    def _all_failed(self) -> bool:
        return len(self._failures) >= len(self._sources)

    def _drops(self) -> dict[str, int]:
        counted = {source.name: source.counters.dropped for source in self._sources}
        return {bus: count for bus, count in counted.items() if count is not None}


def _open_all(sections: list[BusSection], stack: ExitStack) -> list[Source]:
    """Open every bus; say of all that fail, at once, why."""
    sources: list[Source] = []
    failed: list[ConfigError | HardwareError] = []
    for section in sections:
        try:
            source = open_source(section)
        except (ConfigError, HardwareError) as error:
            failed.append(error)
        else:
            stack.callback(source.close)
            sources.append(source)
    if failed:
        raise type(failed[0])(*(fault for error in failed for fault in error.faults)) from None
    return sources


def _remarks(sources: list[Source]) -> tuple[str, ...]:
    return tuple(remark for source in sources for remark in source.remarks)


def _path(vehicle: VehicleConfig, out: Path) -> Path:
    if out.suffix.lower() == ".mcap":
        return out
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(Fault("the folder cannot be made", str(out), error.strerror or str(error))) from None
    name = re.sub(r"[^\w-]+", "-", vehicle.vehicle.name).strip("-") or "run"
    stem = f"{name}_{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    path, number = out / f"{stem}.mcap", 2
    while path.exists():
        path, number = out / f"{stem}-{number}.mcap", number + 1
    return path


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Catch SIGINT and SIGTERM into a list; only the main thread may, elsewhere nothing is caught."""
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def catch(number: int, frame: FrameType | None) -> None:
        del frame
        caught.append(number)

    before = {number: signal.signal(number, catch) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
