"""Opens buses: SocketCAN where the kernel has it, python-can for every other interface."""

from __future__ import annotations

from daq.config import BusSection
from daq.sources.can_source import Sink, Source


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
        from daq.sources.socketcan import RECEIVE_BUFFER_BYTES, SocketCanSource

        return SocketCanSource(bus.channel, buffer_bytes or RECEIVE_BUFFER_BYTES)
    from daq.sources.python_can import PythonCanSource

    return PythonCanSource(bus, buffer_bytes)


def open_sink(bus: BusSection) -> Sink:
    """Open a bus to send to; see `open_source`."""
    if _is_socketcan(bus):
        from daq.sources.socketcan import SocketCanSink

        return SocketCanSink(bus.channel)
    from daq.sources.python_can import PythonCanSink

    return PythonCanSink(bus)


def _is_socketcan(bus: BusSection) -> bool:
    """Whether `daq.sources.socketcan` is for this bus; where its structures are not the kernel's, python-can is."""
    if bus.interface not in (None, "socketcan"):
        return False
    from daq.sources.socketcan import SUPPORTED

    return SUPPORTED
