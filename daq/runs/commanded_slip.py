"""A slip that a test rig commands, in place of one of the speeds: r omega = V / (1 - s), and V (1 + s) for braking."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from daq import ROLES, Channel, ConfigError, FloatArray, VehicleConfig

_OTHER_SPEED = {"wheel_speed": "ground_speed", "ground_speed": "wheel_speed"}


def replaced_speed(vehicle: VehicleConfig) -> str | None:
    """Return the role of the speed that the commanded slip replaces; None where no slip has a signal.

    It is the wheel speed where the ground speed has a signal of its own.

    Raises
    ------
    ConfigError
        Neither speed has a signal, or the radius is not known.
    """
    signals = vehicle.signals
    if "slip" not in signals:
        return None
    own = [role for role in _OTHER_SPEED if role in signals and signals[role] != signals["slip"]]
    if not own:
        step = 'add ground_speed = "..." to [signals]: that of the carriage; or wheel_speed'
        what, found = "the commanded slip needs one of the speeds", str(signals["slip"])
        raise ConfigError.of(what, "vehicle.toml [signals] slip", found, "ground_speed or wheel_speed", step)
    if vehicle.wheel is None:
        step = "add [wheel] radius_m to vehicle.toml"
        raise ConfigError.of("the commanded slip needs the radius", "vehicle.toml", "no [wheel]", next_step=step)
    return "wheel_speed" if "ground_speed" in own else "ground_speed"


def with_commanded_slip(vehicle: VehicleConfig) -> VehicleConfig:
    """Return the vehicle with the signal of the slip for the speed that it replaces; raises as `replaced_speed`."""
    role = replaced_speed(vehicle)
    if role is None:
        return vehicle
    return vehicle.model_copy(update={"signals": vehicle.signals | {role: vehicle.signals["slip"]}})


class CommandedSlip:
    """Computes the replaced speed piece by piece; between its samples the slip keeps its value."""

    def __init__(self, vehicle: VehicleConfig, role: str) -> None:
        self.role, self.needs = role, ("slip", _OTHER_SPEED[role])
        self._radius_m = vehicle.wheel.rolling_m if vehicle.wheel else np.nan
        self._last = np.nan

    def speed(self, channels: Mapping[str, Channel]) -> Channel | None:
        """Return the speed at the samples of the other one, in the unit of its role; None in a piece without those."""
        slip, other = (channels.get(role) for role in self.needs)
        if slip is not None and len(slip) and other is None:
            self._last = float(slip.values[-1])
        if other is None:
            return None
        values = np.full(len(other), self._last)
        if slip is not None and len(slip):
            at = np.searchsorted(slip.time_ns, other.time_ns, side="right") - 1
            values = np.where(at >= 0, slip.values[np.maximum(at, 0)], self._last)
            self._last = float(slip.values[-1])
        return Channel(self.role, ROLES[self.role].unit, other.time_ns, self._speed(other.values, values))

    def _speed(self, other: FloatArray, slip: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(slip >= 0, 1.0 - slip, 1.0 / (1.0 + slip))  # V / (r omega)
            share = np.where((share > 0) & np.isfinite(share), share, np.nan)
            values = other / share / self._radius_m if self.role == "wheel_speed" else other * share * self._radius_m
        return np.asarray(values)
