"""The field logger: records the vehicle's buses until the time is up or a signal or a command ends it.

How it works is described in `daq.logger`.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from types import FrameType

from daq import BusSection, ConfigError, HardwareError, RunInfo, VehicleConfig, check_logging
from daq.can.databases import Database
from daq.host_clock import HostClock
from daq.logger.health.watched_messages import unknown_names, usable_roles
from daq.logger.host_monitor import DiskGuard
from daq.logger.inspection import Inspection, Inspector
from daq.logger.panel import NoPanel, Panel
from daq.logger.recorder import Recorder, RecorderOptions
from daq.logger.run_files import (
    SUFFIX,
    FolderLock,
    RunFiles,
    folder_lock,
    named_run,
    new_run,
    safe_name,
    unfinished_run,
)
from daq.logger.session import Session
from daq.logger.session_monitor import LogSummary, Notifier, Progress, SessionParts
from daq.recording.sink import make_folder
from daq.sources import Source, open_source
from daq.sources.reconnect import ReconnectingSource

_CLOSED_TERMINAL = getattr(signal, "SIGHUP", None)  # Windows has none
_ENDING = (signal.SIGINT, signal.SIGTERM, *([_CLOSED_TERMINAL] if _CLOSED_TERMINAL else []))

SWITCH_S = 0.0005

_OTHER_FOLDER = "choose another with --out, or change its owner or permissions"


@contextmanager
def caught_signals() -> Iterator[list[int]]:
    """Catch SIGINT, SIGTERM and SIGHUP into a list; only the main thread may, elsewhere nothing is caught.

    SIGHUP comes when the terminal is closed, or the connection to it breaks; where it is ignored (``nohup``), it
    stays so.
    """
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def catch(number: int, frame: FrameType | None) -> None:
        del frame
        caught.append(number)

    wanted = [number for number in _ENDING if number != _CLOSED_TERMINAL or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, catch) for number in wanted}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def quick_switching() -> Iterator[None]:
    """Have a thread wait for the interpreter 0.5 ms where it would wait 5.

    A flush gives the interpreter away a dozen times (compression, writing), and while frames are inspected it would
    wait each time: a kill takes what waits.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def log(
    vehicle: VehicleConfig,
    out: str | Path,
    *,
    duration_s: float | None = None,
    run: RunInfo | None = None,
    wait: bool = False,
    attachments: Mapping[str, bytes] | None = None,
    databases: Mapping[str, tuple[Database, ...]] | None = None,
    view: bool = True,
    metadata: Mapping[str, str] | None = None,
    panel: Panel | None = None,
    stop: threading.Event | None = None,
    progress: Progress | None = None,
    opener: Callable[[BusSection], Source] | None = None,
) -> LogSummary:
    """Record every bus of a vehicle.

    SIGINT, SIGTERM and SIGHUP end it like the end of `duration_s`: what is there is written, and the recording
    is closed. A bus that fails or is taken down on the way is opened again for as long as it takes.

    Parameters
    ----------
    out : str or Path
        The recording (``*.mcap``), or a folder. In a folder the recording is named after the run's id, else after the
        vehicle and the time; and where the newest recording of this vehicle was cut off in the last ten minutes, and
        no other run is asked for, that one goes on.
    duration_s : float, optional
        Without it, until a signal.
    wait : bool
        Begin between runs: what comes before the panel's first start goes into the folder ``between``.
    attachments : mapping str -> bytes, optional
        What the recordings shall carry, see `daq.runs.run.Configuration`.
    databases : mapping bus -> databases, optional
        For health, and for decoded topics.
    view : bool
        Whether decoded topics are written beside the raw frames.
    metadata : mapping str -> str, optional
        Goes into the ``run_start`` records.
    panel : Panel, optional
        Where it is shown, and from where runs are started and stopped.
    stop : threading.Event, optional
        Ends it when it is set, for callers outside of the main thread.
    progress : callable, optional
        Called when all sources are open and the first file is made, and then about once a second.
    opener : callable, optional
        Opens a bus; `daq.sources.open_source` by default.

    Raises
    ------
    ConfigError
        If the vehicle names no bus, or an interface that python-can does not know, the folder cannot be written to, or
        this system cannot log (Windows).
    HardwareError
        If a source cannot be opened, another logger records into the folder, or the disk is full from the beginning.
    RecordingError
        If the recording is there already.
    """
    check_logging()
    if not vehicle.bus:
        raise ConfigError.of("the vehicle has no bus to record", next_step="add a [[bus]] to vehicle.toml")
    run, databases = run or RunInfo(), databases or {}
    opener = opener or partial(open_source, buffer_bytes=vehicle.logger.receive_buffer_bytes)
    with ExitStack() as stack:
        folder, lock, files, sources = _opened(vehicle, Path(out), run, opener, stack, wait=wait)
        limits = vehicle.logger
        guard = DiskGuard(folder, warn_min=limits.disk_warn_min, reserve_mb=limits.disk_reserve_mb)
        usable, role_remarks = _with_usable_roles(vehicle, databases)
        role_remarks += [str(fault) for fault in unknown_names(vehicle, databases)]
        clock = HostClock()
        inspection = Inspection(vehicle, usable, databases, started_ns=clock.now_ns())
        remarks = [*(remark for source in sources for remark in source.remarks), *role_remarks]
        described = {f"interface.{bus.channel}": bus.interface or "socketcan" for bus in vehicle.bus}
        described |= {f"remark.{number}": text for number, text in enumerate(remarks)}
        viewed = databases if view and databases else None
        options = RecorderOptions(usable, folder, attachments or {}, {**described, **(metadata or {})}, viewed, lock)
        caught = stack.enter_context(caught_signals())
        stack.enter_context(quick_switching())
        parts = SessionParts(
            vehicle=vehicle,
            clock=clock,
            sources=sources,
            recorder=Recorder(options, clock, files, run),
            inspector=Inspector(inspection),
            guard=guard,
            panel=panel or NoPanel(),
            notifier=stack.enter_context(closing(Notifier.from_environment())),
            asked_to_stop=stop or threading.Event(),
            caught=caught,
            progress=progress,
            remarks=[*role_remarks, *([files.remark] if files and files.remark else [])],
        )
        return Session(parts).record(duration_s)


def _opened(
    vehicle: VehicleConfig,
    out: Path,
    run: RunInfo,
    opener: Callable[[BusSection], Source],
    stack: ExitStack,
    *,
    wait: bool,
) -> tuple[Path, FolderLock, RunFiles | None, list[ReconnectingSource]]:
    """Take the folder and open every bus; a folder that is not there is made last."""
    folder, named = _target(out, run)
    # See that recordings can be made in a folder, or the folder in one that is there.
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ConfigError.of("the folder cannot be made", folder, f"{there} is a file", next_step=_OTHER_FOLDER)
    if not os.access(there, os.W_OK | os.X_OK):
        raise ConfigError.of("the folder cannot be written to", there, next_step=_OTHER_FOLDER)
    lock = stack.enter_context(folder_lock(folder)) if folder.is_dir() else None
    files = _files(folder, named, run, vehicle, wait=wait)
    sources = _open_all(list({bus.channel: bus for bus in vehicle.bus}.values()), opener, stack)
    if lock is None:
        try:
            make_folder(folder)
        except OSError as error:
            found = error.strerror or str(error)
            raise ConfigError.of("the folder cannot be made", folder, found, next_step=_OTHER_FOLDER) from None
        lock = stack.enter_context(folder_lock(folder))
    return folder, lock, files, sources


def _target(out: Path, run: RunInfo) -> tuple[Path, Path | None]:
    """Return the folder to record into, and the file if people named one, by the path or by the run's id."""
    if out.suffix.lower() == SUFFIX:
        return out.parent, out
    return out, out / f"{safe_name(run.id)}{SUFFIX}" if run.id else None


def _files(folder: Path, named: Path | None, run: RunInfo, vehicle: VehicleConfig, *, wait: bool) -> RunFiles | None:
    """Return where the first run goes; None: it begins between runs."""
    if named is not None and not wait:
        return named_run(named, run, vehicle)
    return unfinished_run(folder, vehicle) or (None if wait else new_run(folder, run, vehicle))


def _with_usable_roles(
    vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]
) -> tuple[VehicleConfig, list[str]]:
    """Leave out the roles that name no signal: their frames are recorded all the same."""
    if not databases:
        return vehicle.model_copy(update={"signals": {}}), []
    usable, faults = usable_roles(vehicle, databases, vehicle.signals)
    signals = {role: vehicle.signals[role] for role in usable}
    return vehicle.model_copy(update={"signals": signals}), [str(fault) for fault in faults.values()]


def _open_all(
    sections: list[BusSection], opener: Callable[[BusSection], Source], stack: ExitStack
) -> list[ReconnectingSource]:
    """Open every bus; say of all that fail, at once, why."""
    sources: list[ReconnectingSource] = []
    failed: list[ConfigError | HardwareError] = []
    for section in sections:
        try:
            source = ReconnectingSource(section, opener)
        except (ConfigError, HardwareError) as error:
            failed.append(error)
        else:
            stack.callback(source.close)
            sources.append(source)
    if failed:
        raise type(failed[0])(*(fault for error in failed for fault in error.faults)) from None
    return sources
