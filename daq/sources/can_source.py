"""Live buses: what sources and sinks of frames do, and what a source counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from daq.can.frames import FrameArray, FrameBatch
from daq.errors import HardwareError

BusState = Literal["up", "down", "bus_off"]


class InterfaceDownError(HardwareError):
    """The interface is down. The source stays good: it hands out frames again once the interface is up."""


@dataclass(frozen=True)
class SourceCounters:
    """Counts of a source so far.

    Attributes
    ----------
    received : int
        Frames handed out.
    dropped : int or None
        Frames that the kernel lost because nobody fetched them in time; None where the interface does not count them.
    error_frames : int
        Error frames among the received.
    buffer_bytes : int or None
        Size of the receive buffer that was obtained.
    """

    received: int
    dropped: int | None
    error_frames: int
    buffer_bytes: int | None


@dataclass(frozen=True)
class BusStatus:
    """Status of a bus as the logger knows it; counts are since the logger started.

    Attributes
    ----------
    state : {"up", "down", "bus_off"}
    kernel_drops : int or None
        Lost because nobody fetched them in time; None where the interface does not count them.
    queue_drops : int
        Given up by the logger itself.
    detail : str
        Why it is down; empty when it is up.
    """

    state: BusState
    received: int
    kernel_drops: int | None
    queue_drops: int = 0
    reconnects: int = 0
    detail: str = ""


class Source(Protocol):
    """A bus that is being listened to."""

    @property
    def name(self) -> str:
        """Channel of the bus, and its name in the batches."""

    @property
    def counters(self) -> SourceCounters:
        """What came in and what was lost until now."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user should know of how it was opened, e.g. a refused receive buffer."""

    def read(self, timeout_s: float) -> FrameBatch:
        """Wait for frames and return those that are there; none after `timeout_s`.

        Raises
        ------
        InterfaceDownError
            Once, when the interface was taken down; reading may go on.
        HardwareError
            If the interface has gone away.
        """

    def is_up(self) -> bool:
        """Whether the interface is up; True where that is not known."""

    def close(self) -> None:
        """Stop listening; a second call does nothing."""


class Sink(Protocol):
    """A bus that frames are sent to."""

    @property
    def name(self) -> str:
        """Channel of the bus."""

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        """Send frames at once, in their order, waiting while the bus is busy.

        Raises
        ------
        HardwareError
            If the bus takes no frame for `timeout_s`, or the interface has gone away or cannot send such a frame.
        """

    def close(self) -> None:
        """Let go of the interface; a second call does nothing."""
