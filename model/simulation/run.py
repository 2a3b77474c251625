"""One simulated run: driving, soil, vehicle and sensors; the soil is drawn from the laboratory's uncertainty.

A run is calculated in stretches. What filters, integrals and generators carry goes from one to the next, so that the
numbers are those of the whole run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import chain, pairwise
from math import atan, inf, tan
from typing import Any

import numpy as np

from daq import Channel, ConfigError, Fault, FloatArray, RunInfo, nearest
from model.effects.base import Effect, Signals
from model.simulation.motion import (
    GRAVITY_MPS2,
    Drive,
    DrivingStyle,
    Motion,
    Steering,
    VehicleSetup,
    WheelLoad,
    drawn_drive,
    integrated,
    static_load_n,
)
from model.simulation.speed_sensors import (
    MOTION_SIGMAS,
    GnssReceiver,
    GnssSetup,
    MotionSensors,
    Track,
    WheelSpeedSensor,
    WheelSpeedSetup,
)
from model.simulation.stance import Stance, StandingForces, standing_forces
from model.simulation.transducer import HostClock, HubLoads, Readings, Transducer, TransducerSetup
from model.simulation.truth import (
    PITCH_RAD_PER_MPS2,
    Circumstances,
    Truth,
    campaign_line_m,
    reaction_at_rest,
    soil_reaction,
    towed,
)
from model.wheel_soil.soils import LABORATORY_SPREAD, Soil
from model.wheel_soil.wheel_soil_model import WheelSoilModel

Faults = Sequence[tuple[type[Effect], Mapping[str, float]]]
"""Measurement effects, each with its own parameters."""

TRUTH_RATE_HZ = 200.0
"""The soil's reaction is calculated at this rate; a fitter works at another one (100 Hz by default)."""

STRETCH_S = 60.0
"""So much of a run is calculated at once."""
SHORTEST_STRETCH_S = 6.0
"""The last stretch holds the whole standstill at the end."""

_MOTION_RATE_HZ = 1000.0
_UPSAMPLE = round(_MOTION_RATE_HZ / TRUTH_RATE_HZ)
_MARGIN = 2000
"""Samples of the motion on either side of a stretch, so that a latency can take from them."""
_CONTEXT = 500
"""Of these the samples that the sensors get to see."""
_PAD = 12
"""Samples of the truth on which an interpolated one depends, on either side."""
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
    """The instrumented vehicle, its driver and its sensors; without steering it drives straight on."""

    duration_s: float = 40.0
    vehicle: VehicleSetup = field(default_factory=VehicleSetup)
    style: DrivingStyle = field(default_factory=DrivingStyle)
    transducer: TransducerSetup = field(default_factory=TransducerSetup)
    wheel_speed: WheelSpeedSetup = field(default_factory=WheelSpeedSetup)
    gnss: GnssSetup = field(default_factory=GnssSetup)
    track: Track = field(default_factory=Track)
    clock: HostClock = field(default_factory=HostClock)
    stance: Stance = field(default_factory=Stance)
    steering: Steering | None = None
    motion_sigmas: tuple[float, ...] = MOTION_SIGMAS


@dataclass(frozen=True)
class SensedRun:
    """What the sensors say of a recording.

    Attributes
    ----------
    start_ns : UTC of the start of the run
    sensors : mapping str -> mapping str -> Channel
        Per sensor ("transducer", "wheel_speed", "gnss", with steering "motion") its channels by quantity, in SI units
        and radians. Channels of one sensor share their stamps: the host clock's when the message is ready to be sent.
    """

    info: RunInfo
    start_ns: int
    sensors: dict[str, dict[str, Channel]]


@dataclass(frozen=True)
class VirtualRun(SensedRun):
    """What happened, and what the sensors say of it."""

    truth: Truth


def virtual_run(
    setup: VirtualSetup, model: WheelSoilModel, values: Mapping[str, float], info: RunInfo, **circumstances: Any
) -> VirtualRun:
    """Drive one run and return all of it; as `virtual_stretches`, also in its parameters and errors."""
    return whole(virtual_stretches(setup, model, values, info, **circumstances))


def virtual_stretches(
    setup: VirtualSetup,
    model: WheelSoilModel,
    values: Mapping[str, float],
    info: RunInfo,
    *,
    start_ns: int,
    elapsed_s: float,
    rng: np.random.Generator,
    ring: np.random.Generator,
    own: np.random.Generator | None = None,
    campaign_s: float | None = None,
    faults: Faults = (),
    stretch_s: float = STRETCH_S,
) -> Iterator[VirtualRun]:
    """Drive one run, stretch by stretch, in memory that does not grow with its duration.

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
    own : numpy.random.Generator, optional
        What is random of this wheel alone, where `rng` is of several wheels on one drive: road, transducer, stamps,
        standstills. The drive, the phase of the wheel-speed messages and the GNSS fixes are of all.
    campaign_s : from the start to the end of the campaign; by default it ends with this run
    faults : sequence of (measurement effect, its parameters)
        What the sensors get wrong, in any order; they follow each other by their `stage`.
    stretch_s : duration of each stretch but the last, which is up to twice as long; at least `SHORTEST_STRETCH_S`
        The run is the same for any.

    Yields
    ------
    VirtualRun
        Of one stretch.

    Raises
    ------
    ConfigError
        The run is too short.
    DataError
        The soil cannot carry the wheel.
    """
    driving, road, loads, wheel, fixes, stamps, standing = rng.spawn(7)
    if own is not None:
        road, loads, stamps, standing = own.spawn(4)
    vehicle, radius = setup.vehicle, model.wheel.radius_m
    circumstances = Circumstances(
        info,
        info.inflation_kpa or vehicle.inflation_kpa,
        elapsed_s,
        elapsed_s + setup.duration_s if campaign_s is None else campaign_s,
        campaign_line_m(setup.track.length_m, setup.duration_s),
    )
    direction = circumstances.direction
    coast, resistance_n = towed(model, values, static_load_n(vehicle, info.added_load_kg), circumstances)
    at_rest = standing_forces(setup.stance, vehicle, direction, info.added_load_kg, radius, resistance_n, standing)
    drive = replace(
        drawn_drive(setup.duration_s, radius, driving, rate_hz=_MOTION_RATE_HZ, coast_slip=coast, style=setup.style),
        steering=setup.steering,
    )
    run = _Run(setup, model, values, circumstances, drive, _bounds(drive, stretch_s), at_rest)
    # the interpolation of the truth needs its last value from the start on, and the standstills where the middle is
    length_m, last = run.end(deepcopy(road))
    felt = _Felt(faults, circumstances, vehicle, setup.stance.uphill(direction), last, drive)
    motion = MotionSensors(setup.motion_sigmas, drive, rng.spawn(1)[0]) if setup.steering else None
    sensors = Sensors(setup, circumstances, start_ns, drive.count, radius, [loads, wheel, fixes, stamps], ring, motion)
    for before, now, after in _with_neighbours(run.stretches(road, length_m)):
        until_s = inf if after is None else float(after.motion.time_s[0])
        yield VirtualRun(info, start_ns, sensors.read(*felt.of(before, now, after), until_s), now.truth)


def whole(stretches: Iterable[VirtualRun]) -> VirtualRun:
    """Join the stretches of a run."""
    run: VirtualRun = _joined(list(stretches))
    return run


@dataclass(frozen=True)
class _Stretch:
    """A stretch of a run: its motion, and the truth at the truth rate."""

    motion: Motion
    truth: Truth


def _bounds(drive: Drive, stretch_s: float) -> list[int]:
    """Return the first sample of each stretch, on samples of the truth, and the end of the run."""
    step = round(min(max(stretch_s, SHORTEST_STRETCH_S), drive.duration_s) * TRUTH_RATE_HZ) * _UPSAMPLE
    return [*range(0, max(drive.count - step, 0) + 1, step), drive.count]


@dataclass(frozen=True)
class _Run:
    """What is decided of a run before it is driven."""

    setup: VirtualSetup
    model: WheelSoilModel
    values: Mapping[str, float]
    circumstances: Circumstances
    drive: Drive
    bounds: list[int]
    standing: StandingForces

    def end(self, road: np.random.Generator) -> tuple[float, tuple[float, ...]]:
        """Return the distance driven, and load, drawbar pull and torque when the vehicle stands again."""
        for _, coarse, load_n in self._moved(road):
            last = coarse.time_s[-1:], load_n[-1:]
        forces = reaction_at_rest(self.model, self.values, *last, self.circumstances, self.standing)
        return float(coarse.distance_m[-1]), tuple(float(force[0]) for force in forces)

    def stretches(self, road: np.random.Generator, length_m: float) -> Iterator[_Stretch]:
        """Yield motion and truth, stretch by stretch."""
        track, info = self.setup.track, self.circumstances.info
        for (start, stop), (motion, coarse, load_n) in zip(pairwise(self.bounds), self._moved(road), strict=True):
            jerk, position_m = _jerk_mps3(self.drive, start, stop), track.position_m(coarse.distance_m, info.direction)
            at_rest = self.standing.along(coarse.distance_m, length_m)
            here = self.model, self.values, coarse, jerk, load_n, position_m, self.circumstances
            yield _Stretch(motion, soil_reaction(*here, at_rest))

    def _moved(self, road: np.random.Generator) -> Iterator[tuple[Motion, Motion, FloatArray]]:
        """Yield the motion, the same at the rate of the truth, and the load there, stretch by stretch."""
        vehicle, steering, added_kg = self.setup.vehicle, self.setup.steering, self.circumstances.info.added_load_kg
        load = WheelLoad(vehicle, TRUTH_RATE_HZ, added_kg, road)
        motion: Motion | None = None
        for start, stop in pairwise(self.bounds):
            motion = self.drive.motion(start, stop, motion)
            coarse = _part(motion, slice(None, None, _UPSAMPLE))
            load_n = load.next_n(coarse.ground_speed_mps, coarse.ground_acceleration_mps2)
            if steering:  # the outer wheels gain m a h/track, half of it each
                moment = (vehicle.mass_kg + added_kg) * vehicle.centre_of_gravity_height_m
                load_n -= moment * self.drive.turning(coarse.time_s)[1] / (4 * steering.wheel_m.imag)
            yield motion, coarse, load_n


def _jerk_mps3(drive: Drive, start: int, stop: int) -> FloatArray:
    """Return the jerk over ground at the truth rate, which takes a sample on either side."""
    around_s = drive.time_s(max(start - _UPSAMPLE, 0), min(stop + _UPSAMPLE, drive.count), _UPSAMPLE)
    jerk = np.gradient(drive.ground(around_s)[1], 1 / TRUTH_RATE_HZ)
    return np.asarray(jerk[min(start, 1) :][: len(range(start, stop, _UPSAMPLE))])


class _Felt:
    """What the sensors get to feel and see of a run, stretch by stretch.

    `uphill` is the sine of the tilt as the vehicle drives it; `last` is load, drawbar pull and torque at the end of the
    run.
    """

    def __init__(
        self,
        faults: Faults,
        circumstances: Circumstances,
        vehicle: VehicleSetup,
        uphill: float,
        last: tuple[float, ...],
        drive: Drive,
    ) -> None:
        self._faulty = Faulty(faults, circumstances)
        self._vehicle, self._drive = vehicle, drive
        self._uphill = uphill
        self._last = last
        self._first: tuple[float, ...] = ()
        self._intervals = -(-drive.count // _UPSAMPLE) - 1

    def of(self, before: _Stretch | None, now: _Stretch, after: _Stretch | None) -> tuple[HubLoads, Motion, Motion]:
        """Return the loads, the motion and the motion as the speed sensors see it.

        They begin `_CONTEXT` samples before the stretch and end as many behind it, except at the ends of the run.
        """
        parts = [part for part in (before, now, after) if part]
        motion: Motion = _joined([_part(p.motion, slice(*_near(p is before, p is after, _MARGIN))) for p in parts])
        forces = [(p.truth.vertical_load_n, p.truth.drawbar_pull_n, p.truth.driving_torque_nm) for p in parts]
        self._first = self._first or tuple(float(force[0]) for force in forces[0])
        loads = [
            self._upsampled(of_parts, before is not None, after is not None, number)[: len(motion.time_s)]
            for number, of_parts in enumerate(zip(*forces, strict=True))
        ]
        hub = _hub_loads(self._vehicle, self._uphill, loads, motion)
        rows = slice(_MARGIN - _CONTEXT if before else None, _CONTEXT - _MARGIN if after else None)
        left = len(now.motion.time_s) - 1 - (0 if before else _CONTEXT)
        steering = self._drive.steering
        antenna_mps = self._drive.ground(motion.time_s, steering.antenna_m)[0] if steering else None
        return self._faulty.of(hub, motion, rows, left, antenna_mps)

    def _upsampled(self, parts: tuple[FloatArray, ...], begun: bool, goes_on: bool, number: int) -> FloatArray:
        """Interpolate the forces of stretches, with a band limit at the truth's Nyquist frequency, within the margins.

        The run goes on at either end as the line from its first value to its last does.
        """
        from scipy.signal import resample_poly

        first, last = self._first[number], self._last[number]
        slope = (last - first) / self._intervals
        away = np.arange(1, _PAD + 1)
        margin = _MARGIN // _UPSAMPLE + _PAD
        left = parts[0][-margin:] if begun else first - away[::-1] * slope
        middle = parts[1] if begun else parts[0]
        right = parts[-1][:margin] if goes_on else last + away * slope
        fine = resample_poly(np.concatenate([left, middle, right]), _UPSAMPLE, 1, padtype="line")
        return np.asarray(fine[_PAD * _UPSAMPLE : -_PAD * _UPSAMPLE], np.float64)


class Faulty:
    """What the sensors get to feel and see instead of the true loads and motion; it is asked stretch by stretch."""

    def __init__(self, faults: Faults, circumstances: Circumstances) -> None:
        self._faults = sorted(faults, key=lambda fault: fault[0].stage)
        self._circumstances = circumstances
        self._passed: dict[str, tuple[float, float]] = {}

    def of(
        self,
        hub: HubLoads,
        motion: Motion,
        rows: slice = slice(None),
        left: int = -1,
        antenna_mps: FloatArray | None = None,
    ) -> tuple[HubLoads, Motion, Motion]:
        """Return some rows of the loads, of the motion, and of the motion as the speed sensors see it.

        `left` is the row of these behind which the next stretch begins; `antenna_mps` the ground speed of the antenna
        where that is not the wheel's.
        """
        seen = Signals(
            time_s=motion.time_s,
            drawbar_pull_n=hub.longitudinal_n,
            driving_torque_nm=hub.torque_nm,
            vertical_load_n=hub.vertical_n,
            ground_speed_mps=motion.ground_speed_mps if antenna_mps is None else antenna_mps,
            wheel_speed_radps=motion.wheel_speed_radps,
            campaign_time=self._circumstances.campaign_time(motion.time_s),
            body_pitch_rad=PITCH_RAD_PER_MPS2 * motion.ground_acceleration_mps2,
            direction=self._circumstances.direction,
        )
        for effect, values in self._faults:
            seen = effect().sensed(seen, values)
        hub = replace(
            hub, longitudinal_n=seen.drawbar_pull_n, vertical_n=seen.vertical_load_n, torque_nm=seen.driving_torque_nm
        )
        return _part(hub, rows), _part(motion, rows), self._shown(motion, seen, rows, left)

    def _shown(self, motion: Motion, seen: Signals, rows: slice, left: int) -> Motion:
        """Return the motion with its own distance and angle where a speed is another."""
        changed: dict[str, FloatArray] = {}
        for rate, integral in (("ground_speed_mps", "distance_m"), ("wheel_speed_radps", "wheel_angle_rad")):
            speeds: FloatArray = getattr(seen, rate)
            if speeds is not getattr(motion, rate):
                speeds = speeds[rows]
                path = integrated(speeds, _MOTION_RATE_HZ, self._passed.get(rate))
                self._passed[rate] = float(speeds[left]), float(path[left])
                changed |= {rate: speeds, integral: path}
        shown: Motion = replace(_part(motion, rows), **changed)
        return shown


class Sensors:
    """The sensors on one run; they are read stretch by stretch.

    `count` is that of the motion's samples of the whole run. The streams are those of the transducer, the wheel speed,
    the GNSS receiver and the time stamps; see `virtual_stretches` for `ring`. `motion` is of a vehicle that is steered.
    """

    def __init__(
        self,
        setup: VirtualSetup,
        circumstances: Circumstances,
        start_ns: int,
        count: int,
        wheel_radius_m: float,
        streams: Sequence[np.random.Generator],
        ring: np.random.Generator,
        motion: MotionSensors | None = None,
    ) -> None:
        loads, wheel, fixes, stamps = streams
        last_s = (count - 1) / _MOTION_RATE_HZ
        duration_s = last_s + 1 / _MOTION_RATE_HZ
        day_s = (start_ns // _NS) % _SECONDS_PER_DAY + (start_ns % _NS) / _NS
        direction, outboard_kg = circumstances.info.direction, setup.vehicle.outboard_mass_kg
        self._transducer = Transducer(setup.transducer, duration_s, wheel_radius_m, outboard_kg, loads)
        self._wheel_speed = WheelSpeedSensor(setup.wheel_speed, duration_s, ring, wheel)
        self._gnss = GnssReceiver(setup.gnss, setup.track, direction, day_s, last_s, fixes)
        self._motion = motion
        self._stampers = [
            _Stamper(setup.clock, start_ns, circumstances.elapsed_s, stream) for stream in stamps.spawn(4)
        ]

    def read(self, hub: HubLoads, motion: Motion, shown: Motion, until_s: float = inf) -> dict[str, dict[str, Channel]]:
        """Return the channels of each sensor, of the samples not read yet that come before `until_s`.

        `shown` is the motion as the speed sensors see it.
        """
        readings = {
            "transducer": self._transducer.read(hub, until_s),
            "wheel_speed": self._wheel_speed.read(shown, until_s),
            "gnss": self._gnss.read(motion, until_s, shown.distance_m),
            **({"motion": self._motion.read(until_s)} if self._motion else {}),
        }
        return {
            name: stamper.stamped(reading)
            for (name, reading), stamper in zip(readings.items(), self._stampers, strict=False)
        }


def _near(is_before: bool, is_after: bool, margin: int) -> tuple[int | None, int | None]:
    """Return the rows next to the stretch between, of the one before and of the one after; else all."""
    return (-margin if is_before else None), (margin if is_after else None)


def _with_neighbours(stretches: Iterable[_Stretch]) -> Iterator[tuple[_Stretch | None, _Stretch, _Stretch | None]]:
    before: _Stretch | None = None
    now: _Stretch | None = None
    for after in chain(stretches, [None]):
        if now is not None:
            yield before, now, after
        before, now = now, after


def _part(columns: Any, rows: slice) -> Any:
    """Return some rows of a dataclass of arrays."""
    return replace(columns, **{f.name: getattr(columns, f.name)[rows] for f in fields(columns)})


def _joined(parts: list[Any]) -> Any:
    """Join arrays, and dataclasses and mappings of them; the first holds for everything else."""
    first = parts[0]
    if len(parts) == 1:
        return first
    if isinstance(first, np.ndarray) and first.ndim:
        return np.concatenate(parts)
    if isinstance(first, dict):
        return {name: _joined([part[name] for part in parts]) for name in first}
    if is_dataclass(first) and not isinstance(first, type):
        names = [f.name for f in fields(first)]
        return replace(first, **{name: _joined([getattr(part, name) for part in parts]) for name in names})
    return first


def _hub_loads(vehicle: VehicleSetup, uphill: float, forces: list[FloatArray], motion: Motion) -> HubLoads:
    """Return what the transducer feels: the soil's forces less what moves the outboard parts and holds them uphill.

    `forces` are load, drawbar pull and torque.
    """
    load_n, pull_n, torque_nm = forces
    return HubLoads(
        time_s=motion.time_s,
        longitudinal_n=pull_n - vehicle.outboard_mass_kg * (motion.ground_acceleration_mps2 + GRAVITY_MPS2 * uphill),
        vertical_n=load_n,
        torque_nm=torque_nm + vehicle.outboard_inertia_kgm2 * motion.wheel_acceleration_radps2,
        wheel_angle_rad=motion.wheel_angle_rad,
        wheel_speed_radps=motion.wheel_speed_radps,
    )


class _Stamper:
    """Gives one sensor's readings the stamps of the host clock."""

    def __init__(self, clock: HostClock, start_ns: int, elapsed_s: float, rng: np.random.Generator) -> None:
        self._clock, self._start_ns, self._elapsed_s, self._rng = clock, start_ns, elapsed_s, rng
        self._last_ns = np.iinfo(np.int64).min

    def stamped(self, readings: Readings) -> dict[str, Channel]:
        """Return the next readings as channels; stamps never decrease."""
        ready_s = readings.time_s + readings.latency_s
        time_ns = np.maximum(self._clock.stamps_ns(ready_s, self._start_ns, self._elapsed_s, self._rng), self._last_ns)
        self._last_ns = time_ns.max(initial=self._last_ns)
        return {
            name: Channel(name, readings.units.get(name, ""), time_ns, values)
            for name, values in readings.values.items()
        }
