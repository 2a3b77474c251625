"""What came of each signal of a run: rate, range, share present, longest gap, and what is missing of each message."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from types import MappingProxyType

import numpy as np

from daq import FloatArray, IntArray, SamplingEstimator
from daq.can.roles import NoData

MOST_MESSAGES = 5000


@dataclass(frozen=True)
class SignalFacts:
    """What came of one signal.

    Attributes
    ----------
    least, most : float
        The range of its values; NaN where there was none.
    share : float
        Of the samples that have a value.
    absent : mapping str -> int
        Samples without a value by the sender's own word, by that word.
    all_bits_set : int
        Samples with all bits set, which the DBC does not declare as no value: they count as values.
    """

    name: str
    unit: str
    least: float
    most: float
    share: float
    absent: dict[str, int] = field(default_factory=dict)
    all_bits_set: int = 0


@dataclass(frozen=True)
class MessageFacts:
    """What came of one message of a bus, or of one topic of decoded series.

    Attributes
    ----------
    bus : str
        Empty for decoded series.
    rate_hz : float
        Samples over duration, without pauses; NaN below two samples (`daq.sampling`).
    missing_share : float
        Of the samples that the sender's period lets expect; NaN where they come at no rate.
    longest_gap_s, gap_at_s : float
        The longest interval, and when it began after the run's first sample.
    """

    bus: str
    name: str
    samples: int
    rate_hz: float
    missing_share: float
    longest_gap_s: float
    gap_at_s: float
    signals: tuple[SignalFacts, ...]


class SignalTally:
    """Takes the samples of a run piece by piece, and says what came."""

    def __init__(self) -> None:
        self._messages: dict[tuple[str, str], _Message] = {}
        self.passed_over = 0

    def take(
        self,
        bus: str,
        name: str,
        time_ns: IntArray,
        values: Mapping[str, FloatArray],
        units: Mapping[str, str],
        no_data: Mapping[str, NoData] = MappingProxyType({}),
    ) -> None:
        """Take a piece of one message with all its signals; of new ones beyond `MOST_MESSAGES` samples are counted.

        `no_data` says which values of a signal are none.
        """
        message = self._messages.get((bus, name))
        if message is None:
            if len(self._messages) == MOST_MESSAGES:
                self.passed_over += len(time_ns)
                return
            message = self._messages[bus, name] = _Message(dict(units), no_data)
        message.take(time_ns, values)

    def facts(self) -> tuple[MessageFacts, ...]:
        """Return what came so far, in the order of the first piece."""
        filled = [message for message in self._messages.values() if message.count]
        start_ns = min((message.first_ns for message in filled), default=0)
        return tuple(message.facts(*key, start_ns) for key, message in self._messages.items())


class _Message:
    def __init__(self, units: Mapping[str, str], no_data: Mapping[str, NoData]) -> None:
        self.units = units
        self._no_data = no_data
        self._absent: dict[str, Counter[str]] = {name: Counter() for name in units}
        self._all_bits_set = dict.fromkeys(units, 0)
        self.count = 0
        self.first_ns = self.last_ns = 0
        self._gap_ns, self._gap_at_ns = 0, 0
        self._sampling = SamplingEstimator()
        self._present = dict.fromkeys(units, 0)
        self._range = dict.fromkeys(units, (np.inf, -np.inf))

    def take(self, time_ns: IntArray, values: Mapping[str, FloatArray]) -> None:
        if not len(time_ns):
            return
        before = self.last_ns if self.count else int(time_ns[0])
        steps = np.diff(time_ns, prepend=before)
        longest = int(np.argmax(steps))
        if steps[longest] > self._gap_ns:
            self._gap_ns, self._gap_at_ns = int(steps[longest]), int(time_ns[longest] - steps[longest])
        self._sampling.take(time_ns)
        if not self.count:
            self.first_ns = int(time_ns[0])
        self.last_ns = int(time_ns[-1])
        self.count += len(time_ns)
        for name, column in values.items():
            there = column[np.isfinite(column)]
            least, most = _ends(there)
            if name in self._no_data and self._no_data[name].touches(least, most):
                there = self._without_absent(name, there)
                least, most = _ends(there)
            low, high = self._range[name]
            self._range[name] = (min(low, least), max(high, most))
            self._present[name] += len(there)

    def _without_absent(self, name: str, values: FloatArray) -> FloatArray:
        """Count what is no value, and what may be none; return the values."""
        none = self._no_data[name]
        for word, mask in none.masks(values).items():
            self._absent[name][word] += int(np.count_nonzero(mask))
        if none.all_bits_set is not None:
            self._all_bits_set[name] += int(np.count_nonzero(values == none.all_bits_set))
        return values[none.is_value(values)]

    def facts(self, bus: str, name: str, start_ns: int) -> MessageFacts:
        sampling = self._sampling.estimate()
        signals = []
        for signal, unit in self.units.items():
            low, high = self._range[signal] if self._present[signal] else (nan, nan)
            share = self._present[signal] / self.count if self.count else 0.0
            absent, full = dict(self._absent[signal]), self._all_bits_set[signal]
            signals.append(SignalFacts(signal, unit, low, high, share, absent, full))
        return MessageFacts(
            bus=bus,
            name=name,
            samples=self.count,
            rate_hz=sampling.rate_hz,
            missing_share=sampling.missing_share,
            longest_gap_s=self._gap_ns * 1e-9 if self.count > 1 else nan,
            gap_at_s=(self._gap_at_ns - start_ns) * 1e-9,
            signals=tuple(signals),
        )


def _ends(values: FloatArray) -> tuple[float, float]:
    """Return the least and the largest value, infinity and minus infinity where there is none."""
    return (float(values.min()), float(values.max())) if len(values) else (np.inf, -np.inf)
