"""Peak memory of a process of its own; imports nothing that would weigh."""

from __future__ import annotations

from pathlib import Path


def peak_rss_mb() -> float:
    """Return this process's own peak; ru_maxrss of a child would hold its parent's, too."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1]) / 1024
