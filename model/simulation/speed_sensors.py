"""Wheel-speed sensor (toothed ring, edges timed), GNSS receiver, and sensors of the vehicle's motion in a curve."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from daq import EARTH_RADIUS_M, FloatArray
from model.simulation.motion import Drive, Motion
from model.simulation.transducer import ColouredNoise, Readings, SampleTimes

_SECONDS_PER_DAY = 86_400.0
_GNSS_UNITS = {
    "ground_speed": "m/s",
    "speed_quality": "m/s",
    "latitude": "rad",
    "longitude": "rad",
    "altitude": "m",
    "course": "rad",
    "gnss_time": "s",
}
MOTION_SIGMAS = (0.003, 0.05, 0.002)
"""White noise per sample of the sensors of a stability control: yaw rate, lateral acceleration, steering angle; SI."""
MOTION_LATENCY_S = 0.005
_MOTION_UNITS = {"yaw_rate": "rad/s", "lateral_acceleration": "m/s^2", "steering_angle": "rad"}
_MOTION_RATE_HZ, _MOTION_CLOCK_PPM = 100.0, 30.0


@dataclass(frozen=True)
class WheelSpeedSetup:
    """A toothed ring whose edges are timed.

    Attributes
    ----------
    teeth : edges per revolution
    pitch_error, eccentricity : relative: random error of each tooth, and the ring's error once per revolution
    timer_s : resolution of an edge's time
    timeout_s : without an edge for this long the wheel stands
    transport_s : from the calculation to the message
    typical_radps : wheel speed at which `latency_s` holds: a slower wheel waits longer for its edges
    """

    teeth: int = 120
    pitch_error: float = 0.002
    eccentricity: float = 0.001
    timer_s: float = 1e-6
    timeout_s: float = 0.25
    rate_hz: float = 100.0
    clock_ppm: float = -20.0
    transport_s: float = 0.002
    typical_radps: float = 3.0

    @property
    def latency_s(self) -> float:
        """Whole delay at the typical speed: transport, and about the time between two edges."""
        return self.transport_s + 2 * np.pi / (self.teeth * self.typical_radps)


class WheelSpeedSensor:
    """The wheel speed as an electronic unit calculates it from edges, read stretch by stretch.

    Each message holds the mean speed over the edges since the one before; without a new edge, the last value, or what
    the missing edge allows at most. `ring` draws the ring's errors: the same for every run of a vehicle.
    """

    def __init__(
        self, setup: WheelSpeedSetup, duration_s: float, ring: np.random.Generator, rng: np.random.Generator
    ) -> None:
        self._setup = setup
        self._times = SampleTimes(duration_s, setup.rate_hz, setup.clock_ppm, rng)
        self._pitch = 2 * np.pi / setup.teeth
        tooth = np.arange(setup.teeth)
        self._error = setup.pitch_error * ring.standard_normal(setup.teeth)
        self._error += setup.teeth / (2 * np.pi) * setup.eccentricity * np.sin(2 * np.pi * tooth / setup.teeth)
        self._first = int(rng.integers(setup.teeth))
        self._seen_s = -inf
        self._rolled: tuple[FloatArray, FloatArray] = np.zeros(0), np.zeros(0)
        self._edges_s = np.zeros(0)
        self._edges_before = 0
        self._last = -1

    def read(self, motion: Motion, until_s: float = inf) -> Readings:
        """Return the messages not read yet that come before `until_s`; the motion covers them.

        The motion may begin before and end behind what is read; a stretch before the last must not end at standstill.
        """
        self._add_edges(motion, ends=until_s == inf)
        at = self._times.next_s(until_s)
        return Readings(at, self._setup.transport_s, {"wheel_speed": self._speed(at)}, {"wheel_speed": "rad/s"})

    def _add_edges(self, motion: Motion, *, ends: bool) -> None:
        """Time the edges that have passed; where the run ends, the last of them at the latest then."""
        new = motion.time_s > self._seen_s
        time_s, angle = motion.time_s[new], motion.wheel_angle_rad[new]
        known_s, known = self._rolled
        moving = np.diff(angle, prepend=known[-1] if len(known) else -inf) > 0  # else the inverse is not unique
        known_s, known = np.concatenate([known_s, time_s[moving]]), np.concatenate([known, angle[moving]])
        number = np.arange(self._edges_before + len(self._edges_s) + 1, int(known[-1] / self._pitch) + 2)
        edge = self._pitch * (number + self._error[(number + self._first) % self._setup.teeth])
        passed = number <= int(known[-1] / self._pitch) if ends else edge <= known[-1]
        edges_s = np.interp(edge[passed], known, known_s)
        self._edges_s = np.concatenate([self._edges_s, np.round(edges_s / self._setup.timer_s) * self._setup.timer_s])
        self._rolled = known_s[-1:], known[-1:]
        self._seen_s = float(motion.time_s[-1])

    def _speed(self, at: FloatArray) -> FloatArray:
        """Return pitch * edges / time between them, as known at the instants `at`; forget edges that are done with."""
        if not len(self._edges_s) or not len(at):
            return np.zeros(len(at))
        edges = self._edges_s
        last = np.searchsorted(edges, at, side="right") - 1
        before = np.minimum(np.concatenate([[self._last], last[:-1]]), last - 1)
        known = before >= 0
        newest, oldest = np.maximum(last, 0), np.maximum(before, 0)
        span = np.where(known, edges[newest] - edges[oldest], np.inf)
        silence = np.maximum(at - edges[newest], 1e-9)
        speed = np.minimum(self._pitch * (newest - oldest) / span, self._pitch / silence)
        done = max(int(last[-1]) - 1, 0)
        self._edges_s, self._edges_before = edges[done:], self._edges_before + done
        self._last = int(last[-1]) - done
        return np.where(known & (silence < self._setup.timeout_s), speed, 0.0)


@dataclass(frozen=True)
class GnssSetup:
    """A GNSS receiver at the wheel's track.

    Attributes
    ----------
    rate_hz : solutions per second, on whole multiples of GNSS time
    speed_noise_mps, speed_noise_correlation_s : coloured part of the speed's noise
    speed_white_noise_mps : white part per solution
    filter_window_s : the receiver's speed is the mean over this window; it delays by half of it
    transport_s : from a solution's epoch to its message
    """

    rate_hz: float = 20.0
    speed_noise_mps: float = 0.03
    speed_noise_correlation_s: float = 1.0
    speed_white_noise_mps: float = 0.015
    filter_window_s: float = 0.1
    transport_s: float = 0.02
    position_noise_m: float = 0.3
    position_noise_correlation_s: float = 30.0
    satellites: int = 11

    @property
    def latency_s(self) -> float:
        """Whole delay of the ground speed: filter and transport."""
        return self.transport_s + self.filter_window_s / 2


@dataclass(frozen=True)
class Track:
    """The straight line that every run of a campaign follows.

    Attributes
    ----------
    latitude_deg, longitude_deg : where "out" starts
    bearing_deg : of "out", clockwise from north
    length_m : "back" starts at this distance
    """

    latitude_deg: float = 32.5
    longitude_deg: float = 117.6
    bearing_deg: float = 62.0
    length_m: float = 60.0

    def position_m(self, distance_m: FloatArray, direction: str) -> FloatArray:
        """Return the distance from the start of "out" of a vehicle that has driven `distance_m`."""
        return distance_m if direction == "out" else self.length_m - distance_m


class GnssReceiver:
    """The receiver on one run, read stretch by stretch.

    The direction is "out" or "back". `seconds_of_day` is the UTC time of day of the start of the run; GNSS time is that
    of a solution's epoch. `last_s` is the instant of the last sample of the motion.
    """

    def __init__(
        self,
        setup: GnssSetup,
        track: Track,
        direction: str,
        seconds_of_day: float,
        last_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._setup, self._track, self._direction = setup, track, direction
        self._seconds_of_day = seconds_of_day
        self._first_s = np.ceil(seconds_of_day * setup.rate_hz) / setup.rate_hz - seconds_of_day
        self._count = int((last_s - self._first_s) * setup.rate_hz) + 1
        self._taken = 0
        speed, self._white, position, self._sideways = rng.spawn(4)
        self._speed_noise = ColouredNoise(setup.rate_hz, setup.speed_noise_mps, setup.speed_noise_correlation_s, speed)
        self._east, self._north = (
            ColouredNoise(setup.rate_hz, setup.position_noise_m, setup.position_noise_correlation_s, stream)
            for stream in position.spawn(2)
        )

    def read(self, motion: Motion, until_s: float = inf, speed_path_m: FloatArray | None = None) -> Readings:
        """Return the solutions not read yet that come before `until_s`.

        The motion covers these solutions, and the receiver's filter before them. `speed_path_m`, of its shape, is the
        integral of the speed that the receiver sees, where that is not the true one; the position stays true.
        """
        setup, track = self._setup, self._track
        at = self._next_s(until_s)
        count = len(at)
        window = setup.filter_window_s
        driven = np.interp(at, motion.time_s, motion.distance_m)
        path = motion.distance_m if speed_path_m is None else speed_path_m
        mean_speed = np.interp(at, motion.time_s, path) - np.interp(at - window, motion.time_s, path)
        speed = (
            mean_speed / window
            + self._speed_noise.next(count)
            + setup.speed_white_noise_mps * self._white.standard_normal(count)
        )
        east, north = self._east.next(count), self._north.next(count)
        bearing = np.radians(track.bearing_deg)
        along = track.position_m(driven, self._direction)
        north, east = north + along * np.cos(bearing), east + along * np.sin(bearing)
        latitude = track.latitude_deg + np.degrees(north / EARTH_RADIUS_M)
        longitude = track.longitude_deg + np.degrees(east / EARTH_RADIUS_M) / np.cos(np.radians(track.latitude_deg))
        heading = track.bearing_deg + (0.0 if self._direction == "out" else 180.0)
        sideways = setup.speed_noise_mps * self._sideways.standard_normal(count)
        return Readings(
            time_s=at,
            latency_s=setup.transport_s,
            values={
                "ground_speed": np.abs(speed),
                "ground_speed_valid": np.ones(count),
                "speed_quality": np.full(count, np.hypot(setup.speed_noise_mps, setup.speed_white_noise_mps)),
                "latitude": np.radians(latitude),
                "longitude": np.radians(longitude),
                "altitude": np.full(count, 27.0),
                "course": np.radians(np.mod(heading + np.degrees(np.arctan2(sideways, np.abs(speed))), 360.0)),
                "gnss_time": np.mod(self._seconds_of_day + at, _SECONDS_PER_DAY),
                "satellites": np.full(count, float(setup.satellites)),
            },
            units=_GNSS_UNITS,
        )

    def _next_s(self, until_s: float) -> FloatArray:
        most = min(self._count, int(min((until_s - self._first_s) * self._setup.rate_hz, self._count)) + 2)
        at = self._first_s + np.arange(self._taken, most) / self._setup.rate_hz
        at = at[at < until_s]
        self._taken += len(at)
        return np.asarray(at, np.float64)


class MotionSensors:
    """Yaw rate, lateral acceleration and steering angle on one run, in one message, read stretch by stretch."""

    def __init__(self, sigmas: tuple[float, ...], drive: Drive, rng: np.random.Generator) -> None:
        phase, *self._streams = rng.spawn(1 + len(sigmas))
        self._times = SampleTimes(drive.duration_s, _MOTION_RATE_HZ, _MOTION_CLOCK_PPM, phase)
        self._sigmas, self._drive = sigmas, drive

    def read(self, until_s: float = inf) -> Readings:
        """Return the samples not read yet that come before `until_s`."""
        at = self._times.next_s(until_s)
        values = {
            name: true + sigma * stream.standard_normal(len(at))
            for name, sigma, true, stream in zip(
                _MOTION_UNITS, self._sigmas, self._drive.turning(at), self._streams, strict=True
            )
        }
        return Readings(at, MOTION_LATENCY_S, values, _MOTION_UNITS)
