"""HealthMonitor: everything that is watched while a vehicle is recorded, and the report of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.buses import messages_by_bus
from daq.channel import Channel
from daq.config import ROLES, VehicleConfig
from daq.databases import Database
from daq.errors import ConfigError
from daq.frames import FrameArray, FrameBatch, FrameFlag
from daq.health.board import Board, reason
from daq.health.flow import MessageFlow
from daq.health.report import (
    BusFacts,
    BusHealth,
    HealthReport,
    HostFacts,
    Level,
    MessageHealth,
    Reason,
    SignalHealth,
)
from daq.health.traffic import BusTraffic
from daq.health.values import SignalValues
from daq.identify import UNKNOWN, Identifier
from daq.layout import Message
from daq.roles import SignalRef, resolve_roles

_START_NS = 5_000_000_000
_SILENT_S = 2.0
_LOSING_NS = 10_000_000_000
_UNKNOWN_SHARE = 0.05
_BEHIND = 0.25


@dataclass
class Watched:
    """A DBC message of a bus and what is followed of it."""

    bus: str
    name: str
    message: Message
    names: list[str]
    flow: MessageFlow
    values: SignalValues
    roles: dict[str, SignalRef]


class HealthMonitor:
    """Watches what comes in.

    Parameters
    ----------
    vehicle : VehicleConfig
    databases : mapping bus -> databases
    started_ns : int
        When the logger started, on the recording's time base.
    """

    def __init__(
        self, vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]], *, started_ns: int
    ) -> None:
        self._vehicle = vehicle
        self._started_ns = started_ns
        self._roles = _usable_roles(vehicle, databases)
        self._watched = _watch(databases, self._roles)
        self._identifier = Identifier(
            [(one.bus, one.message, code) for code, one in enumerate(self._watched, UNKNOWN + 1)]
        )
        self._bit_rates = {bus.channel: bus.bitrate for bus in vehicle.bus}
        self._traffic = {bus.channel: BusTraffic() for bus in vehicle.bus}
        self._dropped_ns: dict[tuple[str, str], int] = {}
        self._dropped: dict[tuple[str, str], int] = {}
        self._board = Board()

    def take(self, batch: FrameBatch, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take recorded frames and what they decode to.

        Parameters
        ----------
        batch : FrameBatch
            In the order in which they were received.
        decoded : mapping (bus, "Message.Signal") -> Channel
            Of the same frames, as `daq.decode.Decoder` returns it.
        """
        self._take_traffic(batch)
        for one in self._watched:
            channels = [decoded.get((one.bus, f"{one.name}.{name}")) for name in one.names]
            first = next((channel for channel in channels if channel is not None), None)
            if first is None or not len(first):
                continue
            values = np.array([channel.values for channel in channels if channel is not None])
            one.flow.take(first.time_ns, values)
            one.values.take(first.time_ns, values)

    def skip(self, batch: FrameBatch) -> None:
        """Take frames that were recorded, but not decoded: nothing of them is missing."""
        codes = self._take_traffic(batch)
        for code in np.unique(codes).tolist():
            if code != UNKNOWN:
                self._watched[code - 1].flow.skip(np.sort(batch.frames["time_ns"][codes == code]))

    def losses(self) -> dict[str, int]:
        """Return what was lost since the start.

        Returns
        -------
        dict
            ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>`` and ``missing.<bus>.<message>``, where they
            are not 0. One loss can stand under a bus and under a message.
        """
        lost = {f"{kind}.{bus}": count for (kind, bus), count in self._dropped.items()}
        for one in self._watched:
            lost[f"counter.{one.bus}.{one.name}"] = one.flow.counter_lost
            lost[f"missing.{one.bus}.{one.name}"] = one.flow.missing
        return {name: count for name, count in lost.items() if count}

    def report(self, now_ns: int, host: HostFacts) -> HealthReport:
        """Return the state at `now_ns`, on the time base of the frames."""
        found: list[Reason] = []
        buses = {name: self._bus(name, now_ns, host, found) for name in self._traffic}
        messages = [self._message(one, now_ns, found) for one in self._watched]
        reasons = self._board.update(now_ns, found)
        worst = max((one.level for one in reasons), default=Level.GREEN)
        return HealthReport(
            time_ns=now_ns,
            level=worst,
            reasons=reasons,
            buses=tuple(buses.values()),
            messages=tuple(messages),
            signals=tuple(signal for one in self._watched for signal in self._signals(one, now_ns)),
            gnss=None,
            host=host,
            losses=self.losses(),
        )

    def _take_traffic(self, batch: FrameBatch) -> NDArray[Any]:
        codes = self._identifier.codes(batch.frames, batch.buses)
        for number, bus in enumerate(batch.buses):
            rows = batch.frames["bus"] == number
            frames: FrameArray = batch.frames[rows]
            data = (frames["flags"] & FrameFlag.ERROR) == 0
            known = codes[rows] != UNKNOWN
            self._traffic.setdefault(bus, BusTraffic()).take(
                frames, int(np.count_nonzero(known)), frames[data & ~known]
            )
        return codes

    def _bus(self, name: str, now_ns: int, host: HostFacts, found: list[Reason]) -> BusHealth:
        traffic = self._traffic[name]
        facts = host.buses.get(name, BusFacts("up", traffic.frames, None))
        rate_hz, bit_rate, unknown = traffic.rates(now_ns)
        mine = self._drops(name, now_ns, facts)
        quiet_ns = now_ns - (traffic.last_ns or self._started_ns)
        if facts.state == "down":
            mine.append(reason("bus_down", Level.RED, name, facts.detail or "the interface is down"))
        elif facts.state == "bus_off":
            mine.append(reason("bus_off", Level.RED, name, facts.detail or "the controller is bus-off"))
        elif host.queue_share < _BEHIND and quiet_ns * 1e-9 > (_SILENT_S if traffic.last_ns else _START_NS * 1e-9):
            level = Level.RED if any(one.bus == name for one in self._roles.values()) else Level.AMBER
            mine.append(reason("bus_silent", level, name, f"no frame for {quiet_ns * 1e-9:.0f} s"))
        if traffic.last_ns is not None and unknown > _UNKNOWN_SHARE and any(one.bus == name for one in self._watched):
            what = f"{100 * unknown:.0f} % of the frames are in no DBC, e.g. {', '.join(traffic.ids())}"
            mine.append(reason("unknown_frames", Level.AMBER, name, what))
        found += mine
        bit_limit = self._bit_rates.get(name)
        return BusHealth(
            name,
            max((one.level for one in mine), default=Level.GREEN),
            facts,
            rate_hz,
            bit_rate / bit_limit if bit_limit else float("nan"),
            traffic.age_s(now_ns),
            traffic.error_frames,
            traffic.unknown,
        )

    def _drops(self, name: str, now_ns: int, facts: BusFacts) -> list[Reason]:
        mine = []
        for kind, count in (("kernel", facts.kernel_drops or 0), ("queue", facts.queue_drops)):
            if count > self._dropped.get((kind, name), 0):
                self._dropped_ns[kind, name] = now_ns
            self._dropped[kind, name] = count
            if count:
                now = now_ns - self._dropped_ns[kind, name] < _LOSING_NS
                mine.append(
                    reason(f"{kind}_drops", Level.RED if now else Level.AMBER, name, f"lost {count} frames so far")
                )
        return mine

    def _message(self, one: Watched, now_ns: int, found: list[Reason]) -> MessageHealth:
        flow = one.flow
        where, level = f"{one.bus}: {one.name}", Level.GREEN
        if flow.silent(now_ns) and one.name not in self._vehicle.health.may_be_silent:
            level = Level.RED if one.roles else Level.AMBER
            what = f"has not come for {flow.age_s(now_ns):.1f} s, usually every {flow.period_s:.3g} s"
            found.append(reason("message_missing", level, where, what, bus=one.bus))
        usual_hz = 1 / flow.period_s
        return MessageHealth(
            one.bus,
            one.name,
            level,
            flow.rate_hz(now_ns),
            usual_hz,
            flow.age_s(now_ns),
            flow.frames,
            flow.gaps,
            flow.missing,
            flow.counter_lost,
        )

    def _signals(self, one: Watched, now_ns: int) -> list[SignalHealth]:
        role_of = {reference.signal: role for role, reference in one.roles.items()}
        stuck_s = one.values.stuck_s(now_ns)
        columns = zip(
            one.names,
            one.values.last.tolist(),
            one.values.out_of_range.tolist(),
            one.values.saturated.tolist(),
            stuck_s.tolist(),
            strict=True,
        )
        return [
            SignalHealth(
                one.bus,
                f"{one.name}.{name}",
                one.message.by_name[name].unit,
                role_of.get(name, ""),
                Level.GREEN,
                value,
                out,
                saturated,
                stuck,
            )
            for name, value, out, saturated, stuck in columns
        ]


def _usable_roles(vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]]) -> dict[str, SignalRef]:
    """Return the roles that can be resolved; `log` records with a wrong one all the same."""
    usable: dict[str, SignalRef] = {}
    for role in ROLES:
        try:
            usable |= resolve_roles(vehicle, databases, (), (role,))
        except ConfigError:
            continue
    return usable


def _watch(databases: Mapping[str, tuple[Database, ...]], roles: Mapping[str, SignalRef]) -> list[Watched]:
    watched = []
    for bus, messages in messages_by_bus(databases).items():
        for name, message in messages.items():
            names = list(message.by_name)
            mine = {role: one for role, one in roles.items() if (one.bus, one.message) == (bus, name)}
            watched.append(
                Watched(bus, name, message, names, MessageFlow(message, names), SignalValues(message, names), mine)
            )
    return watched
