"""A tilt of the transducer's frame, and the sensor on the body without which the engine does not consider it.

A body is a mass on springs: its angle follows the acceleration late, and swings. Forces are turned by the whole angle.
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

from daq import Channel, FloatArray

if TYPE_CHECKING:
    from blind.field import FieldDay

PITCH_GRADIENT = np.radians(5.0) / GRAVITY_MPS2
"""Of the body: 5 deg per g, a tall vehicle on soft springs."""
_SENSOR_HZ = 100.0
_PITCH_RAD = np.radians(0.1)
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
        "body_pitch",
        "body_pitch",
        "share",
        0.6,
        (0.0, 2.0),
        "frame turned by a share of the pitch of a body of 1.4 Hz",
        reads(lambda r, m, q: _turned(r, q * body_pitch(m))),
    ),
)


def with_pitch(day: FieldDay, runs: Sequence[dict[str, Channel]]) -> list[dict[str, Channel]]:
    """Return the channels with a pitch sensor on the body; its mounting is in it, and a track that rises and falls."""
    return [run | {"pitch": _pitch_read(day, index)} for index, run in enumerate(runs)]


def _pitch_read(day: FieldDay, index: int) -> Channel:
    rng = np.random.default_rng((*day.seed, index, 5))
    m, plan = day.moments[index], day.plans[index]
    at = np.arange(rng.uniform(0, 1 / _SENSOR_HZ), len(m.speed) / RATE_HZ - 0.1, 1 / _SENSOR_HZ)
    slope = plan.direction * _HUMP_RAD * np.sin(2.2 * m.line + 0.4)
    pitch = np.interp(at, np.arange(len(m.speed)) / RATE_HZ, body_pitch(m) + slope)
    pitch += _MOUNTED_RAD + _PITCH_RAD * rng.standard_normal(len(at))
    time_ns = START_NS + np.round((plan.start_s + at) * 1e9).astype(np.int64)
    return Channel("pitch", "rad", time_ns, pitch)
