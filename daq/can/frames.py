"""FrameBatch: CAN and CAN FD frames as one structured array."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

FrameArray = NDArray[np.void]

_HEADER = [
    ("time_ns", "<i8"),
    ("can_id", "<u4"),
    ("bus", "u1"),
    ("flags", "u1"),
    ("length", "u1"),
    ("reserved", "u1"),
]
CLASSIC_DTYPE: np.dtype[np.void] = np.dtype([*_HEADER, ("data", "u1", (8,))])
"""A classical CAN frame: 24 bytes."""
FD_DTYPE: np.dtype[np.void] = np.dtype([*_HEADER, ("data", "u1", (64,))])
"""A CAN FD frame: 80 bytes."""


class FrameFlag(IntFlag):
    """Bits of the ``flags`` column."""

    EXTENDED = 1
    REMOTE = 2
    ERROR = 4
    FD = 8
    BITRATE_SWITCH = 16
    ERROR_STATE = 32
    TRANSMITTED = 64
    UNCERTAIN_TIME = 128
    """The host's clock was set while the frame came in: the time may be wrong by the step."""


class ErrorClass(IntFlag):
    """Bits of an error frame's ``can_id``, as SocketCAN has them (linux/can/error.h)."""

    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    PROTOCOL = 0x008
    NO_ACK = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100


@dataclass(frozen=True)
class FrameBatch:
    """Frames in the order they were received.

    Attributes
    ----------
    frames : structured array, shape (n,)
        Of `CLASSIC_DTYPE` or `FD_DTYPE`. ``time_ns`` is UTC nanoseconds since 1970, ``can_id`` the bare 11- or
        29-bit identifier (for an error frame: SocketCAN's error class bits), ``bus`` the position in `buses`,
        ``length`` the number of valid bytes in ``data``; the bytes behind them are zero.
    buses : tuple of str
        Names of the buses, e.g. ``("can0", "can1")``.
    """

    frames: FrameArray
    buses: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.frames.dtype not in (CLASSIC_DTYPE, FD_DTYPE):
            raise TypeError(f"frames must be CLASSIC_DTYPE or FD_DTYPE, not {self.frames.dtype}")

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: slice | NDArray[Any]) -> FrameBatch:
        if isinstance(rows, slice):
            return FrameBatch(self.frames[rows], self.buses)
        # numpy's take copies structured records many times faster than its fancy indexing
        positions = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return FrameBatch(self.frames.take(positions), self.buses)

    @property
    def is_fd(self) -> bool:
        """Whether the records have room for CAN FD's 64 bytes."""
        return self.frames.dtype == FD_DTYPE

    def on_bus(self, name: str) -> FrameBatch:
        """Return the frames of one bus (none when the batch does not know it)."""
        if name not in self.buses:
            return self[:0]
        return self[self.frames["bus"] == self.buses.index(name)]

    def widened(self) -> FrameBatch:
        """Return the same frames as `FD_DTYPE` records."""
        if self.is_fd:
            return self
        wide = np.zeros(len(self), FD_DTYPE)
        for field in CLASSIC_DTYPE.names or ():
            if field == "data":
                wide["data"][:, :8] = self.frames["data"]
            else:
                wide[field] = self.frames[field]
        return FrameBatch(wide, self.buses)

    @staticmethod
    def empty(buses: Sequence[str] = (), *, fd: bool = False) -> FrameBatch:
        """Return a batch of no frames."""
        return FrameBatch(np.zeros(0, FD_DTYPE if fd else CLASSIC_DTYPE), tuple(buses))


def concatenate(batches: Sequence[FrameBatch]) -> FrameBatch:
    """Join batches; bus names are merged, and records are widened when any batch is FD."""
    if not batches:
        return FrameBatch.empty()
    buses = tuple(dict.fromkeys(name for batch in batches for name in batch.buses))
    fd = any(batch.is_fd for batch in batches)
    parts = [(batch.widened() if fd else batch) for batch in batches]
    return FrameBatch(joined([renumbered(part, buses) for part in parts]), buses)


def joined(parts: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Join arrays of one record type."""
    return np.concatenate([as_bytes(part) for part in parts]).view(parts[0].dtype)


def as_bytes(records: NDArray[np.void]) -> NDArray[np.void]:
    """Return records without their fields: numpy then copies them whole, 17 times faster than field by field."""
    return records.view(np.dtype(f"V{records.dtype.itemsize}"))  # a dtype given as a tuple would swallow a Ctrl-C


def renumbered(batch: FrameBatch, buses: tuple[str, ...]) -> FrameArray:
    """Return the frames with a ``bus`` column that counts `buses`, which hold all of the batch's."""
    if batch.buses == buses[: len(batch.buses)]:
        return batch.frames
    lookup = np.array([buses.index(name) for name in batch.buses] or [0], np.uint8)
    frames = batch.frames.copy()
    frames["bus"] = lookup[frames["bus"]]
    return frames


def split(batch: FrameBatch, size: int) -> Iterator[FrameBatch]:
    """Yield consecutive pieces of at most `size` frames."""
    for start in range(0, len(batch), size):
        yield batch[start : start + size]
