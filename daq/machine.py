"""What a system can do: memory, which is 0 where it does not tell, and logging."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from daq.errors import ConfigError

_KIB = 1024
_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def machine_memory_bytes() -> int:
    """Return how much memory this machine has; 0 where the system does not say (Windows)."""
    if not hasattr(os, "sysconf"):
        return 0
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def peak_memory_bytes() -> int:
    """Return the most that this process has used, since `reset_peak_memory`; 0 where the system does not say."""
    with suppress(OSError):
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * _KIB
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * _KIB


def reset_peak_memory() -> None:
    """Have `peak_memory_bytes` count from now on, where the system can do that (Linux)."""
    with suppress(OSError):
        _CLEAR.write_text("5")


def limit_memory(most_bytes: int, *, addresses: bool = False) -> None:
    """Let this process have no more data than this, or no more addresses, where the system can do that."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS if addresses else resource.RLIMIT_DATA, (most_bytes, most_bytes))


def check_logging() -> None:
    """Check that this system has what the field logger is built on.

    Raises
    ------
    ConfigError
        It has not (Windows).
    """
    try:
        import fcntl  # noqa: F401 - only whether there is one
    except ImportError:
        what, step = "this system has no locks on folders, without which a vehicle is not logged", "log on Linux"
        raise ConfigError.of(what, sys.platform, next_step=f"{step}; recordings are read on every system") from None
