"""What is wrong with signals: stuck, saturated, out of range, not available."""

from __future__ import annotations

import math
from dataclasses import dataclass

from daq.can.roles import SignalRef
from daq.config import HealthSection
from daq.logger.health.report import Level, Reason, SignalHealth, reason
from daq.logger.health.watched import Motion, Watched

_NOW_NS = 1_000_000_000
_CONSTANT_S = 10.0
_SPEEDS = ("wheel_speed", "ground_speed")
_FLAGS = ("ground_speed_valid", "transducer_status")
_OF_GNSS = ("ground_speed", "latitude", "longitude", "course")


@dataclass(frozen=True)
class Scene:
    """What the signals are judged by.

    Attributes
    ----------
    has_fix : bool
        False where the receiver flags its own values as not valid.
    """

    now_ns: int
    health: HealthSection
    motion: Motion
    has_fix: bool


def role_values(watched: list[Watched]) -> dict[str, float]:
    """Return the last value of every role in SI, NaN where the sender says that it has none."""
    return {
        reference.role: _in_si(reference, float(one.values.last[one.names.index(signal)]))
        for one in watched
        for signal, reference in one.roles.items()
    }


def signal_health(one: Watched, scene: Scene) -> tuple[list[SignalHealth], list[Reason]]:
    """Return the state of a message's signals, and what is wrong with those that have a role."""
    values, now_ns = one.values, scene.now_ns
    columns = zip(
        one.names,
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
        is_out = is_out and not one.listed(scene.health.may_leave_range, name)
        reference = one.roles.get(name)
        if reference is None:
            level = Level.AMBER if stuck_s or is_out or is_saturated else Level.GREEN
        else:
            stuck_s = _judged_stuck(reference.role, value, stuck_s, scene)
            found = _role_reasons(one, row, reference, scene, stuck_s, is_out=is_out, is_saturated=is_saturated)
            level = max((r.level for r in found), default=Level.GREEN)
            reasons += found
        role, unit = reference.role if reference else "", one.message.by_name[name].unit
        full = f"{one.name}.{name}"
        states.append(SignalHealth(one.bus, full, unit, role, level, value, out, saturated, stuck_s))
    return states, reasons


def _in_si(reference: SignalRef, value: float) -> float:
    missing = value >= reference.missing_from or value in reference.missing
    return math.nan if missing else value * reference.si_factor + reference.si_offset


def _judged_stuck(role: str, value: float, stuck_s: float, scene: Scene) -> float:
    """Return how long a role's signal is stuck; 0 where it has a reason to stay the same."""
    if role in _FLAGS or (role in _SPEEDS and value == 0.0):
        return 0.0
    return 0.0 if role in _OF_GNSS and not scene.has_fix else stuck_s


def _role_reasons(
    one: Watched,
    row: int,
    reference: SignalRef,
    scene: Scene,
    stuck_s: float,
    *,
    is_out: bool,
    is_saturated: bool,
) -> list[Reason]:
    signal, values, role = one.message.by_name[reference.signal], one.values, reference.role
    value, where = float(values.last[row]), f"{one.bus}: {reference.name}"
    unit = f" {signal.unit}" if signal.unit else ""
    if math.isnan(value):
        return []
    label = signal.labels.get(round((value - signal.offset) / signal.scale), "") if signal.labels else ""
    found = []
    if role == "transducer_status":
        if value != 0:
            said = f"{value:g}, {label!r}" if label else f"{value:g}"
            found.append(reason("transducer_status", Level.AMBER, where, f"the transducer says {said}, not 0"))
        return found
    if math.isnan(_in_si(reference, value)):
        if role not in _OF_GNSS or scene.has_fix:
            said = f" ({label})" if label else ""
            found.append(reason("signal_not_available", Level.AMBER, where, f"the sender has no value{said}"))
        return found
    if stuck_s:
        usual_s = float(values.longest_ns[row]) * 1e-9
        what = f"{value:g}{unit} for {stuck_s:.1f} s, before never longer than {usual_s:.2g} s the same"
        found.append(reason("signal_stuck", Level.AMBER, where, what))
    elif _constant(role, row, one, scene):
        what = f"{value:g}{unit} since the start, although the vehicle has moved"
        found.append(reason("signal_constant", Level.AMBER, where, what))
    if is_saturated:
        what = f"{value:g}{unit} is the end of what its bits hold; {values.saturated[row]} samples so far"
        found.append(reason("signal_saturated", Level.RED, where, what))
    elif is_out:
        what = (
            f"{value:g}{unit}, the DBC's range is {signal.minimum:g} to {signal.maximum:g}; "
            f"{values.out_of_range[row]} samples so far"
        )
        found.append(reason("signal_out_of_range", Level.AMBER, where, what))
    return found


def _constant(role: str, row: int, one: Watched, scene: Scene) -> bool:
    """Whether a signal has never changed, although the vehicle has moved by what another role says."""
    if role in _FLAGS or not one.values.may_stick[row] or one.values.changes[row]:
        return False
    if role in _OF_GNSS and not scene.has_fix:
        return False
    moved_s = [seconds for other, seconds in scene.motion.moved_s.items() if other != role]
    return max(moved_s) > _CONSTANT_S
