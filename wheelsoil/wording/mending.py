"""What to do about a measurement cause: the step, and the command or the lines of a file to paste."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from daq import VehicleConfig, number
from model import LackCode
from model.diagnosis import Cause, Diagnosis

_LIFTED = 'wheelsoil zero spin.mcap --vehicle vehicle.toml\n# then:\n[transducer]\nzero_file = "zero.toml"'
_RELEASED = '[vehicle]\nstandstill_brakes = "released"'


MENDED = ("wheel_inertia",)
"""Causes of the wheel that are mended in vehicle.toml, as those of the measurement are."""


class Mending(NamedTuple):
    """A step in words, and what to paste; empty where there is nothing to paste."""

    what: str
    paste: str = ""


def mending_of(cause: Cause, vehicle: VehicleConfig) -> Mending:
    """Return how to remove a measurement cause, or to check it where no file can."""
    rule = _RULES.get(cause.name)
    value = cause.parameters[0].value if cause.parameters else 0.0
    return rule(value, vehicle) if rule else Mending("Check the sensor of this cause, and repeat the diagnosis")


def missing_step(found: Diagnosis) -> Mending | None:
    """Return what would make the causes identifiable that the verdict says are not; None where no line does."""
    if any(why.code is LackCode.NOT_AT_STANDSTILL for why in found.not_identifiable.values()):
        return Mending("Record a standstill with released brakes, and declare it in vehicle.toml", _RELEASED)
    return None


def _zero(_: float, __: VehicleConfig) -> Mending:
    return Mending("Determine the zero with the wheel lifted, and name its file in vehicle.toml", _LIFTED)


def _drift(_: float, __: VehicleConfig) -> Mending:
    return Mending(
        "Determine the zero with the wheel lifted before and after the runs; processing interpolates between them",
        "wheelsoil zero before.mcap after.mcap --vehicle vehicle.toml",
    )


def _latency(value: float, vehicle: VehicleConfig) -> Mending:
    line = f"[sensors.ground_speed]\nlatency_s = {vehicle.latency_s('ground_speed') + value:.3f}"
    return Mending("Check the delay of the ground speed; these runs ask for this one in vehicle.toml", line)


def _radius(value: float, vehicle: VehicleConfig) -> Mending:
    wheel = vehicle.wheel
    line = f"[wheel]\nradius_m = {wheel.radius_m * (1 + value):.4f}" if wheel else ""
    return Mending("Measure the rolling radius on firm ground; these runs ask for this one in vehicle.toml", line)


def _inertia(value: float, vehicle: VehicleConfig) -> Mending:
    wheel = vehicle.wheel
    mass = (wheel.outboard_mass_kg if wheel else 0.0) + _MASS_KG * value
    inertia = (wheel.outboard_inertia_kgm2 if wheel else 0.0) + _INERTIA_KGM2 * value
    lines = f"[wheel]\noutboard_mass_kg = {number(mass, 3)}\noutboard_inertia_kgm2 = {number(inertia, 3)}"
    return Mending("Weigh what is outside the transducer; these runs ask for these values in vehicle.toml", lines)


def _gain(what: str) -> Callable[[float, VehicleConfig], Mending]:
    def rule(value: float, _: VehicleConfig) -> Mending:
        return Mending(f"Calibrate the {what}: these runs ask for {1 / (1 + value):.3f} times today's scale in the DBC")

    return rule


def _check(what: str) -> Callable[[float, VehicleConfig], Mending]:
    return lambda _value, _vehicle: Mending(what)


_MASS_KG, _INERTIA_KGM2 = 75.0, 8.0
"""What a scale of 1 of `wheel_inertia` stands for."""
_RULES: dict[str, Callable[[float, VehicleConfig], Mending]] = {
    "torque_zero": _zero,
    "drawbar_pull_zero": _zero,
    "load_zero": _zero,
    "zero_drift": _drift,
    "speed_latency": _latency,
    "wheel_radius": _radius,
    "wheel_inertia": _inertia,
    "drawbar_pull_gain": _gain("drawbar pull"),
    "torque_gain": _gain("driving torque"),
    "load_gain": _gain("vertical load"),
    "crosstalk": _check("Check the transducer's tilt on the hub and its cross-talk matrix, and repeat the diagnosis"),
    "speed_bias": _check("Compare ground speed with rim speed where the wheel rolls freely, and repeat the diagnosis"),
}
