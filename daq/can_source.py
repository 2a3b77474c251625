"""Live frames: SocketCAN read in batches, every other interface through python-can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from daq.config import BusSection
from daq.errors import HardwareError
from daq.frames import FrameArray, FrameBatch


class InterfaceDownError(HardwareError):
    """The interface is down. The source stays good: it hands out frames again once the interface is up."""


@dataclass(frozen=True)
class SourceCounters:
    """What a source has seen so far.

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
        """Whether the interface is up; True where that cannot be told."""

    def close(self) -> None:
        """Stop listening; a second call does nothing."""


def open_source(bus: BusSection, buffer_bytes: int | None = None) -> Source:
    """Start to listen to a bus.

    Parameters
    ----------
    bus : BusSection
        ``interface`` is one that python-can knows; SocketCAN where none is given.
    buffer_bytes : int, optional
        Receive buffer to ask for, where the interface lets one choose.

    Raises
    ------
    ConfigError
        If python-can knows no such interface.
    HardwareError
        If the interface is not there or must not be opened.
    """
    if _is_socketcan(bus):
        from daq.socketcan import RECEIVE_BUFFER_BYTES, SocketCanSource

        return SocketCanSource(bus.channel, buffer_bytes or RECEIVE_BUFFER_BYTES)
    from daq.python_can import PythonCanSource

    return PythonCanSource(bus)


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


def open_sink(bus: BusSection) -> Sink:
    """Open a bus to send to; see `open_source`."""
    if _is_socketcan(bus):
        from daq.socketcan import SocketCanSink

        return SocketCanSink(bus.channel)
    from daq.python_can import PythonCanSink

    return PythonCanSink(bus)


def _is_socketcan(bus: BusSection) -> bool:
    """Whether `daq.socketcan` is for this bus; where its structures are not the kernel's, python-can is."""
    if bus.interface not in (None, "socketcan"):
        return False
    from daq.socketcan import SUPPORTED

    return SUPPORTED
