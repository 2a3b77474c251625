"""FrameArray <-> python-can messages, for the readers and interfaces that speak only python-can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameFlag

if TYPE_CHECKING:
    import can

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Numbers of data bytes that a CAN FD frame can have, by its DLC."""


def frames_from_messages(
    messages: Sequence[can.Message], time_ns: Sequence[int], bus_of: Callable[[can.Message], int]
) -> FrameArray:
    """Turn python-can messages into frames.

    Parameters
    ----------
    messages : sequence of can.Message
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

    messages = []
    for row in frames:
        flags, length = int(row["flags"]), int(row["length"])
        remote, fd = bool(flags & FrameFlag.REMOTE), bool(flags & FrameFlag.FD)
        options: dict[str, Any] = {} if remote else {"data": row["data"][:length].tobytes()}
        messages.append(
            can.Message(
                timestamp=int(row["time_ns"]) / 1e9,
                arbitration_id=int(row["can_id"]),
                is_extended_id=bool(flags & FrameFlag.EXTENDED),
                is_remote_frame=remote,
                is_error_frame=bool(flags & FrameFlag.ERROR),
                is_fd=fd,
                bitrate_switch=bool(flags & FrameFlag.BITRATE_SWITCH),
                error_state_indicator=bool(flags & FrameFlag.ERROR_STATE),
                is_rx=not flags & FrameFlag.TRANSMITTED,
                dlc=length,
                **options,
            )
        )
    return messages


def _flags(message: can.Message) -> int:
    return (
        (FrameFlag.EXTENDED if message.is_extended_id else 0)
        | (FrameFlag.REMOTE if message.is_remote_frame else 0)
        | (FrameFlag.ERROR if message.is_error_frame else 0)
        | (FrameFlag.FD if message.is_fd else 0)
        | (FrameFlag.BITRATE_SWITCH if message.bitrate_switch else 0)
        | (FrameFlag.ERROR_STATE if message.error_state_indicator else 0)
        | (0 if message.is_rx else FrameFlag.TRANSMITTED)
    )
