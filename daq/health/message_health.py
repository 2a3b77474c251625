"""What is wrong with messages: they do not come, or frames of them are lost."""

from __future__ import annotations

from collections.abc import Sequence

from daq.config import HealthSection
from daq.health.board import reason, worst
from daq.health.report import Level, MessageHealth, Reason
from daq.health.watched import Watched

_ABSENT_AFTER_NS = 5_000_000_000
_MISSING_SHARE = 0.02
_DOUBLED_LEAST = 3
_REPEATED_SHARE = 0.5
_REPEATED_LEAST = 10
_NAMED_MOST = 3
_TOGETHER = ("counter_jump", "frames_missing")
_TOGETHER_NAMED_MOST = 8


def message_health(
    one: Watched, now_ns: int, health: HealthSection, *, started_ns: int, heard: bool
) -> tuple[MessageHealth, list[Reason]]:
    """Return the state of a message and what is wrong with it.

    Parameters
    ----------
    one : Watched
    now_ns, started_ns : int
    health : HealthSection
    heard : bool
        Whether its bus is carrying other frames: else the bus is to blame.
    """
    flow = one.flow
    silent_ok = one.listed(health.may_be_silent)
    found = [] if silent_ok or not heard else _silence(one, now_ns, started_ns)
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
    """Join reasons of one code and bus where there are many; those at places in `kept` stay by themselves.

    What messages of one bus lose at the same time is one hole: it is told once.
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
