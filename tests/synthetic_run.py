"""Synthetic channels for the processing tests: known speeds, rates, jitter and gaps."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from daq import Channel, FloatArray, VehicleConfig
from daq.config import SensorSection, WheelSection

Signal = Callable[[FloatArray], FloatArray]

START_NS = 1_700_000_000_000_000_000
RADIUS_M = 0.47


def channel(role: str, time_s: FloatArray, values: FloatArray, unit: str = "") -> Channel:
    """Return a channel whose stamps are `time_s` after `START_NS`."""
    return Channel(role, unit, START_NS + np.round(time_s * 1e9).astype(np.int64), np.asarray(values, np.float64))


def stamps(
    duration_s: float, rate_hz: float, rng: np.random.Generator | None = None, jitter: float = 0.0
) -> FloatArray:
    """Return sampling instants; `jitter` is a share of the interval, below a half."""
    at = np.arange(int(duration_s * rate_hz)) / rate_hz
    return at if rng is None else at + rng.uniform(0, jitter, len(at)) / rate_hz


def driven_speed(time_s: FloatArray) -> FloatArray:
    """Return a speed between 1 and 5 m/s with accelerations up to 1.3 m/s2."""
    return 3.0 + 1.4 * np.sin(0.7 * time_s) + 0.5 * np.sin(1.6 * time_s + 1.0)


def speeds(
    duration_s: float,
    slip: float = 0.0,
    *,
    rng: np.random.Generator | None = None,
    jitter: float = 0.0,
    ground_rate_hz: float = 20.0,
    wheel_rate_hz: float = 100.0,
    delay_s: float = 0.0,
    speed: Signal = driven_speed,
) -> dict[str, Channel]:
    """Return ground and wheel speed at a constant slip; ground speed comes `delay_s` late."""
    ground_at = stamps(duration_s, ground_rate_hz, rng, jitter)
    wheel_at = stamps(duration_s, wheel_rate_hz, rng, jitter)
    ratio = 1 / (1 - slip) if slip >= 0 else 1 + slip
    return {
        "ground_speed": channel("ground_speed", ground_at + delay_s, speed(ground_at), "m/s"),
        "wheel_speed": channel("wheel_speed", wheel_at, speed(wheel_at) * ratio / RADIUS_M, "rad/s"),
    }


def forces(duration_s: float, rate_hz: float = 1000.0, rng: np.random.Generator | None = None) -> dict[str, Channel]:
    """Return load, drawbar pull and torque, smooth, with white noise of 20 N, 20 N and 5 Nm when `rng` is given."""
    at = stamps(duration_s, rate_hz)
    clean = {
        "vertical_load": 8000 + 300 * np.sin(0.9 * at),
        "drawbar_pull": 900 * np.sin(0.7 * at),
        "driving_torque": 700 + 400 * np.sin(0.7 * at),
    }
    sigma = {"vertical_load": 20.0, "drawbar_pull": 20.0, "driving_torque": 5.0}
    noise = {role: 0.0 if rng is None else sigma[role] * rng.standard_normal(len(at)) for role in clean}
    return {role: channel(role, at, values + noise[role]) for role, values in clean.items()}


def vehicle(latencies_s: Mapping[str, float] | None = None, **sections: object) -> VehicleConfig:
    """Return a vehicle with a wheel, declared latencies and other sections."""
    sensors = {role: SensorSection(latency_s=value) for role, value in (latencies_s or {}).items()}
    given: dict[str, object] = {"wheel": WheelSection(radius_m=RADIUS_M, width_m=0.318), "sensors": sensors}
    return VehicleConfig.model_validate(given | sections)
