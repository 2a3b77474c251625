"""A health report as diagnostics, for Foxglove and ROS tools."""

from __future__ import annotations

import math

from daq.health.report import HealthReport, HostFacts, Level
from daq.recording import DiagnosticStatus


def statuses(report: HealthReport) -> list[DiagnosticStatus]:
    """Return the report's buses and messages, the logger itself, and every reason why it is not green."""
    by_place: dict[str, list[str]] = {}
    for reason in report.reasons:
        by_place.setdefault(reason.where, []).append(f"{reason.code}: {reason.what}")
    return [
        DiagnosticStatus(report.level, "logger", _said(report), values=_host(report.host) | _losses(report)),
        *(
            DiagnosticStatus(
                bus.level,
                f"bus/{bus.name}",
                "; ".join(by_place.get(bus.name, [bus.facts.state])),
                values={
                    "rate_hz": _text(bus.rate_hz),
                    "load": _text(bus.load),
                    "received": str(bus.facts.received),
                    "error_frames": str(bus.error_frames),
                    "unknown_frames": str(bus.unknown_frames),
                    "kernel_drops": "" if bus.facts.kernel_drops is None else str(bus.facts.kernel_drops),
                    "queue_drops": str(bus.facts.queue_drops),
                    "reconnects": str(bus.facts.reconnects),
                },
            )
            for bus in report.buses
        ),
        *(
            DiagnosticStatus(
                message.level,
                f"message/{message.bus}/{message.name}",
                "; ".join(by_place.get(f"{message.bus}: {message.name}", [])),
                values={
                    "rate_hz": _text(message.rate_hz),
                    "usual_rate_hz": _text(message.usual_rate_hz),
                    "age_s": _text(message.age_s),
                    "frames": str(message.frames),
                    "missing": str(message.missing),
                    "counter_jumps": str(message.counter_jumps),
                },
            )
            for message in report.messages
        ),
    ]


def _said(report: HealthReport) -> str:
    if report.level is Level.GREEN:
        return "green"
    return "; ".join(f"{reason.code} at {reason.where}: {reason.what}" for reason in report.reasons)


def _host(host: HostFacts) -> dict[str, str]:
    return {
        "queue_share": _text(host.queue_share),
        "skipped_frames": str(host.skipped_frames),
        "disk_free_mb": _text(host.disk_free_bytes * 1e-6),
        "disk_bytes_per_s": _text(host.disk_bytes_per_s),
        "cpu_share": _text(host.cpu_share),
        "rss_mb": _text(host.rss_bytes * 1e-6),
        "clock_steps": str(host.clock_steps),
    }


def _losses(report: HealthReport) -> dict[str, str]:
    return {f"lost.{key}": str(count) for key, count in report.losses.items()}


def _text(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"
