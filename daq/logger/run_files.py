"""The file of a run: a name of its own, or the next part of a run that was cut off.

One logger per folder: a lock on the folder itself, which the kernel releases however the logger ends. Other commands
see by it whether a file without its end is still being written.
"""

from __future__ import annotations

import errno
import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from daq import HardwareError, RecordingError, RunInfo, VehicleConfig, file_name
from daq.recording import Recording
from daq.recording.contents import MAGIC
from daq.recording.format import RUN_END, RUN_START
from daq.recording.part_writer import ROTATED, next_part, part_number, parts_on_disk
from daq.recording.recovery import RECOVERED

_LONGEST_CHECK_S = 0.05
"""How long a process that only checks whether the folder is locked may hold the lock."""
_WRITTEN_WITHIN_S = 10.0
"""A file that is being recorded grows at least once a second."""
BETWEEN_FOLDER = "between"
"""In the logger's folder: what comes between runs."""

VEHICLE_KEY = "vehicle"
"""In the ``run_start`` metadata: the vehicle's name."""
GOES_ON_WITHIN_S = 600.0
"""A run that was cut off continues when its last frame is not older."""
SUFFIX = ".mcap"
_LONGEST_NAME_BYTES = 200
"""File systems take 255; a part's number and the ending come behind it."""


class FolderLock:
    """A logger's hold on its folder; `HardwareError` if another logger holds it, from `renew` too.

    A file system that knows no such locks (some network ones) is used without, and so is a system without `fcntl`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._descriptor = _held(folder)

    def renew(self) -> None:
        """Hold the folder that is in its place now, if it was removed and made again; HardwareError if it cannot."""
        try:
            if not os.path.samestat(os.fstat(self._descriptor), self._folder.stat()):
                old, self._descriptor = self._descriptor, _held(self._folder)
                os.close(old)
        except OSError as error:
            raise HardwareError.of("the folder cannot be held", self._folder, error.strerror or str(error)) from None

    def close(self) -> None:
        """Release it."""
        os.close(self._descriptor)


@contextmanager
def folder_lock(folder: Path) -> Iterator[FolderLock]:
    """Hold the folder for one logger; see `FolderLock`."""
    lock = FolderLock(folder)
    try:
        yield lock
    finally:
        lock.close()


def _held(folder: Path) -> int:
    """Return an open, locked folder."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _take(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        raise HardwareError.of(
            "another logger records into this folder",
            folder,
            next_step="end it, or give this one a folder of its own: --out",
        ) from None
    except OSError:
        pass
    return descriptor


def is_being_recorded(file: Path) -> bool:
    """Return whether a logger holds the folder of a recording without its end, and wrote into it just now.

    False on a system without `fcntl` (Windows): no logger locks a folder there.
    """
    folder = file.parent.parent if file.parent.name == BETWEEN_FOLDER else file.parent
    try:
        recent = abs(time.time() - file.stat().st_mtime) <= _WRITTEN_WITHIN_S
        return recent and (_is_held(folder) or (folder != file.parent and _is_held(file.parent)))
    except OSError:
        return False


def _take(descriptor: int) -> None:
    try:
        _lock(descriptor)
    except BlockingIOError:
        time.sleep(_LONGEST_CHECK_S)
        _lock(descriptor)


def _lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open folder; `BlockingIOError` if another process holds it, `OSError` if there are no such locks."""
    try:
        import fcntl
    except ImportError:
        raise OSError(errno.ENOTSUP, "this system has no locks on folders") from None
    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


def _is_held(folder: Path) -> bool:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _lock(descriptor, shared=True)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


@dataclass(frozen=True)
class RunFiles:
    """Where a run is recorded."""

    first: Path
    """File of the run's first part."""
    part: int
    """Number of the part to begin with."""
    run: RunInfo
    remark: str = ""
    """A remark on the choice for the user; may be empty."""


def safe_name(text: str) -> str:
    """Return a name that stays in its folder and is not too long: letters, digits, ``_ . - @``, no leading dot."""
    return file_name(file_name(text).encode("utf-8", "replace")[:_LONGEST_NAME_BYTES].decode("utf-8", "ignore"))


def dated_name(vehicle: VehicleConfig) -> str:
    """Return the default name of a run: the vehicle's name and the time."""
    name = re.sub(r"[^\w-]+", "-", vehicle.vehicle.name).strip("-") or "run"
    return f"{name}_{datetime.now(UTC):%Y%m%dT%H%M%SZ}"


def new_run(folder: Path, run: RunInfo, vehicle: VehicleConfig) -> RunFiles:
    """Return the files of a new run; an id that is taken gets a number."""
    wanted = run.id or dated_name(vehicle)
    name, stem, number = wanted, safe_name(wanted), 1
    first = folder / f"{stem}{SUFFIX}"
    while parts_on_disk(first):
        number += 1
        name, first = f"{wanted}-{number}", folder / f"{stem}-{number}{SUFFIX}"
    remark = f"there is a run {wanted!r} already: this one is {name!r}" if run.id and name != wanted else ""
    return RunFiles(first, 1, run.model_copy(update={"id": name}), remark)


def named_run(first: Path, run: RunInfo, vehicle: VehicleConfig) -> RunFiles:
    """Return the files of a run that people named; an existing run that was cut off continues.

    Where the clock was set back behind the last frame, a new run with a number begins: the times of a run do not.
    `RecordingError` if the run is there and has ended.
    """
    run = run.model_copy(update={"id": run.id or first.stem})
    there = [*parts_on_disk(first).values()]
    if not there:
        return RunFiles(first, 1, run)
    recording = _last_begun(there)
    if recording is None:
        path, part = next_part(first)
        return RunFiles(first, part, run, f"there is nothing in {there[-1].name}: run {run.id!r} begins in {path.name}")
    if not _was_cut_off(recording) or _vehicle_of(recording) != vehicle.vehicle.name:
        what = "there is a file already"
        raise RecordingError.of(what, recording.path, next_step="choose another name, e.g. with --run-id")
    return _continued(first, recording) if _time_goes_on(recording) else _after(recording, first.parent, run, vehicle)


def unfinished_run(folder: Path, vehicle: VehicleConfig) -> RunFiles | None:
    """Return how the newest recording of a vehicle continues, if it was cut off a short while ago; see `named_run`."""
    for parts in _newest_first(folder):
        try:
            recording = _last_begun(parts)
            if recording is None or _vehicle_of(recording) != vehicle.vehicle.name or RECOVERED in recording.metadata:
                continue
            recent = abs(time.time_ns() - _last_ns(recording)) * 1e-9 <= GOES_ON_WITHIN_S
            first = part_number(recording.path)[0]
            run = recording.run or RunInfo(id=first.stem)
        except RecordingError:
            continue
        if not (recent and _was_cut_off(recording)):
            return None
        return _continued(first, recording) if _time_goes_on(recording) else _after(recording, folder, run, vehicle)
    return None


def _was_cut_off(recording: Recording) -> bool:
    """Whether the run has not ended: no record says so, or one says that another part follows and it does not."""
    ended = recording.metadata.get(RUN_END)
    return RUN_START in recording.metadata and (ended is None or ended.get("exit_status") == ROTATED)


def _vehicle_of(recording: Recording) -> str | None:
    return recording.metadata.get(RUN_START, {}).get(VEHICLE_KEY)


def _last_ns(recording: Recording) -> int:
    """Return when the last frame came, or when the file was made."""
    span = recording.time_range_ns if recording.has_raw_frames else None
    created = recording.metadata[RUN_START].get("created_ns", "")
    return span[1] if span else int(created) if created.isdecimal() else 0


def _time_goes_on(recording: Recording) -> bool:
    """Whether a frame that comes now is later than the last one."""
    return _last_ns(recording) <= time.time_ns()


def _after(recording: Recording, folder: Path, run: RunInfo, vehicle: VehicleConfig) -> RunFiles:
    """Return a new run in place of one that cannot go on because the clock was set back."""
    following = new_run(folder, run, vehicle)
    behind_s = (_last_ns(recording) - time.time_ns()) * 1e-9
    what = f"run {run.id!r} was cut off, and the clock is {behind_s:.1f} s behind its last frame"
    return replace(following, remark=f"{what}: run {following.run.id!r} begins")


def _continued(first: Path, recording: Recording) -> RunFiles:
    run = recording.run or RunInfo(id=first.stem)
    path, part = next_part(first)
    return RunFiles(first, part, run, f"run {run.id!r} was cut off: it continues in {path.name}")


def _last_begun(parts: Sequence[Path]) -> Recording | None:
    """Return the last part of a run in which there is something: what was begun when the power went may be empty.

    `RecordingError` if a part is another kind of file.
    """
    for path in reversed(parts):
        try:
            recording = Recording.open(path)
        except RecordingError:
            with path.open("rb") as file:
                if MAGIC.startswith(file.read(len(MAGIC)).rstrip(b"\0")):
                    continue
            raise
        if RUN_START in recording.metadata or recording.topics:
            return recording
    return None


def _newest_first(folder: Path) -> Iterator[list[Path]]:
    """Yield the parts of every run in a folder, in order; the run with the newest file comes first."""
    runs: dict[Path, list[tuple[int, Path]]] = {}
    for path in folder.glob(f"*{SUFFIX}") if folder.is_dir() else ():
        first, number = part_number(path)
        runs.setdefault(first, []).append((number, path))
    sorted_runs = [[path for _, path in sorted(parts)] for parts in runs.values()]
    yield from sorted(sorted_runs, key=lambda parts: parts[-1].stat().st_mtime_ns, reverse=True)
