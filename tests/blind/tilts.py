"""Tilts of the transducer's frame, and the sensors on hub and body without which the engine does not consider them.

A body and an axle are masses on springs: their angles follow acceleration and torque late, and swing. Forces are turned
by the whole angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from blind.driving import GRAVITY_MPS2, RATE_HZ
from blind.hooks import Hidden, reads
from blind.sensors import START_NS
from blind.wheel import Moments, Reading
from scipy.signal import lfilter

from daq import FloatArray
from daq.channels import Channel

if TYPE_CHECKING:
    from blind.field import FieldDay

PITCH_GRADIENT = np.radians(5.0) / GRAVITY_MPS2
"""Of the body: 5 deg per g, a tall vehicle on soft springs."""
_SENSOR_HZ = 100.0
_ACCELEROMETER_MPS2, _PITCH_RAD = 0.05, np.radians(0.1)
_MOUNTED_RAD, _HUMP_RAD = np.radians(0.5), np.radians(0.15)


def swinging(pushed: FloatArray, natural_hz: float, damping: float) -> FloatArray:
    """Return what follows a push as a mass on a spring does, shape (n,) at `RATE_HZ`."""
    w = 2 * np.pi * natural_hz / RATE_HZ
    rho, beat = np.exp(-damping * w), w * np.sqrt(1 - damping**2)
    a = [1.0, -2 * rho * np.cos(beat), rho**2]
    return np.asarray(lfilter([sum(a)], a, pushed))


def body_pitch(m: Moments) -> FloatArray:
    """Return the pitch of the body on its springs, rad, nose up."""
    return swinging(PITCH_GRADIENT * m.acceleration, 1.4, 0.3)


def _turned(reading: Reading, angle: FloatArray) -> Reading:
    pull = reading.pull * np.cos(angle) + reading.load * np.sin(angle)
    return replace(reading, pull=pull, load=reading.load * np.cos(angle) - reading.pull * np.sin(angle))


TILTS = (
    Hidden(
        "axle_windup",
        "axle_windup",
        "angle_rad_per_knm",
        0.002,
        (-0.01, 0.01),
        "frame turned by c T, on an axle of 6 Hz",
        reads(lambda r, m, c: _turned(r, swinging(1e-3 * c * r.torque, 6.0, 0.3))),
        both=True,
    ),
    Hidden(
        "body_pitch",
        "body_pitch",
        "share",
        0.6,
        (0.0, 2.0),
        "frame turned by a share of the pitch of a body of 1.4 Hz",
        reads(lambda r, m, q: _turned(r, q * body_pitch(m))),
    ),
)


def with_motion(
    day: FieldDay, runs: Sequence[dict[str, Channel]], hidden: Sequence[tuple[str, float]]
) -> list[dict[str, Channel]]:
    """Return the channels with an accelerometer at the hub and a pitch sensor on the body.

    The pitch has the mounting of its sensor in it, and a track that rises and falls.
    """
    per_knm = dict(hidden).get("axle_windup", 0.0)
    return [run | _sensed(day, index, run["driving_torque"], per_knm) for index, run in enumerate(runs)]


def _sensed(day: FieldDay, index: int, torque: Channel, per_knm: float) -> dict[str, Channel]:
    rng = np.random.default_rng((*day.seed, index, 5))
    m, plan = day.moments[index], day.plans[index]
    at = np.arange(rng.uniform(0, 1 / _SENSOR_HZ), len(m.speed) / RATE_HZ - 0.1, 1 / _SENSOR_HZ)
    own = np.arange(len(m.speed)) / RATE_HZ
    slope = plan.direction * _HUMP_RAD * np.sin(2.2 * m.line + 0.4)
    pitch = np.interp(at, own, body_pitch(m) + slope) + _MOUNTED_RAD + _PITCH_RAD * rng.standard_normal(len(at))
    read_s = (torque.time_ns - START_NS) * 1e-9 - plan.start_s - day.suite.force_latency_s
    wound = swinging(1e-3 * per_knm * np.interp(own, read_s, torque.values), 6.0, 0.3)
    felt = np.interp(at, own, m.acceleration + GRAVITY_MPS2 * np.sin(slope + wound))
    felt += 0.05 + _ACCELEROMETER_MPS2 * rng.standard_normal(len(at))
    time_ns = START_NS + np.round((plan.start_s + at) * 1e9).astype(np.int64)
    return {
        "wheel_acceleration_x": Channel("wheel_acceleration_x", "m/s^2", time_ns, felt),
        "pitch": Channel("pitch", "rad", time_ns, pitch),
    }
