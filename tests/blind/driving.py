"""How the runs are driven: standstill, three or four accelerate-coast-brake cycles, standstill; three loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from blind.wheel import YANG, Moments, Vehicle
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from daq import FloatArray

RATE_HZ = 200.0
DURATION_S = 40.0
BETWEEN_RUNS_S = 400.0
GRAVITY_MPS2 = 9.80665
ADDED_SHARE = 0.4
RIM_SPEED_MPS = 5.5
TRANSFER_M = 0.9 / (2 * 2.7)
INFLATION_KPA = 340.0
_PLANS = (
    ((0, 1, 2, 0, 1, 2), (1, 1, 2, 2, 3, 3)),
    ((1, 0, 2, 2, 0, 1), (1, 2, 1, 2, 1, 2)),
    ((2, 1, 0, 1, 0, 2), (1, 2, 3, 1, 2, 3)),
    ((0, 2, 1, 2, 1, 0), (1, 1, 2, 1, 1, 2)),
)
"""Load of each run, and which pass in its rut it is; directions take turns."""


@dataclass(frozen=True)
class Plan:
    """One run before it is driven."""

    index: int
    load_n: float
    direction: int
    passes: int
    start_s: float
    added_load_kg: float
    duration_s: float = DURATION_S


def plans(
    rng: np.random.Generator, runs: int = 6, vehicle: Vehicle = YANG, duration_s: float = DURATION_S
) -> list[Plan]:
    """Return a campaign's runs; after six loads and passes begin anew."""
    loads, passes = _PLANS[rng.integers(len(_PLANS))]
    gaps = BETWEEN_RUNS_S * rng.uniform(0.7, 1.4, runs)
    starts = np.concatenate([[0.0], np.cumsum(gaps[:-1] + duration_s)])
    chosen = [vehicle.loads_n[loads[i % 6]] for i in range(runs)]
    added = [(load - vehicle.loads_n[0]) / ADDED_SHARE / GRAVITY_MPS2 for load in chosen]
    return [
        Plan(i, chosen[i], 1 - 2 * (i % 2), passes[i % 6], float(starts[i]), added[i], duration_s) for i in range(runs)
    ]


def _curve(at: FloatArray, knots: list[tuple[float, float]], blur_s: float) -> FloatArray:
    """Monotone between knots, then blurred so that accelerations are continuous."""
    time, value = np.array(knots).T
    return gaussian_filter1d(PchipInterpolator(time, value, extrapolate=True)(at), blur_s * RATE_HZ, mode="nearest")


@dataclass(frozen=True)
class Motion:
    """Kinematics of one run, shape (n,) at `RATE_HZ`."""

    time_s: FloatArray
    speed: FloatArray
    omega: FloatArray
    acceleration: FloatArray
    alpha: FloatArray
    distance_m: FloatArray


def motion(
    rng: np.random.Generator,
    coast: float,
    vehicle: Vehicle = YANG,
    duration_s: float = DURATION_S,
    slips: tuple[float, float] = (-0.45, 0.92),
) -> Motion:
    """Draw one run; `coast` is the slip at which the wheel is towed, `slips` are the least and the largest."""
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    share = min(duration_s / DURATION_S, 1.0)
    rest = 0.4 + 0.6 * share
    begin, end = 3.0 * rest + share * rng.uniform(0, 1), duration_s - 3.5 * rest - share * rng.uniform(0, 1)
    cycles = max(int(rng.integers(3, 5) * duration_s / DURATION_S), 1)
    peaks = rng.uniform(0.35, 0.75, cycles)
    peaks[rng.integers(cycles)] = rng.uniform(0.84, 0.9)
    weight = 0.7 + peaks
    edges = begin + 2.0 + (end - 2.5 - begin - 2.0) * np.concatenate([[0], np.cumsum(weight)]) / weight.sum()
    speed: list[tuple[float, float]] = [(0, 0), (begin, 0)]
    slip: list[tuple[float, float]] = [(0, 0.06), (begin, 0.06)]
    for first, last, peak in zip(edges[:-1], edges[1:], peaks, strict=True):
        at = first + (last - first) * np.array([0.0, 0.34, 0.58, 0.67, 0.8, 0.9])
        slow = float(np.clip(RIM_SPEED_MPS * (1 - peak), 0.62, 1.7)) * rng.uniform(0.85, 1.1)
        fast = rng.uniform(1.5, 2.6)
        speed += [(at[0], 0.5 * (slow + 1.0)), (at[1], slow), (at[2], fast), (at[3], fast), (at[5], 0.5 * fast + 0.3)]
        brake = -rng.uniform(0.18, 0.34)
        slip += [(at[0], 0.08), (at[1], peak), (at[2], coast), (at[3], coast), (at[4], brake), (at[5], coast)]
    speed += [(edges[-1], 0.75), (end, 0.0), (duration_s, 0.0)]
    slip += [(edges[-1], coast), (end - 0.5, coast - 0.03), (duration_s, 0.0)]
    v = vehicle.pace * np.maximum(_curve(time, speed, 0.3), 0.0)
    v[v < 5e-3] = 0.0
    s = np.clip(_curve(time, slip, 0.3) + _wander(rng, len(time)) * (v > 0), *slips)
    omega = v / np.where(s < 0, 1 / (1 + s), 1 - s) / vehicle.radius_m
    distance = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 / RATE_HZ)])
    return Motion(time, v, omega, np.gradient(v, 1 / RATE_HZ), np.gradient(omega, 1 / RATE_HZ), distance)


def _wander(rng: np.random.Generator, count: int) -> FloatArray:
    """Return the driver's unsteady foot: slip wanders by a percent or so."""
    white = gaussian_filter1d(rng.standard_normal(count), 0.35 * RATE_HZ)
    return 0.008 * white / white.std()


def load_history(plan: Plan, m: Motion, rng: np.random.Generator, vehicle: Vehicle = YANG) -> FloatArray:
    """Return the wheel's load, N: transfer under acceleration, and the road through a body of 1.5 Hz."""
    mass = vehicle.mass_kg + plan.added_load_kg
    w, zeta = 2 * np.pi * 1.5 / RATE_HZ, 0.35
    a = np.exp(-zeta * w)
    road = lfilter([1.0], [1.0, -2 * a * np.cos(w * np.sqrt(1 - zeta**2)), a**2], rng.standard_normal(len(m.speed)))
    road *= 0.035 * plan.load_n / road.std() * np.sqrt(np.minimum(m.speed / vehicle.pace, 3.0) / 1.5)
    return np.asarray(plan.load_n + mass * TRANSFER_M * m.acceleration + road, np.float64)


def moments_of(
    plan: Plan, m: Motion, load: FloatArray, line: tuple[float, float], span_s: float, vehicle: Vehicle = YANG
) -> Moments:
    """Put a run's kinematics and circumstances together.

    `line` holds the ends of the campaign's line in metres along the track, `span_s` the campaign's whole time.
    """
    along = line[0] + m.distance_m if plan.direction > 0 else line[1] - m.distance_m
    ones = np.ones(len(m.time_s))

    def later(dt: float) -> FloatArray:
        return np.interp(m.time_s + dt, m.time_s, m.speed)

    return Moments(
        time_s=plan.start_s + m.time_s,
        speed=m.speed,
        omega=m.omega,
        acceleration=m.acceleration,
        alpha=m.alpha,
        load=load,
        distance_m=m.distance_m,
        line=2 * (along - line[0]) / (line[1] - line[0]) - 1,
        clock=(plan.start_s + m.time_s) / span_s - 0.5,
        direction=plan.direction * ones,
        passes=plan.passes * ones,
        inflation=INFLATION_KPA * ones,
        later=later,
        vehicle=vehicle,
    )
