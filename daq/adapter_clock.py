"""Stamps of a CAN adapter's own clock, which counts from power-up or was set once, brought to the host's clock.

A frame cannot arrive before it was stamped. So the smallest (arrival - stamp) seen is the adapter's clock against the
host's, too large by the shortest delay on the way; all stamps are moved by it, and keep the adapter's order and
spacing. It rises again by 200 ppm, so that an adapter whose clock is slow is followed too: what a stamp owes to that is
200 ppm of the time since the last frame that came quickly.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from daq.host_clock import HostClock

IntArray = NDArray[np.int64]

HOST_STAMPED = frozenset({"socketcan", "udp_multicast", "virtual", "slcan", "robotell", "neousys"})
"""Interfaces of python-can that stamp with the host's CLOCK_REALTIME."""

_FOREIGN_NS = 60 * 10**9
_RESTART_NS = 10**9
_FROZEN_NS = 5 * 10**9
_RISE_PER_NS = 5_000
_WINDOW_NS = 10 * 10**9
_LOST_NS = 50_000_000


class AdapterClock:
    """Brings the stamps of one adapter to the host's realtime.

    Parameters
    ----------
    interface : str
        As python-can calls it.
    clock : HostClock, optional
        For the arrivals.
    """

    def __init__(self, interface: str, clock: HostClock | None = None) -> None:
        self.remarks: tuple[str, ...] = ()
        self.interface = interface
        self._clock = clock or HostClock()
        self._foreign: bool | None = None
        self._frozen = False
        self._floor_ns = 0
        self._last_stamp_ns = self._last_arrival_ns = self._first_seen_ns = self._last_ns = 0
        self._window_from_ns = self._window_above_ns = 0

    def arrived_ns(self) -> int:
        """Return the monotonic time at which a frame was fetched; to be asked for each as it comes."""
        return self._clock.observe()

    def realtime_ns(self, stamps_ns: IntArray, arrived_ns: IntArray) -> IntArray:
        """Return CLOCK_REALTIME at the moment each frame was stamped.

        Parameters
        ----------
        stamps_ns : int64 array, shape (n,)
            As the adapter says; 0 where it says nothing.
        arrived_ns : int64 array, shape (n,)
            Monotonic times of `arrived_ns`.
        """
        if not len(stamps_ns):
            return stamps_ns
        stamped = stamps_ns != 0
        if self._foreign is None:
            self._decide(stamps_ns[stamped], arrived_ns[stamped])
        if not self._foreign:
            return np.where(stamped, stamps_ns, self._clock.realtime_at_ns(arrived_ns))
        times = arrived_ns.copy()
        if stamped.any() and not self._frozen:
            times[stamped] = self._monotonic_ns(stamps_ns[stamped], arrived_ns[stamped])
        times = np.maximum.accumulate(np.maximum(times, self._last_ns))
        self._last_ns = int(times[-1])
        return self._clock.realtime_at_ns(times)

    def _decide(self, stamps_ns: IntArray, arrived_ns: IntArray) -> None:
        """Tell from the first stamp whether the clock is the host's."""
        if not len(stamps_ns):
            self._remark("does not stamp its frames: their times are when they were fetched")
            return
        apart_ns = abs(int(stamps_ns[0]) - int(self._clock.realtime_at_ns(arrived_ns[:1])[0]))
        self._foreign = self.interface not in HOST_STAMPED or apart_ns > _FOREIGN_NS
        if self._foreign:
            self._remark("stamps with a clock of its own: brought to the host's by the shortest delay seen")

    def _remark(self, text: str) -> None:
        said = f"{self.interface} {text}"
        if said not in self.remarks:
            self.remarks += (said,)

    def _monotonic_ns(self, stamps_ns: IntArray, arrived_ns: IntArray) -> IntArray:
        """Return the stamps on the host's monotonic clock; at least one frame."""
        times = np.empty_like(stamps_ns)
        restarts = np.flatnonzero(np.diff(stamps_ns, prepend=self._last_stamp_ns) < -_RESTART_NS)
        edges = sorted({0, *restarts.tolist(), len(stamps_ns)})
        for start, end in pairwise(edges):
            if start in restarts or not self._last_arrival_ns:
                self._floor_ns = int(arrived_ns[start] - stamps_ns[start])
                self._last_arrival_ns = int(arrived_ns[start])
                self._window_from_ns, self._window_above_ns = self._last_arrival_ns, 0
            times[start:end] = self._followed(stamps_ns[start:end], arrived_ns[start:end])
        if stamps_ns[-1] != self._last_stamp_ns:
            self._first_seen_ns = int(arrived_ns[-1])
        elif arrived_ns[-1] - self._first_seen_ns > _FROZEN_NS:
            self._frozen = True
            self._remark("has a clock that stands still: times are when frames were fetched")
        self._last_stamp_ns = int(stamps_ns[-1])
        return times

    def _followed(self, stamps_ns: IntArray, arrived_ns: IntArray) -> IntArray:
        """Move stamps by the smallest delay so far, which rises by 200 ppm of the time that goes by."""
        delay = arrived_ns - stamps_ns
        risen = (arrived_ns - self._last_arrival_ns) // _RISE_PER_NS
        floor = risen + np.minimum(self._floor_ns, np.minimum.accumulate(delay - risen))
        self._last_arrival_ns = int(arrived_ns[-1])
        self._floor_ns = int(floor[-1]) + self._lag_ns(int((delay - floor).min()))
        return np.asarray(stamps_ns + floor)

    def _lag_ns(self, above_ns: int) -> int:
        """Return by how much the floor must rise at once: for ten seconds no frame came near it."""
        if self._last_arrival_ns - self._window_from_ns < _WINDOW_NS:
            self._window_above_ns = min(self._window_above_ns, above_ns)
            return 0
        lag_ns = self._window_above_ns if self._window_above_ns > _LOST_NS else 0
        self._window_from_ns, self._window_above_ns = self._last_arrival_ns, above_ns
        return lag_ns
