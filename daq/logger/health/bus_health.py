"""Faults of buses and messages: down, silent, losing frames, late, unknown to every DBC."""

from __future__ import annotations

import math
from collections.abc import Sequence

from daq.config import HealthSection
from daq.logger.health.report import (
    RECENT_NS,
    BusHealth,
    BusStatus,
    HostStatus,
    Level,
    MessageHealth,
    Reason,
    Recent,
    reason,
    worst,
)
from daq.logger.health.traffic import BusTraffic
from daq.logger.health.watched import Watched

_SILENT_AFTER_NS, _SILENT_FROM_START_NS = 2_000_000_000, 5_000_000_000
_UNKNOWN_SHARE = 0.05
_BEHIND = 0.25
_RETURN_REPORTED_NS = 60_000_000_000


class BusWatch:
    """Follows one bus from report to report.

    Parameters
    ----------
    described, has_roles, may_be_unknown : bool
        Whether a DBC describes it; whether a role's signal is on it; whether it may carry what no DBC knows.
    """

    def __init__(
        self,
        name: str,
        bit_rate: int | None,
        *,
        described: bool,
        has_roles: bool,
        may_be_unknown: bool,
        started_ns: int,
    ) -> None:
        self.name = name
        self.traffic = BusTraffic()
        self.status = BusStatus("up", 0, None)
        self._bit_rate = bit_rate
        self._described = described
        self._judge_ids = described and not may_be_unknown
        self._level = Level.RED if has_roles else Level.AMBER
        self._started_ns = self._away_ns = started_ns
        self._kernel, self._queue, self._returns = Recent(), Recent(), Recent()

    def active(self, now_ns: int, age_ns: int = 500_000_000) -> bool:
        """Whether it is carrying frames, so that a missing message is a matter of its own."""
        return self.traffic.last_ns is not None and now_ns - self.traffic.last_ns < age_ns

    def fits(self, now_ns: int) -> bool:
        """Whether a message of its DBCs has come; True while it is too early to decide."""
        early = now_ns - self._started_ns < _SILENT_FROM_START_NS
        return early or not self._described or not self.traffic.frames or self.traffic.known > 0

    def health(self, now_ns: int, host: HostStatus) -> tuple[BusHealth, list[Reason]]:
        """Return the state of the bus and what is wrong with it."""
        traffic = self.traffic
        self.status = host.buses.get(self.name, BusStatus("up", traffic.frames, None))
        if self.status.state != "up":
            self._away_ns = now_ns
        rate_hz, bit_rate, unknown = traffic.rates(now_ns)
        found = self._state(now_ns, host) + self._drops(now_ns)
        if self.status.state == "up":
            found += traffic.errors.reasons(self.name, now_ns, traffic.last_data_ns)
        found += self._unknown(now_ns, unknown)
        state = BusHealth(
            name=self.name,
            level=worst(found),
            status=self.status,
            rate_hz=rate_hz,
            load=bit_rate / self._bit_rate if self._bit_rate else math.nan,
            age_s=math.nan if traffic.last_ns is None else (now_ns - traffic.last_ns) * 1e-9,
            error_frames=traffic.errors.count,
            unknown_frames=traffic.unknown,
        )
        return state, found

    def losses(self) -> dict[str, int]:
        """Return what was lost on the bus, by who lost it."""
        return {f"kernel.{self.name}": self.status.kernel_drops or 0, f"queue.{self.name}": self.status.queue_drops}

    def _state(self, now_ns: int, host: HostStatus) -> list[Reason]:
        status, found = self.status, []
        self._returns.take(now_ns, status.reconnects)
        if status.state == "down":
            found.append(reason("bus_down", self._level, self.name, status.detail or "the interface is down"))
        elif status.state == "bus_off":
            found.append(reason("bus_off", self._level, self.name, status.detail or "the controller is off the bus"))
        else:
            found += self._silence(now_ns, host)
            if self._returns.last_ns is not None and now_ns - self._returns.last_ns < _RETURN_REPORTED_NS:
                what = f"the bus was lost and came back, {status.reconnects} times so far"
                found.append(reason("bus_returned", Level.AMBER, self.name, what))
        return found

    def _silence(self, now_ns: int, host: HostStatus) -> list[Reason]:
        last_ns = self.traffic.last_data_ns
        quiet_ns = now_ns - max(self._away_ns, last_ns or 0)
        limit_ns = _SILENT_FROM_START_NS if last_ns is None else _SILENT_AFTER_NS
        if quiet_ns < limit_ns or host.queue_share > _BEHIND:
            return []
        what = (
            f"no frame for {quiet_ns * 1e-9:.1f} s"
            if last_ns
            else f"no frame since the start {quiet_ns * 1e-9:.0f} s ago"
        )
        return [reason("bus_silent", self._level, self.name, what)]

    def _drops(self, now_ns: int) -> list[Reason]:
        found = []
        for code, recent, count in (
            ("kernel_drops", self._kernel, self.status.kernel_drops or 0),
            ("queue_drops", self._queue, self.status.queue_drops),
        ):
            now = recent.take(now_ns, count)
            if count:
                level = Level.RED if now else Level.AMBER
                what = f"lost {count} frames so far, {now} of them in the last {RECENT_NS * 1e-9:.0f} s"
                found.append(reason(code, level, self.name, what))
        return found

    def _unknown(self, now_ns: int, share: float) -> list[Reason]:
        ids = ", ".join(self.traffic.ids())
        if not self.fits(now_ns):
            what = f"none of the DBC's messages has come, but {self.traffic.frames} frames, e.g. {ids}"
            return [reason("dbc_does_not_fit", Level.AMBER, self.name, what)]
        early = now_ns - self._started_ns < _SILENT_FROM_START_NS
        if early or not self._judge_ids or share <= _UNKNOWN_SHARE:
            return []
        what = f"{100 * share:.0f} % of the frames are in no DBC, e.g. {ids}"
        return [reason("unknown_frames", Level.AMBER, self.name, what)]


_ABSENT_AFTER_NS = 5_000_000_000
_MISSING_SHARE = 0.02
_DOUBLED_LEAST = 3
_REPEATED_SHARE = 0.5
_REPEATED_LEAST = 10
_NAMED_MOST = 3
_TOGETHER = ("counter_jump", "frames_missing")
_TOGETHER_NAMED_MOST = 8


def message_health(
    one: Watched, now_ns: int, health: HealthSection, *, started_ns: int, bus_active: bool
) -> tuple[MessageHealth, list[Reason]]:
    """Return the state of a message and what is wrong with it.

    Parameters
    ----------
    bus_active : bool
        Whether its bus is carrying other frames: else the bus is to blame.
    """
    flow = one.flow
    silent_ok = one.listed(health.may_be_silent)
    found = [] if silent_ok or not bus_active else _silence(one, now_ns, started_ns)
    found += _losses(one, now_ns, count_missing=not silent_ok)
    state = MessageHealth(
        bus=one.bus,
        name=one.name,
        level=worst(found),
        rate_hz=flow.rate_hz(now_ns),
        usual_rate_hz=1.0 / flow.period_s,
        age_s=flow.age_s(now_ns),
        frames=flow.frames,
        gaps=flow.gaps,
        missing=0 if silent_ok else flow.missing,
        counter_jumps=flow.counter_lost,
    )
    return state, found


def gathered(reasons: Sequence[Reason], kept: frozenset[str]) -> list[Reason]:
    """Combine reasons of one code and bus where there are many; those at places in `kept` stay separate.

    Losses of several messages of one bus at the same time have one cause, and are reported once.
    """
    result: list[Reason] = []
    groups: dict[tuple[str, str], list[Reason]] = {}
    for one in reasons:
        if one.where in kept and one.code not in _TOGETHER:
            result.append(one)
        else:
            groups.setdefault((one.code, one.where.partition(":")[0]), []).append(one)
    for (code, bus), group in groups.items():
        together = code in _TOGETHER
        if len(group) <= (1 if together else _NAMED_MOST):
            result += group
            continue
        group.sort(key=lambda one: -one.level)
        names, most = [one.where.partition(": ")[2] for one in group], _TOGETHER_NAMED_MOST if together else _NAMED_MOST
        more = ", ..." if len(names) > most else ""
        what = f"{len(group)} messages: {', '.join(names[:most])}{more}; the first {group[0].what}"
        where = f"{bus}: several messages" if together else f"{bus}: {len(group)} messages"
        result.append(reason(code, worst(group), where, what, bus=bus))
    return result


def _silence(one: Watched, now_ns: int, started_ns: int) -> list[Reason]:
    flow, level = one.flow, Level.RED if one.roles else Level.AMBER
    if flow.silent(now_ns):
        what = f"has not come for {flow.age_s(now_ns):.1f} s, usually every {flow.period_s:.3g} s"
        return [reason("message_missing", level, one.where, what, bus=one.bus)]
    if one.roles and flow.last_ns is None and now_ns - started_ns > _ABSENT_AFTER_NS:
        roles = ", ".join(reference.role for reference in one.roles.values())
        what = f"has not come since the start {(now_ns - started_ns) * 1e-9:.0f} s ago, and carries {roles}"
        return [reason("message_missing", level, one.where, what, bus=one.bus)]
    return []


def _losses(one: Watched, now_ns: int, *, count_missing: bool) -> list[Reason]:
    flow = one.flow
    lost, missing = one.lost.take(now_ns, flow.counter_lost), one.missing.take(now_ns, flow.missing)
    repeated, came = one.repeated.take(now_ns, flow.repeated), one.came.take(now_ns, flow.frames)
    changed = one.rate.take(now_ns, flow.rate_changes)
    found = []
    if lost:
        level = Level.RED if one.roles else Level.AMBER
        least = "at least " if flow.at_least else ""
        share = f"{lost} of {came + lost} frames in 10 s"
        what = f"lost {least}{share}, by its {flow.counter_name}; {flow.counter_lost} so far"
        found.append(reason("counter_jump", level, one.where, what, bus=one.bus))
    if count_missing and missing > _MISSING_SHARE * came:
        what = f"lacks {missing} of {came + missing} frames in 10 s, by its usual rate; {flow.missing} so far"
        found.append(reason("frames_missing", Level.AMBER, one.where, what, bus=one.bus))
    if repeated >= _REPEATED_LEAST and repeated > _REPEATED_SHARE * came:
        level = Level.RED if one.roles else Level.AMBER
        what = f"its {flow.counter_name} stood still in {repeated} of {came} frames in 10 s"
        found.append(reason("counter_repeated", level, one.where, what, bus=one.bus))
    elif repeated >= _DOUBLED_LEAST:
        what = f"{repeated} of {came} frames in 10 s came twice, by its {flow.counter_name}"
        found.append(reason("frames_doubled", Level.AMBER, one.where, what, bus=one.bus))
    if changed:
        usual = f"comes every {flow.period_s:.3g} s now" if flow.period_s == flow.period_s else "comes irregularly now"
        found.append(reason("rate_changed", Level.AMBER, one.where, f"{usual}, which is not as before", bus=one.bus))
    return found
