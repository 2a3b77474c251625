"""The machine: disk, queue, processor, clock."""

from __future__ import annotations

import math

from daq.config import LoggerSection
from daq.health.board import Recent, Since, reason
from daq.health.report import HostFacts, Level, Reason

_RED_MINUTES = 10.0
_QUEUE_AMBER, _QUEUE_RED = 0.25, 0.75
_BUSY, _BUSY_S = 0.9, 5.0
_STEP_TOLD_NS = 60_000_000_000


class HostWatch:
    """Follows the machine from report to report.

    Parameters
    ----------
    limits : LoggerSection
    """

    def __init__(self, limits: LoggerSection) -> None:
        self._limits = limits
        self._skipped = Recent()
        self._since = Since()
        self._steps = Recent()

    def reasons(self, now_ns: int, host: HostFacts) -> list[Reason]:
        """Return what is wrong with the machine."""
        found = self._disk(host)
        if host.queue_share > _QUEUE_AMBER:
            level = Level.RED if host.queue_share > _QUEUE_RED else Level.AMBER
            what = f"the queue before the disk is {100 * host.queue_share:.0f} % full"
            found.append(reason("queue_filling", level, "host", what))
        if self._skipped.take(now_ns, host.skipped_frames):
            what = f"{host.skipped_frames} frames so far were recorded, but not decoded"
            found.append(reason("inspection_skipped", Level.AMBER, "host", what))
        if self._since.held_s("cpu", now_ns, host.cpu_share > _BUSY) >= _BUSY_S:
            what = f"the logger takes {100 * host.cpu_share:.0f} % of a processor core"
            found.append(reason("cpu_busy", Level.AMBER, "host", what))
        self._steps.take(now_ns, host.clock_steps)
        if self._steps.last_ns is not None and now_ns - self._steps.last_ns < _STEP_TOLD_NS:
            by = f" by {host.last_step_s:+.3f} s" if math.isfinite(host.last_step_s) else ""
            what = f"the host's clock was set{by}, {host.clock_steps} times so far"
            found.append(reason("clock_stepped", Level.AMBER, "host", what))
        return found

    def _disk(self, host: HostFacts) -> list[Reason]:
        usable = max(host.disk_free_bytes - host.disk_reserve_bytes, 0)
        if not host.disk_bytes_per_s > 0:
            return []
        minutes = usable / host.disk_bytes_per_s / 60.0
        if minutes >= self._limits.disk_warn_min:
            return []
        level = Level.RED if minutes < _RED_MINUTES else Level.AMBER
        what = f"the disk lasts {minutes:.0f} minutes: {usable / 1e6:.0f} MB at {host.disk_bytes_per_s / 1e6:.2f} MB/s"
        return [reason("disk_low", level, "host", what)]
