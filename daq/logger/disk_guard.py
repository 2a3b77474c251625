"""Free space of the recording's disk: how long it lasts, and when recording must end so that the file can be closed."""

from __future__ import annotations

import contextlib
import math
import shutil
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from daq.errors import Fault, HardwareError
from daq.logger.health.report import Level

_MB = 1_000_000
_GROWTH_OVER_S = 60.0
_GROWTH_FROM_S = 2.0
"""The growth is that of the last minute, and known when it has been measured for `_GROWTH_FROM_S`."""

_CALM = 1.25
"""The warning ends when the disk lasts so many times longer than where it began."""


@dataclass(frozen=True)
class DiskState:
    """State of the disk now.

    Attributes
    ----------
    free_bytes, reserve_bytes : int
        Free space; where recording ends.
    bytes_per_s : float
        How fast the recording grows; NaN until it is known.
    minutes : float
        Until recording ends, at this growth; NaN until it is known.
    level : Level
        Amber under the vehicle's ``disk_warn_min``, red when recording must end.
    """

    free_bytes: int
    reserve_bytes: int
    bytes_per_s: float
    minutes: float
    level: Level

    def text(self) -> str:
        """Return it as a sentence."""
        lasts = "" if math.isnan(self.minutes) else f", {self.minutes:.0f} minutes at {self.bytes_per_s / _MB:.2f} MB/s"
        return f"{self.free_bytes / _MB:,.0f} MB free, {self.reserve_bytes / _MB:,.0f} MB of them in reserve{lasts}"


class DiskGuard:
    """Watches the free space of a folder.

    Raises
    ------
    HardwareError
        If there is less free than the reserve from the beginning.
    """

    def __init__(self, folder: Path, *, warn_min: float, reserve_mb: float) -> None:
        self._folder = folder
        self._warn_min = warn_min
        self._reserve_bytes = int(reserve_mb * _MB)
        self._history: deque[tuple[float, int]] = deque()
        self._warned = False
        self._free = self._reserve_bytes + 1
        state = self.check(0.0, 0)
        self._history.clear()
        if state.level is Level.RED:
            raise HardwareError(disk_fault(folder, state))

    def check(self, now_s: float, written_bytes: int) -> DiskState:
        """Return the state of the disk.

        Parameters
        ----------
        now_s : float
            Monotonic time.
        written_bytes : int
            What has been recorded since the logger started.
        """
        with contextlib.suppress(OSError):  # a failed disk is reported by the next write
            self._free = shutil.disk_usage(self._folder).free
        free = self._free
        self._history.append((now_s, written_bytes))
        while len(self._history) > 2 and now_s - self._history[1][0] >= _GROWTH_OVER_S:
            self._history.popleft()
        since_s, before = self._history[0]
        growth = (written_bytes - before) / (now_s - since_s) if now_s - since_s >= _GROWTH_FROM_S else math.nan
        minutes = max(free - self._reserve_bytes, 0) / growth / 60.0 if growth > 0 else math.nan
        return DiskState(free, self._reserve_bytes, growth, minutes, self._level(free, minutes))

    def _level(self, free: int, minutes: float) -> Level:
        if free <= self._reserve_bytes:
            return Level.RED
        self._warned = minutes < self._warn_min * (_CALM if self._warned else 1.0)
        return Level.AMBER if self._warned else Level.GREEN


def disk_fault(folder: Path, state: DiskState) -> Fault:
    """Return the fault of a disk that is full up to the reserve."""
    return Fault(
        "the disk is full up to the reserve",
        str(folder),
        f"{state.free_bytes / _MB:,.0f} MB free",
        f"more than [logger] disk_reserve_mb = {state.reserve_bytes / _MB:,.0f}",
        "free the disk, or record elsewhere: --out",
    )
