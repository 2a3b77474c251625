"""Checks of the folder that is recorded into, and of its disk."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from daq.doctor.line import Line, failed, from_fault, passed, warned
from daq.doctor.situation import Situation
from daq.errors import HardwareError
from daq.session.folder_lock import folder_lock

_MB = 1e6
_BLOCK = 64 * 1024
_BLOCKS = 50
_SLOW_S = 0.2
_OWN_IT = "give the folder to the logger's user, mount it writable, or choose another: --out"


def folder(now: Situation) -> Iterator[Line]:
    """Tell whether files can be made there."""
    if now.out.exists() and not now.out.is_dir():
        yield failed(str(now.out), "this is a file", "name a folder: --out")
        return
    try:
        with tempfile.TemporaryFile(dir=now.folder) as file:
            file.write(b"wheelsoil")
    except OSError as error:
        yield failed(str(now.out), f"no file can be made: {error.strerror}", _OWN_IT)
        return
    yield passed(str(now.out), "writable" if now.folder == now.out.absolute() else "not there yet; `log` makes it")


def other_logger(now: Situation) -> Iterator[Line]:
    """Tell whether another logger is on the folder."""
    if not now.out.is_dir():
        yield passed(str(now.out), "none")
        return
    try:
        with folder_lock(now.out):
            yield passed(str(now.out), "none")
    except HardwareError as error:
        yield from_fault(error.faults[0], str(now.out))
    except PermissionError as error:
        yield failed(str(now.out), f"the folder cannot be opened: {error.strerror}", _OWN_IT)


def space(now: Situation) -> Iterator[Line]:
    """Tell how long the disk lasts; of one that takes nothing the other checks tell."""
    if os.statvfs(now.folder).f_flag & os.ST_RDONLY:
        return
    free = shutil.disk_usage(now.folder).free
    logger = now.vehicle.logger
    usable = free - logger.disk_reserve_mb * _MB
    rate = now.bytes_per_s
    found = f"{free / _MB:,.0f} MB free"
    step = "free the disk, or record elsewhere: --out"
    if usable <= 0:
        yield failed(str(now.folder), f"{found}, and {logger.disk_reserve_mb:.0f} MB are kept in reserve", step)
    elif not rate:
        yield passed(str(now.folder), f"{found}; nothing was heard, so how long that lasts is not known")
    else:
        minutes = usable / rate / 60
        found += f", {minutes:,.0f} minutes at {rate / _MB:.3f} MB/s"
        short = minutes < logger.disk_warn_min
        yield warned(str(now.folder), found, step) if short else passed(str(now.folder), found)


def disk_speed(now: Situation) -> Iterator[Line]:
    """Tell whether the disk keeps up with what is written and synced."""
    try:
        took_s = sync_times_s(now.folder)
    except OSError as error:
        yield failed(str(now.folder), f"cannot be written: {error.strerror}", "see the line on the folder")
        return
    yield judged_times(str(now.folder), took_s, now.bytes_per_s)


def judged_times(where: str, took_s: list[float], needed_bytes_per_s: float) -> Line:
    """Return the line for the times of `sync_times_s`, and for the rate that the buses need."""
    typical, slowest = np.quantile(took_s, [0.5, 0.99])
    speed = _BLOCK / float(np.mean(took_s))
    found = f"64 kB written and synced in {1e3 * typical:.1f} ms (median), {1e3 * slowest:.1f} ms (99 %)"
    step = "use an SSD or an industrial SD card; close other programs that write"
    if speed < needed_bytes_per_s:
        return failed(where, f"{found}: {speed / _MB:.2f} MB/s, {needed_bytes_per_s / _MB:.2f} are needed", step)
    if slowest > _SLOW_S:
        return warned(where, f"{found}: a power cut may take more than the last second", step)
    return passed(where, found)


def sync_times_s(where: Path, blocks: int = _BLOCKS) -> list[float]:
    """Return how long each of some blocks of 64 kB takes until it is on the disk."""
    content = np.random.default_rng(0).bytes(_BLOCK)
    took = []
    with tempfile.TemporaryFile(dir=where) as file:
        for _ in range(blocks):
            began = time.perf_counter()
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            took.append(time.perf_counter() - began)
    return took
