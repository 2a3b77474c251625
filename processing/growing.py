"""A series that grows in place: no pile of small pieces, no second copy when it is complete."""

from __future__ import annotations

import numpy as np

from processing.timebase import FloatArray, IntArray

_FIRST_ROOM = 1 << 14
_GROWTH = 8


class GrowingSeries:
    """Stamps and values, appended to. Room is added by an eighth, which the system does without copying."""

    def __init__(self) -> None:
        self._time_ns: IntArray = np.zeros(0, np.int64)
        self._values: FloatArray = np.zeros(0)
        self._count = 0

    def append(self, time_ns: IntArray, values: FloatArray) -> None:
        """Copy samples to the end."""
        end = self._count + len(values)
        if end > len(self._values):
            self._resize(end + max(_FIRST_ROOM, end // _GROWTH))
        self._time_ns[self._count : end] = time_ns
        self._values[self._count : end] = values
        self._count = end

    def release(self) -> tuple[IntArray, FloatArray]:
        """Return everything appended, and hold it no longer."""
        self._resize(self._count)
        time_ns, values = self._time_ns, self._values
        self._time_ns, self._values, self._count = np.zeros(0, np.int64), np.zeros(0), 0
        return time_ns, values

    def _resize(self, room: int) -> None:
        self._time_ns.resize(room, refcheck=False)
        self._values.resize(room, refcheck=False)
