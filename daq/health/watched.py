"""What is watched: every message of the DBCs with its signals, and the roles among them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from daq.buses import messages_by_bus
from daq.config import ROLES, HealthSection, VehicleConfig
from daq.databases import Database
from daq.errors import ConfigError
from daq.health.board import Recent, reason
from daq.health.flow import MessageFlow
from daq.health.report import Level, Reason, SignalHealth
from daq.health.values import SignalValues
from daq.layout import Message
from daq.roles import SignalRef, resolve_roles

_RESTING_ROLES = ("wheel_speed", "ground_speed", "latitude", "longitude", "course", "wheel_angle", "sinkage")


@dataclass(frozen=True)
class Watched:
    """A message of a bus and what is followed of it.

    Attributes
    ----------
    bus, name : str
        As `daq.buses.messages_by_bus` names it.
    message : Message
    names : tuple of str
        Signals, in the order of the rows of `values`.
    keys : tuple of (bus, "Message.Signal")
        Of their channels.
    flow : MessageFlow
    values : SignalValues
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
    def unseen(self) -> list[SignalHealth]:
        """What is told of the signals before the message has come."""
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
            step = fault.next_step or "mend [signals] in vehicle.toml"
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
            rests = {signal for signal, one in mine.items() if one.role in _RESTING_ROLES}
            watched.append(
                Watched(
                    bus,
                    name,
                    message,
                    signals,
                    tuple((bus, f"{name}.{signal}") for signal in signals),
                    MessageFlow(message, signals),
                    SignalValues(message, signals, constant, rests),
                    mine,
                    *(Recent() for _ in range(5)),
                )
            )
    return watched
