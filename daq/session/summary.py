"""What a logger tells its caller: while it records, and when it has ended."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from daq.can_source import SourceCounters
from daq.errors import Fault

Ending = Literal["duration", "signal", "stop", "disk"]


@dataclass(frozen=True)
class LogStatus:
    """The logger now.

    Attributes
    ----------
    buses : mapping str -> SourceCounters
    run : str
        Id of the run; empty between runs.
    path : Path
        The file that is written.
    level : str
        ``"green"``, ``"amber"`` or ``"red"``.
    what : str
        The worst reason; empty when it is green.
    """

    buses: Mapping[str, SourceCounters]
    run: str
    path: Path
    level: str
    what: str


Progress = Callable[[LogStatus], None]


@dataclass(frozen=True)
class LogSummary:
    """What was recorded, and how it ended.

    Attributes
    ----------
    path : Path
        The first file.
    paths : tuple of Path
        All files, in the order in which they were begun; those between runs too.
    runs : tuple of str
        Ids of the runs.
    frames, error_frames : dict of str to int
        Per bus, 0 for one that was silent.
    drops : dict of str to int
        Frames that the kernel lost, of the buses that count them.
    losses : dict of str to int
        Everything that was lost: ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>`` (the rolling counter
        jumped) and ``missing.<bus>.<message>`` (against the learned rate).
    duration_s : float
    ended_by : str
        ``"duration"``, ``"signal"`` (see `signal_number`), ``"stop"`` or ``"disk"``: it is full, or failed.
    signal_number : int or None
    faults : tuple of Fault
        Of the disk, and of the buses that were down at the end.
    remarks : tuple of str
    """

    path: Path
    paths: tuple[Path, ...]
    runs: tuple[str, ...]
    frames: dict[str, int]
    error_frames: dict[str, int]
    drops: dict[str, int]
    losses: dict[str, int]
    duration_s: float
    ended_by: Ending
    signal_number: int | None
    faults: tuple[Fault, ...]
    remarks: tuple[str, ...]

    @property
    def silent(self) -> tuple[str, ...]:
        """Buses of which no frame came."""
        return tuple(bus for bus, count in self.frames.items() if not count)
