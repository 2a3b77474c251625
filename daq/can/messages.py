"""FrameArray <-> python-can messages, for the readers and interfaces that speak only python-can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameFlag

if TYPE_CHECKING:
    import can

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Numbers of data bytes that a CAN FD frame can have, by its DLC."""
_EXTENDED, _REMOTE, _ERROR, _FD, _BITRATE_SWITCH, _ERROR_STATE, _TRANSMITTED, _ = map(int, FrameFlag)


def frames_from_messages(
    messages: Sequence[can.Message], time_ns: Sequence[int], bus_of: Callable[[can.Message], int]
) -> FrameArray:
    """Turn python-can messages into frames.

    Parameters
    ----------
    time_ns : sequence of int
        UTC nanoseconds of each.
    bus_of : callable
        Position of a message's bus.

    Returns
    -------
    structured array, shape (n,)
        Of `FD_DTYPE` when a message is CAN FD, else of `CLASSIC_DTYPE`.
    """
    wide = any(message.is_fd for message in messages)
    room = 64 if wide else 8
    frames = np.zeros(len(messages), FD_DTYPE if wide else CLASSIC_DTYPE)
    frames["time_ns"] = time_ns
    frames["can_id"] = [m.arbitration_id & 0x1FFF_FFFF for m in messages]
    frames["bus"] = [bus_of(m) for m in messages]
    frames["flags"] = [_flags(m) for m in messages]
    # a classical frame may carry a DLC above 8, and still has 8 bytes
    frames["length"] = [min(m.dlc, 64 if m.is_fd else 8) for m in messages]
    joined = b"".join(bytes(m.data or b"")[:room].ljust(room, b"\0") for m in messages)
    frames["data"] = np.frombuffer(joined, np.uint8).reshape(-1, room)
    return frames


def messages_from_frames(frames: FrameArray) -> list[can.Message]:
    """Turn frames into python-can messages with their time stamps in seconds (the bus is left to the caller)."""
    import can

    room = frames["data"].shape[1]
    data = np.ascontiguousarray(frames["data"]).tobytes()
    columns = (frames[name].tolist() for name in ("time_ns", "can_id", "flags", "length"))
    return [
        can.Message(
            timestamp=time_ns / 1e9,
            arbitration_id=can_id,
            is_extended_id=bool(flags & _EXTENDED),
            is_remote_frame=bool(flags & _REMOTE),
            is_error_frame=bool(flags & _ERROR),
            is_fd=bool(flags & _FD),
            bitrate_switch=bool(flags & _BITRATE_SWITCH),
            error_state_indicator=bool(flags & _ERROR_STATE),
            is_rx=not flags & _TRANSMITTED,
            dlc=length,
            data=None if flags & _REMOTE else data[i * room : i * room + length],
        )
        for i, (time_ns, can_id, flags, length) in enumerate(zip(*columns, strict=True))
    ]


def _flags(message: can.Message) -> int:
    return (
        (_EXTENDED if message.is_extended_id else 0)
        | (_REMOTE if message.is_remote_frame else 0)
        | (_ERROR if message.is_error_frame else 0)
        | (_FD if message.is_fd else 0)
        | (_BITRATE_SWITCH if message.bitrate_switch else 0)
        | (_ERROR_STATE if message.error_state_indicator else 0)
        | (0 if message.is_rx else _TRANSMITTED)
    )
