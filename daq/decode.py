"""Frames -> channels, whole columns at a time: one compiled plan per message, the same live and offline.

Values equal those of ``cantools.database.Message.decode(decode_choices=False, allow_truncated=True)``: raw * scale
+ offset in this order, in double precision (raw values beyond 2**53, which cantools keeps as Python integers, are
rounded to a double: at most one unit in the last place). Where cantools raises, a column goes on:

- a signal that does not fit into a frame's actual length is NaN there (cantools leaves it out, or refuses the frame
  when the DBC's own length is too short for the signal);
- a multiplexed signal is NaN in frames whose multiplexer does not select it (an unknown multiplexer value makes
  cantools refuse the whole frame);
- signals that overlap are each read where they lie (cantools refuses every frame of such a message);
- a multiplexer that only ``SG_MUL_VAL_`` names, without an M of its own, selects all the same.

Multiplexer values are compared raw, as bits. Error and remote frames are never decoded.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.bits import read_raw
from daq.buses import messages_by_bus
from daq.channel import Channel
from daq.databases import Database
from daq.errors import DatabaseError, Fault, nearest
from daq.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray, FrameBatch
from daq.identify import UNKNOWN, Identifier
from daq.layout import Message
from daq.plan import SignalPlan, compile_plan

BLOCK = 65_536
"""Frames decoded at once: small enough for the cache, large enough to hide the cost of a call."""
_HEAD = 16
_WORD = {
    dtype: np.dtype({"names": ["word"], "formats": ["<u8"], "offsets": [_HEAD], "itemsize": dtype.itemsize})
    for dtype in (CLASSIC_DTYPE, FD_DTYPE)
}


class Decoder:
    """Decodes batch after batch with plans compiled once.

    Parameters
    ----------
    databases : mapping of bus name to its databases
    wanted : collection of "Message.Signal", optional
        What to decode, on every bus that has it; everything by default.

    Raises
    ------
    DatabaseError
        The databases of a bus contradict each other, or a wanted signal is in none of them.
    """

    def __init__(self, databases: Mapping[str, Sequence[Database]], wanted: Collection[str] | None = None) -> None:
        named = [(bus, name, m) for bus, ms in messages_by_bus(databases).items() for name, m in ms.items()]
        if wanted is not None:
            _check_wanted(wanted, named)
        self._wanted = wanted is not None
        self._targets: list[tuple[str, str, list[SignalPlan]]] = []
        coded = []
        for bus, name, message in named:
            plans = compile_plan(message).signals.values()
            chosen = [p for p in plans if wanted is None or f"{name}.{p.signal.name}" in wanted]
            if chosen:
                self._targets.append((bus, name, chosen))
            coded.append((bus, message, len(self._targets) if chosen else UNKNOWN))
        self._identifier = Identifier(coded)

    def decode(self, batch: FrameBatch) -> dict[tuple[str, str], Channel]:
        """Decode a batch.

        Parameters
        ----------
        batch : FrameBatch

        Returns
        -------
        dict
            (bus, "Message.Signal") to `Channel`; signals of one message share their ``time_ns`` array. Messages
            without a frame are absent, unless their signals were asked for by name: those are empty channels.
        """
        frames = batch.frames
        codes = np.empty(len(frames), self._identifier.dtype)
        for start in range(0, len(frames), BLOCK):
            codes[start : start + BLOCK] = self._identifier.codes(frames[start : start + BLOCK], batch.buses)
        counts = np.bincount(codes, minlength=len(self._targets) + 1)[1:].tolist()
        columns = [_Columns(plans, n) for (_, _, plans), n in zip(self._targets, counts, strict=True)]
        with np.errstate(invalid="ignore", over="ignore"):  # signalling NaN and infinity in float signals
            for start in range(0, len(frames), BLOCK):
                _decode_block(frames[start : start + BLOCK], codes[start : start + BLOCK], columns)
        channels: dict[tuple[str, str], Channel] = {}
        for (bus, name, _), group in zip(self._targets, columns, strict=True):
            if group.size or self._wanted:
                channels |= {(bus, c.name): c for c in group.channels(name)}
        return channels


def decode(
    batch: FrameBatch, databases: Mapping[str, Sequence[Database]], wanted: Collection[str] | None = None
) -> dict[tuple[str, str], Channel]:
    """Decode one batch; see `Decoder`, which is for many."""
    return Decoder(databases, wanted).decode(batch)


class _Columns:
    """The growing columns of one message."""

    def __init__(self, plans: list[SignalPlan], size: int) -> None:
        self.plans = plans
        self.size = size
        self.filled = 0
        self.wide = any(plan.end_byte > 8 for plan in plans)
        self.time_ns = np.empty(size, np.int64)
        self.values = [np.empty(size) for _ in plans]

    def append(self, frames: FrameArray, rows: NDArray[np.intp]) -> None:
        piece = slice(self.filled, self.filled + len(rows))
        self.filled = piece.stop
        self.time_ns[piece] = frames["time_ns"][rows]
        if self.wide:
            data = frames["data"][rows]
        else:
            data = frames.view(_WORD[frames.dtype])["word"][rows].view(np.uint8).reshape(len(rows), 8)
        length = frames["length"][rows]
        _fill(self.plans, data, length, [values[piece] for values in self.values])

    def channels(self, message: str) -> list[Channel]:
        time_ns, values = self.time_ns, self.values
        if np.any(time_ns[1:] < time_ns[:-1]):
            order = np.argsort(time_ns, kind="stable")
            time_ns, values = time_ns[order], [column[order] for column in values]
        return [
            Channel(f"{message}.{plan.signal.name}", plan.signal.unit, time_ns, column, plan.signal.labels)
            for plan, column in zip(self.plans, values, strict=True)
        ]


def _decode_block(frames: FrameArray, codes: NDArray[Any], columns: list[_Columns]) -> None:
    order = np.argsort(codes, kind="stable")
    counts = np.bincount(codes, minlength=len(columns) + 1)
    ends = np.cumsum(counts)
    for code in np.flatnonzero(counts[1:]) + 1:
        columns[code - 1].append(frames, order[ends[code - 1] : ends[code]])


def _fill(
    plans: Sequence[SignalPlan],
    data: NDArray[np.uint8],
    length: NDArray[np.uint8],
    columns: Sequence[NDArray[np.float64]],
) -> None:
    shortest = length.min(initial=255)
    masks: dict[int, NDArray[np.bool_]] = {}
    for plan, out in zip(plans, columns, strict=True):
        if plan.never or plan.end_byte > data.shape[1]:
            out[:] = np.nan
            continue
        _scale(plan, read_raw(plan.field, data), out)
        if plan.selection is not None:
            key = id(plan.selection)
            if key not in masks:
                masks[key] = ~plan.selection.mask(data)
            out[masks[key]] = np.nan
        if shortest < plan.end_byte:
            out[length < plan.end_byte] = np.nan


def _scale(plan: SignalPlan, raw: NDArray[Any], out: NDArray[np.float64]) -> None:
    scale, offset = plan.signal.scale, plan.signal.offset
    if plan.integer:
        out[:] = raw.astype(np.int64) * scale + offset
    elif scale == 1 and offset == 0:
        out[:] = raw
    else:
        np.multiply(raw, scale, out=out, dtype=np.float64)
        if offset != 0 or scale < 0:
            np.add(out, offset, out=out)


def _check_wanted(wanted: Collection[str], named: Sequence[tuple[str, str, Message]]) -> None:
    known = {f"{name}.{signal.name}" for _, name, message in named for signal in message.signals}
    missing = [name for name in wanted if name not in known]
    if missing:
        raise DatabaseError(
            *(Fault(f"no DBC has a signal {name!r}", expected=nearest(name, known)) for name in missing)
        )
