"""Channels of a 60 s run to a processed run: three 1 kHz force channels, wheel speed at 100 Hz, GNSS at 20 Hz."""

from __future__ import annotations

import numpy as np

from benchmarks.table import Row
from benchmarks.timing import median_cpu_seconds
from daq import Channel, VehicleConfig, WheelSection
from processing.pipeline import process

_DURATION_S = 60.0
_RADIUS_M = 0.47


def _channel(role: str, rate_hz: float, rng: np.random.Generator) -> Channel:
    at = np.arange(int(_DURATION_S * rate_hz)) / rate_hz
    speed = 3.0 + 1.4 * np.sin(0.7 * at)
    values = {
        "ground_speed": speed + 0.03 * rng.standard_normal(len(at)),
        "wheel_speed": speed / (0.75 - 0.2 * np.sin(0.9 * at)) / _RADIUS_M,
        "vertical_load": 8000 + 300 * np.cos(0.7 * at) + 20 * rng.standard_normal(len(at)),
        "drawbar_pull": 900 * np.sin(0.9 * at) + 20 * rng.standard_normal(len(at)),
        "driving_torque": 700 + 400 * np.sin(0.9 * at) + 5 * rng.standard_normal(len(at)),
    }[role]
    return Channel(role, "", np.round(at * 1e9).astype(np.int64), values)


def rows() -> list[Row]:
    """Return the time of one run."""
    rng = np.random.default_rng(1)
    rates = {"ground_speed": 20.0, "wheel_speed": 100.0}
    rates |= dict.fromkeys(("vertical_load", "drawbar_pull", "driving_torque"), 1000.0)
    channels = {role: _channel(role, rate, rng) for role, rate in rates.items()}
    vehicle = VehicleConfig(wheel=WheelSection(radius_m=_RADIUS_M, width_m=0.318))
    seconds = median_cpu_seconds(lambda: process(channels, vehicle), 9)
    what = "process one 60 s run (3 x 1 kHz, 100 Hz, 20 Hz)"
    return [Row(what, f"{seconds:.3f} s")]
