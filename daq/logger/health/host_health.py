"""Faults of the machine and of the GNSS receiver: disk, queue, processor, clock, fix, age."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from daq import Channel, LoggerSection
from daq.can.roles import SignalRef
from daq.clock import ClockFit, GnssClock
from daq.logger.health.report import GnssHealth, HostStatus, Level, Reason, Recent, Since, reason, worst

_RED_MINUTES = 10.0
_QUEUE_AMBER, _QUEUE_RED = 0.25, 0.75
_BUSY, _BUSY_S = 0.9, 5.0
_STEP_REPORTED_NS = 60_000_000_000

GNSS_ROLES = ("ground_speed_valid", "latitude", "longitude", "gnss_time", "course")
_FIT_EVERY_NS = 10_000_000_000
_LOST_AFTER_S = 1.5
_MESSAGES = 5
_NEVER_AFTER_S = 10.0
_RESIDUAL_S = 0.05
_DRIFT_PPM = 100.0
_DRIFT_SIGMAS = 3.0
_NULL_ISLAND_RAD = 1e-6


class HostWatch:
    """Follows the machine from report to report."""

    def __init__(self, limits: LoggerSection) -> None:
        self._limits = limits
        self._skipped = Recent()
        self._since = Since()
        self._steps = Recent()

    def reasons(self, now_ns: int, host: HostStatus) -> Iterator[Reason]:
        """Yield what is wrong with the machine."""
        yield from self._disk(host)
        if host.queue_share > _QUEUE_AMBER:
            level = Level.RED if host.queue_share > _QUEUE_RED else Level.AMBER
            what = f"the queue before the disk is {100 * host.queue_share:.0f} % full"
            yield reason("queue_filling", level, "host", what)
        if self._skipped.take(now_ns, host.skipped_frames):
            what = f"{host.skipped_frames} frames so far were recorded, but not decoded"
            yield reason("inspection_skipped", Level.AMBER, "host", what)
        if self._since.held_s("cpu", now_ns, host.cpu_share > _BUSY) >= _BUSY_S:
            what = f"the logger takes {100 * host.cpu_share:.0f} % of a processor core"
            yield reason("cpu_busy", Level.AMBER, "host", what)
        self._steps.take(now_ns, host.clock_steps)
        if self._steps.last_ns is not None and now_ns - self._steps.last_ns < _STEP_REPORTED_NS:
            by = f" by {host.last_step_s:+.3f} s" if math.isfinite(host.last_step_s) else ""
            what = f"the host's clock was set{by}, {host.clock_steps} times so far"
            yield reason("clock_stepped", Level.AMBER, "host", what)

    def _disk(self, host: HostStatus) -> list[Reason]:
        usable = max(host.disk_free_bytes - host.disk_reserve_bytes, 0)
        if not host.disk_bytes_per_s > 0:
            return []
        minutes = usable / host.disk_bytes_per_s / 60.0
        if minutes >= self._limits.disk_warn_min:
            return []
        level = Level.RED if minutes < _RED_MINUTES else Level.AMBER
        what = f"the disk lasts {minutes:.0f} minutes: {usable / 1e6:.0f} MB at {host.disk_bytes_per_s / 1e6:.2f} MB/s"
        return [reason("disk_low", level, "host", what)]


class Gnss:
    """Follows the receiver, by those of the roles that are its own."""

    def __init__(self, roles: Mapping[str, SignalRef], started_ns: int) -> None:
        self.roles = {role: roles[role] for role in GNSS_ROLES if role in roles}
        self._started_ns = started_ns
        self._fix_roles = [role for role in ("ground_speed_valid", "latitude", "longitude") if role in roles][:1]
        self._positions = [role for role in ("latitude", "longitude") if role in roles]
        self._fixed_ns: int | None = None
        self._fix: bool | None = None
        self._clock = GnssClock()
        self._fitted_ns = started_ns
        self._fit: ClockFit | None = None
        self._period_s = 0.0

    def take(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take decoded frames; see `HealthMonitor.take`."""
        if "gnss_time" in self.roles:
            channel = decoded.get(self.roles["gnss_time"].key)
            if channel is not None:
                time = self.roles["gnss_time"].to_si(channel)
                self._clock.take(time.time_ns, time.values)
        for role in self._fix_roles:
            channel = decoded.get(self.roles[role].key)
            if channel is not None and len(channel):
                self._take_fix(role, self.roles[role].to_si(channel))

    def _take_fix(self, role: str, channel: Channel) -> None:
        known = np.isfinite(channel.values)
        valid = (
            known & (channel.values != 0)
            if role == "ground_speed_valid"
            else known & (np.abs(channel.values) >= _NULL_ISLAND_RAD)
        )
        rows = np.flatnonzero(valid)
        if len(rows):
            self._fixed_ns = int(channel.time_ns[rows[-1]])
        self._fix = bool(valid[-1])

    @property
    def fix_signal(self) -> SignalRef | None:
        """The signal that tells whether there is a fix."""
        return self.roles[self._fix_roles[0]] if self._fix_roles else None

    def skip(self, time_ns: int) -> None:
        """Take that frames until then were not decoded: what held before holds on."""
        if self._fix and self._fixed_ns is not None:
            self._fixed_ns = max(self._fixed_ns, time_ns)

    def health(
        self, now_ns: int, values: Mapping[str, float], period_s: float, *, bus_active: bool
    ) -> tuple[GnssHealth, list[Reason]] | None:
        """Return the state of the receiver and what is wrong with it; None without GNSS roles.

        `values` are the last ones by role, in SI; `period_s` is the usual time between the receiver's messages, NaN
        where it is not known. Where its bus is not active, the bus is to blame.
        """
        if not self.roles:
            return None
        if now_ns - self._fitted_ns >= _FIT_EVERY_NS and "gnss_time" in self.roles:
            self._fitted_ns = now_ns
            self._fit = self._clock.fit()
        nowhere = len(self._positions) == 2 and all(abs(values.get(r, 1.0)) < _NULL_ISLAND_RAD for r in self._positions)
        fix = self._fix and not nowhere if self._fix is not None else None
        age_s = math.nan if self._fixed_ns is None else (now_ns - self._fixed_ns) * 1e-9
        found = list(self._clock_reasons())
        if bus_active:
            found += self._fix_reasons(now_ns, fix, age_s, nowhere, period_s)
        return GnssHealth(worst(found), fix, age_s, self._fit), found

    def _fix_reasons(
        self, now_ns: int, fix: bool | None, age_s: float, nowhere: bool, period_s: float
    ) -> Iterator[Reason]:
        patience_s = max(_LOST_AFTER_S, _MESSAGES * period_s) if math.isfinite(period_s) else _NEVER_AFTER_S
        running_s = (now_ns - self._started_ns) * 1e-9
        if fix is None or (math.isnan(age_s) and running_s < _NEVER_AFTER_S):
            return
        if math.isnan(age_s):
            yield reason("gnss_no_fix", Level.RED, "gnss", f"no fix since the start {running_s:.0f} s ago")
        elif nowhere:
            yield reason("gnss_no_fix", Level.RED, "gnss", "the position is 0, 0: the receiver has none")
        elif age_s > patience_s:
            yield reason("gnss_no_fix", Level.RED, "gnss", f"the last valid fix is {age_s:.1f} s old")

    def _clock_reasons(self) -> Iterator[Reason]:
        fit = self._fit
        if fit is None:
            return
        if fit.residual_s > _RESIDUAL_S:
            what = f"GNSS time comes with a jitter of {1e3 * fit.residual_s:.0f} ms against the host's clock"
            yield reason("gnss_clock_residual", Level.AMBER, "gnss", what)
        if abs(fit.drift_ppm) > _DRIFT_PPM + _DRIFT_SIGMAS * fit.drift_sigma_ppm:
            what = f"the host's clock drifts by {fit.drift_ppm:.0f} ppm ({0.06 * fit.drift_ppm:.1f} ms a minute)"
            yield reason("gnss_clock_drift", Level.AMBER, "gnss", what)
