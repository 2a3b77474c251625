"""Checks of a zero: its drift between determinations, and the outboard mass and wheel angle against vehicle.toml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import atan2, degrees, hypot, nan
from typing import Literal

from daq import STANDARD_GRAVITY_MPS2, ChannelZero, Determination, Note, VehicleConfig
from processing.notes import ZeroCode

_GAIN = 0.01
"""Relative uncertainty of a transducer's gain: the weight gives the mass no better."""
_LEAST_MASS_SIGMAS = 5.0
_NOTABLE_SIGMAS = 3.0
_LEAST_ANGLE_DEG = 0.1
_SAME_ANGLE_DEG = 5.0


@dataclass(frozen=True)
class WeightCheck:
    """Outboard mass and wheel angle by the weight that a spin shows, beside the declared mass.

    Attributes
    ----------
    angle_error_deg, angle_error_sigma_deg : float
        psi as counted less the true one, by the direction of the weight; NaN where the weight is too small.
    """

    mass_kg: float
    mass_sigma_kg: float
    declared_kg: float
    angle_error_deg: float
    angle_error_sigma_deg: float
    remarks: tuple[Note, ...]


def check_weight(forces: Mapping[str, tuple[ChannelZero, float]], vehicle: VehicleConfig) -> WeightCheck | None:
    """Compare the weight that a spin shows with the declared one; `forces` has zero and SI factor of each role.

    None without both forces, without a rotating part, or where a transducer in vehicle axes was zeroed with the wheel
    lifted: it does not feel the weight.
    """
    transducer = vehicle.transducer
    if not {"drawbar_pull", "vertical_load"} <= set(forces) or any(zero.cos is None for zero, _ in forces.values()):
        return None
    if transducer.frame == "vehicle" and transducer.zero == "lifted":
        return None
    (x, to_x), (z, to_z) = forces["drawbar_pull"], forces["vertical_load"]
    if transducer.frame == "vehicle":
        down, across = -z.offset * to_z, -x.offset * to_x
        sigma_down, sigma_across = z.offset_sigma * abs(to_z), x.offset_sigma * abs(to_x)
    else:
        side = -1.0 if transducer.side == "right" else 1.0
        x_cos, x_sin = side * to_x * (x.cos or 0.0), side * to_x * (x.sin or 0.0)
        z_cos, z_sin = to_z * (z.cos or 0.0), to_z * (z.sin or 0.0)
        down, across = (x_sin - z_cos) / 2, -(x_cos + z_sin) / 2
        sigma_down = hypot((x.rotating_sigma or 0.0) * to_x, (z.rotating_sigma or 0.0) * to_z) / 2
        sigma_across = sigma_down
    weight = hypot(down, across)
    mass, mass_sigma = weight / STANDARD_GRAVITY_MPS2, sigma_down / STANDARD_GRAVITY_MPS2
    seen = weight > _LEAST_MASS_SIGMAS * hypot(sigma_down, sigma_across)
    angle = degrees(atan2(across, down)) if seen else nan
    angle_sigma = degrees(sigma_across / weight) if seen else nan
    declared = vehicle.wheel.outboard_mass_kg if vehicle.wheel else 0.0
    if down < 0:
        mass = -mass
    remarks = _remarks(vehicle, (mass, mass_sigma, declared), (angle, angle_sigma))
    return WeightCheck(mass, mass_sigma, declared, angle, angle_sigma, tuple(remarks))


def _remarks(vehicle: VehicleConfig, masses: tuple[float, float, float], angles: tuple[float, float]) -> Iterator[Note]:
    mass, sigma, declared = masses
    if abs(mass - declared) > _NOTABLE_SIGMAS * hypot(sigma, _GAIN * declared):
        yield Note(ZeroCode.OUTBOARD_MASS, values={"mass_kg": mass, "sigma_kg": sigma, "declared_kg": declared})
    angle, angle_sigma = angles
    if abs(angle) > max(_NOTABLE_SIGMAS * angle_sigma, _LEAST_ANGLE_DEG):
        offset, direction = vehicle.transducer.angle_offset_deg, vehicle.transducer.angle_direction
        better = offset + direction * angle if vehicle.transducer.frame == "wheel" else None
        direction_facts = {"angle_deg": angle, "sigma_deg": angle_sigma, "offset_deg": offset, "better_deg": better}
        yield Note(ZeroCode.OUTBOARD_DIRECTION, values=direction_facts)


@dataclass(frozen=True)
class Drift:
    """The change of one part of one channel, in its unit."""

    channel: str
    unit: str
    part: Literal["offset", "cos", "sin"]
    change: float
    sigma: float

    @property
    def significant(self) -> bool:
        """Whether it is more than 3 sigma."""
        return abs(self.change) > _NOTABLE_SIGMAS * self.sigma


def drift_between(before: Determination, after: Determination) -> tuple[list[Drift], list[Note]]:
    """Return the drift of every channel that both have, and what cannot be compared.

    Stationary parts are compared where both are of one kind (method, axes, on the ground or not), rotating parts where
    both have them.
    """
    if before.kind != after.kind:
        return [], [Note(ZeroCode.NOT_COMPARABLE, values={"before": _kind(before), "after": _kind(after)})]
    remarks = []
    if before.angle_deg is not None and after.angle_deg is not None:
        apart = abs((after.angle_deg - before.angle_deg + 180) % 360 - 180)
        if apart > _SAME_ANGLE_DEG:
            remarks.append(Note(ZeroCode.STOOD_ELSEWHERE, values={"apart_deg": apart}))
    rows = []
    for name, old in before.channels.items():
        new = after.channels.get(name)
        if new is None or new.unit != old.unit:
            remarks.append(Note(ZeroCode.NOT_IN_BOTH, values={"channel": name}))
        else:
            rows += _of_channel(name, old, new)
    return rows, remarks


def _of_channel(name: str, old: ChannelZero, new: ChannelZero) -> list[Drift]:
    rows = [Drift(name, old.unit, "offset", new.offset - old.offset, hypot(new.offset_sigma, old.offset_sigma))]
    if old.cos is None or new.cos is None or old.sin is None or new.sin is None:
        return rows
    sigma = hypot(old.rotating_sigma or 0.0, new.rotating_sigma or 0.0)
    cos, sin = new.cos - old.cos, new.sin - old.sin
    return [*rows, Drift(name, old.unit, "cos", cos, sigma), Drift(name, old.unit, "sin", sin, sigma)]


def _kind(determination: Determination) -> dict[str, object]:
    names = ("recording", "method", "frame", "on_ground", "angle_offset_deg")
    return {name: getattr(determination, name) for name in names}
