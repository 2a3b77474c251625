"""Watched messages of a vehicle: each message of its DBCs with its arrivals, signal values and roles."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from daq import ROLES, ConfigError, Fault, FloatArray, HealthSection, IntArray, VehicleConfig, nearest
from daq.can import Database, Message, RawKind, Signal, messages_by_bus
from daq.can.roles import SignalRef, means_no_data, resolve_roles
from daq.logger.health.arrivals import MessageFlow, is_named_so
from daq.logger.health.report import Recent, SignalHealth

SATURATED_RUN = 3
"""So many samples in a row at the end of what the bits hold are no coincidence."""
LEAST_CHANGES = 50
"""A signal must have changed this often before it can be stuck."""
_LEAST_LEARN_NS = 5_000_000_000
_MUCH_LONGER = 4.0
_STUCK_LEAST_NS = 1_000_000_000
_RESTING_LONGER = 20.0
_RESTING_LEAST_NS = 10_000_000_000
_SATURABLE_BITS = 8
_LEAST_BITS = 5

_RESTING_ROLES = ("wheel_speed", "ground_speed", "latitude", "longitude", "course", "wheel_angle", "sinkage")

_OF_MESSAGES = ("may_be_silent", "may_be_constant", "may_leave_range")
_STEP = "correct [health] in vehicle.toml"


class SignalValues:
    """Follows the values of a message's signals, all at once.

    `names` are the signals in the order of the rows that `take` gets. Beside counters, flags and enumerations those of
    `constant` may stay the same as long as they like, and those of `at_rest` while the vehicle stands: `resting` is to
    be kept up to date.
    """

    def __init__(
        self, message: Message, names: Sequence[str], constant: Collection[str] = (), at_rest: Collection[str] = ()
    ) -> None:
        signals = [message.by_name[name] for name in names]
        size = len(signals)
        limits = np.array([_limits(signal) for signal in signals], np.float64).reshape(size, 2)
        ends = np.array([_ends(signal, j1939=message.j1939) for signal in signals], np.float64).reshape(size, 2)
        self._low, self._high = limits[:, :1], limits[:, 1:]
        self._bottom, self._top = ends[:, :1], ends[:, 1:]
        self.may_stick = np.array([s.name not in constant and _measures(s) for s in signals], np.bool_)
        self._labelled = [
            (row, raw * signal.scale + signal.offset) for row, signal in enumerate(signals) for raw in signal.labels
        ]
        self._at_rest = np.array([name in at_rest for name in names], np.bool_)
        self.resting = False
        self.last = np.full(size, np.nan)
        self.last_ns = np.zeros(size, np.int64)
        self.changes = np.zeros(size, np.int64)
        self.out_of_range = np.zeros(size, np.int64)
        self.saturated = np.zeros(size, np.int64)
        self.beyond_ns = np.zeros(size, np.int64)
        self.saturated_ns = np.zeros(size, np.int64)
        self.changed_ns = np.zeros(size, np.int64)
        self.first_ns = np.zeros(size, np.int64)
        self.longest_ns = np.zeros(size, np.int64)
        self._at_end = np.zeros((size, SATURATED_RUN - 1), np.bool_)

    def take(self, time_ns: IntArray, values: FloatArray) -> None:
        """Take decoded frames in order: values of shape (signals, n), NaN where a frame does not carry the signal."""
        if not values.size:
            return
        lacking = np.isnan(values)
        if lacking.any():
            for row in range(len(values)):
                there = np.flatnonzero(~lacking[row])
                if len(there):
                    self._take(slice(row, row + 1), time_ns[there], values[row : row + 1, there])
        else:
            self._take(slice(None), time_ns, values)

    def stuck_s(self) -> FloatArray:
        """Return how long each signal has been the same for much longer than ever before; 0 while it is not so.

        The time limits are longer while the vehicle stands.
        """
        same_ns = self.last_ns - self.changed_ns
        learned = (self.changes >= LEAST_CHANGES) & (self.changed_ns - self.first_ns >= _LEAST_LEARN_NS)
        least_ns, longer = (_RESTING_LEAST_NS, _RESTING_LONGER) if self.resting else (_STUCK_LEAST_NS, _MUCH_LONGER)
        limit_ns = np.maximum(least_ns, longer * self.longest_ns)
        return np.where(learned & self.may_stick & (same_ns > limit_ns), same_ns * 1e-9, 0.0)

    def _take(self, rows: slice, time_ns: IntArray, values: FloatArray) -> None:
        fresh = self.last_ns[rows] == 0
        if fresh.any():
            self.first_ns[rows][fresh] = self.changed_ns[rows][fresh] = time_ns[0]
            self.last[rows][fresh] = values[fresh, 0]
        self._count_changes(rows, time_ns, values)
        self._count_beyond_limits(rows, time_ns, values)
        self.last[rows] = values[:, -1]
        self.last_ns[rows] = time_ns[-1]

    def _count_changes(self, rows: slice, time_ns: IntArray, values: FloatArray) -> None:
        before = np.concatenate([self.last[rows, None], values[:, :-1]], axis=1)
        changed = values != before
        stamps = np.where(changed, time_ns, 0)
        stamps[:, 0] = np.maximum(stamps[:, 0], self.changed_ns[rows])
        latest = np.maximum.accumulate(stamps, axis=1)
        previous = np.concatenate([self.changed_ns[rows, None], latest[:, :-1]], axis=1)
        same = np.where(changed, time_ns - previous, 0).max(axis=1)
        changed_ns = latest[:, -1]
        if self.resting:
            same[self._at_rest[rows]] = 0
            changed_ns = np.where(self._at_rest[rows], time_ns[-1], changed_ns)
        self.longest_ns[rows] = np.maximum(self.longest_ns[rows], same)
        self.changes[rows] += np.count_nonzero(changed, axis=1)
        self.changed_ns[rows] = changed_ns

    def _count_beyond_limits(self, rows: slice, time_ns: IntArray, values: FloatArray) -> None:
        beyond = (values < self._low[rows]) | (values > self._high[rows])
        if beyond.any():
            # Do not count values with a label of their own as out of range.
            first = rows.start or 0
            for row, value in self._labelled:
                if first <= row < first + len(values):
                    beyond[row - first] &= values[row - first] != value
            self.out_of_range[rows] += np.count_nonzero(beyond, axis=1)
            self.beyond_ns[rows] = np.maximum(self.beyond_ns[rows], np.where(beyond, time_ns, 0).max(axis=1))
        at_end = (values <= self._bottom[rows]) | (values >= self._top[rows])
        at_end = np.concatenate([self._at_end[rows], at_end], axis=1)
        self._at_end[rows] = at_end[:, 1 - SATURATED_RUN :]
        if at_end.any():
            run = at_end[:, SATURATED_RUN - 1 :].copy()
            for shift in range(SATURATED_RUN - 1):
                run &= at_end[:, shift : shift + run.shape[1]]
            self.saturated[rows] += np.count_nonzero(run, axis=1)
            self.saturated_ns[rows] = np.maximum(self.saturated_ns[rows], np.where(run, time_ns, 0).max(axis=1))


def _measures(signal: Signal) -> bool:
    """Whether a signal measures something that changes: no counter, flag, status or enumeration."""
    enumeration = any(not means_no_data(label) for label in signal.labels.values())
    return not (enumeration or is_named_so(signal) or signal.length_bits < _LEAST_BITS)


def _limits(signal: Signal) -> tuple[float, float]:
    """Return the DBC's range, half a step wider; an empty range gives no limits."""
    low, high = signal.minimum, signal.maximum
    if low is None or high is None or low >= high:
        return -np.inf, np.inf
    half = abs(signal.scale) / 2
    return low - half, high + half


def _ends(signal: Signal, *, j1939: bool) -> tuple[float, float]:
    """Return the physical values at the ends of what the bits hold, infinite where an end means something else.

    The raw zero of an unsigned signal without offset is an ordinary zero, the highest value of a J1939 signal or one
    in the value table is "not available".
    """
    if signal.kind is RawKind.FLOAT or signal.length_bits < _SATURABLE_BITS:
        return -np.inf, np.inf
    low, high = signal.raw_range
    bottom, top = (raw * signal.scale + signal.offset for raw in (low, high))
    no_bottom = low in signal.labels or bottom == 0
    no_top = high in signal.labels or (j1939 and signal.kind is RawKind.UNSIGNED)
    ends = [-np.inf if no_bottom else float(bottom), np.inf if no_top else float(top)]
    if signal.scale < 0:
        return (float(top) if not no_top else -np.inf), (float(bottom) if not no_bottom else np.inf)
    return ends[0], ends[1]


@dataclass(frozen=True)
class WatchedMessage:
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
    lost: Recent = field(default_factory=Recent)
    missing: Recent = field(default_factory=Recent)
    repeated: Recent = field(default_factory=Recent)
    came: Recent = field(default_factory=Recent)
    rate: Recent = field(default_factory=Recent)

    @cached_property
    def initial_signals(self) -> list[SignalHealth]:
        """State of the signals before the first frame of the message."""
        roles = {signal: reference.role for signal, reference in self.roles.items()}
        return [
            SignalHealth(self.bus, f"{self.name}.{name}", self.message.by_name[name].unit, roles.get(name, ""))
            for name in self.names
        ]

    def listed(self, names: tuple[str, ...], signal: str = "") -> bool:
        """Whether the message, or this signal of it, is in a list of ``[health]``."""
        return self.name in names or (bool(signal) and f"{self.name}.{signal}" in names)


def usable_roles(
    vehicle: VehicleConfig, databases: Mapping[str, Sequence[Database]], roles: Iterable[str] = ROLES
) -> tuple[dict[str, SignalRef], dict[str, Fault]]:
    """Return those of the roles of vehicle.toml that can be resolved, and the fault of each that cannot."""
    usable: dict[str, SignalRef] = {}
    faults: dict[str, Fault] = {}
    for role in roles:
        try:
            usable |= resolve_roles(vehicle, databases, (), (role,))
        except ConfigError as error:
            faults[role] = error.faults[0]
    return usable, faults


def watched_messages(
    databases: Mapping[str, tuple[Database, ...]], roles: Mapping[str, SignalRef], health: HealthSection
) -> list[WatchedMessage]:
    """Return every message of the databases."""
    watched = []
    for bus, messages in messages_by_bus(databases).items():
        for name, message in messages.items():
            signals = tuple(message.by_name)
            keys = tuple((bus, f"{name}.{signal}") for signal in signals)
            mine = {
                reference.signal: reference
                for reference in roles.values()
                if (reference.bus, reference.message) == (bus, name)
            }
            constant = {s for s in signals if name in health.may_be_constant or f"{name}.{s}" in health.may_be_constant}
            at_rest = {signal for signal, reference in mine.items() if reference.role in _RESTING_ROLES}
            flow, values = MessageFlow(message, signals), SignalValues(message, signals, constant, at_rest)
            watched.append(WatchedMessage(bus, name, message, signals, keys, flow, values, mine))
    return watched


def unknown_names(vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]) -> Iterator[Fault]:
    """Yield a fault for each name in ``[health]`` that no DBC and no bus has.

    Of a vehicle without databases the names of messages and signals are not checked. `DatabaseError` where those of a
    bus contradict each other.
    """
    messages: set[str] = set()
    signals: set[str] = set()
    for of_bus in messages_by_bus(databases).values():
        messages |= set(of_bus)
        signals |= {f"{name}.{signal}" for name, message in of_bus.items() for signal in message.by_name}
    for key in _OF_MESSAGES if messages else ():
        for name in getattr(vehicle.health, key):
            known = signals if "." in name else messages
            if name not in messages | signals:
                what = f"no {'signal' if known is signals else 'message'} of the DBCs is called {name!r}"
                yield Fault(what, f"[health] {key}", expected=nearest(name, known), next_step=_STEP)
    buses = {bus.channel for bus in vehicle.bus}
    for name in vehicle.health.may_carry_unknown:
        if name not in buses:
            what = f"no bus is called {name!r}"
            yield Fault(what, "[health] may_carry_unknown", expected=nearest(name, buses), next_step=_STEP)
