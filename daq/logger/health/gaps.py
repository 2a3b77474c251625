"""Gaps of a message, judged by whether the frames after them stay late.

A frame's lateness is its arrival less its number times the usual period. Queues, stalls and jitter only add to it, so
that the least lateness of half a second is that of the sender, whatever the arrivals looked like; it rises for good
only by frames that never came. It is judged after a gap, once it falls no more. Everything here depends on the
frames alone, never on how they are cut into batches.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from daq import FloatArray, IntArray, sampling_of

LEARN_NS = 3_000_000_000
"""Arrivals are watched for at least this long before their rate is used."""
_LEARN_MOST = 8192
_REGULAR = 0.35
_WIDE_GAP = 1.5
_SMALLEST_BLOCK = 8
_EVEN = 0.05
_FLOORS, _NO_LOSS = 12, 0.7

BLOCK_NS = 500_000_000
_LEAST_FRAMES = 2
_FALLING, _RISING = 0.5, 1.0
_ANCHORS, _LEAST_ANCHORS = 20, 5
_MOST_BLOCKS = 20
_RATE_ERROR = 2e-4
_SURE = 0.8
_SLACK = 2.0
_FROZEN = 3
_LEAST_TURN = 8
"""Shorter turns of a counter are whole by chance too often."""


@dataclass(frozen=True)
class Usual:
    """What is usual.

    Attributes
    ----------
    wide_ns : float
        Intervals beyond are gaps.
    jitter_ns : float
        By how much half of the frames are later than the least late ones, at most.
    """

    period_ns: float
    wide_ns: float
    jitter_ns: float


def learned_after(time_ns: IntArray, least: int) -> int | None:
    """Return after how many frames the rate of a message can be learned, None where it cannot yet.

    `least` intervals it takes at any rate.
    """
    if len(time_ns) > _LEARN_MOST:
        return _LEARN_MOST
    long_enough = (
        np.flatnonzero(time_ns[least:] - time_ns[:1] >= LEARN_NS) if len(time_ns) > least else np.zeros(0, int)
    )
    return least + int(long_enough[0]) + 1 if len(long_enough) else None


def learn(time_ns: IntArray) -> Usual | None:
    """Return the usual rate of a message, None where its frames come when something happens.

    Lost frames make a few intervals long: these are excluded. Frames that come in bursts have no usual interval; they
    are regular if blocks of them are.
    """
    gaps = np.maximum(np.diff(time_ns), 0)
    period = float(np.median(gaps))
    if period > 0 and _spread(gaps, period) <= _REGULAR and period > 0.5 * float(gaps.mean()):
        wide = max(_WIDE_GAP * period, 1.25 * float(np.quantile(gaps, 0.9)))
        even = _spread(gaps, period) < _EVEN
        near = np.abs(gaps - period) < (2 * _EVEN if even else 0.5) * period
        period = float(gaps[near].mean())
        counted, jitter_ns = _by_count(time_ns, period)
        return Usual(period if even else counted, wide, jitter_ns)
    sampling = sampling_of(time_ns)
    if not sampling.regular:
        return None
    wide = max(2 * _WIDE_GAP * 1e9 * sampling.period_s, 1.5 * float(np.quantile(gaps, 0.98)))
    counted, jitter_ns = _by_count(time_ns, 1e9 * sampling.period_s)
    return Usual(counted, wide, jitter_ns)


def keeps(time_ns: IntArray, usual: Usual) -> bool:
    """Return whether frames come at the usual rate between gaps, however long these are."""
    return _spread(np.maximum(np.diff(time_ns), 0), usual.period_ns) <= _REGULAR


def _by_count(time_ns: IntArray, period: float) -> tuple[float, float]:
    """Return span over count between the least late frames of blocks, and the jitter.

    Blocks between which frames are lost are excluded.
    """
    late = time_ns - time_ns[0] - np.arange(len(time_ns)) * period
    size = len(time_ns) // _FLOORS
    if size < _SMALLEST_BLOCK:
        return period, float(np.median(np.abs(np.diff(time_ns) - period)))
    blocks = late[: size * _FLOORS].reshape(_FLOORS, size)
    jitter_ns = float(np.median(np.median(blocks, axis=1) - blocks.min(axis=1)))
    at = np.argmin(blocks, axis=1) + np.arange(_FLOORS) * size
    frames, span = np.diff(at), np.diff(time_ns[at])
    usual = float(np.median(span / frames))
    off = np.abs(span - frames * usual)
    kept = off < max(_NO_LOSS * usual, 4 * float(np.median(off)))
    return (float(span[kept].sum() / frames[kept].sum()) if kept.any() else usual), jitter_ns


def _spread(gaps: FloatArray | IntArray, period: float) -> float:
    """Return how far the middle three quarters of the intervals are from the usual one, relative to it."""
    return float(np.quantile(np.abs(gaps - period), 0.75)) / period


@dataclass(frozen=True)
class Verdict:
    """Verdict on a gap, or on several close together.

    Attributes
    ----------
    gaps : int
        Long intervals in it; 0 where nothing was lost.
    lacking : int
        Lost frames beyond those that the rolling counter counts: with a counter, whole turns of it.
    stood_still : int
        How often a repeated counter value was a loss of one frame less than a turn.
    sure : bool
        False where it is not known whether the counter wrapped.
    """

    gaps: int
    lacking: int
    stood_still: int = 0
    sure: bool = True


@dataclass
class _Floor:
    """The least late frame of a block."""

    number: int
    time_ns: int
    gaps: int = 0
    lost: int = 0
    still: int = 0


class Gaps:
    """Finds the gaps of a message whose usual rate is known.

    `modulus` frames are a turn of the rolling counter, None without one. `period_ns` is the time between frames, by
    their number over the last seconds without a gap.
    """

    def __init__(self, usual: Usual, modulus: int | None = None) -> None:
        self.usual = usual
        self.modulus = modulus
        self.period_ns = usual.period_ns
        self._number = 0
        self._forget()

    def _forget(self) -> None:
        self._last_ns: int | None = None
        self._pending = np.zeros((4, 0), np.int64)
        self._quiet: deque[_Floor] = deque(maxlen=_ANCHORS)
        self._base: _Floor | None = None
        self._off_turns: list[float] = []
        self._after: _Floor | None = None
        self._blocks = 0
        self._gaps = 0
        self._lost = 0
        self._still = 0

    @property
    def open(self) -> bool:
        """Whether a gap is not judged yet."""
        return self._base is not None

    @property
    def open_with_loss(self) -> bool:
        """Whether a gap is not judged yet in which the counter jumped."""
        return self.open and bool(self._lost or self._still or np.any(self._pending[3]))

    def close(self) -> list[Verdict]:
        """Allow any time before the next frame; return open gaps as undecided, in the form of `take`."""
        verdicts = [self._undecided()] if self.open else []
        self._forget()
        return verdicts

    def take(self, time_ns: IntArray, lost: IntArray) -> list[Verdict]:
        """Take arrivals in order and return the verdicts on the gaps that are judged now.

        `lost` is what the rolling counter says is lost before each, -1 where it stood still.
        """
        if not len(time_ns):
            return []
        first = time_ns[0] if self._last_ns is None else self._last_ns
        wide = np.diff(time_ns, prepend=first) > self.usual.wide_ns
        if self.modulus is not None and self.usual.wide_ns > self.modulus * self.period_ns:
            wide |= lost != 0  # the counter may have wrapped in an interval that is usual in bursts
        self._last_ns = int(time_ns[-1])
        numbers = self._number + np.cumsum(lost + 1)
        self._number = int(numbers[-1])
        self._pending = np.concatenate([self._pending, [time_ns, numbers, wide, lost]], axis=1)
        verdicts: list[Verdict] = []
        while self._pending.shape[1] and self._take_block(verdicts):
            pass
        return verdicts

    def _take_block(self, verdicts: list[Verdict]) -> bool:
        """Take a block off what waits; return False where there is none yet."""
        time_ns, _, wide, _ = self._pending
        full = time_ns[_LEAST_FRAMES:] - time_ns[0] >= BLOCK_NS
        end = _LEAST_FRAMES + int(np.argmax(full)) if full.any() else None
        if not self.open:
            cut = int(np.argmax(wide)) if wide[:end].any() else None
            if cut is not None:
                self._open(self._split(cut) if cut else None)
                return True
        if end is None:
            return False
        block = self._split(end)
        if self.open:
            self._judge(block, verdicts)
        else:
            self._learn_period(block)
        return True

    def _split(self, end: int) -> _Floor:
        """Take the first frames of what waits."""
        time_ns, numbers, wide, lost = self._pending[:, :end]
        self._pending = self._pending[:, end:]
        least = int(np.argmin(time_ns - numbers * self.period_ns))
        return _Floor(
            int(numbers[least]),
            int(time_ns[least]),
            gaps=int(np.count_nonzero(wide)),
            lost=int(lost[lost > 0].sum()),
            still=int(np.count_nonzero(lost < 0)),
        )

    def _learn_period(self, block: _Floor) -> None:
        """Learn the period from frames whose number is known."""
        if block.still >= _FROZEN:
            self._quiet.clear()
        if self._quiet and block.number <= self._quiet[-1].number:
            return
        self._quiet.append(block)
        if len(self._quiet) >= _LEAST_ANCHORS:
            first = self._quiet[0]
            self.period_ns = (block.time_ns - first.time_ns) / (block.number - first.number)

    def _open(self, before: _Floor | None) -> None:
        known = [*list(self._quiet)[-2:], *([before] if before else [])]
        next_number, next_ns = int(self._pending[1, 0]), int(self._pending[0, 0])
        self._base = min(known, key=lambda floor: floor.time_ns - floor.number * self.period_ns, default=None)
        if self._base is None:
            self._base = _Floor(next_number, next_ns)
        self._after = None
        self._blocks = self._gaps = self._lost = self._still = 0
        self._off_turns = []

    def _judge(self, block: _Floor, verdicts: list[Verdict]) -> None:
        """Judge what is open once the frames catch up no more, and with a counter once they stay as late."""
        assert self._base is not None
        before, self._after = self._after, block
        self._blocks += 1
        self._gaps += block.gaps
        self._lost += block.lost
        self._still += block.still
        if before is None:
            return
        moved = self._late_ns(block, before) / self.period_ns
        level = min(before, block, key=lambda floor: floor.time_ns - floor.number * self.period_ns)
        if moved < -_FALLING or (self.modulus is not None and moved > _RISING):
            self._off_turns.append(self._off_turn(block))
            if self._blocks < _MOST_BLOCKS:
                return
            if not self._by_whole_turns():
                verdicts.append(self._undecided())
                self._quiet.clear()
                self._base = None
                return
            level = block
        lacking, sure = self._lacking(self._base, level)
        self._number += lacking
        self._pending[1] += lacking
        for floor in (before, block):
            floor.number += lacking
        still = min(self._still, lacking // self.modulus) if self.modulus else 0
        verdicts.append(Verdict(self._gaps if lacking or self._lost else 0, lacking - still, still, sure))
        self._blocks = self._gaps = self._lost = 0
        self._off_turns = []
        self._still = min(self._still - still, block.still)
        if not sure or (lacking and self.modulus is None):
            self._quiet.clear()
        self._learn_period(level)
        self._base = level if before.gaps or block.gaps else None

    def _off_turn(self, block: _Floor) -> float:
        """Return by how many frames the lateness of a block is not that of whole turns of the counter."""
        assert self._base is not None
        frames = self._late_ns(block, self._base) / self.period_ns
        turns = max(round(frames / self.modulus), 0) if self.modulus else 0
        return abs(frames - turns * self.modulus) if self.modulus else abs(frames)

    def _by_whole_turns(self) -> bool:
        """Whether frames get later by whole turns all the time: they are lost in one gap after another, not held up."""
        if self.modulus is None or self.modulus < _LEAST_TURN:
            return False
        return float(np.mean(np.array(self._off_turns) <= 1)) > _SURE

    def _undecided(self) -> Verdict:
        return Verdict(self._gaps if self._lost else 0, 0, sure=False)

    def _late_ns(self, floor: _Floor, than: _Floor) -> float:
        return floor.time_ns - than.time_ns - (floor.number - than.number) * self.period_ns

    def _lacking(self, base: _Floor, after: _Floor) -> tuple[int, bool]:
        """Return the frames that did not come between two blocks, and whether that is sure."""
        frames = self._late_ns(after, base) / self.period_ns
        if self.modulus is None:
            jitter = self.usual.jitter_ns / self.period_ns
            return (int(frames + 1 - _SURE) if frames > _SLACK * jitter else 0), True
        turns = max(round(frames / self.modulus), 0)
        early = 1 if base.gaps else 0  # a frame between two gaps may have come before the loss
        doubt = min(1 + early + _RATE_ERROR * (after.time_ns - base.time_ns) / self.period_ns, self.modulus / 4)
        sure = self._still < _FROZEN and (abs(frames - turns * self.modulus) <= doubt or frames < 0)
        return (turns * self.modulus if sure else 0), sure
