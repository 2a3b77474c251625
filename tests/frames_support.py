"""Frames for tests: every kind that a bus can carry, and how to compare them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.can import FrameArray, FrameBatch, FrameFlag
from daq.can.frames import FD_DTYPE, FD_LENGTHS

START_NS = 1_700_000_000 * 10**9


def some_frames(
    rng: np.random.Generator, count: int, *, rate_hz: float = 4000.0, buses: tuple[str, ...] = ("can0",)
) -> FrameBatch:
    """Return classical, CAN FD, extended, remote and error frames in whole microseconds, evenly spaced."""
    kinds: NDArray[np.uint8] = np.array(
        [
            0,
            FrameFlag.EXTENDED,
            FrameFlag.FD,
            FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.EXTENDED,
            FrameFlag.FD | FrameFlag.ERROR_STATE,
            FrameFlag.REMOTE,
            FrameFlag.REMOTE | FrameFlag.EXTENDED,
            FrameFlag.ERROR,
        ],
        np.uint8,
    )
    frames = np.zeros(count, FD_DTYPE)
    flags = frames["flags"] = rng.choice(kinds, count, p=[0.35, 0.2, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05])
    frames["time_ns"] = START_NS + np.round(np.arange(count) * 1e6 / rate_hz).astype(np.int64) * 1000
    frames["bus"] = rng.integers(0, len(buses), count)
    long_id = (flags & FrameFlag.EXTENDED) != 0
    frames["can_id"] = np.where(long_id, rng.integers(0, 2**29, count), rng.integers(0, 2**11, count))
    is_error = (flags & FrameFlag.ERROR) != 0
    frames["can_id"][is_error] = 1 << rng.integers(0, 9, int(is_error.sum()))
    is_fd = (flags & FrameFlag.FD) != 0
    frames["length"] = np.where(is_fd, rng.choice(FD_LENGTHS, count), rng.integers(0, 9, count))
    frames["length"][is_error] = 8
    has_data = (flags & FrameFlag.REMOTE) == 0
    frames["data"] = rng.integers(0, 256, (count, 64)) * (np.arange(64) < (frames["length"] * has_data)[:, None])
    return FrameBatch(frames, buses)


def classical(batch: FrameBatch) -> FrameBatch:
    """Return the frames that are not CAN FD."""
    return batch[(batch.frames["flags"] & FrameFlag.FD) == 0]


def content(batch: FrameBatch) -> list[tuple[str, int, int, int, bytes]]:
    """Return what a bus carries of each frame: bus, identifier, flags without the direction, length and data."""
    frames = batch.widened().frames
    flags = frames["flags"] & ~np.uint8(FrameFlag.TRANSMITTED)
    return [
        (batch.buses[bus], can_id, flag, length, data.tobytes())
        for bus, can_id, flag, length, data in zip(
            frames["bus"],
            frames["can_id"].tolist(),
            flags.tolist(),
            frames["length"].tolist(),
            frames["data"],
            strict=True,
        )
    ]


def same(first: FrameArray, second: FrameArray) -> bool:
    """Whether two arrays of frames are equal in every field."""
    return len(first) == len(second) and all((first[name] == second[name]).all() for name in FD_DTYPE.names or ())
