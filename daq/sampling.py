"""The rate at which samples come: their number over the time in which they came, whatever the jitter of their stamps.

The median interval is no rate: frames that arrive in bursts are closer than they were sent, and lost frames do not
move it. The rate is therefore a count over a duration, without pauses of the recording. A second question is what the
sender does, which decides what is missing and how long a hole may be: blocks of samples take equal times where holes
are made up for by bursts, and times that spread as those of independent intervals do where frames are lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from daq.arrays import FloatArray, IntArray

_PIECE = 1 << 14
"""Stamps are looked at together in pieces of at least so many."""
_MOST_KEPT = 3
"""Pieces whose intervals are kept, to be looked at closely."""
_BACK_NS = -100_000_000
"""Stamps that run back further do not belong together: a step of the clock."""
_PAUSE_NS = 2_000_000_000
_PAUSE_INTERVALS, _PAUSE_HOLES = 10, 5
_LEAST_PAUSES_IN_DOUBT = 10
_NEAR = 0.25
"""An interval within this share of the median is a usual one."""
_EVEN_BALANCED, _EVEN = 0.02, 0.1
"""Mean and median differ by less: by jitter where blocks take equal times, else by lost samples, which the median does
not count."""
_LEAST_BLOCKS, _SMALLEST_BLOCK, _LARGEST_BLOCK = 16, 8, 256
_OUTLYING = 4.0
_BALANCED = 0.2
"""Variance of blocks over that of as many independent intervals, below which holes are made up for."""
_LEADING = 256
_SHORT, _MOST_TIMES, _LEAST_TIMES = 0.1, 12.0, 20
_WHOLE, _WHOLE_SHARE = 0.2, 0.8
"""Four of five intervals this near to multiples of one; by chance it would be two of five."""
BRIDGED_INTERVALS = 1.75
"""A hole of this many usual intervals is still none: one late sample."""
_WIDE_TIME_SHARE, _WIDE_MARGIN = 0.98, 1.25


@dataclass(frozen=True)
class Sampling:
    """How the samples of one channel or message come; times in s, NaN where unknown.

    Attributes
    ----------
    rate_hz : float
        Samples over duration; pauses of the recording are excluded.
    interval_s : float
        Time that one sample stands for: the usual interval, or 1 / `rate_hz` where intervals are not even.
    spacing_s : float
        Interval by which holes are judged: `interval_s`, and more where samples come in bursts.
    period_s : float
        The sender's; NaN where it has none.
    missing_share : float
        Of the samples that the period lets expect from the first to the last; NaN without a period.
    pauses : int
        Holes that are not counted in the duration.
    regular : bool
        Whether the sender keeps its rate: intervals are even, or holes are made up for, however late samples come.
    """

    rate_hz: float = nan
    interval_s: float = nan
    spacing_s: float = nan
    period_s: float = nan
    missing_share: float = nan
    pauses: int = 0
    regular: bool = False

    @property
    def in_bursts(self) -> bool:
        """Whether samples are held back and come together, so that stamps are later than the samples."""
        return self.spacing_s > BRIDGED_INTERVALS * self.interval_s


@dataclass(frozen=True)
class _Blocks:
    """Blocks of equally many intervals, without those that a long hole is in.

    Attributes
    ----------
    steps : float64 array, shape (blocks, intervals)
    spread, independent_spread : float
        Variance of the blocks, and what it would be if intervals were independent.
    """

    steps: FloatArray
    spread: float
    independent_spread: float

    @property
    def interval_ns(self) -> float:
        """The mean interval."""
        return float(self.steps.mean())


class SamplingEstimator:
    """Takes the time stamps of a channel piece by piece; holds a bounded number of them."""

    def __init__(self) -> None:
        self._waiting: list[IntArray] = []
        self._last_ns: int | None = None
        self._first_ns = 0
        self._count = 0
        self._short_count, self._short_ns = 0, 0
        self._long: list[IntArray] = []
        self._leading: IntArray = np.zeros(0, np.int64)
        self._medians: list[float] = []
        self._near, self._positive = 0, 0
        self._kept: list[IntArray] = []

    def take(self, time_ns: IntArray) -> None:
        """Take stamps in the order of their samples; equal ones count."""
        if len(time_ns):
            self._waiting.append(time_ns)
            if sum(map(len, self._waiting)) >= _PIECE:
                self._settle()

    def estimate(self) -> Sampling:
        """Return what is known so far."""
        self._settle()
        longest_ns = self._longest_hole_ns()
        long = np.concatenate([np.zeros(0, np.int64), *self._long])
        within = long[long <= longest_ns]
        pauses = len(long) - len(within)
        count, duration_ns = self._short_count + len(within), self._short_ns + int(within.sum())
        if not count or duration_ns <= 0:
            return Sampling(pauses=pauses)
        kept = [steps[steps <= longest_ns] for steps in self._kept]
        blocks = [block for steps in kept for block in _in_blocks(steps)]
        median_ns = float(np.median(self._medians)) if self._medians else nan
        mean_ns = float(np.mean([block.interval_ns for block in blocks])) if blocks else duration_ns / count
        usual, balanced = self._near > 0.5 * self._positive, _balanced(blocks)
        even = usual and abs(mean_ns / median_ns - 1) < (_EVEN_BALANCED if balanced else _EVEN)
        if not even:
            count, duration_ns = self._without_first_burst(count, duration_ns)
        interval_ns = median_ns if even else duration_ns / count
        spacing_ns, period_ns = interval_ns, mean_ns
        if balanced and not even:
            # The interval of which `BRIDGED_INTERVALS` reach over nearly all holes of a stream in bursts.
            ends = np.median(
                [_intervals_up_to(block.steps.ravel(), (0.5, _WIDE_TIME_SHARE)) for block in blocks], axis=0
            )
            half_ns, wide_ns = ends.tolist()
            spacing_ns = max(float(max(half_ns, _WIDE_MARGIN * wide_ns / BRIDGED_INTERVALS)), interval_ns)
        elif not balanced:
            units = [] if even else [unit for steps in kept for unit in _unit_of(steps)]
            period_ns = float(np.median(units)) if units else median_ns if usual else nan
        return Sampling(
            rate_hz=1e9 * count / duration_ns,
            interval_s=interval_ns * 1e-9,
            spacing_s=spacing_ns * 1e-9,
            period_s=period_ns * 1e-9,
            missing_share=self._missing(period_ns),
            pauses=pauses,
            regular=even or balanced,
        )

    def _settle(self) -> None:
        if not self._waiting:
            return
        time_ns = np.concatenate(self._waiting)
        self._waiting = []
        inner = np.diff(time_ns)
        steps = inner if self._last_ns is None else np.concatenate([[time_ns[0] - self._last_ns], inner])
        if self._last_ns is None:
            self._first_ns, self._leading = int(time_ns[0]), inner[:_LEADING]
        self._last_ns = int(time_ns[-1])
        self._count += len(time_ns)
        steps = steps[steps >= _BACK_NS]
        long = steps[steps > _PAUSE_NS]
        self._short_count += len(steps) - len(long)
        self._short_ns += int(steps.sum()) - int(long.sum())
        self._long.append(long)
        positive = inner[inner > 0]
        if len(positive):
            median = float(np.median(positive))
            self._medians.append(median)
            self._near += int(np.count_nonzero(np.abs(positive - median) < _NEAR * median))
            self._positive += len(positive)
        if len(self._kept) < _MOST_KEPT:
            self._kept.append(steps[: 2 * _PIECE].copy())

    def _longest_hole_ns(self) -> float:
        """Return the interval beyond which one is a pause: far longer than others, between stretches, not bursts."""
        long = np.concatenate([np.zeros(0, np.int64), *self._long])
        if not len(long):
            return _PAUSE_NS
        parts = [steps[steps <= _PAUSE_NS] for steps in self._kept]
        usual_hole_ns = max((_intervals_up_to(short, (0.5,))[0] for short in parts if len(short)), default=0.0)
        longest_ns, before_ns = float(_PAUSE_NS), 0.0
        while longest_ns > before_ns:
            before_ns, within = longest_ns, long[long <= longest_ns]
            if len(long) > self._short_count:
                within = long[long <= max(longest_ns, _PAUSE_INTERVALS * float(np.median(long)))]
            time_ns = int(within.sum())
            mean_ns = (self._short_ns + time_ns) / max(self._short_count + len(within), 1)
            half_ns = _intervals_up_to(within, (0.5,))[0] if time_ns > self._short_ns else usual_hole_ns
            longest_ns = max(longest_ns, _PAUSE_INTERVALS * mean_ns, _PAUSE_HOLES * half_ns)
        pauses = long[long > longest_ns]
        rest_ns = self._short_ns + int(long.sum()) - int(pauses.sum())
        in_bursts = len(pauses) >= _LEAST_PAUSES_IN_DOUBT and rest_ns < _PAUSE_NS * len(pauses)
        return np.inf if in_bursts else longest_ns

    def _without_first_burst(self, count: int, duration_ns: int) -> tuple[int, int]:
        """Leave out the intervals within the first burst: its samples were sent before the first stamp."""
        apart = self._leading > 0.5 * duration_ns / count
        burst = self._leading[: int(np.argmax(apart))] if apart.any() else self._leading[:0]
        return count - len(burst), duration_ns - int(burst.sum())

    def _missing(self, period_ns: float) -> float:
        if not isfinite(period_ns) or self._last_ns is None:
            return nan
        expected = (self._last_ns - self._first_ns) / period_ns + 1
        return max(0.0, 1.0 - self._count / expected) if expected >= 1 else nan


def sampling_of(time_ns: IntArray) -> Sampling:
    """Return how the samples with these stamps came, shape (n,), in their order."""
    estimator = SamplingEstimator()
    estimator.take(time_ns)
    return estimator.estimate()


def mean_interval_ns(steps: IntArray) -> float:
    """Return the mean of these intervals in ns, shape (n,), without pauses; NaN where there is none."""
    steps = steps[steps >= _BACK_NS]
    short = steps[steps <= _PAUSE_NS]
    usual = short if 2 * len(short) >= len(steps) else steps
    return float(usual.mean()) if len(usual) else nan


def _in_blocks(steps: IntArray) -> list[_Blocks]:
    """Cut intervals into blocks; none where there are too few, or no time passes in them."""
    size = min(len(steps) // _LEAST_BLOCKS, _LARGEST_BLOCK)
    if size < _SMALLEST_BLOCK:
        return []
    blocks = steps[: len(steps) // size * size].reshape(-1, size).astype(np.float64)
    times = blocks.sum(axis=1)
    off = np.abs(times - np.median(times))
    blocks = blocks[off <= _OUTLYING * np.quantile(off, 0.75)]
    if not blocks.sum() > 0:
        return []
    return [_Blocks(blocks, float(blocks.sum(axis=1).var()), size * float(blocks.var()))]


def _balanced(blocks: list[_Blocks]) -> bool:
    """Return whether blocks take equal times: what is late is made up for, and nothing is lost."""
    spread, independent = sum(block.spread for block in blocks), sum(block.independent_spread for block in blocks)
    return bool(blocks) and spread <= _BALANCED * independent


def _unit_of(steps: IntArray) -> list[float]:
    """Return the interval of which longer ones are multiples, as where samples are lost; none where they are not."""
    steps = steps[steps > 0]
    if not len(steps):
        return []
    shortest = float(np.quantile(steps, _SHORT))
    alike = steps[np.abs(steps - shortest) < _NEAR * shortest]
    unit = float(alike.mean()) if len(alike) else np.inf
    times = steps[(steps > 1.5 * unit) & (steps < _MOST_TIMES * unit)] / unit
    whole = np.abs(times - np.round(times)) < _WHOLE
    return [unit] if len(times) >= _LEAST_TIMES and np.mean(whole) > _WHOLE_SHARE else []


def _intervals_up_to(steps: FloatArray | IntArray, shares: tuple[float, ...]) -> list[float]:
    """Return the intervals up to which each share of the time passes."""
    ordered = np.sort(steps)
    passed = np.cumsum(ordered)
    at = np.searchsorted(passed, np.asarray(shares) * passed[-1])
    return [float(interval) for interval in ordered[np.minimum(at, len(ordered) - 1)]]
