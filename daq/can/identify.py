"""Which message a frame is: identifiers of many frames -> codes, and the coverage of a log by its DBCs.

An exact identifier wins. A J1939 message stands for its whole parameter group: a 29-bit frame without an exact
match belongs to the one J1939 message of its bus with the same group number, whatever its priority, source and
(below PDU format 240) destination. Several sources of one group are decoded as one message; to separate them, write
one message for each source, with the source in its identifier.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.arrays import BoolArray, IndexArray
from daq.can import CLASSIC_DTYPE, Database, FrameArray, FrameBatch, FrameFlag, Message, messages_by_bus
from daq.limits import MOST_IDS

UNKNOWN = 0
"""Code of a frame that is no message: unknown identifier, error frame or remote request."""
_STANDARD_IDS = 2048
_NO_DATA = FrameFlag.ERROR | FrameFlag.REMOTE


@dataclass(frozen=True)
class _BusTable:
    """Codes of one bus: by 11-bit identifier, and sorted 29-bit identifiers and groups with theirs."""

    standard: NDArray[np.uint8] | NDArray[np.uint16]
    extended: NDArray[np.uint32]
    extended_codes: NDArray[np.uint16]
    groups: NDArray[np.uint32]
    group_codes: NDArray[np.uint16]


class Identifier:
    """Gives every frame the code of its message; `messages` are (bus name, Message, code).

    Identifiers of one bus must be unique. A message that is known but not wanted has the code `UNKNOWN`.
    """

    def __init__(self, messages: Sequence[tuple[str, Message, int]]) -> None:
        highest = max((code for _, _, code in messages), default=0)
        self.dtype: np.dtype[Any] = np.dtype(np.uint8 if highest < 256 else np.uint16)
        per_bus: dict[str, list[tuple[Message, int]]] = {}
        for bus, message, code in messages:
            per_bus.setdefault(bus, []).append((message, code))
        self._tables = {bus: _bus_table(known, self.dtype) for bus, known in per_bus.items()}

    def codes(self, frames: FrameArray, buses: Sequence[str]) -> NDArray[Any]:
        """Return the code of each frame, `UNKNOWN` where it has none; the ``bus`` column counts `buses`."""
        ids, flags = frames["can_id"], frames["flags"]
        if len(buses) == 1 and buses[0] in self._tables:
            return _codes_of_bus(self._tables[buses[0]], ids, flags)
        codes = np.zeros(len(frames), self.dtype)
        for number, bus in enumerate(buses):
            if bus in self._tables:
                rows = np.flatnonzero(frames["bus"] == number)
                codes[rows] = _codes_of_bus(self._tables[bus], ids[rows], flags[rows])
        return codes


def _codes_of_bus(table: _BusTable, ids: NDArray[np.uint32], flags: NDArray[np.uint8]) -> NDArray[Any]:
    codes: NDArray[Any] = table.standard.take(np.bitwise_and(ids, _STANDARD_IDS - 1))
    special = int(_NO_DATA | FrameFlag.EXTENDED)
    if np.bitwise_or.reduce(flags, initial=0) & special:
        codes[(flags & special) != 0] = UNKNOWN
        rows = np.flatnonzero((flags & special) == int(FrameFlag.EXTENDED))
        codes[rows] = _extended_codes(table, ids[rows])
    return codes


def parameter_groups(ids: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the J1939 parameter group numbers of 29-bit identifiers, shape as given.

    Below PDU format 240 the low byte is a destination address and not part of the number.
    """
    numbers = np.asarray((ids >> np.uint32(8)) & np.uint32(0x3FFFF), np.uint32)
    broadcast = (numbers & np.uint32(0xFF00)) >= 0xF000
    return np.where(broadcast, numbers, numbers & np.uint32(0x3FF00))


def _extended_codes(table: _BusTable, ids: NDArray[np.uint32]) -> NDArray[np.uint16]:
    codes, found = _codes_of(table.extended, table.extended_codes, ids)
    if len(table.groups):
        rest = np.flatnonzero(~found)
        codes[rest], _ = _codes_of(table.groups, table.group_codes, parameter_groups(ids[rest]))
    return codes


def _codes_of(
    known: NDArray[np.uint32], codes: NDArray[np.uint16], wanted: NDArray[np.uint32]
) -> tuple[NDArray[np.uint16], BoolArray]:
    if not len(known):
        return np.zeros(len(wanted), np.uint16), np.zeros(len(wanted), np.bool_)
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    found = known[place] == wanted
    return np.where(found, codes[place], np.uint16(UNKNOWN)), found


def _bus_table(known: Sequence[tuple[Message, int]], dtype: np.dtype[Any]) -> _BusTable:
    standard = np.zeros(_STANDARD_IDS, dtype)
    extended: dict[int, int] = {}
    groups: dict[int, list[int]] = {}
    for message, code in known:
        if not message.extended:
            standard[message.can_id] = code
            continue
        extended[message.can_id] = code
        if message.j1939:
            groups.setdefault(int(parameter_groups(np.array(message.can_id, np.uint32))), []).append(code)
    unique = {group: codes[0] for group, codes in groups.items() if len(codes) == 1}
    return _BusTable(standard, *_sorted_table(extended), *_sorted_table(unique))


def _sorted_table(table: Mapping[int, int]) -> tuple[NDArray[np.uint32], NDArray[np.uint16]]:
    keys = sorted(table)
    return np.array(keys, np.uint32), np.array([table[key] for key in keys], np.uint16)


@dataclass(frozen=True)
class IdCount:
    """Frames of one identifier on one bus; `message` is None where no DBC knows it."""

    bus: str
    extended: bool
    can_id: int
    message: str | None
    frames: int


@dataclass(frozen=True)
class Coverage:
    """How much of a log the DBCs know.

    Attributes
    ----------
    ids : tuple of IdCount
        Sorted by bus and identifier; of those that no DBC knows the first ones, up to `MOST_IDS`.
    error_frames, remote_frames : int
        Not counted in `ids`.
    further_frames : int
        Unknown frames whose identifiers are not in `ids`.
    """

    ids: tuple[IdCount, ...] = ()
    error_frames: int = 0
    remote_frames: int = 0
    further_frames: int = 0

    @property
    def known(self) -> int:
        """Frames whose identifier a DBC knows."""
        return sum(row.frames for row in self.ids if row.message is not None)

    @property
    def unknown(self) -> int:
        """Frames whose identifier no DBC knows."""
        return sum(row.frames for row in self.ids if row.message is None) + self.further_frames

    def __add__(self, other: Coverage) -> Coverage:
        counts: Counter[tuple[str, bool, int, str | None]] = Counter()
        for row in (*self.ids, *other.ids):
            counts[row.bus, row.extended, row.can_id, row.message] += row.frames
        errors, remotes = self.error_frames + other.error_frames, self.remote_frames + other.remote_frames
        return _coverage(counts, errors, remotes, self.further_frames + other.further_frames)


def coverage(batch: FrameBatch, databases: Mapping[str, Sequence[Database]]) -> Coverage:
    """Count the frames of every identifier, with the message a DBC of its bus knows it as.

    Of a log read in pieces, add the coverage of the pieces.

    Raises
    ------
    DatabaseError
        The databases of a bus contradict each other.
    """
    named = [(bus, name, m) for bus, messages in messages_by_bus(databases).items() for name, m in messages.items()]
    identifier = Identifier([(bus, message, code) for code, (bus, _, message) in enumerate(named, 1)])
    flags = batch.frames["flags"]
    kinds = np.bincount(flags & int(_NO_DATA), minlength=int(_NO_DATA) + 1)
    errors = int(kinds[int(FrameFlag.ERROR) :].sum())
    remotes = int(kinds[int(FrameFlag.REMOTE)])
    frames = batch.frames[(flags & int(_NO_DATA)) == 0] if errors or remotes else batch.frames
    samples, numbers = _one_of_each(frames)
    counts: Counter[tuple[str, bool, int, str | None]] = Counter()
    for row, code, number in zip(samples, identifier.codes(samples, batch.buses), numbers.tolist(), strict=True):
        name = named[code - 1][1] if code != UNKNOWN else None
        counts[batch.buses[row["bus"]], bool(row["flags"] & FrameFlag.EXTENDED), int(row["can_id"]), name] = number
    return _coverage(counts, errors, remotes, 0)


def _one_of_each(frames: FrameArray) -> tuple[FrameArray, IndexArray]:
    """Return a frame of each identifier and bus, and how many there are of it."""
    flag = int(FrameFlag.EXTENDED)
    bus, can_id, extended = frames["bus"].astype(np.int64), frames["can_id"], (frames["flags"] & flag) != 0
    if extended.any():
        long_keys, long_numbers = np.unique((bus[extended] << 32) + can_id[extended], return_counts=True)
        bus, can_id = bus[~extended], can_id[~extended]
    else:
        long_keys, long_numbers = np.zeros(0, np.int64), np.zeros(0, np.intp)
    every = np.bincount((bus << 11) + (can_id & (_STANDARD_IDS - 1)))
    short_keys = np.flatnonzero(every)
    samples = np.zeros(len(short_keys) + len(long_keys), CLASSIC_DTYPE)
    samples["bus"] = np.concatenate([short_keys >> 11, long_keys >> 32])
    samples["can_id"] = np.concatenate([short_keys & (_STANDARD_IDS - 1), long_keys & 0xFFFF_FFFF])
    samples["flags"][len(short_keys) :] = flag
    return samples, np.concatenate([every[short_keys], long_numbers])


def _coverage(counts: Counter[tuple[str, bool, int, str | None]], errors: int, remotes: int, further: int) -> Coverage:
    for key in [key for key in counts if key[3] is None][MOST_IDS:]:
        further += counts.pop(key)
    rows = (IdCount(*key, frames=counts[key]) for key in sorted(counts, key=lambda key: key[:3]))
    return Coverage(tuple(rows), errors, remotes, further)
