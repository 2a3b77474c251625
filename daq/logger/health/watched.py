"""What is watched: the messages of the DBCs, their signals and roles, and whether the vehicle moves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from daq.can.bits import Message
from daq.can.databases import Database, messages_by_bus
from daq.can.roles import SignalRef, resolve_roles
from daq.channels import ROLES
from daq.config import HealthSection, VehicleConfig
from daq.errors import ConfigError, Fault, nearest
from daq.logger.health.flow import MessageFlow
from daq.logger.health.report import Level, Reason, Recent, SignalHealth, Since, reason
from daq.logger.health.values import SignalValues

_RESTING_ROLES = ("wheel_speed", "ground_speed", "latitude", "longitude", "course", "wheel_angle", "sinkage")


@dataclass(frozen=True)
class Watched:
    """A message of a bus and what is followed of it.

    Attributes
    ----------
    bus, name : str
        As `daq.can.databases.messages_by_bus` names it.
    names : tuple of str
        Signals, in the order of the rows of `values`.
    keys : tuple of (bus, "Message.Signal")
        Of their channels.
    roles : mapping signal -> SignalRef
    lost, missing, repeated, came, rate : Recent
        Growth of the counts of `flow`: frames lost by the counter, missing by the rate, repeated, received, and changes
        of the rate.
    """

    bus: str
    name: str
    message: Message
    names: tuple[str, ...]
    keys: tuple[tuple[str, str], ...]
    flow: MessageFlow
    values: SignalValues
    roles: Mapping[str, SignalRef]
    lost: Recent
    missing: Recent
    repeated: Recent
    came: Recent
    rate: Recent

    @cached_property
    def initial_signals(self) -> list[SignalHealth]:
        """State of the signals before the first frame of the message."""
        roles = {signal: reference.role for signal, reference in self.roles.items()}
        return [
            SignalHealth(
                self.bus,
                f"{self.name}.{name}",
                self.message.by_name[name].unit,
                roles.get(name, ""),
                Level.GREEN,
                math.nan,
                0,
                0,
                0.0,
            )
            for name in self.names
        ]

    @property
    def where(self) -> str:
        """The message as people read it."""
        return f"{self.bus}: {self.name}"

    def listed(self, names: tuple[str, ...], signal: str = "") -> bool:
        """Whether the message, or this signal of it, is in a list of ``[health]``."""
        return self.name in names or (bool(signal) and f"{self.name}.{signal}" in names)


def usable_roles(
    vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]
) -> tuple[dict[str, SignalRef], list[Reason]]:
    """Return the roles that can be resolved, and a reason for each that cannot: it is recorded all the same."""
    usable: dict[str, SignalRef] = {}
    refused = []
    for role in ROLES:
        try:
            usable |= resolve_roles(vehicle, databases, (), (role,))
        except ConfigError as error:
            fault = error.faults[0]
            step = fault.next_step or "correct [signals] in vehicle.toml"
            refused.append(reason("role_unusable", Level.AMBER, f"[signals] {role}", fault.what, next_step=step))
    return usable, refused


def watch(
    databases: Mapping[str, tuple[Database, ...]], roles: Mapping[str, SignalRef], health: HealthSection
) -> list[Watched]:
    """Return what is to be watched."""
    watched = []
    for bus, messages in messages_by_bus(databases).items():
        for name, message in messages.items():
            signals = tuple(message.by_name)
            mine = {one.signal: one for one in roles.values() if (one.bus, one.message) == (bus, name)}
            constant = {s for s in signals if name in health.may_be_constant or f"{name}.{s}" in health.may_be_constant}
            at_rest = {signal for signal, one in mine.items() if one.role in _RESTING_ROLES}
            watched.append(
                Watched(
                    bus,
                    name,
                    message,
                    signals,
                    tuple((bus, f"{name}.{signal}") for signal in signals),
                    MessageFlow(message, signals),
                    SignalValues(message, signals, constant, at_rest),
                    mine,
                    *(Recent() for _ in range(5)),
                )
            )
    return watched


_OF_MESSAGES = ("may_be_silent", "may_be_constant", "may_leave_range")
_STEP = "correct [health] in vehicle.toml"


def unknown_names(vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]) -> list[Fault]:
    """Return a fault for each name that no DBC and no bus has.

    Parameters
    ----------
    databases : mapping bus -> databases
        Without any, nothing can be said of messages and signals.

    Raises
    ------
    DatabaseError
        The databases of a bus contradict each other.
    """
    messages: set[str] = set()
    signals: set[str] = set()
    for of_bus in messages_by_bus(databases).values():
        messages |= set(of_bus)
        signals |= {f"{name}.{signal}" for name, message in of_bus.items() for signal in message.by_name}
    faults = []
    for key in _OF_MESSAGES if messages else ():
        for name in getattr(vehicle.health, key):
            known = signals if "." in name else messages
            if name not in messages | signals:
                what = f"no {'signal' if known is signals else 'message'} of the DBCs is called {name!r}"
                faults.append(Fault(what, f"[health] {key}", expected=nearest(name, known), next_step=_STEP))
    buses = {bus.channel for bus in vehicle.bus}
    for name in vehicle.health.may_carry_unknown:
        if name not in buses:
            what = f"no bus is called {name!r}"
            faults.append(Fault(what, "[health] may_carry_unknown", expected=nearest(name, buses), next_step=_STEP))
    return faults


MOVING_MPS = 0.5
_RESTING_MPS = 0.1
_CONTRADICTED_MPS = 1.0
_STANDING_S, _ALL_SLIP_S = 1.0, 3.0
_PLAUSIBLE_RADIUS_M = 0.5


class Motion:
    """Follows the speeds from report to report.

    Parameters
    ----------
    radius_m : float or None
        Of the wheel; a usual value where vehicle.toml has none, which is accurate enough to detect walking pace.
    """

    def __init__(self, radius_m: float | None) -> None:
        self._radius_m = radius_m or _PLAUSIBLE_RADIUS_M
        self._since = Since()
        self._last_ns: int | None = None
        self.ground_mps = self.rim_mps = math.nan
        self.moved_s = {"ground_speed": 0.0, "wheel_speed": 0.0}
        """For how long the vehicle has moved, by what each speed says."""

    @property
    def resting(self) -> bool:
        """Whether the vehicle stands, as far as is known."""
        known = [abs(speed) for speed in (self.ground_mps, self.rim_mps) if math.isfinite(speed)]
        return bool(known) and max(known) < _RESTING_MPS

    def take(self, now_ns: int, values: Mapping[str, float]) -> None:
        """Take the last values of the roles, SI; NaN or absent where there is none."""
        self.ground_mps = values.get("ground_speed", math.nan)
        self.rim_mps = values.get("wheel_speed", math.nan) * self._radius_m
        elapsed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        for role, speed in (("ground_speed", self.ground_mps), ("wheel_speed", self.rim_mps)):
            if abs(speed) > MOVING_MPS:
                self.moved_s[role] += elapsed_s

    def reasons(self, now_ns: int, where: Mapping[str, str]) -> list[Reason]:
        """Return the contradictions.

        Parameters
        ----------
        where : mapping role -> str
            The signals, as people read them.
        """
        found = []
        stands = self.rim_mps == 0 and abs(self.ground_mps) > _CONTRADICTED_MPS
        if self._since.held_s("wheel", now_ns, stands) > _STANDING_S:
            what = f"is exactly 0 while the ground speed is {self.ground_mps:.1f} m/s"
            found.append(reason("wheel_speed_zero", Level.AMBER, where["wheel_speed"], what))
        spins = self.ground_mps == 0 and abs(self.rim_mps) > _CONTRADICTED_MPS
        if self._since.held_s("ground", now_ns, spins) > _ALL_SLIP_S:
            what = f"is exactly 0 while the rim runs at {self.rim_mps:.1f} m/s"
            found.append(reason("ground_speed_zero", Level.AMBER, where["ground_speed"], what))
        return found
