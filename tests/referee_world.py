"""Runs for the referee: any ground, speed and way of driving; sound ones, and ones with one mistake of vehicle.toml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.ndimage import gaussian_filter1d

from daq import STANDARD_GRAVITY_MPS2, Channel, FloatArray, VehicleConfig, VehicleSection
from daq.config import WheelSection
from model.effects import EFFECTS
from model.simulation import drawn_soil
from model.wheel_soil import SOILS, Conditions, Soil, Wheel, WheelSoilModel
from processing import ProcessedRun
from processing.pipeline import process

RATE_HZ = 100.0
FORCE_RATE_HZ = 200.0
EARTH_M = 6_371_008.8
START_NS = 1_700_000_000_000_000_000
FIRM = 30.0
"""A soil's stiffness times this is a firm track."""


@dataclass(frozen=True)
class World:
    """Channels of a run and what vehicle.toml says."""

    channels: dict[str, Channel]
    vehicle: VehicleConfig

    def processed(self) -> ProcessedRun:
        """Return the processed run."""
        return process(self.channels, self.vehicle)


Way = Callable[[np.random.Generator, FloatArray], tuple[FloatArray, FloatArray]]
"""Speed as a share of the usual one, and slip, over time from 0 to 1."""


def _smooth(rng: np.random.Generator, count: int, low: float, high: float, pieces: int = 9) -> FloatArray:
    """Return a smooth random course between two values."""
    knots = rng.uniform(low, high, pieces)
    course = np.interp(np.linspace(0, pieces - 1, count), np.arange(pieces), knots)
    return gaussian_filter1d(course, count / pieces / 5, mode="nearest")


def cycles(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Accelerate, coast and brake, three times, between two standstills."""
    phase = np.clip((at - 0.1) / 0.8, 0, 1) * 3 % 1
    slip = np.select(
        [phase < 0.45, phase < 0.65, phase < 0.85], [rng.uniform(0.3, 0.8), -0.02, -rng.uniform(0.1, 0.4)], 0
    )
    speed = np.where((at > 0.1) & (at < 0.9), 0.5 + 0.5 * np.sin(pi * phase), 0.0)
    width = len(at) / 60
    return gaussian_filter1d(speed, width), gaussian_filter1d(slip, width)


def loaded(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pull and brake without standstill or coasting."""
    slip = _smooth(rng, len(at), -0.35, 0.75, 14)
    return _smooth(rng, len(at), 0.4, 1.0), np.where(np.abs(slip) < 0.06, 0.06 * np.sign(slip), slip)


def pulling(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Driven all the time, without standstill, coasting or braking."""
    return _smooth(rng, len(at), 0.4, 1.0), _smooth(rng, len(at), 0.04, 0.7, 14)


def ploughing(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pull at 8 % slip."""
    return _smooth(rng, len(at), 0.9, 1.0), 0.08 + _smooth(rng, len(at), -0.02, 0.02)


def bogged(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Drive, slip more and more, and spin on the spot."""
    stuck = rng.uniform(0.3, 0.7)
    slip = np.clip(0.1 + 0.9 * at / stuck, 0, 1)
    return np.where(at < stuck, 1 - at / stuck, 0.0), slip


def towed(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """No torque: the slip is that at which there is none."""
    return _smooth(rng, len(at), 0.5, 1.0), np.full(len(at), np.nan)


def standing_start(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stand for a third, then speed up."""
    speed = np.clip((at - 0.35) / 0.6, 0, 1)
    return speed, np.where(at > 0.35, rng.uniform(0.1, 0.5) * np.exp(-(at - 0.35) * 4), 0.0)


def road(rng: np.random.Generator, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Little slip, fast and slow."""
    return _smooth(rng, len(at), 0.2, 1.0), _smooth(rng, len(at), -0.03, 0.04)


WAYS: tuple[Way, ...] = (cycles, loaded, pulling, ploughing, bogged, towed, standing_start, road)


def drawn_ground(rng: np.random.Generator) -> Soil:
    """Return a soil about one of the library, or a firm track of it."""
    soil = drawn_soil(SOILS[str(rng.choice(list(SOILS)))], rng)
    return firm(soil) if rng.random() < 0.4 else soil


def firm(soil: Soil) -> Soil:
    """Return a soil that hardly gives way."""
    return replace(
        soil,
        cohesive_modulus=soil.cohesive_modulus * FIRM,
        frictional_modulus=soil.frictional_modulus * FIRM,
        shear_modulus_m=soil.shear_modulus_m / 2,
    )


def sound_world(
    rng: np.random.Generator,
    soil: Soil | None = None,
    way: Way | None = None,
    *,
    duration_s: float = 40.0,
    speed_mps: float | None = None,
    wheel: Wheel | None = None,
    declared: bool | None = None,
) -> World:
    """Return a sound run; what is not given is drawn, also whether mass and positions are known."""
    soil = soil or drawn_ground(rng)
    wheel = wheel or Wheel(float(rng.choice([0.1, 0.3, 0.47, 0.47, 0.8])), 0.0)
    wheel = wheel if wheel.width_m else Wheel(wheel.radius_m, wheel.radius_m * float(rng.uniform(0.5, 0.9)))
    way = way or WAYS[rng.integers(len(WAYS))]
    speed_mps = speed_mps or float(np.exp(rng.uniform(np.log(0.5), np.log(15.0))))
    load_n = 8000.0 * (wheel.radius_m / 0.47) ** 2.6 * float(rng.uniform(0.5, 1.5))
    names = [
        name for name in ("vasilev", "ding", "bulldozing", "slope", "grouser", "stress_peak_shift") if name in EFFECTS
    ]
    acting = [EFFECTS[str(rng.choice(names))]] if rng.random() < 0.5 else []
    values = {k: v for e in acting for k, v in e.keyed({p.name: p.start for p in e.parameters}).items()}
    curve = _Curve(WheelSoilModel(wheel, soil, acting), values, load_n)
    if not np.isfinite(curve.traction).all():  # the soil does not carry the wheel
        curve = _Curve(WheelSoilModel(wheel, firm(soil), acting), values, load_n)
    return _recorded(rng, curve, wheel, way, duration_s, speed_mps, load_n, declared)


class _Curve:
    """Traction and pull over slip of one wheel and soil, in loads."""

    def __init__(self, model: WheelSoilModel, values: dict[str, float], load_n: float) -> None:
        self.slip = np.concatenate(
            [np.linspace(-0.95, -0.1, 18), np.linspace(-0.08, 0.2, 29), np.linspace(0.25, 0.99, 20)]
        )
        n = len(self.slip)
        conditions = Conditions(
            slip=self.slip,
            vertical_load_n=np.full(n, load_n),
            ground_speed_mps=np.full(n, 2.0),
            ground_acceleration_mps2=np.zeros(n),
            wheel_acceleration_radps2=np.zeros(n),
            direction=np.ones(n),
            inflation_kpa=np.full(n, 340.0),
        )
        found = model.predict(conditions, values)
        self.traction = found.driving_torque_nm / model.wheel.radius_m / load_n
        self.pull = found.drawbar_pull_n / load_n
        self.free = float(np.interp(0.0, self.traction[:47], self.slip[:47]))

    def at(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.interp(slip, self.slip, self.traction), np.interp(slip, self.slip, self.pull)


def _recorded(
    rng: np.random.Generator,
    curve: _Curve,
    wheel: Wheel,
    way: Way,
    duration_s: float,
    speed_mps: float,
    load_n: float,
    declared: bool | None = None,
) -> World:
    time = np.arange(round(duration_s * FORCE_RATE_HZ)) / FORCE_RATE_HZ
    share, slip = way(rng, time / duration_s)
    slip = np.clip(np.where(np.isnan(slip), curve.free, slip), -0.9, 1.0)
    larger = speed_mps * share
    ground = np.where(slip >= 0, larger * (1 - slip), larger)
    rim = np.where(slip >= 0, larger, larger * (1 + slip))
    if way is bogged:
        rim = np.full(len(time), speed_mps)
        ground = rim * (1 - slip)
    load = load_n * (1 + 0.05 * _coloured(rng, len(time), 0.15))
    traction, pull = curve.at(slip)
    moving = np.clip(np.maximum(rim, ground) / (0.1 * speed_mps), 0, 1)
    noise = 0.01 * load_n
    torque = traction * moving * load * wheel.radius_m
    forces = {
        "vertical_load": load + noise * _coloured(rng, len(time), 0.1),
        "drawbar_pull": pull * moving * load + noise * _coloured(rng, len(time), 0.2),
        "driving_torque": torque + noise * wheel.radius_m * _coloured(rng, len(time), 0.2),
    }
    delay_s = float(rng.choice([0.0, 0.1, 0.2]))
    gnss_at = np.arange(0, duration_s, 0.05)
    wheel_at = np.arange(0, duration_s, 1 / RATE_HZ)
    speed = np.interp(gnss_at, time, ground) + 0.03 * _coloured(rng, len(gnss_at), 1.0, 20.0)
    if rng.random() < 0.15:  # held at 1 Hz
        speed = np.repeat(speed[::20], 20)[: len(speed)]
    channels = {role: _channel(role, time, values) for role, values in forces.items()}
    channels["ground_speed"] = _channel("ground_speed", gnss_at + delay_s, np.maximum(speed, 0.0))
    channels["wheel_speed"] = _channel("wheel_speed", wheel_at, np.interp(wheel_at, time, rim) / wheel.radius_m)
    if rng.random() < 0.5 if declared is None else declared:
        distance = np.cumsum(ground) / FORCE_RATE_HZ
        along = np.interp(gnss_at, time, distance) + 0.3 * _coloured(rng, len(gnss_at), 30.0, 20.0)
        channels["latitude"] = _channel("latitude", gnss_at, 52.0 + np.rad2deg(along / EARTH_M))
        channels["longitude"] = _channel("longitude", gnss_at, np.full(len(gnss_at), 10.0))
    mass = VehicleSection(mass_kg=4 * load_n / STANDARD_GRAVITY_MPS2 * float(rng.uniform(0.8, 1.3)))
    section = WheelSection(radius_m=wheel.radius_m, width_m=wheel.width_m)
    given = {"wheel": section} | ({"vehicle": mass} if (rng.random() < 0.5 if declared is None else declared) else {})
    return World(channels, VehicleConfig.model_validate(given))


def _coloured(rng: np.random.Generator, count: int, memory_s: float, rate_hz: float = FORCE_RATE_HZ) -> FloatArray:
    """Return noise of unit size with a memory."""
    from scipy.signal import lfilter

    keep = float(np.exp(-1 / (memory_s * rate_hz)))
    white = rng.standard_normal(count)
    return np.asarray(lfilter([np.sqrt(1 - keep**2)], [1, -keep], white))


def _channel(role: str, at: FloatArray, values: FloatArray) -> Channel:
    return Channel(role, "", START_NS + np.round(at * 1e9).astype(np.int64), np.asarray(values, np.float64))


FIVE = ("ground_speed", "wheel_speed", "vertical_load", "drawbar_pull", "driving_torque")


def mistaken(world: World, key: str) -> World:
    """Return a run with the mistake that a mend of the referee undoes."""
    from processing.referee import BY_KEY
    from processing.referee.mends import RADIUS

    mend = BY_KEY[key]
    channels = dict(world.channels)
    for role, factor in mend.factors.items():
        if role != RADIUS:
            channels[role] = replace(channels[role], values=channels[role].values / factor)
    if mend.exchanged:
        one, other = mend.exchanged
        channels[one], channels[other] = channels[other], channels[one]
    vehicle = world.vehicle
    if RADIUS in mend.factors:
        assert vehicle.wheel is not None
        wheel = vehicle.wheel.model_copy(update={"radius_m": vehicle.wheel.radius_m / mend.factors[RADIUS]})
        vehicle = vehicle.model_copy(update={"wheel": wheel})
    return World(channels, vehicle)
