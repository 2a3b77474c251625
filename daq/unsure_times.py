"""Frames whose time is unsure, because the host's clock was set while they came in: how many, and how unsure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.frames import FrameBatch, FrameFlag


class UnsureTimes:
    """Counts the flagged frames of a run while its batches come by.

    The time of a flagged frame is never late (`daq.host_clock.StampTracker`), and the next sure frame of its bus came
    after it: what lies between the two times is the most that it can be wrong by.
    """

    def __init__(self) -> None:
        self.frames = 0
        """Flagged frames so far."""
        self._within_ns = 0
        self._waiting_ns: dict[str, int] = {}

    @property
    def within_s(self) -> float:
        """By how much the times can be wrong, s; NaN while no sure frame has come after a flagged one."""
        return float("nan") if self._waiting_ns else self._within_ns * 1e-9

    def take(self, batch: FrameBatch) -> None:
        """Look at frames in the order in which they came."""
        unsure = (batch.frames["flags"] & FrameFlag.UNSURE_TIME) != 0
        if not self._waiting_ns and not unsure.any():
            return
        self.frames += int(np.count_nonzero(unsure))
        for number, bus in enumerate(batch.buses):
            rows = batch.frames["bus"] == number
            self._take_bus(bus, batch.frames["time_ns"][rows], unsure[rows])

    def note(self) -> str:
        """Return a sentence for people; empty where no frame was flagged."""
        if not self.frames:
            return ""
        by = "" if self._waiting_ns else f" by up to {self.within_s:.3g} s"
        return f"{self.frames:,} frames came while the host's clock was set; their times may be wrong{by}"

    def _take_bus(self, bus: str, time_ns: NDArray[np.int64], unsure: NDArray[np.bool_]) -> None:
        sure, flagged = np.flatnonzero(~unsure), np.flatnonzero(unsure)
        if len(sure) and bus in self._waiting_ns:
            self._bound(time_ns[sure[:1]] - self._waiting_ns.pop(bus))
        following = np.searchsorted(sure, flagged)
        followed = following < len(sure)
        self._bound(time_ns[sure[following[followed]]] - time_ns[flagged[followed]])
        if not followed.all():
            self._waiting_ns.setdefault(bus, int(time_ns[flagged[~followed]].min()))

    def _bound(self, apart_ns: NDArray[np.int64]) -> None:
        self._within_ns = max(self._within_ns, int(apart_ns.max(initial=0)))
