"""What a run lacks between two of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from daq.recording.format import RUN_END
from daq.recording.parts import ROTATED, part_number
from daq.recording.reader import Recording


@dataclass(frozen=True)
class Gap:
    """What was not recorded between two parts.

    Attributes
    ----------
    before, after : int
        Numbers of the parts.
    from_ns, to_ns : int
        Last frame of the one, first frame of the other.
    """

    before: int
    after: int
    from_ns: int
    to_ns: int

    def __str__(self) -> str:
        length_s = (self.to_ns - self.from_ns) * 1e-9
        if length_s < 0:
            return f"part {self.after} begins {-length_s:.2f} s before the last frame of part {self.before}"
        return f"{length_s:.2f} s between part {self.before} and part {self.after} were not recorded"


def gaps_between(parts: Sequence[Recording]) -> tuple[Gap, ...]:
    """Return where a part does not take up where the one before it left off: the logger had died meanwhile."""
    filled = [(part, span) for part in parts if part.has_raw_frames and (span := part.time_range_ns) is not None]
    return tuple(
        Gap(part_number(before.path)[1], part_number(after.path)[1], before_ns[1], after_ns[0])
        for (before, before_ns), (after, after_ns) in pairwise(filled)
        if before.metadata.get(RUN_END, {}).get("exit_status") != ROTATED
    )
