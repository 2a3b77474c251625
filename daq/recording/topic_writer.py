"""Writing what lies beside the raw frames: decoded topics, and what the host has to say."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.recording.decoded_topics import DecodedTopics
from daq.recording.diagnostics import DiagnosticStatus
from daq.recording.events import Event
from daq.recording.host_topics import HostTopics


@dataclass(frozen=True)
class Topics:
    """The topics of one file beside the raw ones.

    Attributes
    ----------
    decoded : DecodedTopics
    host : HostTopics
    chunk_bytes : int
        Uncompressed size at which a chunk is written.
    tick : callable
        Is called after every write.
    """

    decoded: DecodedTopics
    host: HostTopics
    chunk_bytes: int
    tick: Callable[[], None]

    def settle(self, written: DecodedTopics | HostTopics) -> None:
        """Write a chunk if there is enough for one."""
        if written.pending_bytes >= self.chunk_bytes:
            written.write_chunk()
        self.tick()


class TopicWriter(ABC):
    """What decoded values, events, diagnostics and clock offsets are written to."""

    @property
    @abstractmethod
    def topics(self) -> Topics:
        """Of the file that is written now."""

    def write_decoded(
        self,
        message: str,
        bus: str,
        time_ns: NDArray[np.int64],
        signals: Mapping[str, NDArray[np.float64]],
        units: Mapping[str, str],
        *,
        publish_ns: NDArray[np.int64] | None = None,
    ) -> None:
        """Write a DBC message's physical values as a topic of its own.

        Parameters
        ----------
        message, bus : str
        time_ns : int64 array, shape (n,)
            Host receive time.
        signals : mapping str -> float64 array, shape (n,)
            NaN where a frame did not carry the signal.
        units : mapping str -> str
            Unit of every signal of the message; the first call for a message settles which there are.
        publish_ns : int64 array, shape (n,), optional
            Best estimate of the measurement time; `time_ns` where there is none.
        """
        self.topics.decoded.write(message, bus, time_ns, signals, units, time_ns if publish_ns is None else publish_ns)
        self.topics.settle(self.topics.decoded)

    def write_position(
        self,
        bus: str,
        time_ns: NDArray[np.int64],
        latitude_deg: NDArray[np.float64],
        longitude_deg: NDArray[np.float64],
        altitude_m: NDArray[np.float64] | None = None,
    ) -> None:
        """Write positions as a ROS 2 NavSatFix topic, for map panels; NaN is written as "no fix"."""
        self.topics.decoded.write_position(bus, time_ns, latitude_deg, longitude_deg, altitude_m)
        self.topics.settle(self.topics.decoded)

    def write_event(self, event: Event) -> None:
        """Write an event, topic ``/events``."""
        self.topics.host.write_event(event)
        self.topics.settle(self.topics.host)

    def write_diagnostics(self, time_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Write how everything is at one moment, topic ``/diagnostics``.

        Raises
        ------
        DataError
            If a level is none of 0 to 3.
        """
        self.topics.host.write_diagnostics(time_ns, statuses)
        self.topics.settle(self.topics.host)

    def write_clock(
        self, time_ns: int, bus: str, realtime_minus_monotonic_ns: int, file_minus_realtime_ns: int
    ) -> None:
        """Tell which clock offsets hold for the frames of a bus, topic ``/clock/host``.

        To be called with every batch: it is written when an offset differs by more than 1 ms from what was written
        last, and once a second.

        Parameters
        ----------
        time_ns : int
            On the recording's time base.
        bus : str
        realtime_minus_monotonic_ns : int
            The host's CLOCK_REALTIME less its monotonic clock (`daq.host_clock.monotonic_ns`: on Linux CLOCK_BOOTTIME).
        file_minus_realtime_ns : int
            The recording's time base less the host's CLOCK_REALTIME.
        """
        self.topics.host.write_clock(time_ns, bus, realtime_minus_monotonic_ns, file_minus_realtime_ns)
        self.topics.settle(self.topics.host)
