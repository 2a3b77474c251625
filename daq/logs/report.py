"""Report on reading a log: its format, its buses, and the lines that could not be used."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Protocol

import numpy as np

from daq import Balance, RecordingError
from daq.can.frames import FrameArray
from daq.limits import EARLIEST_DATE_NS, MOST_BUSES

_LISTED = 8  # lost parts of a file
_UNREADABLE = "unreadable"
HEADERS, EMPTY = "headers and comments", "empty lines"
"""What no user need be shown of lines that are no frames."""


@dataclass
class LogReport:
    """Grows while a log is read, and is complete when the last batch has been.

    Attributes
    ----------
    frames : int
        Frames read so far.
    share : float
        Of the file, read so far: 0 to 1.
    absolute_time : bool or None
        Whether ``time_ns`` is UTC; False where the log counts from a zero of its own. None before the first frame.
    local_time : bool
        Whether the dates are local time of the computer that recorded, which is taken for UTC.
    lost : list of str
        Parts of the file that are dropped whole, such as a damaged container: where, why and how much.
    balance : Balance
        Of the lines or objects: frames, what is no frame, and what could not be read.
    file_bytes : Balance
        Of the bytes of a file that holds containers, or is packed.
    faults : list of str
        What is wrong with a header, and where.
    readings : list of str
        How numbers were read that may be read in two ways, and why.
    out_of_order : int
        Frames that are earlier than the one before them; they stay where they are.
    damage : str
        What is wrong with the file as a whole, e.g. that it is cut off.
    buses : list of str
        Names in the order of their first frame.
    """

    path: str
    format: str
    frames: int = 0
    share: float = 0.0
    absolute_time: bool | None = None
    local_time: bool = False
    lost: list[str] = field(default_factory=list)
    balance: Balance = field(default_factory=Balance)
    file_bytes: Balance = field(default_factory=Balance)
    faults: list[str] = field(default_factory=list)
    readings: list[str] = field(default_factory=list)
    out_of_order: int = 0
    first_out_of_order: str = ""
    damage: str = ""
    buses: list[str] = field(default_factory=list)
    _last_time_ns: int | None = None

    def bus(self, name: str) -> int:
        """Return the position of a bus, adding its name when it is new."""
        if name not in self.buses:
            if len(self.buses) == MOST_BUSES:
                raise RecordingError.of(f"more than {MOST_BUSES} different buses", self.path, f"the next is {name!r}")
            self.buses.append(name)
        return self.buses.index(name)

    @property
    def bad(self) -> int:
        """Lines or objects that could not be read."""
        return self.balance.lost(_UNREADABLE)

    @property
    def first_bad(self) -> str:
        """Where the first of them is, and what is in it."""
        return self.balance.losses[_UNREADABLE].first if self.bad else ""

    @property
    def skipped(self) -> dict[str, int]:
        """Lines or objects that are no CAN frames, by kind."""
        return {kind: count for kind, count in self.balance.aside.items() if kind not in (HEADERS, EMPTY)}

    def note_bad(self, where: str, why: str, count: int = 1) -> None:
        """Count what could not be read and keep the first example."""
        self.balance.lose(_UNREADABLE, count, f"{where}: {why}")

    def note_lost(self, where: str, why: str) -> None:
        """Keep a part of the file that is dropped whole."""
        self.lost.append(f"{where}: {why}")

    def note_skipped(self, kind: str, count: int = 1) -> None:
        """Count what is no CAN frame."""
        self.balance.put_aside(kind, count)

    def note_frames(self, frames: FrameArray, where: Callable[[int], str]) -> None:
        """Count frames and check whether their times go back; `where` returns the place of one of these frames."""
        if not len(frames):
            return
        time_ns = frames["time_ns"]
        if self.absolute_time is None:
            self.absolute_time = bool(time_ns[0] >= EARLIEST_DATE_NS)
        before = time_ns[0] if self._last_time_ns is None else self._last_time_ns
        back = np.flatnonzero(np.diff(time_ns, prepend=before) < 0)
        if len(back) and not self.out_of_order:
            first = int(back[0])
            earlier = int(time_ns[first - 1] if first else before)
            step_s = (earlier - int(time_ns[first])) / 1e9
            self.first_out_of_order = f"{where(first)}: {step_s:.6f} s earlier than the frame before it"
        self.out_of_order += len(back)
        self._last_time_ns = int(time_ns[-1])
        self.frames += len(frames)
        self.balance.out += len(frames)

    def close(self) -> None:
        """Close the balances when the file has been read to its end."""
        self.balance.close()
        if self.file_bytes.came is not None:
            self.file_bytes.close()

    def remarks(self) -> list[str]:
        """Return what a user should know of this log, a sentence each."""
        lines = list(self.readings)
        if self.absolute_time is False:
            lines.append("times have no date: they count from a zero of the logger's own")
        if self.local_time:
            lines.append("dates are local time of the computer that recorded: they are taken for UTC")
        lines += self.losses()
        if self.out_of_order:
            lines.append(f"{self.out_of_order} frames are out of order; the first is {self.first_out_of_order}")
        lines.extend(f"{count} skipped: {kind}" for kind, count in self.skipped.items())
        return lines

    def losses(self) -> list[str]:
        """Return what of the log is not in its frames, a sentence each."""
        lines = [f"after frame {self.frames}: {self.damage}"] if self.damage else []
        lines.extend(f"lost: {part}" for part in self.lost[:_LISTED])
        if len(self.lost) > _LISTED:
            lines.append(f"lost: {len(self.lost) - _LISTED} more parts, to {self.lost[-1]}")
        lines += self.faults
        if self.bad:
            lines.append(f"{self.bad} unreadable, skipped; the first is {self.first_bad}")
        for balance in (self.balance, self.file_bytes):
            lines += [
                f"{loss.count:,} {balance.unit} {kind}" for kind, loss in balance.losses.items() if kind != _UNREADABLE
            ]
        return lines


class HasShare(Protocol):
    """A report of a file that is read, with the share of it that has been."""

    share: float


def share_of_file(file: IO[Any]) -> float:
    """Return the share of a file's bytes that has been read, 0 to 1; of a gzipped one, of the packed bytes."""
    place = file.fileno()
    return os.lseek(place, 0, os.SEEK_CUR) / max(os.fstat(place).st_size, 1)


def share_of_all(sizes: Sequence[int], reports: Sequence[HasShare]) -> float:
    """Return the share of all files' bytes that has been read; files without a report yet come later."""
    read = sum(size * report.share for size, report in zip(sizes, reports, strict=False))
    return read / max(sum(sizes), 1)
