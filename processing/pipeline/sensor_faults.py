"""Values that are no measurement: drops to zero, frozen values, a clipped end, values far from all others.

Each is something that the channel's own noise, or the vehicle's inertia, rules out. A channel without noise of its own
(coarse, or held between slow samples) cannot be known to be frozen or clipped, nor can one at rest; a torque may be
constant where a clutch or a limiter holds it, while the pull hardly changes. Such samples are kept: what is excluded
wrongly is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from daq import BoolArray, FloatArray, IntArray
from processing.pipeline.collection import resolution
from processing.robust import roughness
from processing.timebase import nearest

_LOOK = 1 << 12
_ALIKE = 1e-9
_APART, _LEAST_VALUES, _MOST_APART, _MOST_MARKED = 3.0, 10, 4, 0.5
"""Few values, in less than half of the samples, are so many ranges away from at least so many others."""
IMPOSSIBLE_MPS2 = 6.0
"""No vehicle on soil speeds up faster."""
_LEAST_DROP_MPS, _LARGEST_DEAD_BAND_MPS, _LONGEST_DROP_S = 0.5, 1.0, 2.0
_ROLLING_ON = 0.5
"""Share of the speed before a drop at which the wheel still turns within it."""
_FROZEN_S, _FROZEN_SAMPLES, _LEAST_ALIVE = 2.0, 8, 0.1
_STUCK_S, _STUCK_STEPS, _LIVELY, _LIVELY_STEPS, _LEAST_STUCK, _CATCH_UP = 0.25, 4.0, 4, 2.0, 3, 3.0
"""A stuck value lasts so long, and so many times as long as most; so many on each side at most so many times. So many
of them end in a jump of so many steps."""
_CHANGE, _AS_USUAL = 0.05, 0.5
_SWING, _PARTS = 0.25, 16
"""Shares of the load by which the pull differs among so many parts of a time, and no constant torque lets it."""
_EVER_NEW, _OF_INTERPOLATED = 0.95, (1, 5, 10)
"""Share of samples with a new value in a channel that repeats none; it may be interpolated: noise is in each 5th."""
_QUICK_S, _QUICK_SHARE, _USUAL_SHARE = 0.25, 0.95, 0.9
_CLIPPED_S, _CLIPPED_SAMPLES, _IN_A_ROW, _CLIPPED_STRETCHES, _FAR = 0.3, 20, 3, 5, 0.5
_MOVING, _AT_REST = 0.1, 0.001
"""Shares of the usual largest speed, below which it is small, and of the largest value, below which one is at rest."""

LOADS = ("vertical_load", "drawbar_pull")
_PARTNERS = {
    "wheel_speed": ("ground_speed",),
    "vertical_load": ("drawbar_pull", "driving_torque"),
    "drawbar_pull": ("vertical_load", "driving_torque"),
}
"""What moves while a sound channel does."""

Series = tuple[IntArray, FloatArray]
"""Stamps (ns, ascending) and finite values, shape (n,) each."""
Moves = Callable[[FloatArray, FloatArray], bool]
"""Whether a channel moves, by its values within some time and all of them."""


class FaultKind(StrEnum):
    """What is wrong with samples."""

    DROPPED = "dropped"
    FROZEN = "frozen"
    CLIPPED = "clipped"
    MARK = "mark"
    SPIKE = "spike"


@dataclass(frozen=True)
class Held:
    """Stretches of one and the same value.

    Attributes
    ----------
    start, stop : int64 arrays
        Rows; `stop` is exclusive.
    between_s, until_s : float64 arrays
        Time from the first to the last sample, and to the next value (the last stretch: to its last sample).
    """

    start: IntArray
    stop: IntArray
    between_s: FloatArray
    until_s: FloatArray

    @property
    def count(self) -> IntArray:
        """Samples of each."""
        return self.stop - self.start

    def mostly(self, rows: BoolArray) -> BoolArray:
        """Return for which stretches at least half of the rows are among these, shape (n,)."""
        return np.asarray(2 * np.add.reduceat(rows.astype(np.int64), self.start) >= self.count)

    def rows(self, some: BoolArray) -> BoolArray:
        """Return the rows of some stretches, shape (n,)."""
        return np.repeat(some, self.count)


def held_values(series: Series) -> Held:
    """Return the stretches of a series that is not empty."""
    time_ns, values = series
    alike = np.abs(np.diff(values)) <= _ALIKE * np.abs(values[1:])
    bounds = np.concatenate([[0], np.flatnonzero(~alike) + 1, [len(values)]])
    start, stop = bounds[:-1], bounds[1:]
    last_ns = time_ns[stop - 1]
    next_ns = np.append(time_ns[start[1:]], last_ns[-1])
    return Held(start, stop, (last_ns - time_ns[start]) * 1e-9, (next_ns - time_ns[start]) * 1e-9)


def values_apart(values: FloatArray) -> list[float]:
    """Return the few values, shape (n,), that are far from all others: -99999, 65535 times the factor, a shock."""
    rest, found = values, []
    while len(rest):
        apart = _outermost(rest)
        if not 0 < len(apart) <= _MOST_APART:
            break
        found += apart.tolist()
        rest = rest[~np.isin(rest, apart)]
    return found if len(values) - len(rest) < _MOST_MARKED * len(values) else []


def _outermost(values: FloatArray) -> FloatArray:
    """Return the values beyond the outermost gap that is wide enough, if any."""
    looked = np.concatenate([values[:: max(1, len(values) // _LOOK)], [values.min(), values.max()]])
    near = _within_gap(looked)
    outside = values[(values < near.min()) | (values > near.max())]
    if not len(outside):
        return np.asarray(outside)
    near = _within_gap(np.concatenate([looked, outside]))  # with every extreme value, not some of them
    return np.asarray(np.unique(outside[(outside < near.min()) | (outside > near.max())]))


def _within_gap(values: FloatArray) -> FloatArray:
    levels = np.unique(values)
    levels = levels[np.argsort(np.abs(levels - np.median(values)), kind="stable")]
    low, high = np.minimum.accumulate(levels)[:-1], np.maximum.accumulate(levels)[:-1]
    reach = _APART * np.maximum(high - low, np.maximum(np.abs(high), np.abs(low)))
    wide = np.flatnonzero(np.maximum(low - levels[1:], levels[1:] - high) > reach)
    wide = wide[wide >= _LEAST_VALUES - 1]
    return np.asarray(levels[: wide[-1] + 1] if len(wide) else levels)


def held_too_long(role: str, series: Mapping[str, Series], *, rotating: bool = False) -> dict[FaultKind, BoolArray]:
    """Find frozen and clipped values of a wheel speed or a force while a speed is not small; shape (n,) each.

    `rotating`: the forces are in axes of the wheel, and say nothing of a torque.
    """
    if role not in (*_PARTNERS, "driving_torque"):
        return {}
    channel, held = series[role], held_values(series[role])
    speeds = [series[speed] for speed in ("wheel_speed", "ground_speed") if speed in series]
    if role == "driving_torque":
        pull = [] if rotating else _pull_in_loads(series)
        return {FaultKind.FROZEN: frozen(channel, held, pull, speeds, pull_swings)}
    partners = [series[other] for other in _PARTNERS[role] if other in series]
    if role not in LOADS:
        still = frozen(channel, held, partners, speeds, speed_changes)
        return {FaultKind.FROZEN: still | stuck(channel, held, speeds)}
    at_end = clipped(channel, held, speeds)
    still = frozen(channel, held, partners, speeds, force_shakes) | stuck(channel, held, speeds)
    return {FaultKind.CLIPPED: at_end, FaultKind.FROZEN: still & ~at_end}


def moving_at(at_ns: IntArray, speeds: Sequence[Series]) -> BoolArray:
    """Return at which instants one of the speeds is not small."""
    moving = np.zeros(len(at_ns), np.bool_)
    for time_ns, values in (speed for speed in speeds if len(speed[1])):
        fast = np.abs(values) > _MOVING * float(np.quantile(np.abs(values), 0.95))
        moving |= fast[nearest(at_ns, time_ns)]
    return moving


def _noisy(values: FloatArray) -> bool:
    """Whether noise moves values by more than their resolution, so that equal ones in a row are strange."""
    if len(values) < _CLIPPED_SAMPLES:
        return False
    step = resolution(values[:: max(1, len(values) // _LOOK)])
    return roughness(values) > max(step, _ALIKE * float(np.abs(values).max()))


def _quick(held: Held, some: BoolArray) -> bool:
    """Whether these stretches are short: new values come at 4 Hz or more."""
    time_s = held.until_s[some]
    return float(time_s[time_s <= _QUICK_S].sum()) >= _QUICK_SHARE * float(time_s.sum()) > 0


def usual_step_s(steps_s: FloatArray) -> float:
    """Return what most of the time is shorter than, of steps between values, shape (n,); infinite without any."""
    steps_s = np.sort(steps_s)
    passed = np.cumsum(steps_s)
    return float(steps_s[np.searchsorted(passed, _USUAL_SHARE * passed[-1])]) if len(steps_s) else np.inf


def frozen(series: Series, held: Held, partners: Sequence[Series], speeds: Sequence[Series], moves: Moves) -> BoolArray:
    """Find values that stay the same for longer than noise lets them while a partner moves; shape (n,)."""
    none = np.zeros(len(series[1]), np.bool_)
    long = held.between_s >= _FROZEN_S
    alive = np.abs(series[1][held.start]) > _AT_REST * float(np.abs(series[1]).max())
    suspect = long & (held.count >= _FROZEN_SAMPLES) & alive
    if not suspect.any():
        return none
    driven = held.mostly(moving_at(series[0], speeds))
    suspect, rest = suspect & driven, ~long & driven
    if held.until_s[rest].sum() < _LEAST_ALIVE * held.until_s[suspect].sum():
        return none
    values = series[1][held.rows(rest)]
    apart = _OF_INTERPOLATED if rest.sum() >= _EVER_NEW * len(values) else (1,)
    if not _quick(held, rest) or not any(_noisy(values[::step]) for step in apart):
        return none
    for k in np.flatnonzero(suspect):
        within_ns = series[0][[held.start[k], held.stop[k] - 1]]
        parts = [(values[slice(*np.searchsorted(time_ns, within_ns))], values) for time_ns, values in partners]
        suspect[k] = any(moves(part, values) for part, values in parts if len(part) > 2)
    return held.rows(suspect)


def stuck(series: Series, held: Held, speeds: Sequence[Series]) -> BoolArray:
    """Find values that last much longer than all others around and again and again jump at their end; shape (n,)."""
    level = series[1][held.start]
    usual_s = float(np.quantile(held.until_s, _QUICK_SHARE))
    long = (held.until_s >= _STUCK_STEPS * usual_s) & (held.between_s >= _STUCK_S)
    suspect = long & held.mostly(moving_at(series[0], speeds)) & (level != 0)
    for k in np.flatnonzero(suspect).tolist():
        around = np.delete(held.until_s[max(k - _LIVELY, 0) : k + _LIVELY + 1], [min(k, _LIVELY)])
        suspect[k] = len(around) == 2 * _LIVELY and around.max() <= _LIVELY_STEPS * usual_s
    jump = np.abs(np.diff(level, append=level[-1]))
    jumps = suspect & (jump > _CATCH_UP * np.median(jump[~long]))
    return held.rows(suspect & (jumps.sum() >= _LEAST_STUCK))


def speed_changes(partner: FloatArray, _: FloatArray) -> bool:
    """Whether a speed changes within some time, more than a cruise does; shape (k,)."""
    low, middle, high = np.quantile(np.abs(partner), (0.1, 0.5, 0.9))
    return bool(high - low > _CHANGE * middle)


def force_shakes(partner: FloatArray, usual: FloatArray) -> bool:
    """Whether a force is about as noisy within some time, shape (k,), as it usually is, shape (n,)."""
    return roughness(partner) > _AS_USUAL * roughness(usual)


def pull_swings(pull: FloatArray, _: FloatArray) -> bool:
    """Whether the pull, in loads, shape (k,), goes up and down more than under a constant torque."""
    low, high = np.quantile([float(part.mean()) for part in np.array_split(pull, min(_PARTS, len(pull)))], (0.1, 0.9))
    return bool(high - low > _SWING)


def _pull_in_loads(series: Mapping[str, Series]) -> list[Series]:
    if not series.keys() >= set(LOADS):
        return []
    time_ns, pull = series["drawbar_pull"]
    load = float(np.median(np.abs(series["vertical_load"][1])))
    return [(time_ns, pull / load)] if load > 0 else []


def clipped(series: Series, held: Held, speeds: Sequence[Series]) -> BoolArray:
    """Find a largest or smallest value, far from 0, at which noise stops again and again; shape (n,)."""
    bad = np.zeros(len(series[1]), np.bool_)
    ends = float(series[1].max()), float(series[1].min())
    for end in (end for end in ends if abs(end) >= _FAR * max(map(abs, ends))):
        at_end = np.abs(series[1][held.start] - end) <= _ALIKE * abs(end)
        if not _often(held, at_end):
            continue
        driven = held.mostly(moving_at(series[0], speeds))
        rest = driven & ~at_end
        if _often(held, driven & at_end) and _quick(held, rest) and _noisy(series[1][held.rows(rest)]):
            bad |= held.rows(driven & at_end)
    return bad


def _often(held: Held, at_end: BoolArray) -> bool:
    """Whether enough stretches, samples and time are at an end."""
    some = at_end & (held.count >= _IN_A_ROW)
    return bool(
        some.sum() >= _CLIPPED_STRETCHES
        and held.count[some].sum() >= _CLIPPED_SAMPLES
        and held.between_s[some].sum() >= _CLIPPED_S
    )


def dropped(speed: Series, held: Held, wheel: Sequence[Series]) -> BoolArray:
    """Find ground speeds of exactly 0 between two that no vehicle has so shortly before and after a stop; shape (n,).

    The time of a step is that between two different values around it, for a receiver repeats values or sends them in
    bursts; its height is less a dead band, below which receivers report 0.
    """
    time_ns, values = speed
    bad = np.zeros(len(values), np.bool_)
    if not np.any(values == 0) or not np.any(values):
        return bad
    size = np.abs(values[held.start])
    dead_mps = min(float(size[size > 0].min()), _LARGEST_DEAD_BAND_MPS)
    for k in np.flatnonzero(size == 0).tolist():
        if not 0 < k < len(size) - 1 or held.until_s[k] > _LONGEST_DROP_S:
            continue
        start, stop = held.start[k], held.stop[k]
        height = min(size[k - 1], size[k + 1]) - dead_mps
        # The time between two different values within 2 s of a drop, of nearly all.
        begin_ns, around_ns = time_ns[held.start], round(_LONGEST_DROP_S * 1e9)
        first, last = np.searchsorted(begin_ns, (begin_ns[k] - around_ns, time_ns[held.stop[k] - 1] + around_ns))
        step_s = max(usual_step_s(held.until_s[first:last][size[first:last] > 0]), float(held.until_s[k - 1]))
        if height > max(_LEAST_DROP_MPS, IMPOSSIBLE_MPS2 * step_s):
            bad[start:stop] = all(_turns_on(time_ns[start - 1 : stop], series) for series in wheel)
    return bad


def _turns_on(time_ns: IntArray, wheel: Series) -> bool:
    """Whether the wheel keeps its speed from the first of some stamps over the others."""
    before, *within = np.abs(wheel[1][nearest(time_ns, wheel[0])])
    return float(np.median(within)) > _ROLLING_ON * float(before) > 0
