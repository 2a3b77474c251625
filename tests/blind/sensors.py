"""The instruments: noise, ripple of the wheel's order, stones, filters and delays; channels out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blind.colour import Colour, coloured
from blind.driving import RATE_HZ, Motion, Plan
from blind.wheel import YANG, Reading, Vehicle
from scipy.signal import lfilter

from daq import Channel, FloatArray

START_NS = 1_751_350_000_000_000_000
_METRES_PER_DEGREE = 111_195.0
_LATITUDE_DEG, _LONGITUDE_DEG, _BEARING_RAD = 47.21, 8.83, 0.9


QUICK, SLOW = Colour(((0.99, 0.1), (0.01, 0.0))), Colour(((1.0, 1.0),))
"""One memory and white, as the engine assumes."""


@dataclass(frozen=True)
class Suite:
    """What is mounted, and how noisy it is. Sigmas are of the coloured part, of one sample.

    Attributes
    ----------
    pull_n, torque_nm, load_n, force
        Coloured noise and its spectrum; `at_rest` of it is left when the wheel stands (the sensor's share).
    ripple_n, ripple_nm, lugs
        Once a revolution (an offset that turns with the wheel), and of each lug.
    rest_pull_n, rest_torque_nm
        What stays locked in the driveline at each standstill.
    zero_pull_n, zero_torque_nm, zero_load_n
        By how much the bridges' zeros differ from run to run.
    stones : float
        Mean number in a run: bursts of 30 to 100 ms, 3 to 6 sigma in pull and torque.
    speed_mps, speed, speed_white_mps
        GNSS speed: coloured noise and its spectrum, and white noise.
    receiver : "boxcar" or "first order"
        Filter of the receiver with `receiver_s` as its width or time constant; both are declared as a latency.
    tails : float
        Degrees of freedom of the coloured noises; 0: normal.
    """

    force_hz: float = 1000.0
    force_latency_s: float = 0.004
    wheel_hz: float = 100.0
    wheel_window_s: float = 0.02
    wheel_transport_s: float = 0.003
    gnss_hz: float = 20.0
    gnss_transport_s: float = 0.03
    receiver: str = "boxcar"
    receiver_s: float = 0.1
    pull_n: float = 46.0
    torque_nm: float = 14.0
    load_n: float = 60.0
    force: Colour = QUICK
    at_rest: float = 0.35
    ripple_n: tuple[float, float] = (22.0, -14.0)
    ripple_nm: float = 4.0
    lugs: int = 24
    lug_n: float = 25.0
    rest_pull_n: float = 5.0
    rest_torque_nm: float = 1.5
    zero_pull_n: float = 6.0
    zero_torque_nm: float = 1.5
    zero_load_n: float = 12.0
    stones: float = 1.0
    speed_mps: float = 0.035
    speed: Colour = SLOW
    speed_white_mps: float = 0.02
    wheel_pitch_error: float = 0.0015
    tails: float = 0.0

    @property
    def gnss_latency_s(self) -> float:
        """Whole delay of the ground speed."""
        return self.gnss_transport_s + (
            0.5 * self.receiver_s if self.receiver == "boxcar" else self.receiver_s - 0.5 / RATE_HZ
        )

    @property
    def wheel_latency_s(self) -> float:
        """Whole delay of the wheel speed."""
        return self.wheel_transport_s + 0.5 * self.wheel_window_s

    def louder(self, factor: float) -> Suite:
        """Return the suite with every noise of forces scaled."""
        return replace(
            self, pull_n=self.pull_n * factor, torque_nm=self.torque_nm * factor, load_n=self.load_n * factor
        )

    def on(self, vehicle: Vehicle) -> Suite:
        """Return the suite of a vehicle whose forces and torques are smaller or larger than Yang's."""
        force = vehicle.loads_n[0] / YANG.loads_n[0]
        torque = force * vehicle.radius_m / YANG.radius_m
        x, z = self.ripple_n
        forces = ("pull_n", "load_n", "lug_n", "rest_pull_n", "zero_pull_n", "zero_load_n")
        torques = ("torque_nm", "ripple_nm", "rest_torque_nm", "zero_torque_nm")
        scaled = {name: force * getattr(self, name) for name in forces}
        scaled |= {name: torque * getattr(self, name) for name in torques}
        return replace(self, ripple_n=(force * x, force * z), **scaled)


def drawn_noise(
    colour: Colour, count: int, rate_hz: float, sigma: float, rng: np.random.Generator, tails: float = 0.0
) -> FloatArray:
    """Draw a channel's noise; with `tails`, Student's at every moment."""
    noise = sigma * colour.drawn(count, rate_hz, rng)
    return noise * _loudness(count, rate_hz, tails, rng) if tails else noise


def _loudness(count: int, rate_hz: float, tails: float, rng: np.random.Generator) -> FloatArray:
    """Return how loud the noise is from second to second: what makes a normal number one of Student's."""
    seconds = np.sqrt((tails - 2.0) / rng.chisquare(tails, round(count / rate_hz) + 2))
    return np.interp(np.arange(count) / rate_hz, np.arange(len(seconds)), seconds)


def _stones(
    suite: Suite, at: FloatArray, moving: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    pull, torque = np.zeros(len(at)), np.zeros(len(at))
    for _ in range(rng.poisson(suite.stones)):
        middle, width = rng.uniform(at[0], at[-1]), rng.uniform(0.03, 0.1)
        shape = np.abs(at - middle) < width / 2
        pull[shape] += rng.choice([-1, 1]) * rng.uniform(3, 6) * suite.pull_n
        torque[shape] += rng.choice([-1, 1]) * rng.uniform(3, 6) * suite.torque_nm
    return pull * moving, torque * moving


def _instants(plan: Plan, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    return np.arange(rng.uniform(0, 1 / rate_hz), plan.duration_s - 1 / RATE_HZ, 1 / rate_hz)


def _stamps(plan: Plan, at: FloatArray, latency_s: float, rng: np.random.Generator):
    late = at + latency_s + rng.exponential(60e-6, len(at))
    stamps = START_NS + np.round((plan.start_s + late) * 1e9).astype(np.int64)
    return np.maximum.accumulate(stamps)


def measured(
    suite: Suite, plan: Plan, m: Motion, reading: Reading, along_m: FloatArray, rng: np.random.Generator
) -> dict[str, Channel]:
    """Return one run's channels by role, SI and radians (positions in degrees)."""
    forces, wheel, fixes = rng.spawn(3)
    return {
        **_forces(suite, plan, m, reading, forces),
        **_wheel_speed(suite, plan, m, reading, wheel),
        **_fixes(suite, plan, m, reading, along_m, fixes),
    }


def _forces(suite: Suite, plan: Plan, m: Motion, reading: Reading, rng: np.random.Generator) -> dict[str, Channel]:
    at = _instants(plan, suite.force_hz, rng)
    count = len(at)
    moving = np.tanh((np.interp(at, m.time_s, m.speed) / 0.1) ** 2)
    angle = np.interp(at, m.time_s, np.cumsum(m.omega) / RATE_HZ) + rng.uniform(0, 2 * np.pi)
    share = np.sqrt(1 - suite.at_rest**2)

    def noise(sigma: float) -> FloatArray:
        sensor = drawn_noise(suite.force, count, suite.force_hz, suite.at_rest * sigma, rng, suite.tails)
        soil = drawn_noise(suite.force, count, suite.force_hz, share * sigma, rng, suite.tails)
        return sensor + moving * soil

    second = at > plan.duration_s / 2
    locked = rng.standard_normal((2, 2))
    x, z = suite.ripple_n
    sin, cos = np.sin(angle), np.cos(angle)
    lug = suite.lug_n * np.sin(suite.lugs * angle) * moving
    stone_n, stone_nm = _stones(suite, at, moving, rng)
    pull = np.interp(at, m.time_s, reading.pull) + noise(suite.pull_n) + x * cos + z * sin + lug + stone_n
    pull += suite.rest_pull_n * np.where(second, *locked[0]) * (1 - moving)
    load = np.interp(at, m.time_s, reading.load) + noise(suite.load_n) - x * sin + z * cos
    torque = np.interp(at, m.time_s, reading.torque) + noise(suite.torque_nm) + stone_nm
    torque += suite.ripple_nm * np.sin(angle + 1.0) * moving + 0.3 * lug
    torque += suite.rest_torque_nm * np.where(second, *locked[1]) * (1 - moving)
    time_ns = _stamps(plan, at, suite.force_latency_s, rng)
    zeros = rng.standard_normal(3) * (suite.zero_pull_n, suite.zero_torque_nm, suite.zero_load_n)
    return {
        "drawbar_pull": Channel("drawbar_pull", "N", time_ns, pull + zeros[0]),
        "vertical_load": Channel("vertical_load", "N", time_ns, load + zeros[2]),
        "driving_torque": Channel("driving_torque", "Nm", time_ns, torque + zeros[1]),
        "wheel_angle": Channel("wheel_angle", "rad", time_ns, np.mod(angle, 2 * np.pi)),
    }


def _wheel_speed(suite: Suite, plan: Plan, m: Motion, reading: Reading, rng: np.random.Generator) -> dict[str, Channel]:
    at = _instants(plan, suite.wheel_hz, rng)
    angle = np.concatenate([[0.0], np.cumsum((reading.omega[1:] + reading.omega[:-1]) / 2 / RATE_HZ)])
    phase = rng.uniform(0, 2 * np.pi)
    uneven = angle + suite.wheel_pitch_error * np.sin(angle + phase)
    window = suite.wheel_window_s
    mean = (np.interp(at, m.time_s, uneven) - np.interp(at - window, m.time_s, uneven)) / window
    time_ns = _stamps(plan, at, suite.wheel_transport_s, rng)
    return {"wheel_speed": Channel("wheel_speed", "rad/s", time_ns, np.round(mean / 0.002) * 0.002)}


def _fixes(
    suite: Suite, plan: Plan, m: Motion, reading: Reading, along_m: FloatArray, rng: np.random.Generator
) -> dict[str, Channel]:
    at = _instants(plan, suite.gnss_hz, rng)
    count, width = len(at), suite.receiver_s
    if suite.receiver == "boxcar":
        driven = np.concatenate([[0.0], np.cumsum((reading.speed[1:] + reading.speed[:-1]) / 2 / RATE_HZ)])
        speed = (np.interp(at, m.time_s, driven) - np.interp(at - width, m.time_s, driven)) / width
    else:
        keep = np.exp(-1 / (RATE_HZ * width))
        speed = np.interp(at, m.time_s, lfilter([1 - keep], [1.0, -keep], reading.speed))
    speed = speed + drawn_noise(suite.speed, count, suite.gnss_hz, suite.speed_mps, rng, suite.tails)
    speed += suite.speed_white_mps * rng.standard_normal(count)
    along = np.interp(at, m.time_s, along_m) + 0.3 * coloured(count, suite.gnss_hz, 30.0, rng)
    across = 0.3 * coloured(count, suite.gnss_hz, 30.0, rng)
    north = along * np.cos(_BEARING_RAD) - across * np.sin(_BEARING_RAD)
    east = along * np.sin(_BEARING_RAD) + across * np.cos(_BEARING_RAD)
    time_ns = _stamps(plan, at, suite.gnss_transport_s, rng)
    degree = _METRES_PER_DEGREE
    return {
        "ground_speed": Channel("ground_speed", "m/s", time_ns, np.round(np.abs(speed) / 0.005) * 0.005),
        "latitude": Channel("latitude", "deg", time_ns, _LATITUDE_DEG + north / degree),
        "longitude": Channel(
            "longitude", "deg", time_ns, _LONGITUDE_DEG + east / degree / np.cos(np.radians(_LATITUDE_DEG))
        ),
    }
