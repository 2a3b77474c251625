"""Any python-can interface as a source of frames or a place to send them to."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import socket
import struct
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.adapter_clock import AdapterClock
from daq.can_source import SourceCounters
from daq.config import BusSection
from daq.errors import ConfigError, Fault, HardwareError, nearest
from daq.frames import FrameArray, FrameBatch, FrameFlag
from daq.messages import frames_from_messages, messages_from_frames

if TYPE_CHECKING:
    import can

_MOST_AT_ONCE = 4096
_EXTRAS = {
    "udp_multicast": "multicast",
    "serial": "serial",
    "slcan": "serial",
    "robotell": "serial",
    "seeedstudio": "seeedstudio",
    "gs_usb": "gs-usb",
    "neovi": "neovi",
    "canalystii": "canalystii",
    "cantact": "cantact",
}
"""Interfaces and the extra of python-can that brings their Python package."""


_DRIVER_ERRORS = (OSError, ValueError, TypeError, AttributeError, IndexError, struct.error)
"""What python-can's drivers raise, beside its own errors, when their adapter is pulled out or sends nonsense."""


_NOISY_LOGGERS = ("can.bus", "can.pcan")
"""They warn of a bus that could not be opened, and of a package that stamps do not need; the fault says what counts."""


_MULTICAST_ALL = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
"""Linux's IP_MULTICAST_ALL and IPV6_MULTICAST_ALL, which the socket module does not name."""


def open_bus(bus: BusSection) -> can.BusABC:
    """Open a python-can bus.

    Raises
    ------
    ConfigError
        If python-can knows no such interface.
    HardwareError
        If it is not there, must not be opened, or lacks its driver.
    """
    import can

    for name in _NOISY_LOGGERS:
        logging.getLogger(name).setLevel(logging.ERROR)
    interface = bus.interface or "socketcan"
    if interface not in can.VALID_INTERFACES:
        known = nearest(interface, can.VALID_INTERFACES)
        raise ConfigError(Fault(f"python-can knows no interface {interface!r}", f"bus {bus.channel}", expected=known))
    options: dict[str, Any] = {"fd": True} if bus.fd else {}
    if bus.bitrate is not None:
        options["bitrate"] = bus.bitrate
    try:
        opened = can.Bus(interface=interface, channel=bus.channel, ignore_config=True, **options)
        if interface == "udp_multicast":
            _hear_only_its_group(opened)
        return opened
    except (can.CanError, OSError, ImportError, ValueError, TypeError, NameError) as error:
        # NameError: what python-can's kvaser raises without its driver
        raise HardwareError(
            Fault(
                f"the {interface} interface cannot be opened",
                f"bus {bus.channel}",
                str(error) or type(error).__name__,
                next_step=_next_step(interface, bus.channel, error),
            )
        ) from None


def _hear_only_its_group(bus: can.BusABC) -> None:
    """Have a multicast bus ignore the groups that other programs of this machine have joined, as it shares a port."""
    if sys.platform == "linux":
        with socket.socket(fileno=os.dup(bus.fileno())) as same, contextlib.suppress(OSError):  # an old kernel
            same.setsockopt(*_MULTICAST_ALL[socket.AddressFamily(same.family)], 0)


def _next_step(interface: str, channel: str, error: Exception) -> str:
    import can

    if isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError):
        if interface in _EXTRAS:
            return f"install what the interface needs: pip install 'python-can[{_EXTRAS[interface]}]'"
        return "install the interface's driver and Python package, see python-can's documentation of it"
    if interface == "udp_multicast" and not _is_multicast(channel):
        return "for udp_multicast the channel is a multicast address, e.g. 239.74.163.2"
    return "check that the adapter is plugged in, and its driver and Python package installed"


def _is_multicast(channel: str) -> bool:
    try:
        return ipaddress.ip_address(channel).is_multicast
    except ValueError:
        return False


class PythonCanSource:
    """Frames of a python-can bus; see `daq.can_source.Source`. It does not count what it loses."""

    def __init__(self, bus: BusSection) -> None:
        self._bus = open_bus(bus)
        self._open = True
        self.name = bus.channel
        self._clock = AdapterClock(bus.interface or "socketcan")
        self._received = 0
        self._errors = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `daq.can_source.Source`; what is to say of the stamps is known when the first frames are there."""
        return (f"{self._clock.interface} does not report frames that it loses", *self._clock.remarks)

    @property
    def counters(self) -> SourceCounters:
        """See `daq.can_source.Source`."""
        return SourceCounters(self._received, None, self._errors, None)

    def read(self, timeout_s: float) -> FrameBatch:
        """See `daq.can_source.Source`."""
        import can

        messages: list[can.Message] = []
        arrived_ns: list[int] = []
        wait_s = timeout_s
        try:
            while len(messages) < _MOST_AT_ONCE and (message := self._bus.recv(wait_s)) is not None:
                arrived_ns.append(self._clock.arrived_ns())
                messages.append(message)
                wait_s = 0.0
        except (can.CanError, *_DRIVER_ERRORS) as error:
            raise HardwareError(_gone(self.name, error)) from None
        stamps = [round((message.timestamp or 0.0) * 1e6) * 1000 for message in messages]
        times = self._clock.realtime_ns(np.array(stamps, np.int64), np.array(arrived_ns, np.int64))
        frames = frames_from_messages(messages, times.tolist(), lambda _: 0)
        self._received += len(frames)
        self._errors += int(np.count_nonzero(frames["flags"] & FrameFlag.ERROR))
        return FrameBatch(frames, (self.name,))

    def is_up(self) -> bool:
        """See `daq.can_source.Source`."""
        return True

    def close(self) -> None:
        """See `daq.can_source.Source`."""
        if self._open:
            self._open = False
            self._bus.shutdown()


class PythonCanSink:
    """A python-can bus to send frames to; see `daq.can_source.Sink`."""

    def __init__(self, bus: BusSection) -> None:
        self._bus = open_bus(bus)
        self._open = True
        self.name = bus.channel

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        """See `daq.can_source.Sink`."""
        import can

        deadline = time.monotonic() + timeout_s
        for message in messages_from_frames(frames):
            while True:
                try:
                    self._bus.send(message, timeout=max(deadline - time.monotonic(), 0.0))
                except (can.CanError, OSError) as error:
                    if time.monotonic() < deadline and getattr(error, "error_code", None) == 105:
                        time.sleep(0.0005)  # ENOBUFS: the queue of the interface is full
                        continue
                    raise HardwareError(_gone(self.name, error)) from None
                break

    def close(self) -> None:
        """See `daq.can_source.Sink`."""
        if self._open:
            self._open = False
            self._bus.shutdown()


def _gone(name: str, error: Exception) -> Fault:
    return Fault("the interface failed", f"bus {name}", str(error), next_step="check the adapter and its cable")
