"""Recorded frames through the health monitor, five times a second as the logger does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from daq import VehicleConfig
from daq.can import Database, Decoder, FrameBatch, concatenate
from daq.logger.health import HealthMonitor
from daq.logger.health.report import HealthReport, HostStatus, Reason

STEP_NS = 200_000_000


@dataclass(frozen=True)
class HealthRun:
    """Result of a run through the monitor: every report, and all reasons ever reported."""

    monitor: HealthMonitor
    reports: list[HealthReport]

    @property
    def last(self) -> HealthReport:
        return self.reports[-1]

    @property
    def reasons(self) -> list[Reason]:
        return [one for report in self.reports for one in report.reasons]

    def first_s(self, code: str, where: str = "") -> float:
        """Return when a reason first stood, in seconds since the start; NaN if never."""
        start = self.reports[0].time_ns - STEP_NS
        times = (
            (report.time_ns - start) * 1e-9
            for report in self.reports
            for one in report.reasons
            if one.code == code and where in one.where
        )
        return next(times, float("nan"))


def in_steps(batch: FrameBatch, step_ns: int = STEP_NS) -> Iterator[tuple[int, FrameBatch]]:
    """Cut frames by time, in order of time; yield the end of each step with its frames."""
    batch = batch[np.argsort(batch.frames["time_ns"], kind="stable")]
    times = batch.frames["time_ns"]
    ends = np.arange(times[0] + step_ns, times[-1] + 2 * step_ns, step_ns)
    places = [0, *np.searchsorted(times, ends).tolist()]
    for end, start, stop in zip(ends.tolist(), places[:-1], places[1:], strict=True):
        yield end, batch[start:stop]


def watch(
    vehicle: VehicleConfig,
    databases: Mapping[str, tuple[Database, ...]],
    batches: Iterable[FrameBatch],
    host_at: Callable[[float], HostStatus] = lambda _: HostStatus({}),
) -> HealthRun:
    """Run frames through a monitor; `host_at` gives the machine's state at a time since the start."""
    whole = concatenate(list(batches))
    start_ns = int(whole.frames["time_ns"].min())
    monitor = HealthMonitor(vehicle, databases, started_ns=start_ns)
    decoder = Decoder(databases)
    reports = []
    for now_ns, batch in in_steps(whole):
        monitor.take(batch, decoder.decode(batch))
        reports.append(monitor.report(now_ns, host_at((now_ns - start_ns) * 1e-9)))
    return HealthRun(monitor, reports)
