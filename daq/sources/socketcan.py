"""SocketCAN: hundreds of frames per system call, with the kernel's time stamps and its count of lost frames."""

from __future__ import annotations

import ctypes
import errno
import select
import socket
import struct
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from daq import Fault, HardwareError, IntArray, nearest
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch, FrameFlag, joined
from daq.sources.can_source import InterfaceDownError, SourceCounters

# Linux: asm-generic/socket.h, linux/can/raw.h, linux/sock_diag.h
SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55
_MEMINFO_DROPS = 8
_SOL_CAN_RAW, _CAN_RAW_FILTER, _CAN_RAW_ERR_FILTER, _CAN_RAW_FD_FRAMES = 101, 1, 2, 5
_ALL_ERRORS = 0x1FFF_FFFF
_SIOCGIFFLAGS, _IFF_UP = 0x8913, 1
_IFREQ = struct.Struct("=16sH22x")

RECEIVE_BUFFER_BYTES = 8 << 20
"""What is asked of the kernel: 10,000 frames, 3 s of a busy bus. Its default is 278 frames."""
FRAMES_A_CALL = 256
_MOST_AT_ONCE = 16 * FRAMES_A_CALL

# Linux: linux/can.h
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_ID_MASK = 0x1FFF_FFFF
_BRS, _ESI, _FDF = 1, 2, 4
_CLASSIC_BYTES, _FD_BYTES = 16, 72

_HEADER = np.dtype(
    [
        ("name", "u8"),
        ("name_size", "u4"),
        ("iov", "u8"),
        ("iov_count", "u8"),
        ("control", "u8"),
        ("control_size", "u8"),
        ("flags", "i4"),
    ],
    align=True,
)
_MMSGHDR = np.dtype([("header", _HEADER), ("size", "u4")], align=True)
_IOVEC = np.dtype([("base", "u8"), ("size", "u8")])
_FRAME = np.dtype([("id", "u4"), ("length", "u1"), ("flags", "u1"), ("reserved", "V2"), ("data", "u1", (64,))])
_CONTROL_WORDS = 8
"""Two control messages: a time stamp (4 words of 8 bytes), then the count of lost frames (3 words)."""
_STAMP_BYTES = 32
_TIME_STAMP = SO_TIMESTAMPNS << 32 | socket.SOL_SOCKET
_LOST = SO_RXQ_OVFL << 32 | socket.SOL_SOCKET

_BITS = ((_EXTENDED, FrameFlag.EXTENDED), (_REMOTE, FrameFlag.REMOTE), (_ERROR, FrameFlag.ERROR))
_FLAGS = np.array([sum(flag for bit, flag in _BITS if word << 29 & bit) for word in range(8)], np.uint8)
"""What the three highest bits of the kernel's identifier mean."""
_PRESENT = np.array([(1 << 8 * length) - 1 for length in range(9)], np.uint64)
"""The bytes of 8 that a length stands for."""

SUPPORTED = struct.calcsize("P") == 8 and sys.byteorder == "little" and hasattr(socket, "AF_CAN")
"""Whether this file's structures are the kernel's: 64-bit Linux."""

_libc = ctypes.CDLL(None, use_errno=True)


def listening(channel: str, buffer_bytes: int) -> socket.socket:
    """Return a socket that receives the frames of an interface, and its error frames; see `prepared`.

    Raises HardwareError if the kernel has no CAN, or there is no such interface, or it must not be opened.
    """

    def prepare(made: socket.socket) -> None:
        made.setsockopt(_SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ALL_ERRORS)
        prepared(made, buffer_bytes)

    return _bound(channel, prepare)


def prepared(made: socket.socket, buffer_bytes: int) -> socket.socket:
    """Have a socket stamp frames, count lost ones and keep many."""
    made.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    made.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
    ask_for_room(made, buffer_bytes)
    return made


def ask_for_room(made: socket.socket, buffer_bytes: int) -> None:
    """Ask the kernel for a receive buffer of this size, beyond the system's limit where that is allowed."""
    try:
        made.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, buffer_bytes)
    except PermissionError:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)


def room_bytes(made: socket.socket) -> int:
    """Return the receive buffer that the kernel gave."""
    return made.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # the kernel doubles it


def fault_of(channel: str, code: int) -> Fault:
    """Return the fault that an errno of a socket means, with the next step."""
    where, errno_name = f"bus {channel}", errno.errorcode.get(code, str(code))
    if code in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        step = "sudo modprobe can_raw (in a container: on the host)"
        return Fault("this kernel has no SocketCAN", where, errno_name, next_step=step)
    if code == errno.ENODEV:
        names = [name for _, name in socket.if_nameindex()]
        step = (
            f"`ip link show type can`; for a virtual bus: ip link add dev {channel} type vcan; ip link set {channel} up"
        )
        return Fault(f"there is no interface {channel}", where, errno_name, nearest(channel, names), step)
    if code == errno.ENETDOWN:
        return Fault("the interface is down", where, errno_name, next_step=f"ip link set {channel} up")
    if code in (errno.EPERM, errno.EACCES):
        return Fault(
            "the interface must not be opened", where, errno_name, next_step="run with the capability CAP_NET_RAW"
        )
    if code in (errno.ENOBUFS, errno.EAGAIN):
        step = "check that another node acknowledges frames, the bit rate and the termination"
        return Fault("the bus takes no frames", where, errno_name, next_step=step)
    if code == errno.EINVAL:
        step = f"ip link set {channel} mtu 72, or a CAN FD bit rate: ip link set {channel} type can ... fd on"
        return Fault("the interface refuses the frame; it may not be a CAN FD one", where, errno_name, next_step=step)
    return Fault("the interface failed", where, errno_name, next_step="check the adapter and its cable")


def buffer_remarks(channel: str, given: int, wanted: int) -> tuple[str, ...]:
    """Return remarks on a receive buffer that is smaller than requested."""
    if given >= wanted:
        return ()
    step = f"sudo sysctl net.core.rmem_max={wanted}"
    return (f"{channel}: receive buffer of {given} instead of {wanted} bytes, so bursts may be lost; {step}",)


def lost_frames(made: socket.socket) -> int:
    """Return how many frames the kernel has dropped because they were not fetched in time."""
    words: NDArray[np.uint32] = np.frombuffer(made.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 36), np.uint32)
    return int(words[_MEMINFO_DROPS]) if len(words) > _MEMINFO_DROPS else 0


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


class _Batch:
    """Memory for one system call: the frames, their control messages, and the headers that point to them."""

    def __init__(self) -> None:
        n = FRAMES_A_CALL
        self.frames = np.zeros(n, _FRAME)
        self.control = np.zeros((n, _CONTROL_WORDS), np.int64)
        self.iov = np.zeros(n, _IOVEC)
        self.headers = np.zeros(n, _MMSGHDR)
        self.iov["base"] = self.frames.ctypes.data + np.arange(n) * _FRAME.itemsize
        self.iov["size"] = _FRAME.itemsize
        header = self.headers["header"]
        header["iov"] = self.iov.ctypes.data + np.arange(n) * _IOVEC.itemsize
        header["iov_count"] = 1

    def call(self, function: str, descriptor: int, count: int) -> int:
        """Call recvmmsg or sendmmsg without waiting; return the number of frames, or minus the errno."""
        done = getattr(_libc, function)(
            ctypes.c_int(descriptor),
            ctypes.c_void_p(self.headers.ctypes.data),
            ctypes.c_uint(count),
            ctypes.c_int(socket.MSG_DONTWAIT),
            ctypes.c_void_p(None),
        )
        return int(done) if done >= 0 else -ctypes.get_errno()


class SocketCanSource:
    """Frames of a SocketCAN interface; see `daq.sources.can_source.Source`.

    Parameters
    ----------
    channel : str
        Interface, e.g. ``can0``.
    buffer_bytes : int
        Receive buffer to ask for.
    made : socket, optional
        A socket to read from in place of one on the interface: a datagram is one of Linux's ``struct can_frame`` or
        ``canfd_frame``.

    Raises
    ------
    HardwareError
        If the kernel has no CAN, or there is no such interface, or it must not be opened.
    """

    def __init__(
        self, channel: str, buffer_bytes: int = RECEIVE_BUFFER_BYTES, made: socket.socket | None = None
    ) -> None:
        self.name = channel
        self._socket = listening(channel, buffer_bytes) if made is None else prepared(made, buffer_bytes)
        self._received = 0
        self._errors = 0
        self._lost = 0
        self._failed = 0
        self._batch = _Batch()
        header = self._batch.headers["header"]
        header["control"] = self._batch.control.ctypes.data + np.arange(FRAMES_A_CALL) * _CONTROL_WORDS * 8
        self._buffer_bytes = room_bytes(self._socket)
        self.remarks = buffer_remarks(channel, self._buffer_bytes, buffer_bytes)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    @property
    def counters(self) -> SourceCounters:
        """See `daq.sources.can_source.Source`. The losses are asked of the kernel, and so are never late."""
        if self._socket.fileno() >= 0:
            self._lost = max(self._lost, lost_frames(self._socket))
        return SourceCounters(self._received, self._lost, self._errors, self._buffer_bytes)

    def read(self, timeout_s: float) -> FrameBatch:
        """See `daq.sources.can_source.Source`."""
        if self._failed:
            self._raise_failure()
        self._poll.poll(max(timeout_s, 0.0) * 1000)
        parts: list[FrameArray] = []
        for _ in range(_MOST_AT_ONCE // FRAMES_A_CALL):
            self._batch.headers["header"]["control_size"] = _CONTROL_WORDS * 8
            count = self._batch.call("recvmmsg", self._socket.fileno(), FRAMES_A_CALL)
            if count < 0 and -count not in (errno.EAGAIN, errno.EINTR):
                self._failed = -count
                if not parts:
                    self._raise_failure()
            if count > 0:
                parts.append(self._frames(count))
            if count < FRAMES_A_CALL:
                break
        return self._together(parts)

    def is_up(self) -> bool:
        """See `daq.sources.can_source.Source`."""
        import fcntl  # Unix has it; so has every system with SocketCAN

        try:
            request = _IFREQ.pack(self.name.encode(), 0)
            _, flags = _IFREQ.unpack(fcntl.ioctl(self._socket, _SIOCGIFFLAGS, request))
        except OSError:
            return False
        return bool(flags & _IFF_UP)

    def close(self) -> None:
        """See `daq.sources.can_source.Source`."""
        if self._socket.fileno() >= 0:
            _ = self.counters
            self._socket.close()

    def _raise_failure(self) -> None:
        """Raise a failure, after the frames received before it."""
        code, self._failed = self._failed, 0
        kind = InterfaceDownError if code == errno.ENETDOWN else HardwareError
        raise kind(fault_of(self.name, code))

    def _frames(self, count: int) -> FrameArray:
        raw, headers = self._batch.frames[:count], self._batch.headers[:count]
        is_fd = headers["size"] == _FD_BYTES
        has_fd = bool(is_fd.any())
        frames = np.zeros(count, FD_DTYPE if has_fd else CLASSIC_DTYPE)
        frames["time_ns"] = self._stamps(count)
        flags = _FLAGS[raw["id"] >> 29]
        flags |= (headers["header"]["flags"] & socket.MSG_DONTROUTE != 0) * np.uint8(FrameFlag.TRANSMITTED)
        frames["can_id"] = raw["id"] & _ID_MASK
        length = np.minimum(raw["length"], 8)
        present = _PRESENT[length * (flags & FrameFlag.REMOTE == 0)]
        _first_words(frames, 16)[:] = _first_words(raw, 8) & present
        if has_fd:
            length[is_fd] = np.minimum(raw["length"][is_fd], 64)
            flags |= is_fd * np.uint8(FrameFlag.FD)
            flags |= (is_fd & ((raw["flags"] & _BRS) != 0)) * np.uint8(FrameFlag.BITRATE_SWITCH)
            flags |= (is_fd & ((raw["flags"] & _ESI) != 0)) * np.uint8(FrameFlag.ERROR_STATE)
            frames["data"][is_fd] = raw["data"][is_fd] * (np.arange(64) < length[is_fd, None])
        frames["length"] = length
        frames["flags"] = flags
        return frames

    def _stamps(self, count: int) -> IntArray:
        """Return the kernel's time stamps, and note the count of lost frames that may stand beside them."""
        control, sizes = self._batch.control[:count], self._batch.headers["header"]["control_size"][:count]
        stamps: IntArray = control[:, 2] * 10**9 + control[:, 3]
        stamped = control[:, 1] == _TIME_STAMP
        if not stamped.all():
            stamps[~stamped] = time.time_ns()
        if sizes.max() > _STAMP_BYTES:
            counted = stamped & (sizes > _STAMP_BYTES) & (control[:, 5] == _LOST)
            self._lost = max(self._lost, int((control[counted, 6] & 0xFFFF_FFFF).max(initial=0)))
        return stamps

    def _together(self, parts: list[FrameArray]) -> FrameBatch:
        if not parts:
            return FrameBatch.empty((self.name,))
        frames = parts[0] if len(parts) == 1 else joined(parts)
        if not self._received:
            # the kernel starts stamping late, and stamps earlier frames when they are read
            frames["time_ns"] = np.minimum.accumulate(frames["time_ns"][::-1])[::-1]
        self._received += len(frames)
        self._errors += int(np.count_nonzero(frames["flags"] & FrameFlag.ERROR))
        return FrameBatch(frames, (self.name,))


class SocketCanSink:
    """A SocketCAN interface to send frames to; see `daq.sources.can_source.Sink`.

    `HardwareError` as from `SocketCanSource`.
    """

    def __init__(self, channel: str) -> None:
        self.name = channel
        self._socket = _bound(channel, lambda made: made.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, b""))  # only sends
        self._batch = _Batch()

    def send(self, frames: FrameArray, timeout_s: float) -> None:
        """See `daq.sources.can_source.Sink`."""
        for start in range(0, len(frames), FRAMES_A_CALL):
            self._send_batch(frames[start : start + FRAMES_A_CALL], timeout_s)

    def close(self) -> None:
        """See `daq.sources.can_source.Sink`."""
        self._socket.close()

    def _send_batch(self, frames: FrameArray, timeout_s: float) -> None:
        self._fill(frames)
        deadline = time.monotonic() + timeout_s
        done = 0
        while done < len(frames):
            count = self._batch.call("sendmmsg", self._socket.fileno(), len(frames) - done)
            if count > 0:
                done += count
                if done < len(frames):
                    self._fill(frames[done:])
            elif -count not in (errno.ENOBUFS, errno.EAGAIN, errno.EINTR) or time.monotonic() > deadline:
                raise HardwareError(fault_of(self.name, -count))
            else:
                time.sleep(0.0002)  # the queue of the interface is full, and cannot be waited for

    def _fill(self, frames: FrameArray) -> None:
        raw, flags = self._batch.frames[: len(frames)], frames["flags"]
        can_id = frames["can_id"].copy()
        for bit, flag in _BITS:
            can_id |= ((flags & flag) != 0) * np.uint32(bit)
        raw["id"] = can_id
        raw["length"] = frames["length"]
        raw["flags"] = ((flags & FrameFlag.BITRATE_SWITCH) != 0) * _BRS + ((flags & FrameFlag.ERROR_STATE) != 0) * _ESI
        is_fd = (flags & FrameFlag.FD) != 0
        raw["flags"] += is_fd * np.uint8(_FDF)
        raw["flags"] *= is_fd
        raw["data"][:, : frames["data"].shape[1]] = frames["data"]
        self._batch.iov["size"][: len(frames)] = np.where(is_fd, _FD_BYTES, _CLASSIC_BYTES)


def _first_words(frames: NDArray[np.void], data_at: int) -> NDArray[np.uint64]:
    """Return the first 8 data bytes of each frame as a number; of the same memory."""
    return np.ndarray(len(frames), np.uint64, frames, data_at, (frames.itemsize,))
