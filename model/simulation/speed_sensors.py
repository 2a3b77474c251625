"""Wheel-speed sensor (toothed ring, edges timed) and GNSS receiver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import FloatArray
from model.simulation.motion import Motion
from model.simulation.transducer import Readings, coloured_noise, sample_times_s

_EARTH_RADIUS_M = 6_371_008.8
_SECONDS_PER_DAY = 86_400.0


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


def measure_wheel_speed(
    setup: WheelSpeedSetup, motion: Motion, ring: np.random.Generator, rng: np.random.Generator
) -> Readings:
    """Return the wheel speed as an electronic unit calculates it from edges.

    Each message holds the mean speed over the edges since the one before; without a new edge, the last value,
    or what the missing edge allows at most.

    Parameters
    ----------
    ring : numpy.random.Generator
        Draws the ring's errors: the same for every run of a vehicle.
    """
    duration = float(motion.time_s[-1] + motion.time_s[1])
    at = sample_times_s(duration, setup.rate_hz, setup.clock_ppm, rng)
    pitch = 2 * np.pi / setup.teeth
    tooth = np.arange(setup.teeth)
    error = setup.pitch_error * ring.standard_normal(setup.teeth)
    error += setup.teeth / (2 * np.pi) * setup.eccentricity * np.sin(2 * np.pi * tooth / setup.teeth)
    first = int(rng.integers(setup.teeth))
    count = int(motion.wheel_angle_rad[-1] / pitch)
    number = np.arange(1, count + 1)
    edge_angle = pitch * (number + error[(number + first) % setup.teeth])
    moving = np.concatenate([[True], np.diff(motion.wheel_angle_rad) > 0])  # else the inverse is not unique
    edges = np.interp(edge_angle, motion.wheel_angle_rad[moving], motion.time_s[moving])
    edges = np.round(edges / setup.timer_s) * setup.timer_s
    speed = _edge_speed(at, edges, pitch, setup)
    return Readings(at, setup.transport_s, {"wheel_speed": speed}, {"wheel_speed": "rad/s"})


def _edge_speed(at: FloatArray, edges: FloatArray, pitch: float, setup: WheelSpeedSetup) -> FloatArray:
    """Return pitch * edges / time between them, as known at the instants `at`."""
    if len(edges) < 2:
        return np.zeros(len(at))
    last = np.searchsorted(edges, at, side="right") - 1
    before = np.minimum(np.concatenate([[-1], last[:-1]]), last - 1)
    known = before >= 0
    newest, oldest = np.maximum(last, 0), np.maximum(before, 0)
    span = np.where(known, edges[newest] - edges[oldest], np.inf)
    silence = np.maximum(at - edges[newest], 1e-9)
    speed = np.minimum(pitch * (newest - oldest) / span, pitch / silence)
    return np.where(known & (silence < setup.timeout_s), speed, 0.0)


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


def measure_gnss(
    setup: GnssSetup,
    motion: Motion,
    track: Track,
    direction: str,
    seconds_of_day: float,
    rng: np.random.Generator,
    speed_path_m: FloatArray | None = None,
) -> Readings:
    """Return the receiver's solutions.

    Parameters
    ----------
    direction : "out" or "back"
    seconds_of_day : float
        UTC time of day of the start of the run; GNSS time is that of a solution's epoch.
    speed_path_m : float64 array, shape of the motion, optional
        Integral of the speed that the receiver sees, where that is not the true one; the position stays true.
    """
    streams = rng.spawn(4)
    first = np.ceil(seconds_of_day * setup.rate_hz) / setup.rate_hz - seconds_of_day
    duration = float(motion.time_s[-1])
    at = first + np.arange(int((duration - first) * setup.rate_hz) + 1) / setup.rate_hz
    count = len(at)
    window = setup.filter_window_s
    driven = np.interp(at, motion.time_s, motion.distance_m)
    path = motion.distance_m if speed_path_m is None else speed_path_m
    mean_speed = np.interp(at, motion.time_s, path) - np.interp(at - window, motion.time_s, path)
    speed = (
        mean_speed / window
        + coloured_noise(count, setup.rate_hz, setup.speed_noise_mps, setup.speed_noise_correlation_s, streams[0])
        + setup.speed_white_noise_mps * streams[1].standard_normal(count)
    )
    east, north = (
        coloured_noise(count, setup.rate_hz, setup.position_noise_m, setup.position_noise_correlation_s, stream)
        for stream in streams[2].spawn(2)
    )
    bearing = np.radians(track.bearing_deg)
    along = track.position_m(driven, direction)
    north, east = north + along * np.cos(bearing), east + along * np.sin(bearing)
    latitude = track.latitude_deg + np.degrees(north / _EARTH_RADIUS_M)
    longitude = track.longitude_deg + np.degrees(east / _EARTH_RADIUS_M) / np.cos(np.radians(track.latitude_deg))
    heading = track.bearing_deg + (0.0 if direction == "out" else 180.0)
    sideways = setup.speed_noise_mps * streams[3].standard_normal(count)
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
            "gnss_time": np.mod(seconds_of_day + at, _SECONDS_PER_DAY),
            "satellites": np.full(count, float(setup.satellites)),
        },
        units={
            "ground_speed": "m/s",
            "speed_quality": "m/s",
            "latitude": "rad",
            "longitude": "rad",
            "altitude": "m",
            "course": "rad",
            "gnss_time": "s",
        },
    )
