"""What the logger knows of its own process."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_STATM = Path("/proc/self/statm")


class CpuClock:
    """The share of one core that this process takes."""

    def __init__(self) -> None:
        self._wall_s, self._cpu_s = time.monotonic(), time.process_time()
        self.share = math.nan

    def look(self) -> float:
        """Return the share since the last look; NaN the first time."""
        wall_s, cpu_s = time.monotonic(), time.process_time()
        if wall_s > self._wall_s:
            self.share = (cpu_s - self._cpu_s) / (wall_s - self._wall_s)
        self._wall_s, self._cpu_s = wall_s, cpu_s
        return self.share


def resident_bytes() -> int:
    """Return the resident memory of this process; 0 where the system does not tell."""
    try:
        return int(_STATM.read_text(encoding="ascii").split()[1]) * _PAGE_BYTES
    except OSError:
        return 0
