"""The vehicle of the virtual test: its vehicle.toml, and its channels as CAN frames, encoded with the shipped DBCs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import hypot
from typing import Any, Literal

import numpy as np

from daq import (
    BusSection,
    Channel,
    DataError,
    Fault,
    FloatArray,
    Quantity,
    SensorSection,
    SignalName,
    TransducerSection,
    VehicleConfig,
    VehicleSection,
    WheelSection,
    find_unit,
)
from daq.can import FrameBatch, Message, Signal, concatenate, encode, load_database, merge, rolling_counter, shipped_dbc
from model.simulation import MOTION_LATENCY_S, SensedRun, VirtualSetup
from model.wheel_soil import Wheel

DBC_FILES = ("wft.dbc", "wheel_speed.dbc", "gnss.dbc")
MOTION_DBC = "motion.dbc"
BITRATE = 1_000_000
AXLES = 2
FRAME_TIME_S = 110e-6
"""Approximate bus time of one frame of the transducer."""

_OF_THE_WHEEL = {
    "vertical_load": "WFT_Forces.Fz",
    "drawbar_pull": "WFT_Forces.Fx",
    "driving_torque": "WFT_Moments.My",
    "wheel_angle": "WFT_Wheel.Angle",
}
_SPEED_SIGNALS = {"": "RearLeft", "FL": "FrontLeft", "FR": "FrontRight", "RL": "RearLeft", "RR": "RearRight"}
"""Signal of a wheel's speed, by its id."""
_OF_THE_VEHICLE = {
    "ground_speed": "GNSS_2.Speed",
    "ground_speed_valid": "GNSS_3.SpeedValid",
    "latitude": "GNSS_1.Latitude",
    "longitude": "GNSS_2.Longitude",
    "course": "GNSS_2.Course",
    "gnss_time": "GNSS_1.TimeOfDay",
}
_OF_ITS_MOTION = {
    "yaw_rate": "VehicleMotion.YawRate",
    "lateral_acceleration": "VehicleMotion.LateralAcceleration",
    "steering_angle": "VehicleMotion.SteeringAngle",
}

_LAYOUT: dict[str, tuple[tuple[str, dict[str, str]], ...]] = {
    "transducer": (
        (
            "WFT_Forces",
            {
                "Fx": "drawbar_pull",
                "Fy": "lateral_force",
                "Fz": "vertical_load",
                "Counter": "counter",
                "Status": "status",
            },
        ),
        (
            "WFT_Moments",
            {"Mx": "overturning_moment", "My": "driving_torque", "Mz": "steering_moment", "Counter": "counter"},
        ),
        (
            "WFT_Wheel",
            {"Angle": "wheel_angle", "SpinRate": "spin_rate", "Temperature": "temperature", "Counter": "counter"},
        ),
    ),
    "wheel_speed": (("WheelSpeeds", {"RearLeft": "wheel_speed"}),),
    "gnss": (
        ("GNSS_1", {"Satellites": "satellites", "TimeOfDay": "gnss_time", "Latitude": "latitude"}),
        ("GNSS_2", {"Longitude": "longitude", "Speed": "ground_speed", "Course": "course"}),
        (
            "GNSS_3",
            {"Altitude": "altitude", "SpeedValid": "ground_speed_valid", "VelocityQuality": "speed_quality"},
        ),
    ),
    "motion": (
        (
            "VehicleMotion",
            {"YawRate": "yaw_rate", "LateralAcceleration": "lateral_acceleration", "SteeringAngle": "steering_angle"},
        ),
    ),
}
"""Messages of each sensor, and the channel in each signal; of several wheels each speed in the signal of its own."""

_FRONT, _RIGHT = ("FL", "FR"), ("FR", "RR")
_HALF_TRACK_M = 0.9
_CONSTANT = {"Solution": 1.0}
_NOT_AVAILABLE = "Not available"
_HEADER_BITS = 47  # of a frame with an 11-bit identifier, gap to the next one included
_STUFFING = 1.1  # bits on the wire per bit of the frame, about


def vehicle_config(setup: VirtualSetup, wheel: Wheel, bus: str) -> VehicleConfig:
    """Return vehicle.toml: the known data of the vehicle and the declared ones of its sensors."""
    signals = _OF_THE_WHEEL | {"wheel_speed": f"WheelSpeeds.{_SPEED_SIGNALS['']}"} | _of_the_vehicle(setup)
    return VehicleConfig(
        vehicle=_vehicle(setup, None),
        wheel=_wheel_section(setup, wheel, f"rear {setup.transducer.side}"),
        bus=(BusSection(channel=bus, dbc=_dbc_files(setup), bitrate=BITRATE),),
        signals={role: SignalName.model_validate(text) for role, text in signals.items()},
        sensors=_sensors(setup),
        transducer=_transducer(setup),
    )


def config_of_wheels(setups: Mapping[str, VirtualSetup], wheel: Wheel, buses: Mapping[str, str]) -> VehicleConfig:
    """Return vehicle.toml with several ``[[wheel]]``; setups and buses of the transducers are by the wheels' ids.

    Wheel speeds and GNSS are on the first bus.
    """
    first = next(iter(buses.values()))
    any_setup = next(iter(setups.values()))
    return VehicleConfig.model_validate(
        {
            "vehicle": _vehicle(any_setup, AXLES),
            "bus": [
                BusSection(channel=bus, dbc=_dbc_files(any_setup) if bus == first else DBC_FILES[:1], bitrate=BITRATE)
                for bus in buses.values()
            ],
            "signals": _of_the_vehicle(any_setup),
            "sensors": _sensors(any_setup),
            "wheel": [
                _wheel_section(setup, wheel, "").model_dump()
                | _place(name, setup.vehicle.wheelbase_m)
                | {
                    "id": name,
                    "signals": {role: f"{buses[name]}:{signal}" for role, signal in _OF_THE_WHEEL.items()}
                    | {"wheel_speed": f"WheelSpeeds.{_SPEED_SIGNALS[name]}"},
                    "transducer": _transducer(setup),
                }
                for name, setup in setups.items()
            ],
        }
    )


def _dbc_files(setup: VirtualSetup) -> tuple[str, ...]:
    return DBC_FILES if setup.steering is None else (*DBC_FILES, MOTION_DBC)


def _of_the_vehicle(setup: VirtualSetup) -> dict[str, str]:
    return _OF_THE_VEHICLE | (_OF_ITS_MOTION if setup.steering else {})


def axle_of(wheel: str) -> int:
    """Return the axle of a wheel by its id, from 1 at the front."""
    return 1 if wheel in _FRONT else 2


def side_of(wheel: str) -> Literal["left", "right"]:
    """Return the side of a wheel by its id."""
    return "right" if wheel in _RIGHT else "left"


def place_m(wheel: str, wheelbase_m: float) -> complex:
    """Return where a wheel is, by its id: x + iy ahead and to the left of the middle of the rear axle."""
    return complex(wheelbase_m if wheel in _FRONT else 0.0, _HALF_TRACK_M * (1 if side_of(wheel) == "left" else -1))


def _place(wheel: str, wheelbase_m: float) -> dict[str, Any]:
    place, position = place_m(wheel, wheelbase_m), f"{'front' if wheel in _FRONT else 'rear'} {side_of(wheel)}"
    return {"position": position, "axle": axle_of(wheel), "x_m": place.real, "y_m": place.imag}


def _vehicle(setup: VirtualSetup, axles: int | None) -> VehicleSection:
    name, brakes = "virtual test vehicle", setup.stance.brakes
    return VehicleSection(name=name, mass_kg=setup.vehicle.mass_kg, standstill_brakes=brakes, axles=axles)


def _wheel_section(setup: VirtualSetup, wheel: Wheel, position: str) -> WheelSection:
    place = setup.steering.wheel_m if setup.steering else None
    return WheelSection(
        radius_m=wheel.radius_m,
        width_m=wheel.width_m,
        position=position,
        outboard_mass_kg=setup.vehicle.outboard_mass_kg,
        outboard_inertia_kgm2=setup.vehicle.outboard_inertia_kgm2,
        x_m=None if place is None else place.real,
        y_m=None if place is None else place.imag,
    )


def _transducer(setup: VirtualSetup) -> TransducerSection:
    transducer = setup.transducer
    return TransducerSection(
        frame=transducer.frame,
        side=transducer.side,
        angle_offset_deg=transducer.angle_offset_deg,
        angle_direction=transducer.angle_direction,
        zero=transducer.zero,
    )


def _sensors(setup: VirtualSetup) -> dict[str, SensorSection]:
    transducer, gnss = setup.transducer, setup.gnss
    sigmas = {
        "vertical_load": hypot(transducer.load_noise_n, transducer.white_noise_n),
        "drawbar_pull": hypot(transducer.drawbar_pull_noise_n, transducer.white_noise_n),
        "driving_torque": hypot(transducer.torque_noise_nm, transducer.white_noise_nm),
        "ground_speed": hypot(gnss.speed_noise_mps, gnss.speed_white_noise_mps),
    }
    # a sample's three messages follow each other on the bus
    on_bus = {"vertical_load": 1, "drawbar_pull": 1, "driving_torque": 2, "wheel_angle": 3}
    delays = {role: transducer.latency_s + place * FRAME_TIME_S for role, place in on_bus.items()}
    delays |= dict.fromkeys(("gnss_time", "latitude", "longitude"), gnss.transport_s)
    delays |= {"wheel_speed": setup.wheel_speed.latency_s, "ground_speed": gnss.latency_s, "course": gnss.latency_s}
    antenna = setup.steering.antenna_m if setup.steering else None
    if antenna is not None:
        sigmas |= dict(zip(_OF_ITS_MOTION, setup.motion_sigmas, strict=True))
        delays |= dict.fromkeys(_OF_ITS_MOTION, MOTION_LATENCY_S)
    return {
        role: SensorSection(
            latency_s=round(delay, 5),
            sigma=round(sigmas[role], 4) if role in sigmas else None,
            **({"x_m": antenna.real, "y_m": antenna.imag} if antenna and role == "ground_speed" else {}),
        )
        for role, delay in delays.items()
    }


def virtual_frames(run: SensedRun, bus: str = "can0") -> FrameBatch:
    """Encode a run at once; see `frame_batches`."""
    return concatenate(list(frame_batches([run], bus)))


def frame_batches(stretches: Iterable[SensedRun], bus: str = "can0") -> Iterator[FrameBatch]:
    """Encode the run of one wheel, stretch by stretch; see `frames_of_wheels`."""
    return frames_of_wheels(({"": run} for run in stretches), {"": bus})


def frames_of_wheels(stretches: Iterable[Mapping[str, SensedRun]], buses: Mapping[str, str]) -> Iterator[FrameBatch]:
    """Encode the run of a vehicle, stretch by stretch, as frames of buses that each transmit one frame at a time.

    Stretches are by the wheels' ids; a single wheel has an empty one. Wheel speeds are stamped, and what is of the
    vehicle is taken, as the first wheel has them. `buses` are those of the transducers; all else is on that of the
    first. Frames come in time order; a time stamp is the host time at the end of the frame. `DataError` where a value
    is outside the range of its signal.
    """
    messages = {m.name: m for name in (*DBC_FILES, MOTION_DBC) for m in load_database(shipped_dbc(name)).messages}
    first = next(iter(buses))
    speeds = {_SPEED_SIGNALS[wheel]: wheel for wheel in buses}
    encoders = [
        (wheel, "transducer", _Encoder(messages[name], signals, bus))
        for wheel, bus in buses.items()
        for name, signals in _LAYOUT["transducer"]
    ]
    encoders += [
        (first, "wheel_speed", _Encoder(messages[name], speeds, buses[first])) for name, _ in _LAYOUT["wheel_speed"]
    ]
    encoders += [
        (first, sensor, _Encoder(messages[name], signals, buses[first]))
        for sensor in ("gnss", "motion")
        for name, signals in _LAYOUT[sensor]
    ]
    lines = {bus: _Line() for bus in buses.values()}
    held: list[FrameBatch] = []

    def sent(before_ns: int | None) -> FrameBatch:
        ready = [
            line.one_at_a_time(merge([e.released(before_ns) for _, _, e in encoders if e.bus == bus]))
            for bus, line in lines.items()
        ]
        if len(ready) == 1:
            return ready[0]
        frames = merge([*held, *ready])
        stop = len(frames) if before_ns is None else int(np.searchsorted(frames.frames["time_ns"], before_ns))
        held[:] = [frames[stop:]]  # a frame of another bus may still end before these
        return frames[:stop]

    for runs in stretches:
        there = [each for each in encoders if each[1] in runs[each[0]].sensors]
        for wheel, sensor, encoder in there:
            encoder.take(_speeds(runs) if sensor == "wheel_speed" else runs[wheel].sensors[sensor])
        # a sensor's stamps never decrease, so that no frame comes any more before the earliest of their last ones
        yield sent(min(encoder.last_ns for _, _, encoder in there))
    yield sent(None)


def _speeds(runs: Mapping[str, SensedRun]) -> dict[str, Channel]:
    """Return the wheel speeds by the wheels' ids, with the stamps of the first: they travel in one message."""
    speeds = {wheel: run.sensors["wheel_speed"]["wheel_speed"] for wheel, run in runs.items()}
    time_ns = next(iter(speeds.values())).time_ns
    return {wheel: replace(channel, time_ns=time_ns) for wheel, channel in speeds.items()}


class _Encoder:
    """Encodes one message of a run, stretch after stretch, and holds its frames until their turn comes."""

    def __init__(self, message: Message, signals: Mapping[str, str], bus: str) -> None:
        self._message, self._signals, self.bus = message, signals, bus
        self._count = 0
        self._held = FrameBatch.empty((bus,))
        self.last_ns = np.iinfo(np.int64).min
        """Of the last frame that came."""

    def take(self, channels: Mapping[str, Channel]) -> None:
        """Encode a stretch; the channels are those of the sensor."""
        message = self._message
        time_ns = channels[next(iter(self._signals.values()))].time_ns
        values = {name: _in_unit(message.by_name[name], channels[quantity]) for name, quantity in self._signals.items()}
        for name, signal in message.by_name.items():
            if name == "Counter":
                values.setdefault(name, rolling_counter(len(time_ns), signal, self._count))
            elif name not in values:
                # The value of a signal that is not simulated: its "not available", a constant, or zero.
                raw = next((raw for raw, label in signal.labels.items() if label == _NOT_AVAILABLE), None)
                filler = raw * signal.scale + signal.offset if raw is not None else _CONSTANT.get(signal.name, 0.0)
                values[name] = np.full(len(time_ns), filler)
        encoded = encode(message, values, time_ns, self.bus)
        if encoded.saturated:
            raise DataError(
                *(
                    Fault(
                        f"the virtual test exceeds the range of {message.name}.{name}",
                        found=f"{count} of {len(time_ns)} samples, up to {np.nanmax(np.abs(values[name])):.6g}",
                        expected=f"at most {message.by_name[name].maximum:g} {message.by_name[name].unit}",
                        next_step="choose a stiffer soil, less load or a slower run",
                    )
                    for name, count in encoded.saturated.items()
                )
            )
        self._count += len(time_ns)
        self.last_ns = int(time_ns.max(initial=self.last_ns))
        self._held = concatenate([self._held, encoded.frames])

    def released(self, before_ns: int | None) -> FrameBatch:
        """Return the frames before an instant, or all, and hold them no longer."""
        held = self._held
        stop = len(held) if before_ns is None else int(np.searchsorted(held.frames["time_ns"], before_ns))
        self._held = held[stop:]
        return held[:stop]


def _in_unit(signal: Signal, channel: Channel) -> FloatArray:
    """Return a channel's SI values in the unit of its signal; an angle that would round to a full turn is zero."""
    if not channel.unit:
        return channel.values
    unit = find_unit(signal.unit, (Quantity(channel.unit),))
    if unit is None:
        raise ValueError(f"{signal.name}: {signal.unit!r} is not a unit of {channel.name}")
    values = (channel.values - unit.offset) / unit.factor
    if signal.maximum is not None and channel.unit == "rad" and signal.minimum == 0:
        values = np.mod(np.rint(values / signal.scale), round(360 / signal.scale)) * signal.scale
    return values


class _Line:
    """The bus itself, which carries one frame at a time."""

    def __init__(self) -> None:
        self._free_ns = np.iinfo(np.int64).min

    def one_at_a_time(self, batch: FrameBatch) -> FrameBatch:
        """Delay each frame until the bus is free, and add its own duration; the messages of a sensor are consecutive.

        End e_i = max(ready_i, e_(i-1)) + d_i, so that e_i - (d_0 + ... + d_i) is a running maximum.
        """
        frames = batch.frames.copy()
        if not len(frames):
            return batch
        bits = np.rint((_HEADER_BITS + 8 * frames["length"].astype(np.float64)) * _STUFFING)
        duration = (bits * (1e9 / BITRATE)).astype(np.int64)
        ends = np.cumsum(duration)
        least = frames["time_ns"] - (ends - duration)
        least[0] = max(least[0], self._free_ns)
        frames["time_ns"] = np.maximum.accumulate(least) + ends
        self._free_ns = int(frames["time_ns"][-1])
        return FrameBatch(frames, batch.buses)
