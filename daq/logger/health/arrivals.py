"""Arrivals of one message: its rate, gaps and lost frames, and the rolling counter that counts them."""

from __future__ import annotations

import re
from collections import Counter as Tally
from collections import deque
from collections.abc import Sequence

import numpy as np

from daq.arrays import BoolArray, FloatArray, IntArray
from daq.can.bits import Message, RawKind, Signal
from daq.logger.health.gaps import Gaps, Usual, Verdict, keeps, learn, learned_after

NO_VALUE = -1
"""Stands for a frame that does not carry the counter."""
LEAST_STEPS = 32
"""A signal must come this often before it is taken for a counter."""
_NAME = re.compile(r"counter|rolling|alive|sequence|cntr?([^a-z]|$)|(^|[^a-z])(rc|seq|ctr)([^a-z]|$)")
_WORDS = re.compile(r"(?<=[a-z])(?=[A-Z])")
_REGULAR_SHARE, _REGULAR_SHARE_UNNAMED = 0.95, 0.99

_LEAST_INTERVALS = 10
_SILENT_PERIODS = 5
_SILENT_LEAST_NS = 1_000_000_000
_RATE_OVER_NS = 1_000_000_000
_BELIEVED_AFTER = 3
_SAME_RATE = 0.2


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

    Where the name does not say so too, more is asked: hardly an exception, and two turns.
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

    While its range is not known, a fall from the highest value so far to the lowest is either its turn, or lost frames
    around its turn. A later fall decides: the same one again is the turn, one that goes beyond it shows that frames
    were lost. Without better knowledge it runs through all that the signal's `bits` hold.
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
        """Take the raw values of frames in order and return the frames lost just before each, modulo the range.

        -1 where the counter stood still; those of a doubtful fall are listed at the frame that decided it.
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


class MessageFlow:
    """Follows the arrivals of one message.

    What is usual is learned from the first frames, which are judged as soon as that is done. Where there is a rolling
    counter it alone says what is lost, and the rate only how often the counter went round in a long gap. `signals`
    names the rows that `take` gets, in their order.
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
        self.missing = 0
        """Frames that the gaps lack by the usual rate, as far as judged; 0 where a rolling counter counts them."""
        self._turns_lost = 0
        self._undecided = 0
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
    def counter_lost(self) -> int:
        """Frames that the rolling counter says are lost."""
        return self._counter.lost + self._turns_lost if self._counter else 0

    @property
    def at_least(self) -> bool:
        """Whether the loss may be larger: the counter may have wrapped in a gap that is undecided or still open."""
        return self._undecided > 0 or self._gaps is None or self._gaps.open

    @property
    def wrapped(self) -> int:
        """Gaps with lost frames in which the counter may have gone round more often: undecided, or still open."""
        still_open = self._gaps is not None and self._gaps.open_with_loss
        return self._undecided + still_open if self.counter_lost else 0

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
        """Take decoded frames in order: `values` has shape (signals, n)."""
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
        """Take that frames until then were not decoded, and the arrivals of this message among them that are known."""
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
            self._undecided += int(np.count_nonzero(lost))

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
            if self._gaps is not None:
                self._count(self._gaps.close())
            self._gaps = Gaps(usual) if usual else None

    def _count(self, verdicts: list[Verdict]) -> None:
        for verdict in verdicts:
            self.gaps += verdict.gaps
            self._undecided += not verdict.sure
            if self._counter is None:
                self.missing += verdict.lacking
            else:
                self._turns_lost += verdict.lacking
                self._seemed_still += verdict.stood_still


def _same_rate(usual: Usual | None, other: Usual | None) -> bool:
    if usual is None or other is None:
        return usual is other
    return abs(usual.period_ns - other.period_ns) <= _SAME_RATE * other.period_ns
