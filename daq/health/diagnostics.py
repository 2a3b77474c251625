"""A health report as diagnostics of a recording: buses, messages that came, signals with a role, GNSS, the machine."""

from __future__ import annotations

import math
from collections.abc import Mapping

from daq.health.board import worst
from daq.health.report import BusHealth, GnssHealth, HealthReport, HostFacts, MessageHealth, Reason, SignalHealth
from daq.recording.diagnostics import DiagnosticStatus


def statuses(report: HealthReport) -> list[DiagnosticStatus]:
    """Return a status for everything that is worth one.

    Parameters
    ----------
    report : HealthReport

    Returns
    -------
    list of DiagnosticStatus
        Names are ``can0``, ``can0/WFT_Forces``, ``can0/WFT_Forces.Fz``, ``gnss`` and ``host``. A reason stands at the
        bus where its place has no status of its own, and else at the host. What is not known is left out.
    """
    known = {bus.name: _bus(bus) for bus in report.buses}
    known |= {f"{one.bus}/{one.name}": _message(one) for one in report.messages if one.frames or one.level}
    known |= {f"{one.bus}/{one.name}": _signal(one) for one in report.signals if one.role}
    if report.gnss is not None:
        known["gnss"] = _gnss(report.gnss)
    known["host"] = _host(report.host)
    placed: dict[str, list[Reason]] = {name: [] for name in known}
    for reason in report.reasons:
        bus, _, rest = reason.where.partition(": ")
        name = f"{bus}/{rest}" if rest else bus
        placed[next((place for place in (name, bus) if place in placed), "host")].append(reason)
    return [_status(name, values, placed[name]) for name, values in known.items()]


def _status(name: str, values: Mapping[str, float | str], reasons: list[Reason]) -> DiagnosticStatus:
    level = worst(reasons)
    text = "; ".join(f"{reason.code}: {reason.what}" for reason in reasons) if level else "ok"
    told = {key: value if isinstance(value, str) else _number(value) for key, value in values.items()}
    return DiagnosticStatus(int(level), name, text, values={key: value for key, value in told.items() if value})


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}" if isinstance(value, float) else str(value)


def _bus(bus: BusHealth) -> dict[str, float | str]:
    facts = bus.facts
    return {
        "state": facts.state,
        "rate_hz": bus.rate_hz,
        "load_percent": 100.0 * bus.load,
        "frames": facts.received,
        "kernel_drops": math.nan if facts.kernel_drops is None else facts.kernel_drops,
        "queue_drops": facts.queue_drops,
        "error_frames": bus.error_frames,
        "unknown_frames": bus.unknown_frames,
    }


def _message(one: MessageHealth) -> dict[str, float | str]:
    return {
        "rate_hz": one.rate_hz,
        "usual_rate_hz": one.usual_rate_hz,
        "age_s": one.age_s,
        "frames": one.frames,
        "gaps": one.gaps,
        "missing": one.missing,
        "counter_jumps": one.counter_jumps,
    }


def _signal(one: SignalHealth) -> dict[str, float | str]:
    return {
        "role": one.role,
        "value": one.value,
        "unit": one.unit,
        "stuck_s": one.stuck_s,
        "out_of_range": one.out_of_range,
        "saturated": one.saturated,
    }


def _gnss(gnss: GnssHealth) -> dict[str, float | str]:
    values: dict[str, float | str] = {"age_s": gnss.age_s}
    if gnss.fix is not None:
        values["fix"] = "yes" if gnss.fix else "no"
    if gnss.clock is not None:
        fit = gnss.clock
        values |= {"offset_s": fit.offset_s, "drift_ppm": fit.drift_ppm, "residual_s": fit.residual_s}
    return values


def _host(host: HostFacts) -> dict[str, float | str]:
    return {
        "disk_free_mb": host.disk_free_bytes * 1e-6,
        "disk_bytes_per_s": host.disk_bytes_per_s,
        "queue_percent": 100.0 * host.queue_share,
        "skipped_frames": host.skipped_frames,
        "cpu_percent": 100.0 * host.cpu_share,
        "rss_mb": host.rss_bytes * 1e-6,
        "clock_steps": host.clock_steps,
    }
