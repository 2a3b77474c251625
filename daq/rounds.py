"""A recording several times over, as one stream of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import count

from daq.frames import FrameBatch

_LONELY_NS = 1_000_000_000
"""From round to round of a recording of one frame, which has no interval."""


class Rounds:
    """The same frames again and again, with times that go on; `begun` counts the rounds.

    Parameters
    ----------
    once : callable
        Returns the frames of one round, read anew.
    loops : int or None
        None: for ever.
    """

    def __init__(self, once: Callable[[], Iterable[FrameBatch]], loops: int | None) -> None:
        self._once = once
        self._loops = loops
        self.begun = 0

    def __iter__(self) -> Iterator[FrameBatch]:
        shift_ns = 0
        for number in count(1) if self._loops is None else range(1, self._loops + 1):
            self.begun = number
            frames, first_ns, last_ns = 0, 0, 0
            for batch in self._once():
                if not len(batch):
                    continue
                time_ns = batch.frames["time_ns"]
                first_ns, last_ns = (first_ns, last_ns) if frames else (int(time_ns[0]), int(time_ns[0]))
                last_ns = max(last_ns, int(time_ns.max()))
                frames += len(batch)
                yield _later(batch, shift_ns) if shift_ns else batch
            if not frames:
                return
            span_ns = last_ns - first_ns
            shift_ns += span_ns + (span_ns // (frames - 1) if frames > 1 else _LONELY_NS)


def _later(batch: FrameBatch, shift_ns: int) -> FrameBatch:
    frames = batch.frames.copy()
    frames["time_ns"] += shift_ns
    return FrameBatch(frames, batch.buses)
