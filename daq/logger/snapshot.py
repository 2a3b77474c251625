"""The logger's state as plain data, for a panel, with the latest samples of some roles to plot.

Everything is a JSON value; a number that is not known is None.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from daq import Channel, VehicleConfig
from daq.can import Database, resolve_roles
from daq.logger.health.report import BusHealth, HealthReport, HostStatus, Level, Reason
from daq.logger.health.report import worst as worst_level
from daq.logger.host_monitor import DiskState
from daq.recording.events import Event

SNAPSHOT_SCHEMA = "wheelsoil/live/1"

TRACE_ROLES = ("drawbar_pull", "wheel_speed", "ground_speed", "vertical_load", "driving_torque")
TRACE_RATE_HZ = 20.0
_KEPT = 600

Samples = tuple[list[int], list[float]]
"""File times in ns, and the values."""

MIN_SPEED_MPS = 0.5
"""Below this a page shows no slip."""
_REASONS = 20
_REMARKS = 10


class Traces:
    """Gathers samples until they are fetched; the oldest give way.

    `ConfigError` where a role names no signal, or one with an unknown unit.
    """

    def __init__(self, vehicle: VehicleConfig, databases: Mapping[str, Sequence[Database]]) -> None:
        self._references = resolve_roles(vehicle, databases, (), TRACE_ROLES)
        self._period_ns = round(1e9 / TRACE_RATE_HZ)
        self._last: dict[str, int] = {}
        self._samples: dict[str, Samples] = {}

    def take(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take the newest sample of each twentieth of a second."""
        for role, reference in self._references.items():
            channel = decoded.get(reference.key)
            if channel is None or not len(channel):
                continue
            period = channel.time_ns // self._period_ns
            rows = np.flatnonzero(np.diff(period, append=period[-1] + 1))
            rows = rows[period[rows] > self._last.get(role, -1)]
            if len(rows):
                self._last[role] = int(period[rows[-1]])
                chosen = Channel(channel.name, channel.unit, channel.time_ns[rows], channel.values[rows])
                self._gather(role, reference.to_si(chosen))

    def fetch(self) -> dict[str, Samples]:
        """Return the samples since the last call, by role."""
        samples, self._samples = self._samples, {}
        return samples

    def _gather(self, role: str, channel: Channel) -> None:
        times, values = self._samples.setdefault(role, ([], []))
        times += channel.time_ns.tolist()
        values += channel.values.tolist()
        del times[:-_KEPT], values[:-_KEPT]


@dataclass(frozen=True)
class RunState:
    """What is recorded now."""

    id: str
    file: str
    since_s: float
    """How long it has lasted."""
    part: int
    frames: int
    mb: float


@dataclass(frozen=True)
class SessionState:
    """Everything that a snapshot is made of.

    Attributes
    ----------
    state : {"recording", "between", "stopping"}
    file_ns : int
        Time now, as the file tells it.
    session_ns, started_ns : int
        Time now and when the logger started, on the session's time base.
    report : HealthReport or None
        The last one; None before the first.
    host : HostStatus
        Now.
    reasons : tuple of Reason
        What the logger itself has to say, beside the report.
    traces : mapping role -> samples
        Since the last snapshot.
    losses : mapping str -> int
    """

    vehicle: VehicleConfig
    state: str
    file_ns: int
    session_ns: int
    started_ns: int
    run: RunState
    report: HealthReport | None
    host: HostStatus
    disk: DiskState
    reasons: tuple[Reason, ...] = ()
    traces: Mapping[str, Samples] = field(default_factory=dict)
    losses: Mapping[str, int] = field(default_factory=dict)
    marks: tuple[Event, ...] = ()
    remarks: tuple[str, ...] = ()


def worst(state: SessionState) -> tuple[Reason, ...]:
    """Return the reasons of the report and of the logger, the worst first."""
    found = (*state.reasons, *(state.report.reasons if state.report else ()))
    return tuple(sorted(found, key=lambda reason: -reason.level))


def snapshot(state: SessionState) -> dict[str, Any]:
    """Return a state for a panel; see `daq.logger.panel.Panel`."""
    reasons = worst(state)
    report, host = state.report, state.host
    return {
        "schema": SNAPSHOT_SCHEMA,
        "vehicle": state.vehicle.vehicle.name,
        "state": state.state,
        "level": _level(worst_level(reasons)),
        "time_utc_s": state.file_ns * 1e-9,
        "session_s": (state.session_ns - state.started_ns) * 1e-9,
        "run": asdict(state.run),
        "reasons": [asdict(reason) | {"level": _level(reason.level)} for reason in reasons[:_REASONS]],
        "buses": list(_buses(state)),
        "values": list(_values(state)),
        "traces": {role: _trace(samples, state.started_ns) for role, samples in state.traces.items()},
        "setup": _setup(state.vehicle),
        "losses": dict(state.losses),
        "disk": {
            "free_mb": state.disk.free_bytes * 1e-6,
            "minutes": _number(state.disk.minutes),
            "level": _level(state.disk.level),
        },
        "queue_percent": 100.0 * host.queue_share,
        "cpu_percent": _number(100.0 * host.cpu_share),
        "rss_mb": host.rss_bytes * 1e-6,
        "clock": _clock(state),
        "gnss": _gnss(report),
        "marks": [{"time_utc_s": mark.time_ns * 1e-9, "text": mark.text} for mark in state.marks],
        "remarks": list(state.remarks[-_REMARKS:]),
    }


def _buses(state: SessionState) -> Iterator[dict[str, Any]]:
    """Yield the buses; what only the report knows is None before the first."""
    known: dict[str, BusHealth] = {bus.name: bus for bus in state.report.buses} if state.report else {}
    for name, status in state.host.buses.items():
        health = known.get(name)
        yield {
            "name": name,
            "level": _level(health.level if health else Level.GREEN if status.state == "up" else Level.RED),
            "state": status.state,
            "rate_hz": health and _number(health.rate_hz),
            "load_percent": health and _number(100.0 * health.load),
            "frames": status.received,
            "error_frames": health.error_frames if health else 0,
            "kernel_drops": status.kernel_drops,
            "queue_drops": status.queue_drops,
            "unknown_frames": health.unknown_frames if health else 0,
            "age_s": health and _number(health.age_s),
            "detail": status.detail,
        }


def _values(state: SessionState) -> Iterator[dict[str, Any]]:
    """Yield the last value of every role, in the DBC's unit."""
    report = state.report
    signals = {signal.role: signal for signal in report.signals if signal.role} if report else {}
    ages = {(message.bus, message.name): message.age_s for message in report.messages} if report else {}
    for role, name in state.vehicle.signals.items():
        signal = signals.get(role)
        age_s = ages.get((signal.bus, signal.name.rpartition(".")[0]), math.nan) if signal else math.nan
        yield {
            "role": role,
            "name": str(name),
            "value": signal and _number(signal.value),
            "unit": signal.unit if signal else "",
            "age_s": _number(age_s),
            "level": _level(signal.level if signal else Level.GREEN),
        }


def _trace(samples: Samples, started_ns: int) -> dict[str, list[float | None]]:
    times, values = samples
    return {
        "time_s": [(time_ns - started_ns) * 1e-9 for time_ns in times],
        "value": [_number(value) for value in values],
    }


def _setup(vehicle: VehicleConfig) -> dict[str, Any]:
    return {
        "wheel_radius_m": vehicle.wheel.rolling_m if vehicle.wheel else None,
        "latency_s": {role: vehicle.latency_s(role) for role in TRACE_ROLES if role in vehicle.signals},
        "min_speed_mps": MIN_SPEED_MPS,
        "transducer_frame": vehicle.transducer.frame,
    }


def _clock(state: SessionState) -> dict[str, Any]:
    fit = state.report.gnss.clock if state.report and state.report.gnss else None
    return {
        "steps": state.host.clock_steps,
        "offset_s": fit and _number(fit.offset_s),
        "drift_ppm": fit and _number(fit.drift_ppm),
        "residual_s": fit and _number(fit.residual_s),
    }


def _gnss(report: HealthReport | None) -> dict[str, Any] | None:
    if report is None or report.gnss is None:
        return None
    return {"fix": report.gnss.fix, "age_s": _number(report.gnss.age_s), "level": _level(report.gnss.level)}


def _level(level: Level) -> str:
    return level.name.lower()


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
