"""Roles of vehicle.toml -> signals of the DBCs, with the factor to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq.can.bits import Message, RawKind, Signal
from daq.can.databases import Database, messages_by_bus
from daq.channels import ROLES, Channel, Use
from daq.config import VehicleConfig
from daq.errors import ConfigError, Fault, nearest
from daq.units import Quantity, explain_unknown, find_unit

_NO_DATA = re.compile(
    r"not.?avail|unavail|not.?valid|invalid|(?<![a-z])init|(?<!no.)(?<![a-z])(error|fault)|^(sna|n/?a)$", re.IGNORECASE
)


@dataclass(frozen=True)
class SignalRef:
    """Where a role comes from, and how it becomes SI.

    Attributes
    ----------
    bus, message, signal : str
        `message` as `daq.can.databases.messages_by_bus` names it.
    unit : str
        As the DBC writes it.
    si_unit : str
        ``N, Nm, m/s, rad/s, rad, m, s`` or ``1``.
    si_factor, si_offset : float
        SI value = decoded value * si_factor + si_offset.
    missing : tuple of float
        Decoded values that the DBC's value table says are no data ("not available", "SNA", "error", ...).
    missing_from : float
        Decoded values from here on are no data (J1939 keeps the top of every range for that).
    """

    role: str
    bus: str
    message: str
    signal: str
    unit: str
    si_unit: str
    si_factor: float
    si_offset: float = 0.0
    missing: tuple[float, ...] = ()
    missing_from: float = math.inf

    @property
    def name(self) -> str:
        """``"Message.Signal"``, as `daq.can.codec.Decoder` expects it."""
        return f"{self.message}.{self.signal}"

    @property
    def key(self) -> tuple[str, str]:
        """Key of the channel among the decoded ones."""
        return self.bus, self.name

    def to_si(self, channel: Channel) -> Channel:
        """Return the decoded channel in SI, named by the role; NaN where the sender had no data."""
        values = channel.values * self.si_factor + self.si_offset
        values[channel.values >= self.missing_from] = np.nan
        for value in self.missing:
            values[channel.values == value] = np.nan
        return Channel(self.role, self.si_unit, channel.time_ns, values, channel.labels)


def resolve_roles(
    vehicle: VehicleConfig,
    databases: Mapping[str, Sequence[Database]],
    needed: Collection[str],
    optional: Collection[str] = (),
) -> dict[str, SignalRef]:
    """Find the signal of each role.

    In ``[signals]`` a role is ``"Message.Signal"``; ``"can1:Message.Signal"`` where several buses have it, and a
    leading ``-`` turns the sign of a sensor whose axis points the other way.

    Parameters
    ----------
    vehicle : VehicleConfig
        ``signals`` and, for a wheel speed given as a rim speed, ``wheel.radius_m``.
    databases : mapping of bus name to its databases
    needed : collection of str
        Roles that must be there.
    optional : collection of str
        Roles that are resolved where vehicle.toml has them; one that it has and that is wrong is a fault all the same.

    Returns
    -------
    dict
        Role to `SignalRef`, in the order of ``[signals]``.

    Raises
    ------
    ConfigError
        Lists every fault at once: a needed role without a signal, a signal that no DBC has, an unknown or wrong unit.
    """
    messages = messages_by_bus(databases)
    where = "vehicle.toml [signals]"
    faults = [
        Fault(f"role {role!r} is needed and has no signal", where, next_step=f'add {role} = "Message.Signal"')
        for role in needed
        if role not in vehicle.signals
    ]
    found: dict[str, SignalRef] = {}
    for role, text in vehicle.signals.items():
        if role in needed or role in optional:
            resolved = _resolve(role, text, vehicle, messages)
            if isinstance(resolved, Fault):
                faults.append(resolved)
            else:
                found[role] = resolved
    if faults:
        raise ConfigError(*faults)
    return found


def _resolve(
    role: str, text: str, vehicle: VehicleConfig, messages: Mapping[str, Mapping[str, Message]]
) -> SignalRef | Fault:
    place = _find(role, text, messages)
    if isinstance(place, Fault):
        return place
    bus, message, signal = place
    where = f"vehicle.toml [signals] {role}"
    quantities = ROLES[role].quantities
    unit = find_unit(signal.unit, quantities)
    if unit is None:
        what, known = explain_unknown(signal.unit, quantities)
        name = f"{message}.{signal.name} on {bus}"
        return Fault(f"{name} {what}", where, repr(signal.unit), known, "write the unit the sender uses into the DBC")
    factor, si_unit = unit.factor, unit.quantity.value
    if role == "wheel_speed" and unit.quantity is Quantity.SPEED:
        if vehicle.wheel is None:
            what = f"{message}.{signal.name} is a rim speed ({signal.unit}): the wheel radius makes it an angular speed"
            return Fault(what, where, "no [wheel]", next_step="add [wheel] radius_m: the radius its sender assumes")
        factor, si_unit = factor / vehicle.wheel.radius_m, Quantity.ANGULAR_SPEED.value
    sign = -1.0 if text.startswith("-") else 1.0
    missing = () if ROLES[role].use is Use.FLAG else _missing(signal)
    limit = _missing_from(signal) if messages[bus][message].j1939 else math.inf
    at = (role, bus, message, signal.name, signal.unit)
    return SignalRef(*at, si_unit, sign * factor, sign * unit.offset, missing, limit)


def means_no_data(label: str) -> bool:
    """Whether a label of a value table says that there is no value: "not available", "SNA", "error" and the like."""
    return bool(_NO_DATA.search(label.strip()))


def _missing(signal: Signal) -> tuple[float, ...]:
    labelled = (raw for raw, label in signal.labels.items() if means_no_data(label))
    return tuple(float(raw * signal.scale + signal.offset) for raw in labelled)


def _missing_from(signal: Signal) -> float:
    """Return where J1939's error and not-available ranges begin: 0xFE in the highest byte."""
    if signal.kind is not RawKind.UNSIGNED or signal.length_bits not in (8, 16, 32) or signal.scale <= 0:
        return math.inf
    return float((0xFE << (signal.length_bits - 8)) * signal.scale + signal.offset)


def _find(role: str, text: str, messages: Mapping[str, Mapping[str, Message]]) -> tuple[str, str, Signal] | Fault:
    where = f"vehicle.toml [signals] {role}"
    unsigned = text.removeprefix("-")
    bus_name, _, name = unsigned.rpartition(":")
    if bus_name and bus_name not in messages:
        return Fault(f"no [[bus]] has the channel {bus_name!r}", where, repr(text), nearest(bus_name, messages))
    message_name, _, signal_name = name.partition(".")
    hits = [
        (bus, message_name, known[message_name].by_name[signal_name])
        for bus, known in messages.items()
        if bus_name in ("", bus) and message_name in known and signal_name in known[message_name].by_name
    ]
    if len(hits) == 1:
        return hits[0]
    if hits:
        choices = " or ".join(f'"{bus}:{name}"' for bus, _, _ in hits)
        return Fault(f"{name} is on several buses", where, repr(text), choices, "name the bus")
    searched = [known for bus, known in messages.items() if bus_name in ("", bus)]
    names = [f"{message}.{signal}" for known in searched for message, m in known.items() for signal in m.by_name]
    return Fault(f"no DBC has a signal {name!r}", where, repr(text), nearest(name, names))
