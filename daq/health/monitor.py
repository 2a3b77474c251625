"""HealthMonitor: everything that is watched while a vehicle is recorded, and the report of it.

A batch of frames costs the same few calls on columns however many frames it has; the reasons are found at the pace of
the reports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.channel import Channel
from daq.config import VehicleConfig
from daq.databases import Database
from daq.frames import FrameArray, FrameBatch, FrameFlag
from daq.health.board import Board, reason, worst
from daq.health.bus_health import BusWatch
from daq.health.gnss import Gnss
from daq.health.host_health import HostWatch
from daq.health.message_health import gathered, message_health
from daq.health.motion import Motion
from daq.health.names import unknown_names
from daq.health.report import BusHealth, GnssHealth, HealthReport, HostFacts, Level, MessageHealth, Reason, SignalHealth
from daq.health.signal_health import Scene, role_values, signal_health
from daq.health.watched import usable_roles, watch
from daq.identify import UNKNOWN, Identifier

_NO_DATA = FrameFlag.ERROR | FrameFlag.REMOTE


class HealthMonitor:
    """Watches what comes in.

    Parameters
    ----------
    vehicle : VehicleConfig
        A role that names no signal is a reason of the report, not an error: frames are recorded all the same.
    databases : mapping bus -> databases
    started_ns : int
        When the logger started, on the recording's time base.

    Raises
    ------
    DatabaseError
        The databases of a bus contradict each other.
    """

    def __init__(
        self, vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]], *, started_ns: int
    ) -> None:
        self._health = vehicle.health
        self._started_ns = started_ns
        roles, self._always = usable_roles(vehicle, databases)
        for fault in unknown_names(vehicle, databases):
            what = f"{fault.what} ({fault.expected})"
            self._always.append(reason("health_name_unknown", Level.AMBER, fault.where, what))
        self._watched = watch(databases, roles, vehicle.health)
        self._identifier = Identifier(
            [(one.bus, one.message, code) for code, one in enumerate(self._watched, UNKNOWN + 1)]
        )
        self._where = {role: f"{one.bus}: {one.name}" for role, one in roles.items()}
        self._role_messages = frozenset(one.where for one in self._watched if one.roles)
        described = {one.bus for one in self._watched}
        self._buses = {
            bus.channel: BusWatch(
                bus.channel,
                bus.bitrate,
                described=bus.channel in described,
                has_roles=any(one.bus == bus.channel for one in roles.values()),
                may_be_unknown=bus.channel in vehicle.health.may_carry_unknown,
                started_ns=started_ns,
            )
            for bus in vehicle.bus
        }
        self._gnss = Gnss(roles, started_ns)
        self._motion = Motion(vehicle.wheel.radius_m if vehicle.wheel else None)
        self._host = HostWatch(vehicle.logger)
        self._board = Board()

    def take(self, batch: FrameBatch, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take recorded frames and what they decode to.

        Parameters
        ----------
        batch : FrameBatch
            In the order in which they were received.
        decoded : mapping (bus, "Message.Signal") -> Channel
            Of the same frames: all signals of every message that came, as `daq.decode.Decoder` returns them.
        """
        self._take_traffic(batch)
        unsure = bool(np.bitwise_or.reduce(batch.frames["flags"], initial=0) & FrameFlag.UNSURE_TIME)
        for one in self._watched:
            if not one.keys or one.keys[0] not in decoded:
                continue
            time_ns = decoded[one.keys[0]].time_ns
            if not len(time_ns):
                continue
            values = np.array([decoded[key].values for key in one.keys])
            if unsure:
                one.flow.forget_last()
            one.flow.take(time_ns, values)
            if unsure:
                one.flow.forget_last()
            one.values.take(time_ns, values)
        self._gnss.take(decoded)

    def skip(self, batch: FrameBatch) -> None:
        """Take frames that were recorded, but not decoded: nothing of them is missing."""
        codes = self._take_traffic(batch)
        times = batch.frames["time_ns"]
        until_ns = int(times.max(initial=0))
        for code, one in enumerate(self._watched, UNKNOWN + 1):
            one.flow.skip(np.sort(times[codes == code]), until_ns)
        self._gnss.skip(until_ns)

    def losses(self) -> dict[str, int]:
        """Return what was lost since the start.

        Returns
        -------
        dict
            ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>`` and ``missing.<bus>.<message>``, where they
            are not 0. A message with a rolling counter has no ``missing``. What the kernel lost, or the logger gave
            up, is told once for its bus and, as far as it was noticed there, once more by the messages.
        """
        lost: dict[str, int] = {}
        for bus in self._buses.values():
            lost |= bus.losses()
        for one in self._watched:
            lost[f"counter.{one.bus}.{one.name}"] = one.flow.counter_lost
            if not one.listed(self._health.may_be_silent):
                lost[f"missing.{one.bus}.{one.name}"] = one.flow.missing
        return {name: count for name, count in lost.items() if count}

    def report(self, now_ns: int, host: HostFacts) -> HealthReport:
        """Return the state of everything.

        Parameters
        ----------
        now_ns : int
            On the time base of the frames; all frames that came before have been taken or skipped, or are in the queue.
        host : HostFacts
        """
        found = [*self._always, *self._host.reasons(now_ns, host)]
        buses = self._report_buses(now_ns, host, found)
        messages = self._report_messages(now_ns, found)
        values = role_values(self._watched)
        gnss = self._report_gnss(now_ns, values, found)
        has_fix = gnss is None or gnss.fix is not False
        if not has_fix:
            values.pop("ground_speed", None)
        self._motion.take(now_ns, values)
        found += self._motion.reasons(now_ns, self._where)
        signals = self._report_signals(Scene(now_ns, self._health, self._motion, has_fix), found)
        reasons = self._board.update(now_ns, found)
        return HealthReport(
            time_ns=now_ns,
            level=worst(reasons),
            reasons=reasons,
            buses=tuple(buses),
            messages=tuple(messages),
            signals=tuple(signals),
            gnss=gnss,
            host=host,
            losses=self.losses(),
        )

    def _take_traffic(self, batch: FrameBatch) -> NDArray[Any]:
        """Count the frames of every bus; return the place of each frame's message, plus one."""
        codes = self._identifier.codes(batch.frames, batch.buses)
        single = len(batch.buses) == 1
        for number, bus in enumerate(batch.buses):
            if bus not in self._buses:
                continue
            rows = None if single else np.flatnonzero(batch.frames["bus"] == number)
            frames: FrameArray = batch.frames if rows is None else batch.frames.take(rows)
            unknown = (codes if rows is None else codes[rows]) == UNKNOWN
            if np.bitwise_or.reduce(frames["flags"], initial=0) & _NO_DATA:
                unknown &= (frames["flags"] & _NO_DATA) == 0
            self._buses[bus].traffic.take(frames, frames.take(np.flatnonzero(unknown)))
        return codes

    def _report_buses(self, now_ns: int, host: HostFacts, found: list[Reason]) -> list[BusHealth]:
        states = []
        for bus in self._buses.values():
            state, reasons = bus.health(now_ns, host)
            states.append(state)
            found += reasons
        return states

    def _report_messages(self, now_ns: int, found: list[Reason]) -> list[MessageHealth]:
        heard = {name: bus.heard(now_ns) and bus.fits(now_ns) for name, bus in self._buses.items()}
        states, reasons = [], []
        for one in self._watched:
            state, mine = message_health(
                one, now_ns, self._health, started_ns=self._started_ns, heard=heard.get(one.bus, False)
            )
            states.append(state)
            reasons += mine
        found += gathered(reasons, self._role_messages)
        return states

    def _report_signals(self, scene: Scene, found: list[Reason]) -> list[SignalHealth]:
        states = []
        for one in self._watched:
            if one.flow.last_ns is None:
                states += one.unseen
                continue
            one.values.resting = self._motion.resting
            mine, reasons = signal_health(one, scene)
            states += mine
            found += reasons
        return states

    def _report_gnss(self, now_ns: int, values: Mapping[str, float], found: list[Reason]) -> GnssHealth | None:
        source = self._gnss.told_by
        period_s = next((one.flow.period_s for one in self._watched if source in one.roles.values()), math.nan)
        heard = source is None or (source.bus in self._buses and self._buses[source.bus].heard(now_ns))
        told = self._gnss.health(now_ns, values, period_s, heard=heard)
        if told is None:
            return None
        found += told[1]
        return told[0]
