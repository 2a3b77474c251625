"""Roles of vehicle.toml -> signals of the DBCs, with the factor to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from daq import ROLES, BoolArray, Channel, ConfigError, Fault, FloatArray, SignalName, Use, VehicleConfig, nearest
from daq.can import Database, Message, RawKind, Signal, messages_by_bus
from daq.units import Quantity, explain_unknown, find_unit

_NAMED = 4
"""Columns of one name that a fault lists."""
_UNIT_BEHIND = re.compile(
    r"(?:\s+\[(?P<spaced>[^\[\]]*)\]|\[(?P<square>[^\[\]]*[^\[\]\d][^\[\]]*)\]|\s*\((?P<round>[^()]*)\))\s*$"
)
"""A unit in brackets at the end of a header; ``velocity[2]`` has none."""

_VALID = re.compile(r"valid", re.IGNORECASE)
_SPEED_VALID = re.compile(r"speed[ _]?(is[ _]?)?valid|valid[ _]?speed", re.IGNORECASE)
_NO_DATA = re.compile(
    r"not.?avail|unavail|not.?valid|invalid|(?<![a-z])init|(?<!no.)(?<![a-z])(error|fault)|^(sna|n/?a)$", re.IGNORECASE
)

_NOT_AVAILABLE = re.compile(r"not.?avail|unavail|^(sna|n/?a)$", re.IGNORECASE)
_LEAST_BITS, _LEAST_MEASURED_BITS = 8, 12
"""Extreme codes of shorter signals are values."""
_EXTREME = "extreme code outside the DBC's range"
_J1939 = "error or not available (J1939)"


@dataclass(frozen=True)
class NoData:
    """Which decoded values of a signal mean that there is no data.

    Attributes
    ----------
    words : mapping float -> str
        Single values, with the reason: their label in the value table ("not available", "SNA", "error", ...), or that
        they are extreme codes outside the range of the DBC.
    above : float
        All values from here on: J1939 reserves the top of every range.
    all_bits_set : float or None
        Value of an unsigned signal with all bits set, if the DBC allows it: many senders mean no data by it.
    """

    words: Mapping[float, str] = field(default_factory=dict)
    above: float = math.inf
    all_bits_set: float | None = None

    def masks(self, values: FloatArray) -> dict[str, BoolArray]:
        """Return where `values` mean no data, a mask of their shape for each reason that occurs."""
        found: dict[str, BoolArray] = {}
        for value, word in self.words.items():
            found[word] = found.get(word, np.zeros(len(values), np.bool_)) | (values == value)
        if math.isfinite(self.above):
            found[_J1939] = (values >= self.above) & ~np.isin(values, list(self.words))
        return {word: mask for word, mask in found.items() if mask.any()}

    def is_value(self, values: FloatArray) -> BoolArray:
        """Return where `values` are data, a mask of their shape."""
        found = values < self.above if math.isfinite(self.above) else np.ones(len(values), np.bool_)
        for value in self.words:
            found &= values != value
        return found

    def touches(self, low: float, high: float) -> bool:
        """Return whether values from `low` to `high` may include one that means no data, or has all bits set."""
        special = (*self.words, self.above, math.inf if self.all_bits_set is None else self.all_bits_set)
        return high >= self.above or any(low <= value <= high for value in special)


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
    no_data : NoData
        Which decoded values mean no data.
    replaced_unit : str
        Unit of the DBC or file in place of which vehicle.toml states another one.
    """

    role: str
    bus: str
    message: str
    signal: str
    unit: str
    si_unit: str
    si_factor: float
    si_offset: float = 0.0
    no_data: NoData = field(default_factory=NoData)
    replaced_unit: str = ""

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
        if self.no_data.words or math.isfinite(self.no_data.above):
            values[~self.no_data.is_value(channel.values)] = np.nan
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
    return _resolved(vehicle, needed, optional, lambda role, name: _find_signal(role, name, messages))


def resolve_columns(
    vehicle: VehicleConfig,
    topics: Mapping[str, Mapping[str, str]],
    needed: Collection[str],
    optional: Collection[str] = (),
    *,
    source: str,
) -> dict[str, SignalRef]:
    """Find the column of each role among the topics of decoded series.

    A role names a column as its file writes it (``"FZ_RL [kN]"``), its plain name (``"FZ_RL"``), or topic and column
    (``"/wheel_states.velocity[2]"``, ``"/wheel_states:velocity[2]"``), where several topics have the column. `topics`
    has the unit of each column of each topic; `source` names the file for messages.

    The result and the errors are those of `resolve_roles`, with an empty ``bus``; `ConfigError` also for a column whose
    unit neither the file nor vehicle.toml states.
    """
    try:
        return _resolved(vehicle, needed, optional, lambda role, name: _find_column(role, name, topics))
    except ConfigError as error:
        raise ConfigError(*(replace(fault, what=f"{source}: {fault.what}") for fault in error.faults)) from None


def unused_validity(
    references: Mapping[str, SignalRef], signals: Mapping[tuple[str, str], Collection[str]]
) -> str | None:
    """Return the signal that looks like the validity of the ground speed and has no role, None where there is none.

    In the same message any name with "valid" counts; in another message of the bus the name must contain "speed" too.
    `signals` is by bus and message; the result is ``"Message.Signal"``.
    """
    speed = references.get("ground_speed")
    if speed is None or "ground_speed_valid" in references:
        return None
    beside = [f"{speed.message}.{name}" for name in signals.get((speed.bus, speed.message), ()) if _VALID.search(name)]
    others = [f"{m}.{name}" for (bus, m), names in signals.items() if bus == speed.bus for name in names]
    return next(chain(beside, filter(_SPEED_VALID.search, others)), None)


class _Place(NamedTuple):
    """A signal or column that a role may name; `advice` says where its unit can be written."""

    bus: str
    message: str
    signal: str
    unit: str
    advice: str
    no_data: NoData = NoData()


def _resolved(
    vehicle: VehicleConfig,
    needed: Collection[str],
    optional: Collection[str],
    find: Callable[[str, SignalName], _Place | Fault],
) -> dict[str, SignalRef]:
    where = "vehicle.toml [signals]"
    faults = [
        _of_wheel(
            Fault(f"role {role!r} is needed and has no signal", where, next_step=f'add {role} = "Message.Signal"'),
            role,
            vehicle,
        )
        for role in needed
        if role not in vehicle.signals
    ]
    found: dict[str, SignalRef] = {}
    for role, name in vehicle.signals.items():
        if role in needed or role in optional:
            place = find(role, name)
            reference = place if isinstance(place, Fault) else _in_si(role, name, place, vehicle)
            if isinstance(reference, Fault):
                faults.append(_of_wheel(reference, role, vehicle))
            else:
                found[role] = reference
    ConfigError.stop_if_any(faults)
    return found


def _of_wheel(fault: Fault, role: str, vehicle: VehicleConfig) -> Fault:
    """Return a fault of a role that names the wheel, where it has an id."""
    of_wheel = vehicle.wheel and vehicle.wheel.id and ROLES[role].of_wheel
    return replace(fault, where=f"{fault.where}, wheel {vehicle.wheel.id}") if vehicle.wheel and of_wheel else fault


def _in_si(role: str, name: SignalName, place: _Place, vehicle: VehicleConfig) -> SignalRef | Fault:
    text = place.unit if name.unit is None else name.unit
    quantities = ROLES[role].quantities
    unit = find_unit(text, quantities)
    shown = f"{place.message}.{place.signal}" + (f" on {place.bus}" if place.bus else "")
    if unit is None:
        what, known = explain_unknown(text, quantities)
        return Fault(f"{shown} {what}", f"vehicle.toml [signals] {role}", repr(text), known, place.advice)
    factor, si_unit = unit.factor, unit.quantity.value
    if role == "wheel_speed" and unit.quantity is Quantity.SPEED:
        if vehicle.wheel is None:
            what = f"{shown} is a rim speed ({text}): the wheel radius makes it an angular speed"
            step = "add [wheel] radius_m: the radius its sender assumes"
            return Fault(what, f"vehicle.toml [signals] {role}", "no [wheel]", next_step=step)
        factor, si_unit = factor / vehicle.wheel.rolling_m, Quantity.ANGULAR_SPEED.value
    return SignalRef(
        role=role,
        bus=place.bus,
        message=place.message,
        signal=place.signal,
        unit=text,
        si_unit=si_unit,
        si_factor=name.sign * factor,
        si_offset=name.sign * unit.offset,
        no_data=replace(place.no_data, words={}) if ROLES[role].use is Use.FLAG else place.no_data,
        replaced_unit=place.unit if find_unit(place.unit, quantities) not in (None, unit) else "",
    )


def _find_column(role: str, name: SignalName, topics: Mapping[str, Mapping[str, str]]) -> _Place | Fault:
    step = f'state the unit: {role} = {{signal = "{name.signal}", unit = "..."}}'
    columns = [
        _Place("", topic, column, unit, step) for topic, units in topics.items() for column, unit in units.items()
    ]
    for spelled in (  # as the file writes it; with the topic; without the unit
        lambda place: {place.signal},
        lambda place: {f"{place.message}.{place.signal}", f"{place.message}:{place.signal}"},
        lambda place: {plain_name(place.signal), f"{place.message}.{plain_name(place.signal)}"},
    ):
        hits = [place for place in columns if name.signal in spelled(place)]
        if len(hits) == 1:
            return hits[0]
        if hits:
            choices = " or ".join(f'"{place.message}:{place.signal}"' for place in hits[:_NAMED])
            where = f"vehicle.toml [signals] {role}"
            return Fault(f"{name.signal!r} is there several times", where, repr(str(name)), choices, "name one of them")
    names = [place.signal for place in columns] + [f"{place.message}.{place.signal}" for place in columns]
    what = f"no column is called {name.signal!r}"
    step = "correct the name; files that together are one run become one by `wheelsoil import FILE FILE`"
    return Fault(what, f"vehicle.toml [signals] {role}", repr(str(name)), nearest(name.signal, names), step)


def plain_name(header: str) -> str:
    """Return a column's name without the unit behind it: ``FZ_RL`` of ``FZ_RL [kN]``."""
    return _UNIT_BEHIND.sub("", header).strip()


def unit_behind(header: str) -> str:
    """Return the unit behind a column's name, in brackets: ``kN`` of ``FZ_RL [kN]``; empty where there is none."""
    match = _UNIT_BEHIND.search(header)
    return (match["spaced"] or match["square"] or match["round"] or "").strip() if match else ""


def means_no_data(label: str) -> bool:
    """Whether a label of a value table means that there is no data: "not available", "SNA", "error" and the like."""
    return bool(_NO_DATA.search(label.strip()))


def no_data_of(message: Message, signal: Signal) -> NoData:
    """Return which decoded values of a signal mean no data, by what the DBC declares of it."""
    no_data = [(raw, label) for raw, label in signal.labels.items() if means_no_data(label)]
    if not signal.unit and len(no_data) < len(signal.labels):  # an enumeration: "error" is one of its values
        no_data = [(raw, label) for raw, label in no_data if _NOT_AVAILABLE.search(label.strip())]
    words = {_physical(signal, raw): label for raw, label in no_data}
    above = _j1939_none_from(signal) if message.j1939 else math.inf
    if signal.kind not in (RawKind.UNSIGNED, RawKind.SIGNED) or signal.length_bits < _LEAST_BITS:
        return NoData(words, above)
    low, high = signal.raw_range
    extremes = (high,) if signal.kind is RawKind.UNSIGNED else (low, high)
    for value in (_physical(signal, raw) for raw in extremes):
        if _outside(signal, value):
            words.setdefault(value, _EXTREME)
    all_bits = _physical(signal, high)
    measured = signal.kind is RawKind.UNSIGNED and bool(signal.unit) and signal.length_bits >= _LEAST_MEASURED_BITS
    allowed = measured and all_bits not in words and all_bits < above and high not in signal.labels
    return NoData(words, above, all_bits if allowed else None)


def _physical(signal: Signal, raw: int) -> float:
    return float(raw * signal.scale + signal.offset)


def _outside(signal: Signal, value: float) -> bool:
    """Return whether a value is outside the range that a DBC declares; 0 to 0 declares none."""
    low, high = signal.minimum, signal.maximum
    return low is not None and high is not None and low < high and not low <= value <= high


def _j1939_none_from(signal: Signal) -> float:
    """Return where J1939's error and not-available ranges begin: 0xFE in the highest byte."""
    if signal.kind is not RawKind.UNSIGNED or signal.length_bits not in (8, 16, 32) or signal.scale <= 0:
        return math.inf
    return _physical(signal, 0xFE << (signal.length_bits - 8))


def _find_signal(role: str, name: SignalName, messages: Mapping[str, Mapping[str, Message]]) -> _Place | Fault:
    where = f"vehicle.toml [signals] {role}"
    bus_name, _, path = name.signal.rpartition(":")
    if bus_name and bus_name not in messages:
        return Fault(
            f"no [[bus]] has the channel {bus_name!r}",
            where,
            repr(str(name)),
            nearest(bus_name, messages),
            "correct the bus before the colon, or add it as [[bus]]",
        )
    message_name, _, signal_name = path.partition(".")
    hits = [
        (bus, known[message_name])
        for bus, known in messages.items()
        if bus_name in ("", bus) and message_name in known and signal_name in known[message_name].by_name
    ]
    if len(hits) == 1:
        bus, message = hits[0]
        signal = message.by_name[signal_name]
        advice = "write the unit the sender uses into the DBC"
        return _Place(bus, message_name, signal_name, signal.unit, advice, no_data_of(message, signal))
    if hits:
        choices = " or ".join(f'"{bus}:{path}"' for bus, _ in hits)
        return Fault(f"{path} is on several buses", where, repr(str(name)), choices, "name the bus")
    searched = [known for bus, known in messages.items() if bus_name in ("", bus)]
    names = [f"{message}.{signal}" for known in searched for message, m in known.items() for signal in m.by_name]
    return Fault(
        f"no DBC has a signal {path!r}",
        where,
        repr(str(name)),
        nearest(path, names),
        "correct the name, or add its DBC to [[bus]] dbc",
    )
