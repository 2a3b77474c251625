"""Snapshots of a drive for the status page, as the logger would make them, from a sample recording."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from daq import FloatArray
from daq.logger.snapshot import SNAPSHOT_SCHEMA
from daq.runs import Run, open_runs

SAMPLE = Path(__file__).parents[1] / "recordings" / "clay" / "run-1.mcap"
TRACED = ("drawbar_pull", "wheel_speed", "ground_speed", "vertical_load", "driving_torque")
UNITS = {
    "vertical_load": "N",
    "drawbar_pull": "N",
    "driving_torque": "N m",
    "wheel_speed": "rad/s",
    "ground_speed": "m/s",
    "latitude": "°",
    "longitude": "°",
    "course": "°",
    "wheel_angle": "°",
    "gnss_time": "s",
    "ground_speed_valid": "",
}
_DEGREES = ("course", "wheel_angle")
START_UTC_S = 1_780_000_000.0


@dataclass(frozen=True)
class Drive:
    """A recorded run by role: seconds since its start, values in SI units."""

    run: Run
    time_s: dict[str, FloatArray]
    value: dict[str, FloatArray]

    @property
    def duration_s(self) -> float:
        return max(float(t[-1]) for t in self.time_s.values())


@lru_cache
def drive() -> Drive:
    """The sample recording's run."""
    [run] = open_runs([SAMPLE])
    channels = run.channels()
    start_ns = min(int(c.time_ns[0]) for c in channels.values())
    time_s = {role: (c.time_ns - start_ns) * 1e-9 for role, c in channels.items()}
    return Drive(run, time_s, {role: np.asarray(c.values, np.float64) for role, c in channels.items()})


def trace(role: str, after_s: float, until_s: float) -> dict[str, list[float]]:
    """What is new of a role, at most 20 Hz."""
    time_s, value = drive().time_s[role], drive().value[role]
    rows = np.flatnonzero((time_s > after_s) & (time_s <= until_s))
    rows = rows[:: max(1, round(0.05 / max(np.median(np.diff(time_s)), 1e-3)))]
    return {"time_s": time_s[rows].tolist(), "value": value[rows].tolist()}


def snapshot(after_s: float, until_s: float, **changes: Any) -> dict[str, Any]:
    """The logger's snapshot at `until_s`, the one before being at `after_s`."""
    vehicle = drive().run.vehicle
    assert vehicle is not None and vehicle.wheel is not None
    made: dict[str, Any] = {
        "schema": SNAPSHOT_SCHEMA,
        "vehicle": vehicle.vehicle.name,
        "state": "recording",
        "level": "green",
        "time_utc_s": START_UTC_S + until_s,
        "session_s": until_s,
        "run": {
            "id": "clay-out-3",
            "since_s": until_s,
            "part": 1,
            "file": "clay-out-3.mcap",
            "mb": 0.021 * until_s,
            "frames": round(3261 * until_s),
        },
        "reasons": [],
        "buses": [bus("can0", until_s)],
        "values": [_value(role, name, until_s) for role, name in vehicle.signals.items()],
        "traces": {role: trace(role, after_s, until_s) for role in TRACED},
        "setup": {
            "wheel_radius_m": vehicle.wheel.radius_m,
            "latency_s": {role: vehicle.latency_s(role) for role in vehicle.signals},
            "min_speed_mps": 0.5,
        },
        "losses": {},
        "disk": {"free_mb": 58_412.0, "minutes": 46_000.0, "level": "green"},
        "queue_percent": 0.4,
        "cpu_percent": 11.6,
        "rss_mb": 128.0,
        "clock": {"steps": 0, "offset_s": 18.0003, "drift_ppm": 1.31, "residual_s": 0.00042},
        "gnss": {"fix": True, "age_s": 0.04, "level": "green"},
        "marks": [],
        "remarks": [],
    }
    return made | changes


def bus(name: str, until_s: float, **changes: Any) -> dict[str, Any]:
    """A bus that is well."""
    made = {
        "name": name,
        "level": "green",
        "state": "up",
        "rate_hz": 3261.0,
        "load_percent": 37.2,
        "frames": round(3261 * until_s),
        "error_frames": 0,
        "kernel_drops": 0,
        "queue_drops": 0,
        "unknown_frames": 0,
        "age_s": 0.001,
        "detail": "",
    }
    return made | changes


def reason(level: str, code: str, where: str, what: str, next_step: str) -> dict[str, str]:
    """Why it is not green."""
    return {"code": code, "level": level, "where": where, "what": what, "next_step": next_step}


def _value(role: str, name: str, until_s: float) -> dict[str, Any]:
    time_s, value = drive().time_s[role], drive().value[role]
    last = int(np.searchsorted(time_s, until_s, side="right")) - 1
    number = float(value[last]) if last >= 0 and np.isfinite(value[last]) else None
    if number is not None and role in _DEGREES:
        number = float(np.degrees(number))
    return {
        "role": role,
        "name": name,
        "value": number,
        "unit": UNITS[role],
        "age_s": until_s - float(time_s[last]) if last >= 0 else None,
        "level": "green",
    }
