"""A UDP socket pair in place of a CAN bus, for kernels without one: a datagram is a ``struct can_frame``.

What receiving costs lies in the system call, the time stamp and what Python makes of them, which are the same.
"""

from __future__ import annotations

import fcntl
import logging
import socket
import sys
import termios
import time

import can
import numpy as np
from can.interfaces.socketcan import socketcan

from daq.can import FrameArray

_CAN_FRAME = np.dtype([("id", "u4"), ("length", "u1"), ("reserved", "V3"), ("data", "u1", (8,))])
_BURST_S = 0.001
_SO_RCVBUFFORCE = 33
_RECEIVE_BYTES = 64 << 20


def pair(port: int = 0) -> tuple[socket.socket, socket.socket]:
    """Return a socket that sends and the one that receives, with room for seconds of a busy bus."""
    receiver = listening(port)
    return sending(receiver.getsockname()[1]), receiver


def listening(port: int = 0) -> socket.socket:
    """Return a socket that receives at a port of this machine."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BYTES)
    except PermissionError:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BYTES)
    made.bind(("127.0.0.1", port))
    return made


def sending(port: int) -> socket.socket:
    """Return a socket that sends there."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.connect(("127.0.0.1", port))
    return made


def datagrams(frames: FrameArray) -> list[bytes]:
    """Return what a CAN socket would hand out for classical frames."""
    raw = np.zeros(len(frames), _CAN_FRAME)
    raw["id"], raw["length"], raw["data"] = frames["can_id"], frames["length"], frames["data"]
    whole = raw.tobytes()
    return [whole[i : i + 16] for i in range(0, len(whole), 16)]


def wait_until_read(receiver: socket.socket) -> None:
    """Return when nothing has waited there for a while: a busy machine may be behind."""
    quiet = 0
    while quiet < 3:
        time.sleep(0.1)
        waiting = int.from_bytes(fcntl.ioctl(receiver, termios.FIONREAD, bytes(4)), sys.byteorder)
        quiet = 0 if waiting else quiet + 1


def send(sender: socket.socket, messages: list[bytes], rate_hz: float) -> None:
    """Send at a rate, a millisecond's worth at a time."""
    size = max(1, round(rate_hz * _BURST_S))
    began_at = time.perf_counter()
    for start in range(0, len(messages), size):
        time.sleep(max(began_at + start / rate_hz - time.perf_counter(), 0.0))
        for message in messages[start : start + size]:
            sender.send(message)


def python_can_bus(receiver: socket.socket) -> can.BusABC:
    """Return python-can's SocketCAN bus, reading from `receiver`."""
    logging.getLogger("can").setLevel(logging.CRITICAL)  # of the options that only a CAN socket knows
    create, bind = socketcan.create_socket, socketcan.bind_socket
    socketcan.create_socket, socketcan.bind_socket = lambda: receiver, lambda *_: None
    try:
        bus = socketcan.SocketcanBus("can0")
    finally:
        socketcan.create_socket, socketcan.bind_socket = create, bind
    bus._is_filtered = True  # as on a CAN socket: the kernel filters
    return bus
