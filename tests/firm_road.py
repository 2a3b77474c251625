"""Runs on a road by formulas of its own: a tyre of Pacejka's brush model, air drag, rolling resistance that grows.

The engine knows none of them: it takes a wheel that rolls freely for one without slip.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from kept_runs import kept

from daq import RunInfo
from daq.can import Decoder, load_database, resolve_roles, shipped_dbc
from model.simulation import SensedRun
from model.simulation.motion import Motion
from model.simulation.run import Sensors
from model.simulation.transducer import HubLoads
from model.simulation.truth import Circumstances
from processing import ProcessedRun
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions
from wheelsoil.simulation.campaign import BUS, simulated_setup
from wheelsoil.simulation.vehicle import vehicle_config, virtual_frames

RATE_HZ = 1000.0
STIFFNESS, FRICTION = 14.0, 0.8
"""Longitudinal stiffness of the tyre over its load, and its largest pull over the load."""
DRAG_NM = 3.0
"""Bearings and brake pads."""


def brush_slip(pull_over_load: np.ndarray) -> np.ndarray:
    """Return the slip of a brush tyre with a parabola of pressure: F = mu W (1 - (1 - C s / 3 mu W)^3), inverted."""
    share = np.clip(np.abs(pull_over_load) / FRICTION, 0.0, 0.95)
    return np.sign(pull_over_load) * 3.0 * FRICTION / STIFFNESS * (1.0 - np.cbrt(1.0 - share))


def road_motion(seconds: float, radius_m: float, load_n: float, seed: int) -> tuple[Motion, HubLoads]:
    """Return a drive of so many seconds: sped up in three seconds, coasted down in twelve, braked a little in two.

    The wheel rolls freely on `radius_m`.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    speed, acceleration, pull = 2.0, np.zeros(len(time_s)), np.zeros(len(time_s))
    speeds = np.zeros(len(time_s))
    phase = (time_s + rng.uniform(0.0, 3.0)) % 17.0
    for i, at in enumerate(phase):
        wanted = 0.12 if at < 3.0 else -0.05 if at > 15.0 else -DRAG_NM / radius_m / load_n
        smooth = min(at % 3.0, 0.3) / 0.3
        pull[i] = wanted * smooth
        rolling = 0.012 + 2e-5 * speed**2
        acceleration[i] = 9.81 * (pull[i] - rolling) if speed > 0.8 or pull[i] > 0.0 else 0.0
        speed += acceleration[i] / RATE_HZ
        speeds[i] = speed
    slip = brush_slip(pull)
    omega = speeds / radius_m / np.where(slip > 0.0, 1.0 - slip, 1.0 / (1.0 + np.minimum(slip, 0.0)))
    alpha = np.gradient(omega) * RATE_HZ
    angle, distance = (np.cumsum(x) / RATE_HZ for x in (omega, speeds))
    torque = load_n * pull * radius_m * 0.97
    hub = HubLoads(time_s, load_n * (pull - 0.012), np.full(len(time_s), load_n), torque, angle, omega)
    return Motion(time_s, speeds, acceleration, omega, alpha, angle, distance, slip), hub


def road_run(options: SimulationOptions, larger: float = 0.0, seed: int = 0, seconds: float = 70.0) -> SensedRun:
    """Return what the sensors of a simulated vehicle say on a road, on a wheel that is larger than declared."""
    setup, info = simulated_setup(options), RunInfo(id="road", ground="firm")
    motion, hub = road_motion(seconds, options.wheel.radius_m * (1.0 + larger), 8000.0, seed)
    here = Circumstances(info, setup.vehicle.inflation_kpa, 0.0, 600.0, (0.0, 1.0))
    start_ns = round(options.start.timestamp() - 3600.0) * 10**9
    streams = np.random.default_rng(seed + 7000).spawn(5)
    sensors = Sensors(setup, here, start_ns, len(motion.time_s), options.wheel.radius_m, streams[:4], streams[4])
    return SensedRun(info, start_ns, sensors.read(hub, motion, motion))


@lru_cache(maxsize=24)
def road(larger: float = 0.0, seed: int = 0, seconds: float = 70.0) -> ProcessedRun:
    """Return the processed run on the road, through frames."""
    return kept(f"road: {larger}, {seed}, {seconds}", lambda: _processed(larger, seed, seconds))


def _processed(larger: float, seed: int, seconds: float) -> ProcessedRun:
    options = SimulationOptions(seed=seed)
    vehicle = vehicle_config(simulated_setup(options), options.wheel, BUS)
    databases = {BUS: tuple(load_database(shipped_dbc(name)) for name in vehicle.bus[0].dbc)}
    roles = [role for role in vehicle.signals if role not in ("latitude", "longitude")]
    references = resolve_roles(vehicle, databases, (), roles)
    run = road_run(options, larger, seed, seconds)
    decoded = Decoder(databases, {reference.name for reference in references.values()}).decode(virtual_frames(run, BUS))
    channels = {role: ref.to_si(decoded[ref.key]) for role, ref in references.items()}
    return process(channels, vehicle, run.info)
