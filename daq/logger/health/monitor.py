"""HealthMonitor: everything that is watched while a vehicle is recorded, and its report, also as ROS diagnostics.

A batch of frames costs the same few calls on columns however many frames it has; the reasons are found at the pace of
the reports.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import Channel, VehicleConfig
from daq.can import Database, FrameArray, FrameBatch, FrameFlag
from daq.can.identify import UNKNOWN, Identifier
from daq.logger.health.bus_health import BusWatch
from daq.logger.health.host_health import Gnss, HostWatch
from daq.logger.health.message_health import (
    Motion,
    Scene,
    grouped_reasons,
    message_health,
    role_values,
    signal_health,
)
from daq.logger.health.report import (
    Board,
    BusHealth,
    GnssHealth,
    HealthReport,
    HostStatus,
    Level,
    MessageHealth,
    Reason,
    SignalHealth,
    reason,
    worst,
)
from daq.logger.health.watched_messages import unknown_names, usable_roles, watched_messages
from daq.recording.events import DiagnosticStatus

_NO_DATA = FrameFlag.ERROR | FrameFlag.REMOTE

_OF_MESSAGE = ("rate_hz", "usual_rate_hz", "age_s", "frames", "gaps", "missing", "counter_jumps")
_OF_SIGNAL = ("role", "value", "unit", "stuck_s", "out_of_range", "saturated")


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
        roles, faults = usable_roles(vehicle, databases)
        self._always = [
            reason("role_unusable", Level.AMBER, f"[signals] {role}", fault.what, next_step=fault.next_step)
            for role, fault in faults.items()
        ]
        for fault in unknown_names(vehicle, databases):
            what = f"{fault.what} ({fault.expected})"
            self._always.append(reason("health_name_unknown", Level.AMBER, fault.where, what))
        self._watched = watched_messages(databases, roles, vehicle.health)
        self._identifier = Identifier(
            [(message.bus, message.message, code) for code, message in enumerate(self._watched, UNKNOWN + 1)]
        )
        self._roles = roles
        self._role_messages = frozenset((message.bus, message.name) for message in self._watched if message.roles)
        described = {message.bus for message in self._watched}
        self._buses = {
            bus.channel: BusWatch(
                bus.channel,
                bus.bitrate,
                described=bus.channel in described,
                has_roles=any(reference.bus == bus.channel for reference in roles.values()),
                may_be_unknown=bus.channel in vehicle.health.may_carry_unknown,
                started_ns=started_ns,
            )
            for bus in vehicle.bus
        }
        self._gnss = Gnss(roles, started_ns)
        self._motion = Motion(vehicle.wheel.rolling_m if vehicle.wheel else None)
        self._host = HostWatch(vehicle.logger)
        self._board = Board()

    def take(self, batch: FrameBatch, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Take recorded frames and what they decode to.

        Parameters
        ----------
        batch : FrameBatch
            In the order in which they were received.
        decoded : mapping (bus, "Message.Signal") -> Channel
            Of the same frames: all signals of every message that came, as `daq.can.codec.Decoder` returns them.
        """
        self._take_traffic(batch)
        uncertain = bool(np.bitwise_or.reduce(batch.frames["flags"], initial=0) & FrameFlag.UNCERTAIN_TIME)
        for message in self._watched:
            if not message.keys or message.keys[0] not in decoded:
                continue
            time_ns = decoded[message.keys[0]].time_ns
            if not len(time_ns):
                continue
            values = np.array([decoded[key].values for key in message.keys])
            if uncertain:
                message.flow.forget_last()
            message.flow.take(time_ns, values)
            if uncertain:
                message.flow.forget_last()
            message.values.take(time_ns, values)
        self._gnss.take(decoded)

    def skip(self, batch: FrameBatch) -> None:
        """Take frames that were recorded, but not decoded: nothing of them is missing."""
        codes = self._take_traffic(batch)
        times = batch.frames["time_ns"]
        until_ns = int(times.max(initial=0))
        for code, message in enumerate(self._watched, UNKNOWN + 1):
            message.flow.skip(np.sort(times[codes == code]), until_ns)
        self._gnss.skip(until_ns)

    def losses(self) -> dict[str, int]:
        """Return the counts of lost frames since the start that are not 0.

        They are ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>`` and ``missing.<bus>.<message>``. A
        message with a rolling counter has no ``missing``; ``wrapped.<bus>.<message>`` says in how many gaps the counter
        may have gone round more often than its count has, which is then the least. Frames lost by the kernel or given
        up by the logger are
        counted for their bus and, where a message notices them, there too.
        """
        lost: dict[str, int] = {}
        for bus in self._buses.values():
            lost |= bus.losses()
        for message in self._watched:
            lost[f"counter.{message.bus}.{message.name}"] = message.flow.counter_lost
            lost[f"wrapped.{message.bus}.{message.name}"] = message.flow.wrapped
            if not message.listed(self._health.may_be_silent):
                lost[f"missing.{message.bus}.{message.name}"] = message.flow.missing
        return {name: count for name, count in lost.items() if count}

    def report(self, now_ns: int, host: HostStatus) -> HealthReport:
        """Return the state of everything.

        `now_ns` is on the time base of the frames; all frames that came before have been taken or skipped, or are in
        the queue.
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
        found += self._motion.reasons(now_ns, self._roles)
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
            frames: FrameArray = batch.frames
            unknown = codes == UNKNOWN
            if not single:
                rows = np.flatnonzero(batch.frames["bus"] == number)
                frames, unknown = frames.take(rows), unknown[rows]
            if np.bitwise_or.reduce(frames["flags"], initial=0) & _NO_DATA:
                unknown &= (frames["flags"] & _NO_DATA) == 0
            self._buses[bus].traffic.take(frames, frames.take(np.flatnonzero(unknown)))
        return codes

    def _report_buses(self, now_ns: int, host: HostStatus, found: list[Reason]) -> list[BusHealth]:
        states = []
        for bus in self._buses.values():
            state, reasons = bus.health(now_ns, host)
            states.append(state)
            found += reasons
        return states

    def _report_messages(self, now_ns: int, found: list[Reason]) -> list[MessageHealth]:
        active = {name: bus.active(now_ns) and bus.fits(now_ns) for name, bus in self._buses.items()}
        states, reasons = [], []
        for message in self._watched:
            state, mine = message_health(
                message, now_ns, self._health, started_ns=self._started_ns, bus_active=active.get(message.bus, False)
            )
            states.append(state)
            reasons += mine
        found += grouped_reasons(reasons, self._role_messages)
        return states

    def _report_signals(self, scene: Scene, found: list[Reason]) -> list[SignalHealth]:
        states = []
        for message in self._watched:
            if message.flow.last_ns is None:
                states += message.initial_signals
                continue
            message.values.resting = self._motion.resting
            mine, reasons = signal_health(message, scene)
            states += mine
            found += reasons
        return states

    def _report_gnss(self, now_ns: int, values: Mapping[str, float], found: list[Reason]) -> GnssHealth | None:
        source = self._gnss.fix_signal
        period_s = next(
            (message.flow.period_s for message in self._watched if source in message.roles.values()), math.nan
        )
        active = source is None or (source.bus in self._buses and self._buses[source.bus].active(now_ns))
        result = self._gnss.health(now_ns, values, period_s, bus_active=active)
        if result is None:
            return None
        found += result[1]
        return result[0]


def statuses(report: HealthReport) -> list[DiagnosticStatus]:
    """Return a status for everything that is worth one.

    Names are ``can0``, ``can0/WFT_Forces``, ``can0/WFT_Forces.Fz``, ``gnss`` and ``host``. A reason is listed at
    the bus where its place has no status of its own, and else at the host. Values that are not known are omitted.
    """
    known = {bus.name: _bus(bus) for bus in report.buses}
    for message in report.messages:
        if message.frames or message.level:
            known[f"{message.bus}/{message.name}"] = {key: getattr(message, key) for key in _OF_MESSAGE}
    for signal in report.signals:
        if signal.role:
            known[f"{signal.bus}/{signal.name}"] = {key: getattr(signal, key) for key in _OF_SIGNAL}
    if report.gnss is not None:
        known["gnss"] = _gnss(report.gnss)
    known["host"] = _host(report.host)
    placed: dict[str, list[Reason]] = {name: [] for name in known}
    for entry in report.reasons:
        places = (f"{entry.bus}/{entry.name}", entry.bus, "host")
        placed[next(place for place in places if place in placed)].append(entry)
    return [_status(name, values, placed[name]) for name, values in known.items()]


def _status(name: str, values: Mapping[str, float | str], reasons: list[Reason]) -> DiagnosticStatus:
    level = worst(reasons)
    text = "; ".join(f"{reason.code}: {reason.what}" for reason in reasons) if level else "ok"
    texts = {key: value if isinstance(value, str) else _number(value) for key, value in values.items()}
    return DiagnosticStatus(int(level), name, text, values={key: value for key, value in texts.items() if value})


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}" if isinstance(value, float) else str(value)


def _bus(bus: BusHealth) -> dict[str, float | str]:
    status = bus.status
    return {
        "state": status.state,
        "rate_hz": bus.rate_hz,
        "load_percent": 100.0 * bus.load,
        "frames": status.received,
        "kernel_drops": math.nan if status.kernel_drops is None else status.kernel_drops,
        "queue_drops": status.queue_drops,
        "error_frames": bus.error_frames,
        "unknown_frames": bus.unknown_frames,
    }


def _gnss(gnss: GnssHealth) -> dict[str, float | str]:
    values: dict[str, float | str] = {"age_s": gnss.age_s}
    if gnss.fix is not None:
        values["fix"] = "yes" if gnss.fix else "no"
    if gnss.clock is not None:
        fit = gnss.clock
        values |= {"offset_s": fit.offset_s, "drift_ppm": fit.drift_ppm, "residual_s": fit.residual_s}
    return values


def _host(host: HostStatus) -> dict[str, float | str]:
    return {
        "disk_free_mb": host.disk_free_bytes * 1e-6,
        "disk_bytes_per_s": host.disk_bytes_per_s,
        "queue_percent": 100.0 * host.queue_share,
        "skipped_frames": host.skipped_frames,
        "cpu_percent": 100.0 * host.cpu_share,
        "rss_mb": host.rss_bytes * 1e-6,
        "clock_steps": host.clock_steps,
    }
