"""A determination of the zero from the signals of one recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import hypot, isfinite, radians, sin, sqrt

import numpy as np

from daq import STANDARD_GRAVITY_MPS2, ChannelZero, ConfigError, DataError, Fault, FloatArray, Note, VehicleConfig
from processing import LEVEL_DEG, RUT_SHARE, ZeroCode
from processing.pipeline.wheel_frames import interpolate_angle, rotate
from processing.transducer_zero.parts import Harmonics, Motion, Part, find_spin, find_standstill, fit_harmonics

_LIFTED_SHARE = 0.2
"""A lifted wheel reads less than this share of a quarter of the vehicle's weight, its zeros included."""
_LIFTED_WITHOUT_MASS_N = 1500.0
_ON_GROUND_SHARE = hypot(RUT_SHARE, sin(radians(LEVEL_DEG)))
"""One-sigma of the pull at a released wheel on the ground, of its load."""
_NOTABLE_CHANGE = 0.2
"""Of the speed over the spin, as a share."""
_FEWEST_SAMPLES = 50


@dataclass(frozen=True)
class TransducerSignal:
    """One signal of the transducer, NaN and distrusted samples excluded.

    Attributes
    ----------
    name, role, unit : str
        As zero.toml calls it; empty where it has none; as the DBC writes it.
    si_factor : float
        SI value in the sense of the role = value * `si_factor`.
    resolution : float
        Step of the values.
    time_s, values : float64 arrays, shape (n,)
        Declared latency taken off; in the unit of the DBC.
    """

    name: str
    role: str
    unit: str
    si_factor: float
    resolution: float
    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class Lifted:
    """What `determine` found.

    Attributes
    ----------
    outliers : mapping str -> int
        Samples of each channel that did not count.
    """

    part: Part
    channels: dict[str, ChannelZero]
    outliers: dict[str, int]
    remarks: tuple[Note, ...]


def determine(
    signals: Sequence[TransducerSignal],
    angle: tuple[FloatArray, FloatArray] | None,
    speed: tuple[FloatArray, FloatArray] | None,
    vehicle: VehicleConfig,
    *,
    on_ground: bool = False,
) -> Lifted:
    """Find the part that can be used and fit every signal over it.

    Parameters
    ----------
    signals : sequence of TransducerSignal
        With the role ``vertical_load``, and ``drawbar_pull`` for a transducer in wheel axes.
    angle : (time_s, psi), or None
        Unwrapped psi in rad, see `processing.pipeline.wheel_angle`.
    speed : (time_s, omega), or None
        Wheel speed in rad/s.
    on_ground : bool
        Take the wheel to stand on the ground: only what must read zero there is determined.

    Raises
    ------
    DataError
        The wheel carries the vehicle, or nothing of the recording can be used.
    ConfigError
        On the ground: the brakes are not declared to be released.
    """
    limit_n = _lifted_limit_n(vehicle)
    _check_there(signals, angle, vehicle)
    motion = Motion(_load(signals, angle, vehicle), angle, speed)
    if on_ground:
        _check_released(vehicle)
        part = find_standstill(motion, (limit_n, np.inf))
    else:
        part = find_spin(motion, limit_n) or find_standstill(motion, (0.0, limit_n))
    if part is None:
        raise DataError(_nothing(motion, limit_n, on_ground=on_ground))
    used = _on_ground(signals, vehicle) if on_ground else signals
    channels, outliers = {}, {}
    for signal in used:
        fit = _fit(signal, part, angle, vehicle)
        if fit is not None:
            channels[signal.name] = _channel(signal, fit, part, motion, vehicle, on_ground=on_ground)
            outliers[signal.name] = fit.outliers
    if not channels:
        raise DataError.of("too few samples", expected=f"{_FEWEST_SAMPLES} of each channel in what can be used")
    standing = part.method == "standstill"
    remarks = (
        _standing_remarks(part, motion, vehicle, on_ground=on_ground) if standing else _spin_remarks(part, vehicle)
    )
    return Lifted(part, channels, outliers, tuple(remarks))


def _check_released(vehicle: VehicleConfig) -> None:
    """Raise a ConfigError unless the vehicle is declared to stand with released brakes."""
    brakes = vehicle.vehicle.standstill_brakes
    if brakes != "released":
        raise ConfigError(
            Fault(
                "held brakes keep an unknown pull and torque in the hub: this is no zero",
                "vehicle.toml",
                found=f'[vehicle] standstill_brakes = "{brakes}"',
                expected='"released"',
                next_step='record with the brakes released and write standstill_brakes = "released", or lift the wheel',
            )
        )


def _lifted_limit_n(vehicle: VehicleConfig) -> float:
    """Return the mean vertical load below which, either sign, a wheel is taken to be lifted."""
    mass = vehicle.vehicle.mass_kg
    least = 2 * STANDARD_GRAVITY_MPS2 * vehicle.wheel.outboard_mass_kg if vehicle.wheel else 0.0
    usual = _LIFTED_SHARE * mass * STANDARD_GRAVITY_MPS2 / 4 if mass else _LIFTED_WITHOUT_MASS_N
    return max(usual, least)


def _check_there(
    signals: Sequence[TransducerSignal], angle: tuple[FloatArray, FloatArray] | None, vehicle: VehicleConfig
) -> None:
    """Raise a DataError that names what nothing was received of."""
    have = {signal.role for signal in signals if len(signal.values)}
    have |= {"wheel_angle"} if angle is not None and len(angle[0]) else set()
    needed = {"vertical_load"} | ({"drawbar_pull", "wheel_angle"} if vehicle.transducer.frame == "wheel" else set())
    step = "check with wheelsoil info that its frames were recorded, and --from and --to"
    DataError.stop_if_any(
        Fault(f"nothing usable was received of {role}", next_step=step) for role in sorted(needed - have)
    )


def _load(
    signals: Sequence[TransducerSignal], angle: tuple[FloatArray, FloatArray] | None, vehicle: VehicleConfig
) -> tuple[FloatArray, FloatArray]:
    """Return the vertical load in vehicle axes."""
    by_role = {signal.role: signal for signal in signals}
    up = by_role["vertical_load"]
    if vehicle.transducer.frame == "vehicle":
        return up.time_s, up.si_factor * up.values
    forward = by_role["drawbar_pull"]
    assert angle is not None
    pull = np.interp(up.time_s, forward.time_s, forward.si_factor * forward.values)
    psi = interpolate_angle(up.time_s, *angle)
    # psi is counted already: only the side is left for `rotate` to turn
    plain = vehicle.transducer.model_copy(update={"angle_offset_deg": 0.0, "angle_direction": 1})
    _, load = rotate(pull, up.si_factor * up.values, psi, plain)
    known = np.isfinite(load)
    return up.time_s[known], load[known]


def _nothing(motion: Motion, limit_n: float, *, on_ground: bool) -> Fault:
    time_s, load = motion.load
    middle = float(np.median(load))
    found = f"vertical load {middle / 1e3:.2f} kN (median) over {time_s[-1] - time_s[0]:.1f} s"
    if on_ground:
        return Fault(
            "the vehicle does not stand on the wheel for a second",
            found=found,
            expected=f"a standstill with more than {limit_n / 1e3:.2f} kN",
            next_step="leave --on-ground out for a lifted wheel",
        )
    if abs(middle) >= limit_n:
        return Fault(
            "the wheel carries the vehicle: this is no zero",
            found=found,
            expected=f"less than {limit_n / 1e3:.2f} kN, as of a lifted wheel",
            next_step="lift the wheel and record again, or --on-ground for the channels that must read zero standing",
        )
    turns = "" if motion.angle is None else f", {np.ptp(motion.angle[1]) / (2 * np.pi):.1f} revolutions"
    return Fault(
        "no part of the recording can be used",
        found=found + turns,
        expected="two revolutions at a steady speed, or a second of standstill, with the wheel lifted",
        next_step="spin the wheel evenly at about one revolution a second for 10 s or more",
    )


def _on_ground(signals: Sequence[TransducerSignal], vehicle: VehicleConfig) -> list[TransducerSignal]:
    """Return what must read zero on level ground with released brakes: pull (vehicle axes) and torque."""
    roles = ("driving_torque",) if vehicle.transducer.frame == "wheel" else ("drawbar_pull", "driving_torque")
    return [signal for signal in signals if signal.role in roles]


def _fit(
    signal: TransducerSignal, part: Part, angle: tuple[FloatArray, FloatArray] | None, vehicle: VehicleConfig
) -> Harmonics | None:
    rows = (signal.time_s >= part.start_s) & (signal.time_s < part.stop_s)
    time_s, values = signal.time_s[rows], signal.values[rows]
    psi = None
    if part.method == "spin":
        assert angle is not None
        psi = interpolate_angle(time_s, *angle)
        known = np.isfinite(psi)
        time_s, values, psi = time_s[known], values[known], psi[known]
        if signal.role == "driving_torque" and vehicle.wheel:
            sense = -1.0 if vehicle.transducer.frame == "wheel" and vehicle.transducer.side == "right" else 1.0
            turning = vehicle.wheel.outboard_inertia_kgm2 * part.acceleration_at(time_s)
            values = values - sense * turning / signal.si_factor
    return fit_harmonics(time_s, values, psi, signal.resolution) if len(values) >= _FEWEST_SAMPLES else None


def _channel(
    signal: TransducerSignal, fit: Harmonics, part: Part, motion: Motion, vehicle: VehicleConfig, *, on_ground: bool
) -> ChannelZero:
    p, sigma = fit.coefficients, fit.sigmas
    if part.method == "spin":
        return ChannelZero(
            offset=p[0],
            offset_sigma=sigma[0],
            cos=p[1],
            sin=p[2],
            rotating_sigma=sqrt((sigma[1] ** 2 + sigma[2] ** 2) / 2),
            twice=hypot(p[3], p[4]),
            unit=signal.unit,
        )
    offset, offset_sigma = float(p[0]), float(sigma[0])
    if on_ground and signal.role == "drawbar_pull":
        held = _ON_GROUND_SHARE * float(np.median(np.abs(motion.load[1])))
        offset_sigma = hypot(offset_sigma, held / abs(signal.si_factor))
    elif not on_ground and vehicle.transducer.frame == "wheel":
        offset -= _weight_n(signal.role, part.angle_rad, vehicle) / signal.si_factor
    return ChannelZero(offset=offset, offset_sigma=offset_sigma, unit=signal.unit)


def _weight_n(role: str, psi: float, vehicle: VehicleConfig) -> float:
    """Return what the declared outboard weight reads in wheel axes."""
    weight = STANDARD_GRAVITY_MPS2 * vehicle.wheel.outboard_mass_kg if vehicle.wheel else 0.0
    if role == "vertical_load":
        return -weight * float(np.cos(psi))
    if role == "drawbar_pull":
        return weight * float(np.sin(psi)) * (-1.0 if vehicle.transducer.side == "right" else 1.0)
    return 0.0


def _standing_remarks(part: Part, motion: Motion, vehicle: VehicleConfig, *, on_ground: bool) -> Iterator[Note]:
    yield Note(ZeroCode.ONE_WHEEL_ANGLE)
    if not isfinite(part.angle_rad) and motion.speed is None:
        yield Note(ZeroCode.STANDING_ASSUMED)
    if on_ground:
        yield Note(ZeroCode.ON_GROUND, values={"load_share": _ON_GROUND_SHARE})
    elif vehicle.transducer.frame == "wheel":
        mass = vehicle.wheel.outboard_mass_kg if vehicle.wheel else 0.0
        yield Note(ZeroCode.WEIGHT_TAKEN_OUT, values={"mass_kg": mass})


def _spin_remarks(part: Part, vehicle: VehicleConfig) -> Iterator[Note]:
    speed = np.abs(part.speed[1])
    if np.ptp(speed) < _NOTABLE_CHANGE * np.mean(speed):
        return
    inertia = vehicle.wheel.outboard_inertia_kgm2 if vehicle.wheel else 0.0
    facts = {"from_radps": float(speed[0]), "to_radps": float(speed[-1]), "inertia_kgm2": inertia}
    yield Note(ZeroCode.SPEED_CHANGED, values=facts)
