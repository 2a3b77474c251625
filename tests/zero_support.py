"""Lifted wheels for the tests of `wheelsoil zero`: bridges, an encoder and gravity, by other formulas than ours.

Forces of the x-z plane are complex numbers, F = F_x + i F_z, which a wheel that has rolled psi turns by exp(i psi).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq import FloatArray
from daq.can import FrameBatch, Message, encode, load_database, merge, shipped_dbc
from daq.recording import RecordingWriter

START_NS = 1_780_000_000_000_000_000
GRAVITY = 9.80665
RATE_HZ = 1000.0
SIGNALS = {
    "WFT_Forces.Fx": "N",
    "WFT_Forces.Fy": "N",
    "WFT_Forces.Fz": "N",
    "WFT_Moments.Mx": "Nm",
    "WFT_Moments.My": "Nm",
    "WFT_Moments.Mz": "Nm",
}


@dataclass(frozen=True)
class Bench:
    """A lifted wheel and its transducer. Bridges' zeros in wheel axes, N and Nm."""

    frame: str = "vehicle"
    side: str = "left"
    angle_offset_deg: float = 0.0
    angle_direction: int = 1
    angle_error_deg: float = 0.0  # of what vehicle.toml says of the offset
    mass_kg: float = 75.0
    inertia_kgm2: float = 8.0
    lever_m: float = 0.04  # of the weight, along the axle
    unbalance_kgm: float = 0.05
    bridges_n: complex = 60.0 - 110.0j
    bridges_nm: complex = 12.0 + 7.0j
    box_n: complex = 0j  # what a box in vehicle axes adds, standing still
    lateral_n: float = -45.0
    torque_nm: float = 9.0
    tared: bool = False
    speed_radps: float = 6.5
    speed_up_s: float = 3.0
    duration_s: float = 15.0
    noise: float = 25.0
    correlation_s: float = 0.08
    spikes: float = 0.001
    temperature_degc: float = 31.0
    rest_angle_rad: float = 0.7
    ground_n: float = 0.0
    start_ns: int = START_NS
    status: tuple[float, float] = field(default=(0.0, 0.0))  # from, to: overrange


def vehicle_toml(bench: Bench, *, zero: str = "spin", zero_file: str = "", brakes: str = "unknown") -> str:
    """Return the vehicle.toml of a bench."""
    lines = [
        "[vehicle]",
        "mass_kg = 3600.0",
        f'standstill_brakes = "{brakes}"',
        "[wheel]",
        "radius_m = 0.47",
        "width_m = 0.318",
        f"outboard_mass_kg = {bench.mass_kg}",
        f"outboard_inertia_kgm2 = {bench.inertia_kgm2}",
        "[[bus]]",
        'channel = "can0"',
        'dbc = ["wft.dbc"]',
        "[signals]",
        'vertical_load = "WFT_Forces.Fz"',
        'drawbar_pull = "WFT_Forces.Fx"',
        'driving_torque = "WFT_Moments.My"',
        'wheel_angle = "WFT_Wheel.Angle"',
        'transducer_status = "WFT_Forces.Status"',
        "[transducer]",
        f'frame = "{bench.frame}"',
        f'side = "{bench.side}"',
        f"angle_offset_deg = {bench.angle_offset_deg + bench.angle_direction * bench.angle_error_deg}",
        f"angle_direction = {bench.angle_direction}",
        f'zero = "{zero}"',
    ]
    return "\n".join([*lines, f'zero_file = "{zero_file}"' if zero_file else "", ""])


def lifted_frames(bench: Bench, seed: int) -> FrameBatch:
    """Return the frames of a lifted wheel that is spun up and then kept turning; it rests where the speed is 0."""
    rng = np.random.default_rng(seed)
    count = round(bench.duration_s * RATE_HZ)
    at = np.arange(count) / RATE_HZ
    waves = rng.uniform(0, 2 * np.pi, 2)
    steady = 1 + 0.005 * (np.sin(0.7 * at + waves[0]) + np.sin(1.5 * at + waves[1]))
    speed = bench.speed_radps * np.clip(at / bench.speed_up_s, 0, 1) * steady
    psi = bench.rest_angle_rad + np.cumsum(speed) / RATE_HZ
    turn = np.exp(1j * psi)
    torque = bench.torque_nm + bench.inertia_kgm2 * np.gradient(speed, at)
    torque -= bench.unbalance_kgm * GRAVITY * np.cos(psi)
    force = 1j * (bench.ground_n - bench.mass_kg * GRAVITY) * np.ones(count)
    moment = np.full(count, 1.0 + 0.0j) * bench.mass_kg * GRAVITY * bench.lever_m
    if bench.tared:
        force, moment = force * 0, moment * 0
    n, k = bench.noise, bench.correlation_s
    in_wheel = (force + n * (slow(count, k, rng) + 1j * slow(count, k, rng))) * turn + bench.bridges_n
    in_wheel = in_wheel + bench.unbalance_kgm * speed**2
    moments = (moment + n / 4 * (slow(count, k, rng) + 1j * slow(count, k, rng))) * turn + bench.bridges_nm
    lateral = bench.lateral_n + n * slow(count, k, rng)
    torque = torque + n / 4 * slow(count, k, rng)
    if bench.frame == "vehicle":
        in_wheel, moments = in_wheel / turn + bench.box_n, moments / turn
    mirror = -1.0 if bench.side == "right" and bench.frame == "wheel" else 1.0
    values = {
        "Fx": mirror * in_wheel.real,
        "Fy": mirror * lateral,
        "Fz": in_wheel.imag,
        "Mx": mirror * moments.real,
        "My": mirror * torque,
        "Mz": moments.imag,
    }
    spiky = {}
    for name, clean in values.items():
        hit = rng.random(count) < bench.spikes
        spiky[name] = np.where(hit, rng.choice([-9000.0, 14_000.0], count), clean)
    runout = 0.03 * np.cos(psi + 0.4)
    angle = np.degrees(bench.angle_direction * psi) + bench.angle_offset_deg + runout
    spiky["Angle"] = np.mod(np.rint(angle / 0.01), 36_000) * 0.01
    spiky["SpinRate"] = speed * 60 / (2 * np.pi)
    spiky["Temperature"] = np.full(count, bench.temperature_degc)
    spiky["Counter"] = np.arange(count) % 16
    spiky["Status"] = np.where((at >= bench.status[0]) & (at < bench.status[1]), 2, 0)
    stamps = bench.start_ns + np.round((at + rng.uniform(0, 3e-5, count)) * 1e9).astype(np.int64)
    return merge([_encoded(m, spiky, stamps + 110_000 * place) for place, m in enumerate(_messages())])


def rested(bench: Bench) -> Bench:
    """Return a bench whose wheel does not turn."""
    return replace(bench, speed_radps=0.0)


def truth(bench: Bench) -> dict[str, tuple[float, float, float]]:
    """Return offset, cos and sin of each signal of a wheel that turns at its speed, worked out by hand."""
    stands = bench.bridges_n + bench.unbalance_kgm * bench.speed_radps**2
    weight = 0.0 if bench.tared else bench.mass_kg * GRAVITY
    tilt = weight * bench.lever_m
    ox, oz, mx, mz = stands.real, stands.imag, bench.bridges_nm.real, bench.bridges_nm.imag
    unbalance = -bench.unbalance_kgm * GRAVITY
    if bench.frame == "vehicle":
        rows = {
            "WFT_Forces.Fx": (bench.box_n.real, ox, oz),
            "WFT_Forces.Fz": (bench.box_n.imag - weight, oz, -ox),
            "WFT_Moments.Mx": (tilt, mx, mz),
            "WFT_Moments.Mz": (0.0, mz, -mx),
        }
    else:
        rows = {
            "WFT_Forces.Fx": (ox, 0.0, weight),
            "WFT_Forces.Fz": (oz, -weight, 0.0),
            "WFT_Moments.Mx": (mx, tilt, 0.0),
            "WFT_Moments.Mz": (mz, 0.0, tilt),
        }
    rows |= {"WFT_Forces.Fy": (bench.lateral_n, 0.0, 0.0), "WFT_Moments.My": (bench.torque_nm, unbalance, 0.0)}
    if bench.side == "right" and bench.frame == "wheel":
        for name in ("WFT_Forces.Fx", "WFT_Forces.Fy", "WFT_Moments.Mx", "WFT_Moments.My"):
            a, b, c = rows[name]
            rows[name] = (-a, -b, -c)
    return rows


def write_lifted(path: Path, bench: Bench, seed: int, **options: str) -> Path:
    """Write the recording of a bench, with the files that describe it."""
    carried = {"vehicle.toml": vehicle_toml(bench, **options).encode(), "wft.dbc": shipped_dbc("wft.dbc").read_bytes()}
    with RecordingWriter(path, attachments=carried, flush_every_s=None, sync_every_s=None) as writer:
        writer.write_frames(lifted_frames(bench, seed))
    return path


def slow(count: int, correlation_s: float, rng: np.random.Generator) -> FloatArray:
    """Return noise of unit variance whose autocorrelation falls by e in `correlation_s`, with a little white noise."""
    from scipy.signal import lfilter

    keep = np.exp(-1 / (RATE_HZ * correlation_s))
    drive = np.sqrt(1 - keep**2) * rng.standard_normal(count)
    drive[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -keep], drive) + 0.2 * rng.standard_normal(count))


@lru_cache(maxsize=1)
def _messages() -> tuple[Message, ...]:
    return tuple(load_database(shipped_dbc("wft.dbc")).messages)


def _encoded(message: Message, values: dict[str, FloatArray], stamps: NDArray[np.int64]) -> FrameBatch:
    return encode(message, {name: values[name] for name in message.by_name}, stamps, "can0").frames
