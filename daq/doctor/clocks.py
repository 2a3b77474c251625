"""Checks of the clocks: the host's own, and the receiver's against it."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np

from daq.clock import fit_clock
from daq.doctor.line import Line, failed, passed, warned
from daq.doctor.situation import Situation
from daq.errors import DataError

_FIRST_YEAR, _LAST_YEAR = 2025, 2100
_STEP_S = 0.001
_STA_UNSYNC = 0x0040
"""linux/timex.h"""
_LEAP_S = 18.0
_FAR_S = 1.0
_CHRONY = (
    "install chrony or systemd-timesyncd (`timedatectl set-ntp true`); without a network feed chrony from the GNSS"
)


def host_time(now: Situation) -> Iterator[Line]:
    """Tell whether the host's clock is set at all."""
    del now
    yield judged_time(datetime.now(UTC))


def judged_time(moment: datetime) -> Line:
    """Return the line for a time that the host's clock shows."""
    if _FIRST_YEAR <= moment.year <= _LAST_YEAR:
        return passed("", f"{moment:%Y-%m-%d %H:%M:%S} UTC")
    step = "set it (`sudo timedatectl set-time ...`, or chrony); a Raspberry Pi has no battery-backed clock"
    return failed("", f"the clock shows {moment:%Y-%m-%d}: it was never set", step)


def clock_steps(now: Situation) -> Iterator[Line]:
    """Tell whether the host's clock is left alone."""
    if abs(now.clock_moved_s) > _STEP_S:
        step = (
            "wait until the clock is synchronised; a step while recording is noted, and the file's time stays monotonic"
        )
        yield warned("", f"the clock was set by {now.clock_moved_s:+.3f} s while listening", step)
    else:
        yield passed("", "not set while listening")


def clock_sync(now: Situation) -> Iterator[Line]:
    """Tell whether the host's clock is synchronised."""
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
    """Tell whether the receiver has a fix."""
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
    """Tell how far apart the host's clock and the receiver's are."""
    channel = now.channels.get("gnss_time")
    if channel is None or not len(channel.values):
        return
    try:
        fit = fit_clock(channel.time_ns, channel.values)
    except DataError:
        yield warned("gnss_time", "it stands still", "wait for a fix, or listen longer: --listen 10")
        return
    found = f"host minus GNSS {fit.offset_s:+.3f} s (delay included), jitter {1e3 * fit.residual_s:.1f} ms"
    if abs(fit.offset_s + _LEAP_S) < _FAR_S:
        yield passed("gnss_time", f"{found}: GPS time, which has no leap seconds")
    elif abs(fit.offset_s) > _FAR_S:
        step = f"the fit allows for it, but set the clock if it is the host's that is wrong: {_CHRONY}"
        yield warned("gnss_time", found, step)
    else:
        yield passed("gnss_time", found)
