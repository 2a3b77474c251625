"""One simulated run: driving, soil, vehicle and sensors; the soil is drawn from the laboratory's uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import atan, tan

import numpy as np

from daq import Channel, ConfigError, Fault, FloatArray, RunInfo, nearest
from model.effects.base import Effect, Signals
from model.simulation.motion import (
    GRAVITY_MPS2,
    DrivingStyle,
    Motion,
    VehicleSetup,
    drive,
    integrated,
    static_load_n,
    vertical_load_n,
)
from model.simulation.speed_sensors import GnssSetup, Track, WheelSpeedSetup, measure_gnss, measure_wheel_speed
from model.simulation.stance import Stance, standing_forces
from model.simulation.transducer import HostClock, HubLoads, Readings, TransducerSetup, measure_loads
from model.simulation.truth import Circumstances, Truth, campaign_line_m, soil_reaction, towed
from model.wheel_soil.soils import LABORATORY_SPREAD, Soil
from model.wheel_soil.wheel_soil_model import WheelSoilModel

Faults = Sequence[tuple[type[Effect], Mapping[str, float]]]
"""Measurement effects, each with its own parameters."""

TRUTH_RATE_HZ = 200.0
"""The soil's reaction is calculated at this rate; a fitter works at another one (100 Hz by default)."""

_MOTION_RATE_HZ = 1000.0
_UPSAMPLE = round(_MOTION_RATE_HZ / TRUTH_RATE_HZ)
_SECONDS_PER_DAY = 86_400
_NS = 1_000_000_000


def drawn_soil(soil: Soil, rng: np.random.Generator, spread: Mapping[str, float] | None = None) -> Soil:
    """Return a soil whose parameters are log-normal about the laboratory's.

    Parameters
    ----------
    soil : Soil
        The laboratory's values.
    spread : mapping, optional
        Relative one-sigma per parameter (``tan_phi`` for the friction angle); `LABORATORY_SPREAD` by default. A
        parameter that is left out stays as it is.

    Raises
    ------
    ConfigError
        `spread` names no parameter of a soil.
    """
    sigmas = LABORATORY_SPREAD if spread is None else spread
    unknown = [name for name in sigmas if name not in LABORATORY_SPREAD]
    if unknown:
        raise ConfigError(
            *(Fault(f"a soil has no parameter {n!r}", expected=nearest(n, LABORATORY_SPREAD)) for n in unknown)
        )
    z = dict(zip(LABORATORY_SPREAD, rng.standard_normal(len(LABORATORY_SPREAD)), strict=True))
    factor = {name: float(np.exp(sigmas.get(name, 0.0) * z[name])) for name in LABORATORY_SPREAD}
    friction = factor.pop("tan_phi")
    changed = {name: getattr(soil, name) * f for name, f in factor.items()}
    angle = atan(tan(soil.friction_angle_rad) * friction)
    return replace(soil, **changed, friction_angle_rad=angle, source=f"drawn about: {soil.source}")


@dataclass(frozen=True)
class VirtualSetup:
    """The instrumented vehicle, its driver and its sensors."""

    duration_s: float = 40.0
    vehicle: VehicleSetup = field(default_factory=VehicleSetup)
    style: DrivingStyle = field(default_factory=DrivingStyle)
    transducer: TransducerSetup = field(default_factory=TransducerSetup)
    wheel_speed: WheelSpeedSetup = field(default_factory=WheelSpeedSetup)
    gnss: GnssSetup = field(default_factory=GnssSetup)
    track: Track = field(default_factory=Track)
    stance: Stance = field(default_factory=Stance)
    clock: HostClock = field(default_factory=HostClock)


@dataclass(frozen=True)
class SensedRun:
    """What the sensors say of a recording.

    Attributes
    ----------
    start_ns : UTC of the start of the run
    sensors : mapping str -> mapping str -> Channel
        Per sensor ("transducer", "wheel_speed", "gnss") its channels by quantity, in SI units and radians. Channels
        of one sensor share their time stamps: the host clock's when the message is ready to be sent.
    """

    info: RunInfo
    start_ns: int
    sensors: dict[str, dict[str, Channel]]


@dataclass(frozen=True)
class VirtualRun(SensedRun):
    """What happened, and what the sensors say of it."""

    truth: Truth


def virtual_run(
    setup: VirtualSetup,
    model: WheelSoilModel,
    values: Mapping[str, float],
    info: RunInfo,
    *,
    start_ns: int,
    elapsed_s: float,
    rng: np.random.Generator,
    ring: np.random.Generator,
    campaign_s: float | None = None,
    faults: Faults = (),
) -> VirtualRun:
    """Drive one run.

    Parameters
    ----------
    model : WheelSoilModel
        The truth: soil, physical effects, reading, and a quadrature that is not the fitter's (`TRUTH_QUADRATURE`).
    values : parameters of the effects, as the model takes them; what is left out is neutral
    info : RunInfo
        Direction, added load, pass number and inflation.
    start_ns : UTC of the start of the run
    elapsed_s : from the start of the campaign to the start of the run (the host clock drifts)
    rng : numpy.random.Generator
        Everything random of this run. Every noise has its own stream: switching one off leaves the others as they are.
    ring : numpy.random.Generator
        Draws the errors of the toothed ring; pass one in the same state for every run of a vehicle.
    campaign_s : from the start to the end of the campaign; by default it ends with this run
    faults : sequence of (measurement effect, its parameters)
        What the sensors get wrong, in any order; they follow each other by their `stage`.

    Raises
    ------
    ConfigError
        The run is too short.
    DataError
        The soil cannot carry the wheel.
    """
    driving, road, loads, wheel, fixes, stamps, standing = rng.spawn(7)
    radius = model.wheel.radius_m
    circumstances = Circumstances(
        info,
        info.inflation_kpa or setup.vehicle.inflation_kpa,
        elapsed_s,
        elapsed_s + setup.duration_s if campaign_s is None else campaign_s,
        campaign_line_m(setup.track.length_m, setup.duration_s),
    )
    coast, resistance_n = towed(model, values, static_load_n(setup.vehicle, info.added_load_kg), circumstances)
    at_rest = standing_forces(
        setup.stance, setup.vehicle, circumstances.direction, info.added_load_kg, radius, resistance_n, standing
    )
    fine = drive(setup.duration_s, radius, driving, rate_hz=_MOTION_RATE_HZ, coast_slip=coast, style=setup.style)
    coarse = _every(fine, _UPSAMPLE)
    load = vertical_load_n(
        setup.vehicle,
        coarse.ground_speed_mps,
        coarse.ground_acceleration_mps2,
        TRUTH_RATE_HZ,
        info.added_load_kg,
        road,
    )
    position = setup.track.position_m(coarse.distance_m, info.direction)
    truth = soil_reaction(model, values, coarse, load, position, circumstances, at_rest)
    uphill = setup.stance.uphill(circumstances.direction)
    hub = _hub_loads(setup.vehicle, truth, fine, uphill)
    streams = [loads, wheel, fixes, stamps]
    said = sensed_run(setup, hub, fine, circumstances, start_ns, radius, streams, ring, faults)
    return VirtualRun(said.info, said.start_ns, said.sensors, truth)


def sensed_run(
    setup: VirtualSetup,
    hub: HubLoads,
    motion: Motion,
    circumstances: Circumstances,
    start_ns: int,
    wheel_radius_m: float,
    streams: Sequence[np.random.Generator],
    ring: np.random.Generator,
    faults: Faults = (),
) -> SensedRun:
    """Return what the sensors say of what happens at the hub.

    Parameters
    ----------
    hub, motion : at the rate of the motion
    streams : of the transducer, the wheel speed, the GNSS receiver and the time stamps
    start_ns, ring, faults : see `virtual_run`
    """
    hub, seen = _faulty(faults, hub, motion, circumstances)
    info, elapsed_s, (loads, wheel, fixes, stamps) = circumstances.info, circumstances.elapsed_s, streams
    day_s = (start_ns // _NS) % _SECONDS_PER_DAY + (start_ns % _NS) / _NS
    readings = {
        "transducer": measure_loads(setup.transducer, hub, wheel_radius_m, setup.vehicle.outboard_mass_kg, loads),
        "wheel_speed": measure_wheel_speed(setup.wheel_speed, seen, ring, wheel),
        "gnss": measure_gnss(setup.gnss, motion, setup.track, info.direction, day_s, fixes, seen.distance_m),
    }
    sensors = {
        name: _stamped(reading, setup.clock, start_ns, elapsed_s, stream)
        for (name, reading), stream in zip(readings.items(), stamps.spawn(len(readings)), strict=True)
    }
    return SensedRun(info, start_ns, sensors)


def _every(motion: Motion, step: int) -> Motion:
    return replace(motion, **{f.name: getattr(motion, f.name)[::step] for f in fields(motion)})


def _hub_loads(vehicle: VehicleSetup, truth: Truth, motion: Motion, uphill: float) -> HubLoads:
    """Return what the transducer feels: the soil's forces less what moves the outboard parts and holds them uphill."""
    return HubLoads(
        time_s=motion.time_s,
        longitudinal_n=_upsampled(truth.drawbar_pull_n, len(motion.time_s))
        - vehicle.outboard_mass_kg * (motion.ground_acceleration_mps2 + GRAVITY_MPS2 * uphill),
        vertical_n=_upsampled(truth.vertical_load_n, len(motion.time_s)),
        torque_nm=_upsampled(truth.driving_torque_nm, len(motion.time_s))
        + vehicle.outboard_inertia_kgm2 * motion.wheel_acceleration_radps2,
        wheel_angle_rad=motion.wheel_angle_rad,
        wheel_speed_radps=motion.wheel_speed_radps,
    )


def _faulty(faults: Faults, hub: HubLoads, motion: Motion, circumstances: Circumstances) -> tuple[HubLoads, Motion]:
    """Return the loads and the motion that the sensors see instead of the true ones."""
    if not faults:
        return hub, motion
    true = Signals(
        time_s=motion.time_s,
        drawbar_pull_n=hub.longitudinal_n,
        driving_torque_nm=hub.torque_nm,
        vertical_load_n=hub.vertical_n,
        ground_speed_mps=motion.ground_speed_mps,
        wheel_speed_radps=motion.wheel_speed_radps,
        campaign_time=circumstances.campaign_time(motion.time_s),
        direction=circumstances.direction,
    )
    seen = true
    for effect, values in sorted(faults, key=lambda fault: fault[0].stage):
        seen = effect().sensed(seen, values)
    hub = replace(
        hub, longitudinal_n=seen.drawbar_pull_n, vertical_n=seen.vertical_load_n, torque_nm=seen.driving_torque_nm
    )
    if seen.ground_speed_mps is not true.ground_speed_mps:
        distance = integrated(seen.ground_speed_mps, _MOTION_RATE_HZ)
        motion = replace(motion, ground_speed_mps=seen.ground_speed_mps, distance_m=distance)
    if seen.wheel_speed_radps is not true.wheel_speed_radps:
        angle = integrated(seen.wheel_speed_radps, _MOTION_RATE_HZ)
        motion = replace(motion, wheel_speed_radps=seen.wheel_speed_radps, wheel_angle_rad=angle)
    return hub, motion


def _upsampled(values: FloatArray, count: int) -> FloatArray:
    """Interpolate with a band limit at the truth's Nyquist frequency."""
    from scipy.signal import resample_poly

    fine = resample_poly(values, _UPSAMPLE, 1, padtype="line")
    return np.asarray(fine[:count], np.float64)


def _stamped(
    readings: Readings, clock: HostClock, start_ns: int, elapsed_s: float, rng: np.random.Generator
) -> dict[str, Channel]:
    time_ns = clock.stamps_ns(readings.time_s + readings.latency_s, start_ns, elapsed_s, rng)
    return {
        name: Channel(name, readings.units.get(name, ""), time_ns, values) for name, values in readings.values.items()
    }
