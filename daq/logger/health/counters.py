"""Rolling counters: which signal is one, and how many frames it says are lost."""

from __future__ import annotations

import re
from collections import Counter as Tally

import numpy as np

from daq.arrays import BoolArray, FloatArray, IntArray
from daq.can.bits import RawKind, Signal

NO_VALUE = -1
"""Stands for a frame that does not carry the counter."""
LEAST_STEPS = 32
"""A signal must come this often before it is taken for a counter."""
_NAME = re.compile(r"counter|rolling|alive|sequence|cntr?([^a-z]|$)|(^|[^a-z])(rc|seq|ctr)([^a-z]|$)")
_WORDS = re.compile(r"(?<=[a-z])(?=[A-Z])")
_REGULAR_SHARE, _REGULAR_SHARE_UNNAMED = 0.95, 0.99


def is_named_so(signal: Signal) -> bool:
    """Whether a signal's name says that it counts frames."""
    return bool(_NAME.search(_WORDS.sub("_", signal.name).lower()))


def may_count(signal: Signal) -> bool:
    """Whether a signal could be a rolling counter, by its layout."""
    plain = signal.kind is RawKind.UNSIGNED and signal.multiplexer is None and signal.scale != 0
    if is_named_so(signal):
        return plain and signal.length_bits <= 32
    return plain and 2 <= signal.length_bits <= 16 and not signal.labels


def raw_of(signal: Signal, values: FloatArray) -> IntArray:
    """Return the raw integers behind decoded values, `NO_VALUE` for NaN."""
    raw = np.rint((values - signal.offset) / signal.scale)
    return np.where(np.isfinite(raw), raw, NO_VALUE).astype(np.int64)


def counts(raw: IntArray, *, named: bool) -> bool:
    """Whether values behave like a rolling counter: up by one, and from one value always down to one other.

    Parameters
    ----------
    raw : int64 array, shape (n,)
    named : bool
        Whether the name says so too; without it more is asked: hardly an exception, and two turns.
    """
    before, after = raw[:-1], raw[1:]
    known = (before != NO_VALUE) & (after != NO_VALUE)
    before, after = before[known], after[known]
    if len(before) < LEAST_STEPS:
        return False
    falls = Tally(zip(before[after < before].tolist(), after[after < before].tolist(), strict=True))
    turns = max(falls.values(), default=0)
    share = (int(np.count_nonzero(after == before + 1)) + turns) / len(before)
    return share >= _REGULAR_SHARE if named else share >= _REGULAR_SHARE_UNNAMED and turns >= 2


class RollingCounter:
    """A counter that has been recognised; where it starts again is learned.

    A fall from the highest value so far to the lowest is a turn of an unknown range or a loss across the end of a known
    one. It stays undecided until the next turn: the same fall again is the counter's range.

    Parameters
    ----------
    bits : int
        Length of the signal: without better knowledge the counter runs through all that they hold.
    """

    def __init__(self, bits: int) -> None:
        self._full = (1 << bits) - 1
        self._previous = NO_VALUE
        self.lost = 0
        self.repeated = 0
        self._start_over()

    @property
    def modulus(self) -> int:
        """How many values it runs through."""
        return self._high - self._low + 1

    def _start_over(self) -> None:
        self._low, self._high = 0, self._full
        self._sure = False
        self._lowest, self._highest = self._full, 0
        self._doubt: tuple[int, int] | None = None

    def forget_last(self) -> None:
        """Accept any next value: frames in between were not inspected."""
        self._previous = NO_VALUE

    def take(self, raw: IntArray) -> IntArray:
        """Take the raw values of frames in order.

        Returns
        -------
        int64 array, shape as `raw`
            Frames lost just before each, modulo the counter's range, -1 where it stood still. What was in doubt stands
            where it was settled.
        """
        lost = np.zeros(len(raw), np.int64)
        start = 0
        while start < len(raw):
            piece = raw[start:]
            before = np.concatenate([[self._previous], piece[:-1]])
            known = (before != NO_VALUE) & (piece != NO_VALUE)
            lost[start:], end = (self._judge if self._sure else self._learn)(before, piece, known)
            self._previous = int(piece[end - 1])
            start += end
        self.lost += int(lost[lost > 0].sum())
        return lost

    def _judge(self, before: IntArray, raw: IntArray, known: BoolArray) -> tuple[IntArray, int]:
        """Return what is lost, up to the first value that is out of the learned range, and the number of values."""
        strange = (raw != NO_VALUE) & ((raw < self._low) | (raw > self._high))
        end = int(np.argmax(strange)) if strange.any() else len(raw)
        if end == 0:
            self._start_over()
            return self._learn(before, raw, known)
        lost = np.where(known, (raw - before) % self.modulus - 1, 0)
        lost[end:] = 0
        self.repeated += int(np.count_nonzero(lost < 0))
        return lost, end

    def _learn(self, before: IntArray, raw: IntArray, known: BoolArray) -> tuple[IntArray, int]:
        """Return what is lost, up to the value at which the range is known, and the number of values."""
        lost = np.where(known, (raw - before) % self.modulus - 1, 0)
        falls = known & (raw < before)
        lost[falls] = 0
        end = len(raw)
        for at in np.flatnonzero(falls).tolist():
            lost[at] = self._fall(int(before[at]), int(raw[at]))
            if self._sure:
                end = at + 1
                lost[end:] = 0
                break
        self.repeated += int(np.count_nonzero(lost[:end] < 0))
        return lost, end

    def _fall(self, high: int, low: int) -> int:
        """Judge a fall while the range is unknown; return the frames that are lost for certain."""
        beyond = self._doubt is not None and (high > self._doubt[0] or low < self._doubt[1])
        settled = self._loss(*self._doubt) if beyond and self._doubt else 0
        if beyond:
            self._doubt = None
        extreme = high >= self._highest and low <= self._lowest
        self._highest, self._lowest = max(self._highest, high), min(self._lowest, low)
        if (high, low) == (self._full, 0) or (high, low) == self._doubt:
            self._low, self._high, self._sure, self._doubt = low, high, True, None
            return settled
        if extreme:
            self._doubt = (high, low)
            return settled
        return settled + self._loss(high, low)

    def _loss(self, high: int, low: int) -> int:
        return (low - high) % (self._full + 1) - 1
