"""Faults of messages and their signals.

A message is missing, late or loses frames; a signal is stuck, saturated, out of range or not available.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from daq.can.roles import SignalRef
from daq.config import HealthSection
from daq.logger.health.report import Level, MessageHealth, Reason, SignalHealth, Since, reason, worst
from daq.logger.health.watched_messages import WatchedMessage

_ABSENT_AFTER_NS = 5_000_000_000
_MISSING_SHARE = 0.02
_DOUBLED_LEAST = 3
_REPEATED_SHARE = 0.5
_REPEATED_LEAST = 10
_NAMED_MOST = 3
_TOGETHER = ("counter_jump", "frames_missing")
_TOGETHER_NAMED_MOST = 8

MOVING_MPS = 0.5
_RESTING_MPS = 0.1
_CONTRADICTED_MPS = 1.0
_STANDING_S, _ALL_SLIP_S = 1.0, 3.0
_PLAUSIBLE_RADIUS_M = 0.5

_NOW_NS = 1_000_000_000
_CONSTANT_S = 10.0
_SPEEDS = ("wheel_speed", "ground_speed")
_FLAGS = ("ground_speed_valid", "transducer_status")
_OF_GNSS = ("ground_speed", "latitude", "longitude", "course")


def message_health(
    message: WatchedMessage, now_ns: int, health: HealthSection, *, started_ns: int, bus_active: bool
) -> tuple[MessageHealth, list[Reason]]:
    """Return the state of a message and what is wrong with it; silence is not its fault where the bus is not active."""
    flow = message.flow
    silent_ok = message.listed(health.may_be_silent)
    found = [] if silent_ok or not bus_active else list(_silence(message, now_ns, started_ns))
    found += _losses(message, now_ns, count_missing=not silent_ok)
    state = MessageHealth(
        bus=message.bus,
        name=message.name,
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


def grouped_reasons(reasons: Sequence[Reason], kept: frozenset[tuple[str, str]]) -> list[Reason]:
    """Combine reasons of one code and bus where there are many; messages (bus, name) in `kept` stay separate.

    Losses of several messages of one bus at the same time have one cause, and are reported once.
    """
    result: list[Reason] = []
    groups: dict[tuple[str, str], list[Reason]] = {}
    for entry in reasons:
        if (entry.bus, entry.name) in kept and entry.code not in _TOGETHER:
            result.append(entry)
        else:
            groups.setdefault((entry.code, entry.bus), []).append(entry)
    for (code, bus), group in groups.items():
        together = code in _TOGETHER
        if len(group) <= (1 if together else _NAMED_MOST):
            result += group
            continue
        group.sort(key=lambda member: -member.level)
        names, most = [member.name for member in group], _TOGETHER_NAMED_MOST if together else _NAMED_MOST
        more = ", ..." if len(names) > most else ""
        told = f"{', '.join(names[:most])}{more}; the first {group[0].what}"
        what = f"{len(group)} messages: {told}" if together else told
        name = "several messages" if together else f"{len(group)} messages"
        result.append(reason(code, worst(group), bus, what, name=name))
    return result


def _silence(message: WatchedMessage, now_ns: int, started_ns: int) -> Iterator[Reason]:
    flow, level = message.flow, Level.RED if message.roles else Level.AMBER
    if flow.silent(now_ns):
        what = f"has not come for {flow.age_s(now_ns):.1f} s, usually every {flow.period_s:.3g} s"
        yield reason("message_missing", level, message.bus, what, name=message.name)
    elif message.roles and flow.last_ns is None and now_ns - started_ns > _ABSENT_AFTER_NS:
        roles = ", ".join(reference.role for reference in message.roles.values())
        what = f"has not come since the start {(now_ns - started_ns) * 1e-9:.0f} s ago, and carries {roles}"
        yield reason("message_missing", level, message.bus, what, name=message.name)


def _losses(message: WatchedMessage, now_ns: int, *, count_missing: bool) -> Iterator[Reason]:
    flow = message.flow
    lost, missing = message.lost.take(now_ns, flow.counter_lost), message.missing.take(now_ns, flow.missing)
    repeated, came = message.repeated.take(now_ns, flow.repeated), message.came.take(now_ns, flow.frames)
    changed = message.rate.take(now_ns, flow.rate_changes)
    if lost:
        level = Level.RED if message.roles else Level.AMBER
        least = "at least " if flow.wrapped else ""
        share = f"{lost} of {came + lost} frames in 10 s"
        what = f"lost {least}{share}, by its {flow.counter_name}; {least}{flow.counter_lost} so far"
        yield reason("counter_jump", level, message.bus, what, name=message.name)
    if count_missing and missing > _MISSING_SHARE * came:
        what = f"lacks {missing} of {came + missing} frames in 10 s, by its usual rate; {flow.missing} so far"
        yield reason("frames_missing", Level.AMBER, message.bus, what, name=message.name)
    if repeated >= _REPEATED_LEAST and repeated > _REPEATED_SHARE * came:
        level = Level.RED if message.roles else Level.AMBER
        what = f"its {flow.counter_name} stood still in {repeated} of {came} frames in 10 s"
        yield reason("counter_repeated", level, message.bus, what, name=message.name)
    elif repeated >= _DOUBLED_LEAST:
        what = f"{repeated} of {came} frames in 10 s came twice, by its {flow.counter_name}"
        yield reason("frames_doubled", Level.AMBER, message.bus, what, name=message.name)
    if changed:
        usual = f"comes every {flow.period_s:.3g} s now" if flow.period_s == flow.period_s else "comes irregularly now"
        yield reason("rate_changed", Level.AMBER, message.bus, f"{usual}, which is not as before", name=message.name)


class Motion:
    """Follows the speeds from report to report.

    Without a radius of the wheel it takes a usual one, which is accurate enough to detect walking pace.
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

    def reasons(self, now_ns: int, roles: Mapping[str, SignalRef]) -> Iterator[Reason]:
        """Yield the contradictions of the speeds of these roles."""
        stands = self.rim_mps == 0 and abs(self.ground_mps) > _CONTRADICTED_MPS
        if self._since.held_s("wheel", now_ns, stands) > _STANDING_S:
            what = f"is exactly 0 while the ground speed is {self.ground_mps:.1f} m/s"
            of = roles["wheel_speed"]
            yield reason("wheel_speed_zero", Level.AMBER, of.bus, what, name=of.name)
        spins = self.ground_mps == 0 and abs(self.rim_mps) > _CONTRADICTED_MPS
        if self._since.held_s("ground", now_ns, spins) > _ALL_SLIP_S:
            what = f"is exactly 0 while the rim runs at {self.rim_mps:.1f} m/s"
            of = roles["ground_speed"]
            yield reason("ground_speed_zero", Level.AMBER, of.bus, what, name=of.name)


@dataclass(frozen=True)
class Scene:
    """What the signals are judged by."""

    now_ns: int
    health: HealthSection
    motion: Motion
    has_fix: bool
    """False where the receiver flags its own values as not valid."""


def role_values(watched: list[WatchedMessage]) -> dict[str, float]:
    """Return the last value of every role in SI, NaN where the sender says that it has none."""
    return {
        reference.role: _in_si(reference, float(message.values.last[message.names.index(signal)]))
        for message in watched
        for signal, reference in message.roles.items()
    }


def signal_health(message: WatchedMessage, scene: Scene) -> tuple[list[SignalHealth], list[Reason]]:
    """Return the state of a message's signals, and what is wrong with those that have a role."""
    values, now_ns = message.values, scene.now_ns
    columns = zip(
        message.names,
        values.last.tolist(),
        values.stuck_s().tolist(),
        values.out_of_range.tolist(),
        (now_ns - values.beyond_ns < _NOW_NS).tolist(),
        values.saturated.tolist(),
        (now_ns - values.saturated_ns < _NOW_NS).tolist(),
        strict=True,
    )
    states, reasons = [], []
    for row, (name, value, stuck_s, out, is_out, saturated, is_saturated) in enumerate(columns):
        is_out = is_out and not message.listed(scene.health.may_leave_range, name)
        reference = message.roles.get(name)
        if reference is None:
            level = Level.AMBER if stuck_s or is_out or is_saturated else Level.GREEN
        else:
            role = reference.role
            if role in _FLAGS or (role in _SPEEDS and value == 0.0) or (role in _OF_GNSS and not scene.has_fix):
                stuck_s = 0.0  # it has a reason to stay the same
            found = [*_role_reasons(message, row, reference, scene, stuck_s, is_out=is_out, is_saturated=is_saturated)]
            level = worst(found)
            reasons += found
        role, unit = reference.role if reference else "", message.message.by_name[name].unit
        full = f"{message.name}.{name}"
        states.append(SignalHealth(message.bus, full, unit, role, level, value, out, saturated, stuck_s))
    return states, reasons


def _in_si(reference: SignalRef, value: float) -> float:
    missing = value >= reference.no_data.above or value in reference.no_data.words
    return math.nan if missing else value * reference.si_factor + reference.si_offset


def _role_reasons(
    message: WatchedMessage,
    row: int,
    reference: SignalRef,
    scene: Scene,
    stuck_s: float,
    *,
    is_out: bool,
    is_saturated: bool,
) -> Iterator[Reason]:
    signal, values, role = message.message.by_name[reference.signal], message.values, reference.role
    value, name = float(values.last[row]), reference.name
    unit = f" {signal.unit}" if signal.unit else ""
    if math.isnan(value):
        return
    label = signal.labels.get(round((value - signal.offset) / signal.scale), "") if signal.labels else ""
    if role == "transducer_status":
        if value != 0:
            shown = f"{value:g}, {label!r}" if label else f"{value:g}"
            yield reason(
                "transducer_status", Level.AMBER, message.bus, f"the transducer says {shown}, not 0", name=name
            )
        return
    if math.isnan(_in_si(reference, value)):
        if role not in _OF_GNSS or scene.has_fix:
            meaning = f" ({label})" if label else ""
            yield reason(
                "signal_not_available", Level.AMBER, message.bus, f"the sender has no value{meaning}", name=name
            )
        return
    if stuck_s:
        usual_s = float(values.longest_ns[row]) * 1e-9
        what = f"has stood at {value:g}{unit} for {stuck_s:.1f} s; never above {usual_s:.2g} s before"
        yield reason("signal_stuck", Level.AMBER, message.bus, what, name=name)
    elif _constant(role, row, message, scene):
        what = f"{value:g}{unit} since the start, although the vehicle has moved"
        yield reason("signal_constant", Level.AMBER, message.bus, what, name=name)
    if is_saturated:
        what = f"{value:g}{unit} is the end of what its bits hold; {values.saturated[row]} samples so far"
        yield reason("signal_saturated", Level.RED, message.bus, what, name=name)
    elif is_out:
        what = (
            f"{value:g}{unit}, the DBC's range is {signal.minimum:g} to {signal.maximum:g}; "
            f"{values.out_of_range[row]} samples so far"
        )
        yield reason("signal_out_of_range", Level.AMBER, message.bus, what, name=name)


def _constant(role: str, row: int, message: WatchedMessage, scene: Scene) -> bool:
    """Whether a signal has never changed, although the vehicle has moved by what another role says."""
    if role in _FLAGS or not message.values.may_stick[row] or message.values.changes[row]:
        return False
    if role in _OF_GNSS and not scene.has_fix:
        return False
    moved_s = [seconds for other, seconds in scene.motion.moved_s.items() if other != role]
    return max(moved_s) > _CONSTANT_S
