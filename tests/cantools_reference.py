"""cantools as the reference for decoding: one frame at a time, signal by signal where it refuses a whole frame."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import cantools.database
import numpy as np
from cantools.database.can import Message, Signal

from daq.can import CLASSIC_DTYPE, Database, Decoder, FrameBatch, FrameFlag
from daq.can.frames import FD_DTYPE

logging.getLogger("cantools").addHandler(logging.NullHandler())


def load_reference(path: Path) -> Any:
    """Load a DBC with cantools alone; None where cantools refuses it."""
    try:
        return cantools.database.load_file(path, strict=False)
    except cantools.database.UnsupportedDatabaseFormatError:
        return None


class Reference:
    """What cantools says of one message's payloads."""

    def __init__(self, message: Any) -> None:
        self.message = message
        self.alone: dict[str, Any] = {}
        outers = {s.multiplexer_signal for s in message.signals if s.multiplexer_signal}
        self.whole = all(message.get_signal_by_name(name).is_multiplexer for name in outers)

    def decode(self, payload: bytes) -> dict[str, float]:
        """Physical values; NaN where a frame has no such signal."""
        values = self._all_at_once(payload) if self.whole else None
        if values is None:
            values = {s.name: self._one(s, payload) for s in self.message.signals if self._selected(s, payload)}
        return {signal.name: float(values.get(signal.name, math.nan)) for signal in self.message.signals}

    def _all_at_once(self, payload: bytes) -> dict[str, Any] | None:
        """What cantools decodes; None where it refuses the frame (overlaps, an unknown multiplexer value)."""
        try:
            return dict(self.message.decode(payload, decode_choices=False, allow_truncated=True))
        except cantools.database.DecodeError:
            return None

    def _one(self, signal: Any, payload: bytes) -> float:
        if signal.name not in self.alone:
            self.alone[signal.name] = _alone(signal, self.message)
        alone = self.alone[signal.name]
        values = alone.decode(payload[: alone.length], decode_choices=False, allow_truncated=True)
        return float(values.get(signal.name, math.nan))

    def _selected(self, signal: Any, payload: bytes) -> bool:
        if signal.multiplexer_signal is None:
            return True
        outer = self.message.get_signal_by_name(signal.multiplexer_signal)
        value = self._one(outer, payload)
        if math.isnan(value) or not self._selected(outer, payload):
            return False
        bits = (1 << outer.length) - 1
        return int(value) & bits in {i & bits for i in signal.multiplexer_ids or ()}


def _alone(signal: Any, message: Any) -> Any:
    """A message of this signal only, long enough for it."""
    copy = Signal(
        signal.name, signal.start, signal.length, signal.byte_order, signal.is_signed, conversion=signal.conversion
    )
    start = 8 * (signal.start // 8) + 7 - signal.start % 8 if signal.byte_order == "big_endian" else signal.start
    length = max(message.length, (start + signal.length + 7) // 8)
    return Message(message.frame_id, message.name, length, [copy], is_extended_frame=message.is_extended_frame)


def frames_of(message: Any, payloads: list[bytes]) -> FrameBatch:
    """One frame of `message` for each payload."""
    wide = max((len(p) for p in payloads), default=0) > 8
    frames = np.zeros(len(payloads), FD_DTYPE if wide else CLASSIC_DTYPE)
    frames["time_ns"] = np.arange(len(payloads))
    frames["can_id"] = message.frame_id
    frames["flags"] = FrameFlag.EXTENDED if message.is_extended_frame else 0
    frames["length"] = [len(p) for p in payloads]
    for row, payload in zip(frames["data"], payloads, strict=True):
        row[: len(payload)] = np.frombuffer(payload, np.uint8)
    return FrameBatch(frames, ("can0",))


def assert_same(database: Database, message: Any, payloads: list[bytes], decoder: Decoder | None = None) -> None:
    """Our columns equal cantools, bit for bit: what cantools gives as a huge integer, as the nearest double."""
    ours = (decoder or Decoder({"can0": [database]})).decode(frames_of(message, payloads))
    reference = Reference(message)
    expected = [reference.decode(payload) for payload in payloads]
    for signal in message.signals:
        want = np.array([values[signal.name] for values in expected])
        got = ours["can0", f"{message.name}.{signal.name}"].values
        np.testing.assert_array_equal(got, want, err_msg=f"{database.name} {message.name}.{signal.name}")
