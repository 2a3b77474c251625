"""The wheel force transducer: forces at the hub, noise, rotating zero offset, axes, sampling clock."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from math import inf
from typing import Literal

import numpy as np

from daq import FloatArray, IntArray
from model.simulation.motion import GRAVITY_MPS2

_SKIPPED = 1 << 16
_UNITS = {
    "drawbar_pull": "N",
    "lateral_force": "N",
    "vertical_load": "N",
    "overturning_moment": "Nm",
    "driving_torque": "Nm",
    "steering_moment": "Nm",
    "wheel_angle": "rad",
    "spin_rate": "rad/s",
    "temperature": "K",
}


@dataclass(frozen=True)
class HostClock:
    """The logger's clock against UTC, and what happens between a sensor's message and its time stamp.

    Attributes
    ----------
    offset_s : host minus UTC at the start of the campaign; positive: the host is ahead
    drift_ppm : how much faster than UTC the host runs
    jitter_s : mean of the exponential delay between the end of a measurement's latency and its message
    """

    offset_s: float = 0.25
    drift_ppm: float = 8.0
    jitter_s: float = 60e-6

    def stamps_ns(
        self,
        time_s: FloatArray,
        start_ns: int,
        elapsed_s: float,
        rng: np.random.Generator,
    ) -> IntArray:
        """Return host time stamps of messages; whole microseconds, never decreasing.

        Parameters
        ----------
        time_s : float64 array, shape (n,)
            True time at which each message is ready, since the start of the run.
        start_ns : UTC of the start of the run
        elapsed_s : from the start of the campaign to the start of the run
        """
        late = time_s + rng.exponential(self.jitter_s, len(time_s)) if self.jitter_s else time_s
        error = self.offset_s + self.drift_ppm * 1e-6 * (elapsed_s + late)
        microseconds = np.round((late + error) * 1e6).astype(np.int64)
        return np.maximum.accumulate(start_ns + microseconds * 1000)


class SampleTimes:
    """Instants at which a free-running sensor samples within a run: random phase, own clock error.

    `clock_ppm` is how much faster than true time the sensor's clock runs; `rng` draws the phase.
    """

    def __init__(self, duration_s: float, rate_hz: float, clock_ppm: float, rng: np.random.Generator) -> None:
        self._period_s = 1.0 / (rate_hz * (1.0 + clock_ppm * 1e-6))
        self._phase_s = rng.uniform(0.0, self._period_s)
        self.count = int((duration_s - 1.0 / rate_hz - self._phase_s) / self._period_s) + 1
        self.taken = 0

    def next_s(self, until_s: float = inf) -> FloatArray:
        """Return the instants not taken yet that come before `until_s`."""
        most = min(self.count, int(min((until_s - self._phase_s) / self._period_s, self.count)) + 2)
        at = self._phase_s + self._period_s * np.arange(self.taken, most)
        at = at[at < until_s]
        self.taken += len(at)
        return np.asarray(at, np.float64)


class ColouredNoise:
    """A stationary Ornstein-Uhlenbeck process: autocorrelation sigma^2 exp(-|lag|/correlation time).

    The standard deviation `sigma` is in the unit of the result. `rng` gives one normal number for each sample, whatever
    `sigma` is.
    """

    def __init__(self, rate_hz: float, sigma: float, correlation_time_s: float, rng: np.random.Generator) -> None:
        self._memory = float(np.exp(-1.0 / (rate_hz * correlation_time_s)))
        self._sigma = sigma
        self._rng = rng
        self._state = np.zeros(1)
        self._begun = False

    def next(self, count: int) -> FloatArray:
        """Return the next samples, shape (count,)."""
        from scipy.signal import lfilter

        white = self._rng.standard_normal(count)
        white[0 if self._begun else 1 :] *= np.sqrt(1.0 - self._memory**2)
        self._begun |= count > 0
        coloured, self._state = lfilter([1.0], [1.0, -self._memory], white, zi=self._state)
        return np.asarray(self._sigma * coloured, np.float64)


def after_normals(rng: np.random.Generator, count: int) -> np.random.Generator:
    """Return a generator in the state that `rng` has after `count` more normal numbers."""
    later = deepcopy(rng)
    for start in range(0, count, _SKIPPED):
        later.standard_normal(min(_SKIPPED, count - start))
    return later


@dataclass(frozen=True)
class TransducerSetup:
    """What the transducer adds to the truth.

    Attributes
    ----------
    drawbar_pull_noise_n, load_noise_n, lateral_noise_n, torque_noise_nm : float
        Standard deviation of the coloured noise (soil and sensor).
    white_noise_n, white_noise_nm : standard deviation of white noise per sample, forces and moments
    zero_offset_n : (x', z')
        Bridge offsets that turn with the wheel: a ripple once per revolution.
    frame : "vehicle" or "wheel"
        "wheel": forces and moments come in axes that turn with the wheel.
    side : "left" or "right"
        Wheel axes only: on the right x' and y' are turned round, since y' points outward on both sides.
    angle_offset_deg, angle_direction : float, 1 or -1
        Wheel angle sent = direction * rolled angle + offset.
    zero : "lifted" or "spin"
        "lifted": the outboard weight was tared away; "spin": it is missing from the vertical force.
    latency_s : whole delay from a force to its message
    """

    drawbar_pull_noise_n: float = 46.0
    load_noise_n: float = 60.0
    lateral_noise_n: float = 60.0
    torque_noise_nm: float = 14.0
    noise_correlation_s: float = 0.1
    white_noise_n: float = 5.0
    white_noise_nm: float = 1.0
    zero_offset_n: tuple[float, float] = (25.0, -15.0)
    frame: Literal["vehicle", "wheel"] = "vehicle"
    side: Literal["left", "right"] = "left"
    angle_offset_deg: float = 0.0
    angle_direction: Literal[1, -1] = 1
    zero: Literal["lifted", "spin"] = "lifted"
    rate_hz: float = 1000.0
    clock_ppm: float = 15.0
    latency_s: float = 0.004


@dataclass(frozen=True)
class HubLoads:
    """What acts on the hub through the wheel, in vehicle axes; shape (n,) each.

    Forces on the wheel: x forward, y left, z up; `torque_nm` positive when it drives the wheel.
    """

    time_s: FloatArray
    longitudinal_n: FloatArray
    vertical_n: FloatArray
    torque_nm: FloatArray
    wheel_angle_rad: FloatArray
    wheel_speed_radps: FloatArray


@dataclass(frozen=True)
class Readings:
    """A sensor's samples: the true instant of each, and values by name (SI, radians)."""

    time_s: FloatArray
    latency_s: float
    values: dict[str, FloatArray]
    units: dict[str, str] = field(default_factory=dict)


class Transducer:
    """The transducer on one run; it is read stretch by stretch.

    The wheel's radius is the arm of the lateral force. The weight of the outboard mass is missing from the vertical
    force unless the zero was taken with the wheel lifted. Every noise has its own stream of `rng`: switching one off
    leaves the others as they are.
    """

    def __init__(
        self,
        setup: TransducerSetup,
        duration_s: float,
        wheel_radius_m: float,
        outboard_mass_kg: float,
        rng: np.random.Generator,
    ) -> None:
        self._setup = setup
        self._wheel_radius_m = wheel_radius_m
        self._weight_n = outboard_mass_kg * GRAVITY_MPS2 if setup.zero == "spin" else 0.0
        streams = rng.spawn(6)
        self._times = SampleTimes(duration_s, setup.rate_hz, setup.clock_ppm, streams[0])
        self._first_angle_rad = streams[0].uniform(0, 2 * np.pi)
        self._noise = {
            name: _Noise(setup, sigma, white, self._times.count, stream)
            for name, sigma, white, stream in (
                ("fx", setup.drawbar_pull_noise_n, setup.white_noise_n, streams[1]),
                ("fz", setup.load_noise_n, setup.white_noise_n, streams[2]),
                ("fy", setup.lateral_noise_n, setup.white_noise_n, streams[3]),
                ("my", setup.torque_noise_nm, setup.white_noise_nm, streams[4]),
            )
        }
        self._mz_rng = after_normals(streams[5], self._times.count)
        self._mx_rng = streams[5]

    def read(self, hub: HubLoads, until_s: float = inf) -> Readings:
        """Return the samples not read yet that come before `until_s`.

        The loads are evenly sampled, at a rate that their content needs, and cover those samples.
        """
        setup = self._setup
        start = self._times.taken
        at = self._times.next_s(until_s)
        count = len(at)
        noise = {name: source.next(count) for name, source in self._noise.items()}
        angle = np.interp(at, hub.time_s, hub.wheel_angle_rad) + self._first_angle_rad
        fx = np.interp(at, hub.time_s, hub.longitudinal_n) + noise["fx"]
        fz = np.interp(at, hub.time_s, hub.vertical_n) - self._weight_n + noise["fz"]
        fy = noise["fy"]
        my = np.interp(at, hub.time_s, hub.torque_nm) + noise["my"]
        mx = fy * self._wheel_radius_m + setup.white_noise_nm * self._mx_rng.standard_normal(count)
        mz = setup.white_noise_nm * self._mz_rng.standard_normal(count)
        fx, fz = to_wheel_axes(fx, fz, angle)
        fx, fz = fx + setup.zero_offset_n[0], fz + setup.zero_offset_n[1]
        if setup.frame == "vehicle":
            fx, fz = to_vehicle_axes(fx, fz, angle)
        else:
            mx, mz = to_wheel_axes(mx, mz, angle)
            if setup.side == "right":
                fx, fy, mx, my = -fx, -fy, -mx, -my
        values = {
            "drawbar_pull": fx,
            "lateral_force": fy,
            "vertical_load": fz,
            "overturning_moment": mx,
            "driving_torque": my,
            "steering_moment": mz,
            "wheel_angle": np.mod(setup.angle_direction * angle + np.radians(setup.angle_offset_deg), 2 * np.pi),
            "spin_rate": np.interp(at, hub.time_s, hub.wheel_speed_radps),
            "counter": np.mod(np.arange(start, start + count), 16).astype(np.float64),
            "status": np.zeros(count),
            "temperature": 304.0 + 4.0 * (1 - np.exp(-at / 300.0)),
        }
        return Readings(at, setup.latency_s, values, _UNITS)


class _Noise:
    """Coloured and white noise of one channel: one stream gives first all numbers of the one, then of the other."""

    def __init__(
        self, setup: TransducerSetup, sigma: float, white: float, count: int, rng: np.random.Generator
    ) -> None:
        self._white = white
        self._white_rng = after_normals(rng, count)
        self._slow = ColouredNoise(setup.rate_hz, sigma, setup.noise_correlation_s, rng)

    def next(self, count: int) -> FloatArray:
        return self._slow.next(count) + self._white * self._white_rng.standard_normal(count)


def to_vehicle_axes(x: FloatArray, z: FloatArray, angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn components in wheel axes into vehicle axes; the angle is the one rolled forward."""
    return x * np.cos(angle_rad) + z * np.sin(angle_rad), -x * np.sin(angle_rad) + z * np.cos(angle_rad)


def to_wheel_axes(x: FloatArray, z: FloatArray, angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn components in vehicle axes into wheel axes; inverse of `to_vehicle_axes`."""
    return to_vehicle_axes(x, z, -angle_rad)
