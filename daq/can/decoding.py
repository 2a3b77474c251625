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

from daq.arrays import BoolArray, FloatArray, IntArray
from daq.can.bits import Message, read_raw
from daq.can.buses import messages_by_bus
from daq.can.databases import Database
from daq.can.decode_plan import SignalPlan, compile_plan
from daq.can.frames import FrameArray, FrameBatch
from daq.can.identify import UNKNOWN, Identifier
from daq.channels import Channel
from daq.errors import DatabaseError, Fault, nearest

BLOCK = 65_536
"""Frames decoded at once: small enough for the cache, large enough to hide the cost of a call."""


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

        Returns
        -------
        dict
            (bus, "Message.Signal") to `Channel`; signals of one message share their ``time_ns`` array. Messages
            without a frame are absent, unless their signals were asked for by name: those are empty channels.
        """
        frames, blocks = batch.frames, range(0, len(batch), BLOCK)
        codes = np.empty(len(frames), self._identifier.dtype)
        counts = np.zeros((len(blocks), len(self._targets) + 1), np.int64)
        for number, start in enumerate(blocks):
            part = slice(start, start + BLOCK)
            codes[part] = self._identifier.codes(frames[part], batch.buses)
            counts[number] = np.bincount(codes[part], minlength=counts.shape[1])
        sizes = counts.sum(axis=0)[1:].tolist()
        columns = [_Columns(plans, size) for (_, _, plans), size in zip(self._targets, sizes, strict=True)]
        with np.errstate(invalid="ignore", over="ignore"):  # signalling NaN and infinity in float signals
            for number, start in enumerate(blocks):
                part = slice(start, start + BLOCK)
                _decode_block(frames[part], codes[part], counts[number], columns)
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
        self.time_ns = np.empty(size, np.int64)
        self.values = np.empty((len(plans), size))  # one block: large pages from the system

    def append(self, frames: FrameArray) -> None:
        piece = slice(self.filled, self.filled + len(frames))
        self.filled = piece.stop
        self.time_ns[piece] = frames["time_ns"]
        _fill(self.plans, frames["data"], frames["length"], self.values[:, piece])

    def channels(self, message: str) -> list[Channel]:
        time_ns, values = self.time_ns, self.values
        if np.any(time_ns[1:] < time_ns[:-1]):
            order = np.argsort(time_ns, kind="stable")
            time_ns, values = time_ns[order], values[:, order]
        return [
            Channel(f"{message}.{plan.signal.name}", plan.signal.unit, time_ns, column, plan.signal.labels)
            for plan, column in zip(self.plans, values, strict=True)
        ]


def _decode_block(frames: FrameArray, codes: NDArray[Any], counts: IntArray, columns: list[_Columns]) -> None:
    """Sort the frames by message once, while they are in the cache; then every field is a strided view."""
    grouped = frames.take(np.argsort(codes, kind="stable")[counts[UNKNOWN] :])
    ends = np.cumsum(counts) - counts[UNKNOWN]
    for code in np.flatnonzero(counts):
        if code != UNKNOWN:
            columns[code - 1].append(grouped[ends[code - 1] : ends[code]])


def _fill(
    plans: Sequence[SignalPlan],
    data: NDArray[np.uint8],
    length: NDArray[np.uint8],
    columns: FloatArray,
) -> None:
    shortest = length.min(initial=255)
    masks: dict[int, BoolArray] = {}
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


def _scale(plan: SignalPlan, raw: NDArray[Any], out: FloatArray) -> None:
    scale, offset = plan.signal.scale, plan.signal.offset
    if plan.integer:
        out[:] = raw.astype(np.int64) * scale + offset
    elif scale == 1 and offset == 0:
        out[:] = raw
    else:
        np.multiply(raw, float(scale), out=out, dtype=np.float64)
        if offset != 0 or scale < 0:
            np.add(out, float(offset), out=out)


def _check_wanted(wanted: Collection[str], named: Sequence[tuple[str, str, Message]]) -> None:
    known = {f"{name}.{signal.name}" for _, name, message in named for signal in message.signals}
    missing = [name for name in wanted if name not in known]
    if missing:
        raise DatabaseError(
            *(Fault(f"no DBC has a signal {name!r}", expected=nearest(name, known)) for name in missing)
        )
