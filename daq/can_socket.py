"""Sockets of SocketCAN: opened and set up, asked for their losses, and why they refuse."""

from __future__ import annotations

import errno
import fcntl
import socket
import struct
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from daq.errors import Fault, HardwareError, nearest

# Linux: asm-generic/socket.h, linux/can/raw.h, linux/sock_diag.h
SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55
_MEMINFO_DROPS = 8
_SOL_CAN_RAW, _CAN_RAW_FILTER, _CAN_RAW_ERR_FILTER, _CAN_RAW_FD_FRAMES = 101, 1, 2, 5
_ALL_ERRORS = 0x1FFF_FFFF
_SIOCGIFFLAGS, _IFF_UP = 0x8913, 1
_IFREQ = struct.Struct("=16sH22x")


def listening(channel: str, buffer_bytes: int) -> socket.socket:
    """Return a socket that receives the frames of an interface, and its error frames; see `prepared`.

    Raises
    ------
    HardwareError
        If the kernel has no CAN, or there is no such interface, or it must not be opened.
    """

    def prepare(made: socket.socket) -> None:
        made.setsockopt(_SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ALL_ERRORS)
        prepared(made, buffer_bytes)

    return _bound(channel, prepare)


def sending(channel: str) -> socket.socket:
    """Return a socket that only sends; raises as `listening` does."""
    return _bound(channel, lambda made: made.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, b""))


def prepared(made: socket.socket, buffer_bytes: int) -> socket.socket:
    """Have a socket stamp frames, count lost ones and keep many, beyond the system's limit where that is allowed."""
    made.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    made.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
    try:
        made.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, buffer_bytes)
    except PermissionError:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    return made


def fault_of(channel: str, code: int) -> Fault:
    """Return what an errno of a socket means to people, and what to do."""
    where, said = f"bus {channel}", errno.errorcode.get(code, str(code))
    if code in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        step = "sudo modprobe can_raw (in a container: on the host)"
        return Fault("this kernel has no SocketCAN", where, said, next_step=step)
    if code == errno.ENODEV:
        names = [name for _, name in socket.if_nameindex()]
        step = (
            f"`ip link show type can`; for a virtual bus: ip link add dev {channel} type vcan; ip link set {channel} up"
        )
        return Fault(f"there is no interface {channel}", where, said, nearest(channel, names), step)
    if code == errno.ENETDOWN:
        return Fault("the interface is down", where, said, next_step=f"ip link set {channel} up")
    if code in (errno.EPERM, errno.EACCES):
        return Fault("the interface must not be opened", where, said, next_step="run with the capability CAP_NET_RAW")
    if code in (errno.ENOBUFS, errno.EAGAIN):
        step = "check that another node acknowledges frames, the bit rate and the termination"
        return Fault("the bus takes no frames", where, said, next_step=step)
    if code == errno.EINVAL:
        step = f"ip link set {channel} mtu 72, or a CAN FD bit rate: ip link set {channel} type can ... fd on"
        return Fault("the interface refuses the frame; it may not be a CAN FD one", where, said, next_step=step)
    return Fault("the interface failed", where, said, next_step="check the adapter and its cable")


def buffer_remarks(channel: str, given: int, wanted: int) -> tuple[str, ...]:
    """Return what people should know of a receive buffer that is smaller than wanted."""
    if given >= wanted:
        return ()
    step = f"sudo sysctl net.core.rmem_max={wanted}"
    return (f"{channel}: receive buffer of {given} instead of {wanted} bytes, so bursts may be lost; {step}",)


def lost_frames(made: socket.socket) -> int:
    """Return how many frames the kernel has dropped because they were not fetched in time."""
    words: NDArray[np.uint32] = np.frombuffer(made.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 36), np.uint32)
    return int(words[_MEMINFO_DROPS]) if len(words) > _MEMINFO_DROPS else 0


def interface_is_up(made: socket.socket, channel: str) -> bool:
    """Whether an interface is there and up."""
    try:
        _, flags = _IFREQ.unpack(fcntl.ioctl(made, _SIOCGIFFLAGS, _IFREQ.pack(channel.encode(), 0)))
    except OSError:
        return False
    return bool(flags & _IFF_UP)


def _bound(channel: str, prepare: Callable[[socket.socket], object]) -> socket.socket:
    """Return a socket of an interface, prepared before its first frame can come."""
    try:
        made = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise HardwareError(fault_of(channel, error.errno or 0)) from None
    try:
        made.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FD_FRAMES, 1)
        prepare(made)
        made.bind((channel,))
    except OSError as error:
        made.close()
        raise HardwareError(fault_of(channel, error.errno or 0)) from None
    return made
