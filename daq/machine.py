"""What a system can do: memory, which is 0 where it does not tell, and logging."""

from __future__ import annotations

import os
import sys

from daq.errors import ConfigError

_KIB = 1024


def machine_memory_bytes() -> int:
    """Return how much memory this machine has; 0 where the system does not say (Windows)."""
    if not hasattr(os, "sysconf"):
        return 0
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def peak_memory_bytes() -> int:
    """Return the most that this process has used; 0 where the system does not say (Windows)."""
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * _KIB


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
