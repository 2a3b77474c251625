"""Any python-can interface as a source or a sink of frames.

Some adapters stamp frames with a clock of their own, which counts from power-up or was set once; its stamps are
brought to the host's clock. A frame cannot arrive before it was stamped, so the smallest (arrival - stamp) is the
offset between the two clocks plus the shortest delay on the way. All stamps are moved by it, and keep the adapter's
order and spacing. The offset may rise again by 200 ppm, so that a slow adapter clock is followed too: the error from
that is at most 200 ppm of the time since the last frame with the shortest delay.
"""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import socket
import struct
import sys
import time
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from daq import BusSection, ConfigError, Fault, HardwareError, IntArray, nearest
from daq.can.frames import FrameArray, FrameBatch, FrameFlag, frames_from_messages, messages_from_frames
from daq.host_clock import HostClock, monotonic_ns
from daq.sources.can_source import SourceCounters

if TYPE_CHECKING:
    from daq.can.library import can


HOST_STAMPED = frozenset({"socketcan", "udp_multicast", "virtual", "slcan", "robotell", "neousys"})
"""Interfaces of python-can that stamp with the host's CLOCK_REALTIME."""

_FOREIGN_NS = 60 * 10**9
_RESTART_NS = 10**9
_FROZEN_NS = 5 * 10**9
_RISE_PER_NS = 5_000
_WINDOW_NS = 10 * 10**9
_LOST_NS = 50_000_000

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


class AdapterClock:
    """Brings the stamps of one adapter to the host's realtime; `clock` is for the arrivals."""

    def __init__(self, interface: str, clock: HostClock | None = None) -> None:
        self.remarks: tuple[str, ...] = ()
        self.interface = interface
        self._clock = clock or HostClock()
        self._foreign: bool | None = None
        self._frozen = False
        self._floor_ns = 0
        self._last_stamp_ns = self._last_arrival_ns = self._stamp_since_ns = self._last_ns = 0
        self._window_from_ns = self._window_above_ns = 0

    def observe(self) -> None:
        """Check whether the host's clock was set; to be called after each reading."""
        self._clock.observe()

    def realtime_ns(self, stamps_ns: IntArray, arrived_ns: IntArray) -> IntArray:
        """Return CLOCK_REALTIME at the moment each frame was stamped.

        `stamps_ns` are the adapter's, 0 where it says nothing; `arrived_ns` are the monotonic times at which the frames
        were fetched; shape (n,) each.
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
        """Decide from the first stamp whether the clock is the host's."""
        if not len(stamps_ns):
            self._remark("does not stamp its frames: their times are when they were fetched")
            return
        apart_ns = abs(int(stamps_ns[0]) - int(self._clock.realtime_at_ns(arrived_ns[:1])[0]))
        self._foreign = self.interface not in HOST_STAMPED or apart_ns > _FOREIGN_NS
        if self._foreign:
            self._remark("stamps with a clock of its own: brought to the host's by the shortest delay so far")

    def _remark(self, text: str) -> None:
        remark = f"{self.interface} {text}"
        if remark not in self.remarks:
            self.remarks += (remark,)

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
            self._stamp_since_ns = int(arrived_ns[-1])
        elif arrived_ns[-1] - self._stamp_since_ns > _FROZEN_NS:
            self._frozen = True
            self._remark("has time stamps that do not advance: times are when frames were fetched")
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


def open_bus(bus: BusSection) -> can.BusABC:
    """Open a python-can bus.

    Raises ConfigError if python-can knows no such interface, HardwareError if it is not there, must not be opened, or
    lacks its driver.
    """
    from daq.can.library import can

    for name in _NOISY_LOGGERS:
        logging.getLogger(name).setLevel(logging.ERROR)
    interface = bus.interface or "socketcan"
    if interface not in can.VALID_INTERFACES:
        known = nearest(interface, can.VALID_INTERFACES)
        raise ConfigError.of(
            f"python-can knows no interface {interface!r}",
            f"bus {bus.channel}",
            "",
            known,
            "correct interface under [[bus]]",
        )
    options: dict[str, Any] = {"fd": True} if bus.fd else {}
    if bus.bitrate is not None:
        options["bitrate"] = bus.bitrate
    try:
        opened = can.Bus(interface=interface, channel=bus.channel, ignore_config=True, **options)
        if made := _socket_of(opened):
            with made, contextlib.suppress(OSError):  # an old kernel
                made.setsockopt(*_MULTICAST_ALL[socket.AddressFamily(made.family)], 0)
        return opened
    except (can.CanError, OSError, ImportError, ValueError, TypeError, NameError) as error:
        # NameError: what python-can's kvaser raises without its driver
        what, found = f"the {interface} interface cannot be opened", str(error) or type(error).__name__
        step = _next_step(interface, bus.channel, error)
        raise HardwareError.of(what, f"bus {bus.channel}", found, next_step=step) from None


def _socket_of(bus: can.BusABC) -> socket.socket | None:
    """Return the socket of a multicast bus, on Linux, where it can be asked for room and for its losses."""
    if sys.platform != "linux" or type(bus).__name__ != "UdpMulticastBus":
        return None
    return socket.socket(fileno=os.dup(bus.fileno()))


def _next_step(interface: str, channel: str, error: Exception) -> str:
    from daq.can.library import can

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


class _OpenBus:
    """A python-can bus that is open until `close`."""

    def __init__(self, bus: BusSection) -> None:
        self._bus = open_bus(bus)
        self._open = True
        self.name = bus.channel

    def close(self) -> None:
        """Let go of the interface; a second call does nothing."""
        if self._open:
            self._open = False
            self._bus.shutdown()


class PythonCanSource(_OpenBus):
    """Frames of a python-can bus; see `daq.sources.can_source.Source`. Only of a multicast bus are losses counted.

    `buffer_bytes` is the receive buffer to ask for, where the bus is a socket.
    """

    def __init__(self, bus: BusSection, buffer_bytes: int | None = None) -> None:
        super().__init__(bus)
        self._socket = _socket_of(self._bus)
        if self._socket:
            from daq.sources.socketcan import RECEIVE_BUFFER_BYTES, ask_for_room  # Linux has it

            ask_for_room(self._socket, buffer_bytes or RECEIVE_BUFFER_BYTES)
        self._counted: tuple[int, int] | None = None
        self._clock = AdapterClock(bus.interface or "socketcan")
        self._received = 0
        self._errors = 0
        self._failed: HardwareError | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `daq.sources.can_source.Source`; what to say of the stamps is known with the first frames."""
        silent = () if self._socket else (f"{self._clock.interface} does not report frames that it loses",)
        return (*silent, *self._clock.remarks)

    @property
    def counters(self) -> SourceCounters:
        """See `daq.sources.can_source.Source`."""
        if self._socket and self._open:
            from daq.sources.socketcan import lost_frames, room_bytes

            self._counted = lost_frames(self._socket), room_bytes(self._socket)
        lost, room = self._counted or (None, None)
        return SourceCounters(self._received, lost, self._errors, room)

    def close(self) -> None:
        """See `_OpenBus.close`."""
        _ = self.counters
        super().close()
        if self._socket:
            self._socket.close()

    def read(self, timeout_s: float) -> FrameBatch:
        """See `daq.sources.can_source.Source`."""
        from daq.can.library import can

        if self._failed:
            raise self._failed
        messages: list[can.Message] = []
        arrived_ns: list[int] = []
        wait_s = timeout_s
        try:
            while len(messages) < _MOST_AT_ONCE and (message := self._bus.recv(wait_s)) is not None:
                arrived_ns.append(monotonic_ns())
                messages.append(message)
                wait_s = 0.0
        except (can.CanError, *_DRIVER_ERRORS) as error:
            self._failed = HardwareError(_gone(self.name, error))
            if not messages:
                raise self._failed from None
        self._clock.observe()
        stamps = [round((message.timestamp or 0.0) * 1e6) * 1000 for message in messages]
        times = self._clock.realtime_ns(np.array(stamps, np.int64), np.array(arrived_ns, np.int64))
        frames = frames_from_messages(messages, times)
        self._received += len(frames)
        self._errors += int(np.count_nonzero(frames["flags"] & FrameFlag.ERROR))
        return FrameBatch(frames, (self.name,))

    def is_up(self) -> bool:
        """See `daq.sources.can_source.Source`."""
        return True


class PythonCanSink(_OpenBus):
    """A python-can bus to send frames to; see `daq.sources.can_source.Sink`."""

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        """See `daq.sources.can_source.Sink`."""
        from daq.can.library import can

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


def _gone(name: str, error: Exception) -> Fault:
    return Fault("the interface failed", f"bus {name}", str(error), next_step="check the adapter and its cable")
