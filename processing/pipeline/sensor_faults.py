"""What a sensor gives where it gives no measurement: drops to zero, frozen values, a clipped end, marks of "none".

A sound channel is left alone: each fault is something that its own noise, or the vehicle's inertia, rules out. One
without noise of its own (coarse, or held between slow samples) cannot be told to be frozen or clipped, and is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from math import sqrt

import numpy as np

from daq import ON_TIME_BASE, TRANSDUCER_ROLES, BoolArray, FloatArray, IntArray, Note, Severity
from processing.notes import RunCode
from processing.pipeline.collection import Samples, marks_of
from processing.pipeline.kinematics import runs_of
from processing.robust import robust_spread
from processing.timebase import nearest

_IMPOSSIBLE_MPS2 = 6.0
"""No vehicle on soil speeds up faster."""
_LEAST_DROP_MPS = 0.5
_ROLLING_ON = 0.5
"""Share of the speed before a drop at which the wheel still turns within it."""
_FROZEN_S, _FROZEN_SAMPLES = 2.0, 8
_CLIPPED_S, _CLIPPED_SAMPLES, _IN_A_ROW, _AT_AN_END = 0.3, 20, 3, 0.8
_ALIKE = 1e-9


class FaultKind(StrEnum):
    """What is wrong with samples."""

    DROPPED = "dropped"
    FROZEN = "frozen"
    CLIPPED = "clipped"
    MARK = "mark"


def without_sensor_faults(samples: Mapping[str, Samples]) -> tuple[dict[str, Samples], list[Note]]:
    """Take out what is no measurement, and note how much of which channel, and why.

    A ground speed that drops while the wheel turns on is told from a stop.
    """
    sound, notes = dict(samples), []
    for role in (channel.role for channel in ON_TIME_BASE if channel.role in samples):
        one = samples[role]
        if one.marks:
            share = one.marks / (one.marks + one.count)
            notes.append(_note(role, FaultKind.MARK, one.mark, share, one.marks * _interval_s(one)))
        bad = np.zeros(len(one.values), np.bool_)
        for kind, rows in _faults(role, one, samples.get("wheel_speed")).items():
            of_kind = rows & ~bad
            bad |= rows
            if of_kind.any():
                lasting_s = float(of_kind.sum()) * max(_interval_s(one), one.node_s)
                middle = float(np.median(one.values[of_kind]))
                notes.append(_note(role, kind, middle, float(of_kind.mean()), lasting_s))
        if bad.any():
            faulty_ns = np.union1d(one.faulty_ns, one.time_ns[bad])
            sound[role] = replace(one, time_ns=one.time_ns[~bad], values=one.values[~bad], faulty_ns=faulty_ns)
    return sound, notes


def _faults(role: str, one: Samples, wheel: Samples | None) -> dict[FaultKind, BoolArray]:
    if len(one.values) < _FROZEN_SAMPLES:
        return {}
    found = {FaultKind.MARK: np.isin(one.values, [] if one.node_s else marks_of(one.values))}
    if role in TRANSDUCER_ROLES:
        return found | {FaultKind.CLIPPED: _clipped(one), FaultKind.FROZEN: _frozen(one)}
    if role == "ground_speed":
        found[FaultKind.DROPPED] = _dropped(one, wheel)
    return found | {FaultKind.FROZEN: _frozen(one) & (one.values != 0)}  # a speed of 0 is a standstill


def _note(role: str, kind: FaultKind, value: float, share: float, lasting_s: float) -> Note:
    facts = {"role": role, "kind": kind.value, "value": value, "share": share, "time_s": lasting_s}
    return Note(RunCode.SENSOR_FAULT, Severity.DOUBT, facts)


def _interval_s(one: Samples) -> float:
    return float(np.nan_to_num(one.sampling.interval_s))


def _held(one: Samples) -> tuple[IntArray, IntArray, FloatArray]:
    """Return start, stop (exclusive) and duration (s) of every stretch of one and the same value."""
    alike = np.abs(np.diff(one.values)) <= _ALIKE * np.abs(one.values[1:])
    bounds = np.concatenate([[0], np.flatnonzero(~alike) + 1, [len(one.values)]])
    start, stop = bounds[:-1], bounds[1:]
    return start, stop, (one.time_ns[stop - 1] - one.time_ns[start]) * 1e-9


def _rows(count: int, start: IntArray, stop: IntArray) -> BoolArray:
    """Return the rows of some stretches."""
    edges = np.zeros(count + 1, np.int64)
    edges[start] += 1
    edges[stop] -= 1
    return np.asarray(np.cumsum(edges[:-1]) > 0)


def _noisy(one: Samples) -> bool:
    """Whether noise moves the channel by more than its resolution, so that equal values in a row are strange."""
    least = max(one.step, _ALIKE * float(np.abs(one.values).max()))
    return one.rough > least or _roughness(one) > least


def _roughness(one: Samples) -> float:
    """Return the one-sigma from one entry to the next where the value is not held; 0 of one held at any value."""
    start, stop, _ = _held(one)
    short = stop - start < _IN_A_ROW
    held = one.values[start[~short]]
    at_end = np.isclose(held, one.values.max(), _ALIKE, 0) | np.isclose(held, one.values.min(), _ALIKE, 0)
    if at_end.sum() < _AT_AN_END * len(held):
        return 0.0
    moving = one.values[_rows(len(one.values), start[short], stop[short])]
    return robust_spread(np.diff(moving, 2)) / sqrt(6.0) if len(moving) > _CLIPPED_SAMPLES else 0.0


def _frozen(one: Samples) -> BoolArray:
    """Find values that stay the same for longer than noise lets them."""
    if not _noisy(one):
        return np.zeros(len(one.values), np.bool_)
    start, stop, lasting_s = _held(one)
    bad = (lasting_s >= _FROZEN_S) & (stop - start >= _FROZEN_SAMPLES)
    return _rows(len(one.values), start[bad], stop[bad])


def _clipped(one: Samples) -> BoolArray:
    """Find the largest and the smallest value where noise stops there again and again."""
    bad = np.zeros(len(one.values), np.bool_)
    if not _noisy(one):
        return bad
    start, stop, lasting_s = _held(one)
    for end in (one.values.max(), one.values.min()):
        at_end = np.abs(one.values[start] - end) <= _ALIKE * abs(end)
        long = at_end & (stop - start >= _IN_A_ROW)
        if lasting_s[long].sum() >= _CLIPPED_S and (stop - start)[long].sum() >= _CLIPPED_SAMPLES:
            bad |= _rows(len(one.values), start[at_end], stop[at_end])
    return bad


def _dropped(speed: Samples, wheel: Samples | None) -> BoolArray:
    """Find ground speeds of exactly 0 between two that no vehicle has so shortly before and after a stop."""
    pairs = [(a, b) for a, b in runs_of(speed.values == 0).tolist() if speed.values[a] == 0]
    inside = [(a, b) for a, b in pairs if a > 0 and b < len(speed.values)]
    bad = np.zeros(len(speed.values), np.bool_)
    for start, stop in inside:
        before, after = abs(float(speed.values[start - 1])), abs(float(speed.values[stop]))
        into_s, out_s = (speed.time_ns[[start, stop]] - speed.time_ns[[start - 1, stop - 1]]) * 1e-9
        sharp = min(before / into_s, after / out_s) > _IMPOSSIBLE_MPS2
        if sharp and min(before, after) > _LEAST_DROP_MPS and _turns_on(speed, start, stop, wheel):
            bad[start:stop] = True
    return bad


def _turns_on(speed: Samples, start: int, stop: int, wheel: Samples | None) -> bool:
    """Whether the wheel keeps its speed within a stretch; so it is taken to do where nobody measures it."""
    if wheel is None or not len(wheel.values):
        return True
    rows = np.unique(nearest(speed.time_ns[start:stop], wheel.time_ns))
    before = wheel.values[nearest(speed.time_ns[start - 1 : start], wheel.time_ns)[0]]
    return float(np.median(np.abs(wheel.values[rows]))) > _ROLLING_ON * abs(float(before)) > 0
