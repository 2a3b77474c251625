"""Between the writer and the inspection: gathers frames, and gives way when the writer is behind."""

from __future__ import annotations

from collections import deque

from daq.frames import FrameBatch
from daq.health.report import HostFacts
from daq.session.inspection import Task

_BEHIND, _CAUGHT_UP = 0.25, 0.05
_MOST_BYTES = 4 << 20


class Feed:
    """Frames that were recorded and wait for their inspection.

    Attributes
    ----------
    skipped_frames : int
        Frames that were recorded and not inspected so far.
    behind : bool
        Whether the queue was more than a quarter full, and has not drained since.
    """

    def __init__(self) -> None:
        self.skipped_frames = 0
        self.behind = False
        self._fresh: deque[FrameBatch] = deque()
        self._skipped: deque[FrameBatch] = deque()
        self._bytes = 0
        self._skipped_bytes = 0

    def take(self, batch: FrameBatch, queue_share: float) -> None:
        """Take recorded frames."""
        if queue_share > _BEHIND:
            self.behind = True
        elif queue_share < _CAUGHT_UP:
            self.behind = False
        self._fresh.append(batch)
        self._bytes += batch.frames.nbytes
        while self._fresh and (self.behind or self._bytes > _MOST_BYTES):
            self._skip()

    def task(self, now_ns: int, host: HostFacts) -> Task:
        """Return what is to be inspected now."""
        task = Task(list(self._fresh), list(self._skipped), now_ns, host)
        self._fresh.clear()
        self._skipped.clear()
        self._bytes = self._skipped_bytes = 0
        return task

    def _skip(self) -> None:
        """Give up the inspection of the oldest frames; the newest of those are kept to be counted."""
        batch = self._fresh.popleft()
        self._bytes -= batch.frames.nbytes
        self.skipped_frames += len(batch)
        self._skipped.append(batch)
        self._skipped_bytes += batch.frames.nbytes
        while self._skipped_bytes > _MOST_BYTES and len(self._skipped) > 1:
            self._skipped_bytes -= self._skipped.popleft().frames.nbytes
