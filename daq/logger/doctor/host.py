"""Checks of the machine: clocks, the folder and disk that are recorded to, and what is installed."""

from __future__ import annotations

import ctypes
import errno
import importlib.util
import os
import platform
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from daq import DataError, HardwareError, fit_clock
from daq.logger.doctor.situation import Line, Situation, failed, from_fault, passed, warned
from daq.logger.host_monitor import megabytes
from daq.logger.run_files import folder_lock

_FIRST_YEAR, _LAST_YEAR = 2025, 2100
_CLOCK_STEP_S = 0.001
_STA_UNSYNC = 0x0040
"""linux/timex.h"""
_LEAP_S = 18.0
"""GPS time minus UTC, since 2017."""
_GNSS_FAR_S = 1.0
_CHRONY = (
    "install chrony or systemd-timesyncd (`timedatectl set-ntp true`); without a network feed chrony from the GNSS"
)

_MB = 1e6
_SYNCED_BYTES = 64 * 1024
_SYNCED_BLOCKS = 50
_SLOW_SYNC_S = 0.2
_FOLDER_STEP = "give the folder to the logger's user, mount it writable, or choose another: --out"

_SLOW_IMPORT_S = 5.0
_UNITS = (Path("/etc/systemd/system"), Path("/usr/lib/systemd/system"), Path("/lib/systemd/system"))
_UNIT = "wheelsoil-log.service"
_UNIT_KEYS = ("Type=notify", "WatchdogSec=", "Restart=")


def host_time(now: Situation) -> Iterator[Line]:
    """Check whether the host's clock is set at all."""
    del now
    yield judged_time(datetime.now(UTC))


def judged_time(moment: datetime) -> Line:
    """Return the line for a time that the host's clock shows."""
    if _FIRST_YEAR <= moment.year <= _LAST_YEAR:
        return passed("", f"{moment:%Y-%m-%d %H:%M:%S} UTC")
    step = "set it (`sudo timedatectl set-time ...`, or chrony); a Raspberry Pi has no battery-backed clock"
    return failed("", f"the clock shows {moment:%Y-%m-%d}: it was never set", step)


def clock_steps(now: Situation) -> Iterator[Line]:
    """Check whether the host's clock is left alone."""
    if abs(now.clock_moved_s) > _CLOCK_STEP_S:
        step = (
            "wait until the clock is synchronised; a step while recording is noted, and the file's time stays monotonic"
        )
        yield warned("", f"the clock was set by {now.clock_moved_s:+.3f} s while listening", step)
    else:
        yield passed("", "not set while listening")


def clock_sync(now: Situation) -> Iterator[Line]:
    """Check whether the host's clock is synchronised."""
    del now
    yield judged_status(kernel_clock_status())


def judged_status(status: int | None) -> Line:
    """Return the line for the status word of adjtimex(2)."""
    if status is None:
        return warned("", "this system does not say", "see that its clock is set before a test")
    if status & _STA_UNSYNC:
        return warned("", "not synchronised: it drifts by seconds a day, and may be set in mid-run", _CHRONY)
    return passed("", "the kernel says that it is synchronised")


def kernel_clock_status() -> int | None:
    """Return the status word of adjtimex(2); None where there is none."""
    if sys.platform != "linux":
        return None
    timex = (ctypes.c_long * 64)()  # modes = 0: only asks; longer than the kernel's struct
    if ctypes.CDLL(None).adjtimex(timex) < 0:
        return None
    return int(ctypes.cast(ctypes.byref(timex, 5 * ctypes.sizeof(ctypes.c_long)), ctypes.POINTER(ctypes.c_int))[0])


def gnss_fix(now: Situation) -> Iterator[Line]:
    """Check whether the receiver has a fix."""
    channel = now.channels.get("ground_speed_valid")
    if channel is None or not len(channel.values):
        return
    valid = float(np.mean(channel.values != 0))
    if channel.values[-1] == 0:
        yield failed(
            "ground_speed_valid", f"no fix ({valid:.0%} of the samples had one)", "give the antenna a free sky"
        )
    elif valid < 1:
        yield warned("ground_speed_valid", f"a fix in {valid:.0%} of the samples only", "give the antenna a free sky")
    else:
        yield passed("ground_speed_valid", "fix")


def gnss_time(now: Situation) -> Iterator[Line]:
    """Check how far apart the host's clock and the receiver's are."""
    channel = now.channels.get("gnss_time")
    if channel is None or not len(channel.values):
        return
    try:
        fit = fit_clock(channel.time_ns, channel.values)
    except DataError:
        yield warned("gnss_time", "the GNSS time does not advance", "wait for a fix, or listen longer: --listen 10")
        return
    found = f"host minus GNSS {fit.offset_s:+.3f} s (delay included), jitter {1e3 * fit.residual_s:.1f} ms"
    if abs(fit.offset_s + _LEAP_S) < _GNSS_FAR_S:
        yield passed("gnss_time", f"{found}: GPS time, which has no leap seconds")
    elif abs(fit.offset_s) > _GNSS_FAR_S:
        step = f"the fit allows for it, but set the clock if it is the host's that is wrong: {_CHRONY}"
        yield warned("gnss_time", found, step)
    else:
        yield passed("gnss_time", found)


def folder(now: Situation) -> Iterator[Line]:
    """Check whether files can be made there."""
    if now.out.exists() and not now.out.is_dir():
        yield failed(str(now.out), "this is a file", "name a folder: --out")
        return
    try:
        with tempfile.TemporaryFile(dir=now.folder) as file:
            file.write(b"wheelsoil")
    except OSError as error:
        yield failed(str(now.out), f"no file can be made: {error.strerror}", _FOLDER_STEP)
        return
    yield passed(str(now.out), "writable" if now.folder == now.out.absolute() else "not there yet; `log` makes it")


def other_logger(now: Situation) -> Iterator[Line]:
    """Check whether another logger is on the folder."""
    if not now.out.is_dir():
        yield passed(str(now.out), "none")
        return
    try:
        with folder_lock(now.out):
            yield passed(str(now.out), "none")
    except HardwareError as error:
        yield from_fault(error.faults[0], str(now.out))
    except PermissionError as error:
        yield failed(str(now.out), f"the folder cannot be opened: {error.strerror}", _FOLDER_STEP)


def space(now: Situation) -> Iterator[Line]:
    """Check how long the disk lasts; other checks report one that cannot be written."""
    if os.statvfs(now.folder).f_flag & os.ST_RDONLY:
        return
    free = shutil.disk_usage(now.folder).free
    logger = now.vehicle.logger
    usable = free - logger.disk_reserve_mb * _MB
    rate = now.bytes_per_s
    found = f"{free / _MB:,.0f} MB free"
    step = "free the disk, or record elsewhere: --out"
    if usable <= 0:
        reserve = megabytes(round(logger.disk_reserve_mb * _MB))
        yield failed(str(now.folder), f"{found}, and {reserve} MB are kept in reserve", step)
    elif not rate:
        yield passed(str(now.folder), f"{found}; nothing was received, so how long that lasts is not known")
    else:
        minutes = usable / rate / 60
        found += f", {minutes:,.0f} minutes at {rate / _MB:.3f} MB/s"
        short = minutes < logger.disk_warn_min
        yield warned(str(now.folder), found, step) if short else passed(str(now.folder), found)


def disk_speed(now: Situation) -> Iterator[Line]:
    """Check whether the disk keeps up with what is written and synced."""
    try:
        took_s = sync_times_s(now.folder)
    except OSError as error:
        yield failed(str(now.folder), f"cannot be written: {error.strerror}", "see the line on the folder")
        return
    yield judged_times(str(now.folder), took_s, now.bytes_per_s)


def judged_times(where: str, took_s: list[float], needed_bytes_per_s: float) -> Line:
    """Return the line on whether a disk with these times of `sync_times_s` reaches the rate that the buses need."""
    typical, slowest = np.quantile(took_s, [0.5, 0.99])
    speed = _SYNCED_BYTES / float(np.mean(took_s))
    found = f"64 kB written and synced in {1e3 * typical:.1f} ms (median), {1e3 * slowest:.1f} ms (99 %)"
    step = "use an SSD or an industrial SD card; close other programs that write"
    if speed < needed_bytes_per_s:
        return failed(where, f"{found}: {speed / _MB:.2f} MB/s, {needed_bytes_per_s / _MB:.2f} are needed", step)
    if slowest > _SLOW_SYNC_S:
        return warned(where, f"{found}: a power cut may take more than the last second", step)
    return passed(where, found)


def sync_times_s(where: Path, blocks: int = _SYNCED_BLOCKS) -> list[float]:
    """Return how long each block of 64 kB takes until it is on the disk."""
    content = np.random.default_rng(0).bytes(_SYNCED_BYTES)
    took = []
    with tempfile.TemporaryFile(dir=where) as file:
        for _ in range(blocks):
            began = time.perf_counter()
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            took.append(time.perf_counter() - began)
    return took


def python(now: Situation) -> Iterator[Line]:
    """Check whether the logger starts quickly."""
    del now
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import can"], check=False, capture_output=True)
    took_s = time.perf_counter() - began
    found = f"Python {platform.python_version()}, python-can imported in {took_s:.1f} s"
    if importlib.util.find_spec("asammdf") is not None:
        step = "keep asammdf out of the logger's environment: python-can imports it and starts seconds later"
        yield warned("", f"{found}, with asammdf beside it", step)
    elif took_s > _SLOW_IMPORT_S:
        yield warned("", found, "a restart of the logger loses that time; use a faster card, or fewer packages")
    else:
        yield passed("", found)


def page(now: Situation) -> Iterator[Line]:
    """Check whether the status page's port is free."""
    where = f"127.0.0.1:{now.page_port}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            made.bind(("127.0.0.1", now.page_port))
        except OSError as error:
            taken = error.errno == errno.EADDRINUSE
            found = "another program has the port" if taken else f"the port cannot be had: {error.strerror}"
            yield failed(
                where, found, f"end it (`ss -ltnp 'sport = :{now.page_port}'`), or log with another: --page-port"
            )
            return
    yield passed(where, "free")


def service(now: Situation) -> Iterator[Line]:
    """Check whether the logger is a service that is started again when it dies."""
    del now
    yield judged_unit([folder / _UNIT for folder in _UNITS])


def judged_unit(places: list[Path]) -> Line:
    """Return the line for the first unit file of some places that is there."""
    unit = next((place for place in places if place.is_file()), None)
    if unit is None:
        step = f"for a test day install deploy/{_UNIT}: it starts with the machine and comes back after a fault"
        return warned("", f"{_UNIT} is not installed: a logger started by hand ends with its terminal", step)
    text = unit.read_text(encoding="utf-8", errors="replace")
    lacking = [key.rstrip("=") for key in _UNIT_KEYS if key not in text]
    if lacking:
        return warned(str(unit), f"it lacks {', '.join(lacking)}", f"take deploy/{_UNIT} again")
    return passed(str(unit), "installed, with a watchdog")
