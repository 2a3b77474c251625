"""What a session has lost, as the parts of a run tell it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from daq.recording.counts import since
from daq.recording.format import LOSSES
from daq.recording.writer import RecordingWriter

_EVERY_S = 1.0


class LossTeller:
    """Keeps counts of what was lost, and writes a metadata record of them when there is news.

    Parameters
    ----------
    clock : callable
        Monotonic time, s.

    Attributes
    ----------
    drops : dict str -> int
        Frames lost before they were recorded, per bus, since the session's first part.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.drops: dict[str, int] = {}
        self._drops_before: dict[str, int] = {}
        self._losses: dict[str, int] = {}
        self._told: dict[str, int] = {}
        self._told_at = -math.inf

    @property
    def part_drops(self) -> dict[str, int]:
        """The drops of this part."""
        return since(self.drops, self._drops_before)

    def note(self, drops: Mapping[str, int] | None, losses: Mapping[str, int] | None) -> None:
        """Take what has been lost so far; what was noted last holds where nothing is given."""
        self.drops = self.drops if drops is None else dict(drops)
        self._losses = self._losses if losses is None else dict(losses)

    def tell_if_due(self, writer: RecordingWriter) -> None:
        """Tell the file of news, at most once a second."""
        if self._clock() - self._told_at >= _EVERY_S:
            self.tell(writer)

    def tell(self, writer: RecordingWriter) -> None:
        """Tell the file of news."""
        if self._losses != self._told:
            writer.add_metadata(LOSSES, {key: str(count) for key, count in self._losses.items()})
            self._told, self._told_at = dict(self._losses), self._clock()

    def begin_part(self) -> None:
        """Count and tell from here on for the next part."""
        self._drops_before, self._told = self.drops, {}
