"""Arrivals of one message: its rate, gaps and lost frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from daq.arrays import FloatArray, IntArray
from daq.can.bits import Message, Signal
from daq.logger.health.counters import LEAST_STEPS, RollingCounter, counts, is_named_so, may_count, raw_of
from daq.logger.health.gaps import Gaps, Usual, Verdict, keeps, learn, learned_after

_LEAST_INTERVALS = 10
_SILENT_PERIODS = 5
_SILENT_LEAST_NS = 1_000_000_000
_RATE_OVER_NS = 1_000_000_000
_BELIEVED_AFTER = 3
_SAME_RATE = 0.2


class MessageFlow:
    """Follows the arrivals of one message.

    What is usual is learned from the first frames, which are judged as soon as that is done. Where there is a rolling
    counter it alone says what is lost, and the rate only how often the counter went round in a long gap.

    Parameters
    ----------
    signals : sequence of str
        Names of the signals in the order of the rows that `take` gets.
    """

    def __init__(self, message: Message, signals: Sequence[str]) -> None:
        self._candidates = [
            (row, message.by_name[name]) for row, name in enumerate(signals) if may_count(message.by_name[name])
        ]
        named = any(is_named_so(signal) for _, signal in self._candidates)
        self._least = LEAST_STEPS if named else _LEAST_INTERVALS
        self._declared_s = message.cycle_time_s
        self._held: list[tuple[IntArray, IntArray]] | None = []
        self._usual: Usual | None = None
        self._gaps: Gaps | None = None
        self._counter: RollingCounter | None = None
        self._counter_at: tuple[int, Signal] | None = None
        self._past: deque[tuple[int, int]] = deque()
        self._block = np.zeros(0, np.int64)
        self._other: list[Usual | None] = []
        self.frames = 0
        self.last_ns: int | None = None
        self._skipped_until_ns = 0
        self.gaps = 0
        self.rate_changes = 0
        self._missing = 0
        self._turns_lost = 0
        self._unsure = False
        self._seemed_still = 0

    @property
    def learned(self) -> bool:
        """Whether it is known what is usual."""
        return self._held is None

    @property
    def counter_name(self) -> str:
        """The rolling counter's signal, empty where there is none."""
        return self._counter_at[1].name if self._counter_at else ""

    @property
    def missing(self) -> int:
        """Frames that the gaps lack by the usual rate, as far as judged; 0 where a rolling counter counts them."""
        return self._missing

    @property
    def counter_lost(self) -> int:
        """Frames that the rolling counter says are lost."""
        return self._counter.lost + self._turns_lost if self._counter else 0

    @property
    def at_least(self) -> bool:
        """Whether the loss may be larger: the counter may have wrapped in a gap that is undecided or still open."""
        return self._unsure or self._gaps is None or self._gaps.open

    @property
    def repeated(self) -> int:
        """Frames that repeated the value of the rolling counter."""
        return self._counter.repeated - self._seemed_still if self._counter else 0

    @property
    def period_s(self) -> float:
        """The usual time between frames, declared or learned; NaN where there is none."""
        if self._gaps is not None:
            return self._gaps.period_ns * 1e-9
        return self._declared_s if self._declared_s and not self.learned else float("nan")

    def take(self, time_ns: IntArray, values: FloatArray) -> None:
        """Take decoded frames in order.

        Parameters
        ----------
        time_ns : int64 array, shape (n,)
        values : float64 array, shape (signals, n)
        """
        self._count_frames(time_ns)
        if self._held is not None:
            raw = [raw_of(signal, values[row]) for row, signal in self._candidates]
            self._held.append((time_ns, np.array(raw, np.int64).reshape(len(raw), len(time_ns))))
            self._learn()
        elif self._counter_at is not None:
            row, signal = self._counter_at
            self._judge(time_ns, raw_of(signal, values[row]))
        else:
            self._judge(time_ns, None)

    def skip(self, time_ns: IntArray, until_ns: int) -> None:
        """Take that frames until then were not decoded; some of this message, of others perhaps not even counted.

        Parameters
        ----------
        time_ns : int64 array, shape (n,)
            Arrivals of this message among them, as far as they are known.
        """
        self._count_frames(time_ns)
        self._skipped_until_ns = max(until_ns, self._skipped_until_ns)
        if self._counter is not None:
            self._counter.forget_last()
        self.forget_last()

    def forget_last(self) -> None:
        """Judge nothing across this point: the times before and after do not belong together."""
        if self._held is not None:
            self._held = []
        self._block = self._block[:0]
        if self._gaps is not None:
            self._count(self._gaps.close())

    def age_s(self, now_ns: int) -> float:
        """Return the time since the last frame, NaN before the first."""
        return float("nan") if self.last_ns is None else (now_ns - self.last_ns) * 1e-9

    def silent(self, now_ns: int) -> bool:
        """Whether it ought to have come by now."""
        if self._usual is None or self.last_ns is None:
            return False
        quiet_ns = now_ns - max(self.last_ns, self._skipped_until_ns)
        return quiet_ns > max(_SILENT_LEAST_NS, _SILENT_PERIODS * self._usual.wide_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Return the frames per second over about the last second, NaN before there were any."""
        if self.last_ns is None:
            return float("nan")
        if not self._past or self._past[-1][0] != self.frames:
            self._past.append((self.frames, self.last_ns))
        while len(self._past) > 2 and self._past[-1][1] - self._past[1][1] >= _RATE_OVER_NS:
            self._past.popleft()
        frames, last_ns = self._past[0]
        until_ns = max(self.last_ns, now_ns if self.silent(now_ns) else self.last_ns)
        return (self.frames - frames) / ((until_ns - last_ns) * 1e-9) if until_ns > last_ns else float("nan")

    def _count_frames(self, time_ns: IntArray) -> None:
        self.frames += len(time_ns)
        if len(time_ns):
            self.last_ns = max(int(time_ns[-1]), self.last_ns or 0)

    def _learn(self) -> None:
        assert self._held is not None
        time_ns = np.concatenate([held for held, _ in self._held])
        end = learned_after(time_ns, self._least)
        if end is None:
            return
        raw = np.concatenate([held for _, held in self._held], axis=1)
        self._held = None
        self._usual = learn(time_ns[:end])
        self._gaps = Gaps(self._usual) if self._usual else None
        found = [
            (not is_named_so(signal), place)
            for place, (_, signal) in enumerate(self._candidates)
            if counts(raw[place, :end], named=is_named_so(signal))
        ]
        if found:
            place = min(found)[1]
            self._counter_at = self._candidates[place]
            self._counter = RollingCounter(self._counter_at[1].length_bits)
        self._judge(time_ns, raw[place] if found else None)

    def _judge(self, time_ns: IntArray, raw: IntArray | None) -> None:
        """Judge frames by the usual rate, which is reviewed after every block of them."""
        while len(time_ns):
            block = np.concatenate([self._block, time_ns])
            end = learned_after(block, self._least)
            piece = len(time_ns) if end is None else end - len(self._block)
            self._judge_piece(time_ns[:piece], None if raw is None else raw[:piece])
            self._block = block if end is None else block[end - 1 : end]
            if end is not None:
                self._review(block[:end])
            time_ns, raw = time_ns[piece:], None if raw is None else raw[piece:]

    def _judge_piece(self, time_ns: IntArray, raw: IntArray | None) -> None:
        lost = np.zeros(len(time_ns), np.int64) if raw is None or self._counter is None else self._counter.take(raw)
        if self._gaps is not None:
            self._gaps.modulus = self._counter.modulus if self._counter else None
            self._count(self._gaps.take(time_ns, lost))
        else:
            self.gaps += int(np.count_nonzero(lost > 0))

    def _review(self, time_ns: IntArray) -> None:
        """Adopt another rate once it has held for some blocks; where most frames are lost no rate can be estimated."""
        usual = learn(time_ns)
        if _same_rate(usual, self._usual) or (
            usual is None and self._usual is not None and keeps(time_ns, self._usual)
        ):
            self._other = []
            return
        self._other = [*self._other, usual] if self._other and _same_rate(usual, self._other[-1]) else [usual]
        if len(self._other) >= _BELIEVED_AFTER:
            self.rate_changes += self._usual is not None
            self._usual, self._other = usual, []
            self._gaps = Gaps(usual) if usual else None

    def _count(self, verdicts: list[Verdict]) -> None:
        for verdict in verdicts:
            self.gaps += verdict.gaps
            self._unsure |= not verdict.sure
            if self._counter is None:
                self._missing += verdict.lacking
            else:
                self._turns_lost += verdict.lacking
                self._seemed_still += verdict.stood_still


def _same_rate(one: Usual | None, other: Usual | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one.period_ns - other.period_ns) <= _SAME_RATE * other.period_ns
