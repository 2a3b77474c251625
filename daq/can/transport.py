"""Messages longer than a classical frame, put together again: J1939 transport (BAM, RTS/CTS) and ISO-TP.

J1939-21: a connection management frame (group EC00) announces size, packets and group; data transfer frames (EB00)
carry a number and seven bytes each. ISO 15765-2, normal addressing: the first four bits of a frame tell a single,
first, consecutive or flow control frame. An interrupted transfer is dropped and counted; nothing is guessed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from daq.can.frames import FrameBatch, FrameFlag

_EXTENDED = int(FrameFlag.EXTENDED)
_NO_TRANSPORT = int(FrameFlag.ERROR | FrameFlag.REMOTE | FrameFlag.FD)
_MANAGEMENT, _TRANSFER = 0xEC, 0xEB
_RTS, _BAM, _ABORT = 16, 32, 255
_SINGLE, _FIRST, _CONSECUTIVE = 0, 1, 2
_PACKET_BYTES = 7
_LONGEST_J1939 = 1785
_PRIORITY = 6
_PATIENCE_NS = 1_250_000_000
"""The longest that either standard lets a sender wait between two frames of a transfer."""


class Payload(NamedTuple):
    """A message put together; its time is that of its last frame."""

    time_ns: int
    bus: str
    can_id: int
    extended: bool
    data: bytes


@dataclass
class _J1939Transfer:
    can_id: int
    size: int
    packets: int
    time_ns: int
    parts: dict[int, bytes] = field(default_factory=dict)


@dataclass
class _IsoTransfer:
    size: int
    time_ns: int
    data: bytearray
    number: int = 1


class Transport:
    """Puts messages together, batch after batch.

    `iso` has, by bus, the messages (identifier, extended) that may be sent by ISO-TP, each with its largest size in
    bytes; `j1939` are the buses with messages that are sent by J1939's transport.

    `confirmed` are the messages (bus, identifier, extended) that are sent by ISO-TP: one of several frames was
    completed. Until then a frame may as well be a plain one that is shorter than its database says, so that a single
    frame is not taken for ISO-TP.
    """

    def __init__(self, iso: Mapping[str, Mapping[tuple[int, bool], int]], j1939: Collection[str]) -> None:
        self._iso, self._j1939 = iso, frozenset(j1939)
        self._iso_transfers: dict[tuple[str, int, bool], _IsoTransfer] = {}
        self._j1939_transfers: dict[tuple[str, int, int], _J1939Transfer] = {}
        self.confirmed: set[tuple[str, int, bool]] = set()
        self._interrupted: Counter[str] = Counter()
        self._begun_only: Counter[tuple[str, int, bool]] = Counter()

    def interrupted(self) -> Counter[str]:
        """Return how many transfers were begun and not completed so far, per bus.

        A first frame of ISO-TP that nothing followed counts only if its message is `confirmed`.
        """
        found = self._interrupted + Counter(bus for bus, _, _ in self._j1939_transfers)
        for key, transfer in self._iso_transfers.items():
            if transfer.number > 1 or key in self.confirmed:
                found[key[0]] += 1
        for key, count in self._begun_only.items():
            if key in self.confirmed:
                found[key[0]] += count
        return found

    def take(self, batch: FrameBatch) -> Iterator[Payload]:
        """Yield what is complete with the frames of a batch."""
        frames = batch.frames
        classical = (frames["flags"] & _NO_TRANSPORT) == 0
        pdu_format = (frames["can_id"] >> np.uint32(16)) & np.uint32(0xFF)
        managed = ((frames["flags"] & _EXTENDED) != 0) & ((pdu_format == _MANAGEMENT) | (pdu_format == _TRANSFER))
        known = np.array(sorted({can_id for ids in self._iso.values() for can_id, _ in ids}), np.uint32)
        chosen = classical & (np.isin(frames["can_id"], known) | (managed & bool(self._j1939)))
        for i in np.flatnonzero(chosen).tolist():
            frame = frames[i]
            bus, can_id = batch.buses[frame["bus"]], int(frame["can_id"])
            extended, time_ns = bool(frame["flags"] & _EXTENDED), int(frame["time_ns"])
            data = frame["data"][: min(int(frame["length"]), 8)].tobytes()
            found = None
            if (can_id, extended) in self._iso.get(bus, ()):
                found = self._iso_frame((bus, can_id, extended), time_ns, data)
            elif managed[i] and bus in self._j1939:
                found = self._j1939_frame(bus, can_id, time_ns, data)
            if found is not None:
                yield found

    def _iso_frame(self, key: tuple[str, int, bool], time_ns: int, data: bytes) -> Payload | None:
        if not data:
            return None
        kind, low = data[0] >> 4, data[0] & 15
        if kind == _SINGLE and 0 < low < len(data) and key in self.confirmed:
            self._end_iso(key)
            return Payload(time_ns, *key, data[1 : 1 + low])
        if kind == _FIRST and len(data) == 8:
            self._end_iso(key)
            size = low << 8 | data[1]
            if _PACKET_BYTES < size <= self._iso[key[0]][key[1:]]:
                self._iso_transfers[key] = _IsoTransfer(size, time_ns, bytearray(data[2:]))
            return None
        transfer = self._iso_transfers.get(key)
        if kind != _CONSECUTIVE or transfer is None:
            return None
        if low != transfer.number & 15 or not 0 <= time_ns - transfer.time_ns <= _PATIENCE_NS:
            self._end_iso(key)
            return None
        transfer.number += 1
        transfer.time_ns = time_ns
        transfer.data += data[1:]
        if len(transfer.data) < transfer.size:
            if len(data) < 8:
                self._end_iso(key)
            return None
        del self._iso_transfers[key]
        self.confirmed.add(key)
        return Payload(time_ns, *key, bytes(transfer.data[: transfer.size]))

    def _end_iso(self, key: tuple[str, int, bool]) -> None:
        transfer = self._iso_transfers.pop(key, None)
        if transfer is not None and transfer.number > 1:
            self._interrupted[key[0]] += 1
        elif transfer is not None:
            self._begun_only[key] += 1

    def _j1939_frame(self, bus: str, can_id: int, time_ns: int, data: bytes) -> Payload | None:
        key = (bus, can_id & 0xFF, can_id >> 8 & 0xFF)
        if len(data) < 8:
            return None
        if can_id >> 16 & 0xFF == _MANAGEMENT:
            control = data[0]
            if control in (_RTS, _BAM):
                self._end_j1939(key)
                self._begin_j1939(key, time_ns, data)
            elif control == _ABORT:
                self._end_j1939(key)
                self._end_j1939((bus, key[2], key[1]))
            return None
        transfer = self._j1939_transfers.get(key)
        if transfer is None:
            return None
        if not 0 <= time_ns - transfer.time_ns <= _PATIENCE_NS or not 1 <= data[0] <= transfer.packets:
            self._end_j1939(key)
            return None
        transfer.time_ns = time_ns
        transfer.parts[data[0]] = data[1:]  # a packet may be asked for again
        if len(transfer.parts) < transfer.packets:
            return None
        del self._j1939_transfers[key]
        whole = b"".join(transfer.parts[i] for i in range(1, transfer.packets + 1))
        return Payload(time_ns, bus, transfer.can_id, True, whole[: transfer.size])

    def _begin_j1939(self, key: tuple[str, int, int], time_ns: int, data: bytes) -> None:
        _, source, destination = key
        size, packets, group = int.from_bytes(data[1:3], "little"), data[3], int.from_bytes(data[5:8], "little")
        if not 8 < size <= _LONGEST_J1939 or packets != -(-size // _PACKET_BYTES) or group > 0x3FFFF:
            self._interrupted[key[0]] += 1
            return
        if group >> 8 & 0xFF < 0xF0:
            group |= destination
        self._j1939_transfers[key] = _J1939Transfer(_PRIORITY << 26 | group << 8 | source, size, packets, time_ns)

    def _end_j1939(self, key: tuple[str, int, int]) -> None:
        if self._j1939_transfers.pop(key, None) is not None:
            self._interrupted[key[0]] += 1
