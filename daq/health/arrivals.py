"""When the frames of one message come: its usual rate, its gaps and how many frames they lack.

Arrival is not sending: frames queue and come in bursts. A gap counts only by what the frames behind it do not make up
for by coming early; so judging it waits for the first frames that come at the usual rate again. Everything here depends
on the frames alone, never on how they are cut into batches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

LEARN_NS = 3_000_000_000
"""Arrivals are watched for at least this long before their rate is believed."""
_LEARN_MOST = 8192
_REGULAR = 0.35
_WIDE_GAP = 1.5
_AT_USUAL_RATE = 0.7
_BURST_MOST = 4096
_SMALLEST_BLOCK, _LARGEST_BLOCK, _LEAST_BLOCKS = 8, 64, 8
_CATCHES_UP_NS = 200_000_000
_LEVEL_OVER = 8
_STRICTEST = 0.85


@dataclass(frozen=True)
class Usual:
    """What is usual.

    Attributes
    ----------
    period_ns : float
    wide_ns : float
        Intervals beyond are gaps.
    tolerance_ns : float
        A frame is lacking where a gap is longer than a period by more than this: half a period where arrivals jitter
        much, nearly a whole one where they are even.
    """

    period_ns: float
    wide_ns: float
    tolerance_ns: float


def learned_after(time_ns: IntArray, least: int) -> int | None:
    """Return after how many frames the rate of a message can be learned, None where it cannot yet.

    Parameters
    ----------
    time_ns : int64 array, shape (n,)
    least : int
        Intervals that it takes at any rate.
    """
    if len(time_ns) > _LEARN_MOST:
        return _LEARN_MOST
    long_enough = (
        np.flatnonzero(time_ns[least:] - time_ns[:1] >= LEARN_NS) if len(time_ns) > least else np.zeros(0, int)
    )
    return least + int(long_enough[0]) + 1 if len(long_enough) else None


def learn(time_ns: IntArray) -> Usual | None:
    """Return the usual rate of a message, None where its frames come when something happens.

    Lost frames make a few intervals long: they are left out. Frames that come in bursts have no usual interval; they
    are regular if blocks of them are.
    """
    gaps = np.maximum(np.diff(time_ns), 0)
    period = float(np.median(gaps))
    if period > 0 and _spread(gaps, period) <= _REGULAR and period > 0.5 * float(gaps.mean()):
        wide = max(_WIDE_GAP * period, 1.25 * float(np.quantile(gaps, 0.9)))
        period = float(gaps[np.abs(gaps - period) < 0.5 * period].mean())
        jitter = float(np.quantile(np.abs(gaps - period), 0.9)) / period
        return Usual(period, wide, period * min(max(_STRICTEST - 2 * jitter, 0.5), _STRICTEST))
    size = min(len(gaps) // _LEAST_BLOCKS, _LARGEST_BLOCK)
    if size < _SMALLEST_BLOCK:
        return None
    blocks = np.diff(time_ns[: len(gaps) // size * size + 1 : size]) / size
    period = float(np.median(blocks))
    if period > 0 and _spread(blocks, period) <= _REGULAR / 2:
        return Usual(period, max(2 * _WIDE_GAP * period, 1.5 * float(np.quantile(gaps, 0.98))), 0.5 * period)
    return None


def _spread(gaps: NDArray[np.float64] | IntArray, period: float) -> float:
    """Return how far the middle three quarters of the intervals are from the usual one, relative to it."""
    return float(np.quantile(np.abs(gaps - period), 0.75)) / period


class Gaps:
    """Finds the gaps of a message whose usual rate is known.

    Parameters
    ----------
    usual : Usual
    """

    def __init__(self, usual: Usual) -> None:
        self.usual = usual
        self._last_ns: int | None = None
        self._open = np.zeros((0, 2), np.int64)

    def close(self) -> list[tuple[int, int]]:
        """Judge a gap that is open as it stands, and let the next frame come after any time; returns as `take`."""
        lacking = self.unsettled()
        settled = [(lacking, int(self._open[0, 1]))] if lacking else []
        self._last_ns = None
        self._open = self._open[:0]
        return settled

    def take(self, time_ns: IntArray, lost: IntArray) -> list[tuple[int, int]]:
        """Take arrivals in order.

        Parameters
        ----------
        time_ns : int64 array, shape (n,)
        lost : int64 array, shape (n,)
            What the rolling counter says is lost before each.

        Returns
        -------
        list of (int, int)
            Of every gap that is settled now and lacks frames: how many by the rate, and what the counter said.
        """
        if not len(time_ns):
            return []
        first = time_ns[0] if self._last_ns is None else self._last_ns
        gaps = np.maximum(np.diff(time_ns, prepend=first), 0)
        self._last_ns = int(time_ns[-1])
        if not len(self._open) and not np.any(gaps > self.usual.wide_ns):
            return []
        self._open = np.concatenate([self._open, np.stack([gaps, lost], axis=1)])
        return self._settle()

    def unsettled(self) -> int:
        """Return how many frames the gap that is open lacks, if nothing more makes up for it."""
        return self._lacking(0, len(self._open) - 1) if len(self._open) else 0

    def _settle(self) -> list[tuple[int, int]]:
        gaps, lost = self._open[:, 0], self._open[:, 1]
        settled = []
        wide = np.flatnonzero(gaps > self.usual.wide_ns)
        kept = len(gaps)
        for number, at in enumerate(wide.tolist()):
            limit = int(wide[number + 1]) - at - 1 if number + 1 < len(wide) else None
            end = self._end_of_burst(gaps[at + 1 : at + 1 + _BURST_MOST], limit)
            if end is None:
                kept = at
                break
            lacking = self._lacking(at, end)
            if lacking > 0:
                settled.append((lacking, int(lost[at])))
        self._open = self._open[kept:].copy()
        return settled

    def _end_of_burst(self, after: IntArray, limit: int | None) -> int | None:
        """Return how many frames behind a gap may make up for it, None while that is open."""
        usual = after > _AT_USUAL_RATE * self.usual.period_ns
        twice = np.flatnonzero(usual[1:] & usual[:-1])
        late = np.flatnonzero(np.cumsum(after) >= _CATCHES_UP_NS)
        ends = [max(int(twice[0]), int(late[0]))] if len(twice) and len(late) else []
        if limit is not None and limit <= len(after):
            ends.append(limit)
        if len(after) == _BURST_MOST:
            ends.append(_BURST_MOST)
        return min(ends, default=None)

    def _lacking(self, at: int, end: int) -> int:
        """Return floor((gap - what the frames behind make up for - tolerance) / period)."""
        period = self.usual.period_ns
        after = self._open[at + 1 : at + 1 + end, 0]
        early = np.cumsum(period - after)
        made_up = 0.0
        if len(early):
            in_burst = np.any(after[-_LEVEL_OVER:] < _AT_USUAL_RATE * period)
            made_up = max(float(early.max() if in_burst else np.median(early[-_LEVEL_OVER:])), 0.0)
        return max(int((float(self._open[at, 0]) - made_up - self.usual.tolerance_ns) // period), 0)
