"""Frames to channels and back, whole columns at a time: one compiled plan per message, the same live and offline.

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

from bisect import bisect_left
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq import BoolArray, Channel, FloatArray, IntArray
from daq.can.bits import BitField, Message, RawKind, Signal, bit_field, read_raw, write_raw
from daq.can.databases import Database, messages_by_bus
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FD_LENGTHS, FrameArray, FrameBatch, FrameFlag, concatenate
from daq.can.identify import UNKNOWN, Identifier
from daq.can.transport import Payload, Transport
from daq.errors import DatabaseError, Fault, nearest

_EXACT = 1 << 53
_CLASSICAL_BYTES = 8

BLOCK = 65_536
"""Frames decoded at once: small enough for the cache, large enough to hide the cost of a call."""

_BELOW_2_63 = float(np.nextafter(2.0**63, 0.0))
_BELOW_2_64 = float(np.nextafter(2.0**64, 0.0))


@dataclass(frozen=True, eq=False)
class Selection:
    """What a multiplexed signal needs: each of these multiplexers holds one of its raw values, outermost first."""

    needs: tuple[tuple[BitField, NDArray[Any]], ...]

    def mask(self, data: NDArray[np.uint8]) -> BoolArray:
        """Return which payloads are selected."""
        masks = []
        for place, ids in self.needs:
            raw = read_raw(place, data)
            masks.append(raw == ids[0] if len(ids) == 1 else np.isin(raw, ids))
        return np.asarray(np.logical_and.reduce(masks))


@dataclass(frozen=True)
class SignalPlan:
    """How one signal becomes a column.

    Attributes
    ----------
    integer : bool
        Scale in 64-bit integers, as the result may exceed what a double holds exactly.
    selection : Selection or None
        For a multiplexed signal; signals selected alike share it.
    never : bool
        No frame can carry the signal: the DBC gives no multiplexer value for it.
    end_byte : int
        Payload bytes needed to decode the value.
    """

    signal: Signal
    field: BitField
    integer: bool
    selection: Selection | None
    never: bool
    end_byte: int


@cache
def compile_plan(message: Message) -> dict[str, SignalPlan]:
    """Compile the signals of a message, by name, once; the plans serve decoding and encoding, live and offline."""
    selections: dict[tuple[str | None, tuple[int, ...]], Selection | None] = {}
    plans = {}
    for signal in message.signals:
        key = (signal.multiplexer, signal.multiplexer_ids)
        if key not in selections:
            selections[key] = _selection(signal, message)
        plans[signal.name] = _signal_plan(signal, selections[key])
    return plans


def _signal_plan(signal: Signal, selection: Selection | None) -> SignalPlan:
    low, high = signal.raw_range
    reach = max(abs(low), abs(high)) * abs(signal.scale) + abs(signal.offset)
    integer = (
        signal.kind is not RawKind.FLOAT
        and isinstance(signal.scale, int)
        and isinstance(signal.offset, int)
        and _EXACT < reach < 1 << 63
    )
    ends = [signal.end_byte, *(field.end_byte for field, _ in (selection.needs if selection else ()))]
    never = signal.multiplexer is not None and selection is None
    return SignalPlan(signal, bit_field(signal), integer, selection, never, max(ends))


def _selection(signal: Signal, message: Message) -> Selection | None:
    """Return what selects a signal; None for one that is always there, or that nothing can select."""
    needs: list[tuple[BitField, NDArray[Any]]] = []
    seen = {signal.name}
    while signal.multiplexer is not None:
        outer = message.by_name.get(signal.multiplexer)
        if outer is None or outer.name in seen or not signal.multiplexer_ids:
            return None
        bits = (1 << outer.length_bits) - 1
        ids = np.array(
            sorted({value & bits for value in signal.multiplexer_ids}), np.int64 if bits >> 63 == 0 else np.uint64
        )
        needs.insert(0, (bit_field(replace(outer, kind=RawKind.UNSIGNED)), ids))
        seen.add(outer.name)
        signal = outer
    return Selection(tuple(needs)) if needs else None


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
            known = {f"{name}.{signal.name}" for _, name, message in named for signal in message.signals}
            DatabaseError.stop_if_any(
                Fault(f"no DBC has a signal {name!r}", expected=nearest(name, known))
                for name in wanted
                if name not in known
            )
        self._wanted = wanted is not None
        self._targets: list[tuple[str, str, list[SignalPlan]]] = []
        coded = []
        for bus, name, message in named:
            plans = compile_plan(message).values()
            chosen = [p for p in plans if wanted is None or f"{name}.{p.signal.name}" in wanted]
            if chosen:
                self._targets.append((bus, name, chosen))
            coded.append((bus, message, len(self._targets) if chosen else UNKNOWN))
        self._identifier = Identifier(coded)
        long = [(bus, message) for bus, _, message in named if message.length > _CLASSICAL_BYTES]
        self._long = _LongMessages(long, coded, self._identifier) if long else None

    def interrupted(self) -> dict[str, int]:
        """Return how many messages of several frames were begun and not completed so far, per bus."""
        return dict(self._long.transport.interrupted()) if self._long else {}

    def decode(self, batch: FrameBatch) -> dict[tuple[str, str], Channel]:
        """Decode a batch.

        Returns
        -------
        dict
            (bus, "Message.Signal") to `Channel`; signals of one message share their ``time_ns`` array. Messages
            without a frame are absent, unless their signals were asked for by name: those are empty channels.
        """
        long = self._long.payloads(batch) if self._long else {}
        frames, blocks = batch.frames, range(0, len(batch), BLOCK)
        codes = np.empty(len(frames), self._identifier.dtype)
        counts = np.zeros((len(blocks), len(self._targets) + 1), np.int64)
        for number, start in enumerate(blocks):
            part = slice(start, start + BLOCK)
            codes[part] = self._identifier.codes(frames[part], batch.buses)
            if self._long:
                self._long.leave_out(frames[part], codes[part])
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
        for code, payloads in long.items():
            bus, name, plans = self._targets[code - 1]
            group = _Columns(plans, len(payloads))
            group.append_payloads(payloads)
            for channel in group.channels(name):
                before = channels.get((bus, channel.name))
                channels[bus, channel.name] = _merged(before, channel) if before else channel
        return channels


def decode(
    batch: FrameBatch, databases: Mapping[str, Sequence[Database]], wanted: Collection[str] | None = None
) -> dict[tuple[str, str], Channel]:
    """Decode one batch; see `Decoder`, which is for many."""
    return Decoder(databases, wanted).decode(batch)


def _merged(channel: Channel, other: Channel) -> Channel:
    """Return the samples of both in order of time."""
    time_ns, values = np.concatenate([channel.time_ns, other.time_ns]), np.concatenate([channel.values, other.values])
    order = np.argsort(time_ns, kind="stable")
    return replace(channel, time_ns=time_ns[order], values=values[order])


class _LongMessages:
    """Messages that do not fit a classical frame, put together from several, see `daq.can.transport`."""

    def __init__(
        self, long: Sequence[tuple[str, Message]], coded: Sequence[tuple[str, Message, int]], identifier: Identifier
    ) -> None:
        iso: dict[str, dict[tuple[int, bool], int]] = {}
        for bus, message in long:
            if not message.j1939:
                iso.setdefault(bus, {})[message.can_id, message.extended] = message.length
        self.transport = Transport(iso, {bus for bus, message in long if message.j1939})
        self._identifier = identifier
        self._codes = {(bus, m.can_id, m.extended): code for bus, m, code in coded}
        self._pieces = np.zeros(max((code for _, _, code in coded), default=0) + 1, np.bool_)

    def leave_out(self, frames: FrameArray, codes: NDArray[Any]) -> None:
        """Take classical frames that are pieces of a message for none, in place."""
        codes[self._pieces[codes] & ((frames["flags"] & int(FrameFlag.FD)) == 0)] = UNKNOWN

    def payloads(self, batch: FrameBatch) -> dict[int, list[Payload]]:
        """Return the messages that are complete with a batch, by their code."""
        found: dict[int, list[Payload]] = {}
        complete = list(self.transport.take(batch))
        self._pieces[[self._codes[key] for key in self.transport.confirmed]] = True
        self._pieces[UNKNOWN] = False
        if complete:
            heads = np.zeros(len(complete), CLASSIC_DTYPE)
            heads["can_id"] = [payload.can_id for payload in complete]
            heads["flags"] = [int(FrameFlag.EXTENDED) * payload.extended for payload in complete]
            heads["bus"] = [batch.buses.index(payload.bus) for payload in complete]
            for code, payload in zip(self._identifier.codes(heads, batch.buses).tolist(), complete, strict=True):
                if code != UNKNOWN:
                    found.setdefault(code, []).append(payload)
        return found


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

    def append_payloads(self, payloads: Sequence[Payload]) -> None:
        """Append messages of any length."""
        length = np.array([len(payload.data) for payload in payloads], np.int64)
        data = np.zeros((len(payloads), max(int(length.max()), max(plan.end_byte for plan in self.plans))), np.uint8)
        for row, payload in zip(data, payloads, strict=True):
            row[: len(payload.data)] = np.frombuffer(payload.data, np.uint8)
        self.time_ns[:] = [payload.time_ns for payload in payloads]
        with np.errstate(invalid="ignore", over="ignore"):
            _fill(self.plans, data, length, self.values)

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
    length: NDArray[Any],
    columns: FloatArray,
) -> None:
    shortest = int(length.min()) if len(length) else 0
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


@dataclass(frozen=True)
class Encoded:
    """Frames of one message, and how many samples could not be encoded exactly.

    Attributes
    ----------
    saturated : mapping str -> int
        Samples per signal that lay beyond its raw range and were cut to it.
    missing : mapping str -> int
        Samples per signal that were NaN where the frame carries it: sent as raw 0 (floats as NaN).
    """

    frames: FrameBatch
    saturated: dict[str, int] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)


def encode(message: Message, values: Mapping[str, ArrayLike], time_ns: ArrayLike, bus: str) -> Encoded:
    """Encode one message at many times.

    Parameters
    ----------
    values : mapping of signal name to array, shape (n,), or number
        Physical values; rounded to the nearest raw value (halves to even, as cantools does). A signal that is not
        named is sent as raw 0; a multiplexed one only in frames whose multiplexer selects it.
    time_ns : int64 array, shape (n,)
        UTC nanoseconds.

    Raises
    ------
    DatabaseError
        The message has no such signal, or is longer than a frame.
    """
    plans = compile_plan(message)
    _check(message, values)
    times = np.asarray(time_ns, np.int64)
    fd = message.fd or message.length > 8
    frames = np.zeros(len(times), FD_DTYPE if fd else CLASSIC_DTYPE)
    frames["time_ns"] = times
    frames["can_id"] = message.can_id
    frames["length"] = FD_LENGTHS[bisect_left(FD_LENGTHS, message.length)]
    frames["flags"] = (FrameFlag.EXTENDED if message.extended else 0) | (FrameFlag.FD if fd else 0)
    saturated: dict[str, int] = {}
    missing: dict[str, int] = {}
    data = np.zeros((len(times), frames["data"].shape[1]), np.uint8)
    for part in _outer_first(plans):
        name = part.signal.name
        if name not in values:
            continue
        column = np.broadcast_to(np.asarray(values[name], np.float64), times.shape)
        carried = part.selection.mask(data) if part.selection else np.broadcast_to(True, times.shape)
        raw, cut = _to_raw(part.signal, column)
        saturated |= _count(name, cut & carried)
        missing |= _count(name, np.isnan(column) & carried)
        write_raw(part.field, data, np.where(carried, raw, np.uint64(0)))
    frames["data"] = data
    return Encoded(FrameBatch(frames, (bus,)), saturated, missing)


def merge(batches: Sequence[FrameBatch]) -> FrameBatch:
    """Join batches in the order of time; frames of one instant keep the order of the batches."""
    joined = concatenate(batches)
    return FrameBatch(joined.frames.take(np.argsort(joined.frames["time_ns"], kind="stable")), joined.buses)


def rolling_counter(count: int, signal: Signal, start: int = 0) -> FloatArray:
    """Return `count` values of a counter that wraps at the signal's range; `start` is the raw value of the first."""
    raw = ((np.arange(count) + start) % (1 << signal.length_bits)).astype(np.float64)
    return raw * signal.scale + signal.offset


def _check(message: Message, values: Mapping[str, ArrayLike]) -> None:
    faults = [
        Fault(f"message {message.name} has no signal {name!r}", expected=nearest(name, message.by_name))
        for name in values
        if name not in message.by_name
    ]
    if message.length > 64:
        faults.append(Fault(f"message {message.name} does not fit a frame", found=f"{message.length} bytes"))
    faults += [
        Fault(f"signal {message.name}.{name} does not fit its message", found=f"{message.length} bytes")
        for name in values
        if name in message.by_name and message.by_name[name].end_byte > message.length
    ]
    DatabaseError.stop_if_any(faults)


def _outer_first(plans: Mapping[str, SignalPlan]) -> list[SignalPlan]:
    """Return the plans that some frame can carry, multiplexers before what they select."""
    carried = [plan for plan in plans.values() if not plan.never]
    return sorted(carried, key=lambda plan: len(plan.selection.needs) if plan.selection else 0)


def _to_raw(signal: Signal, values: FloatArray) -> tuple[NDArray[np.uint64], BoolArray]:
    """Return the bits of each value in the low end of a word, and which values were cut to the raw range."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a DBC may give the scale 0
        scaled = (values - float(signal.offset)) / float(signal.scale)
    if signal.kind is RawKind.FLOAT:
        size = signal.length_bits // 8
        with np.errstate(over="ignore", invalid="ignore"):
            bits: NDArray[Any] = scaled.astype(f"f{size}").view(f"u{size}")
        return bits.astype(np.uint64), np.zeros(len(values), np.bool_)
    low, high = signal.raw_range
    rounded = np.rint(scaled)
    cut = (rounded < low) | (rounded > high)
    clipped = np.nan_to_num(np.clip(rounded, low, min(float(high), _BELOW_2_64)))
    if signal.kind is RawKind.SIGNED:
        words = np.minimum(clipped, _BELOW_2_63).astype(np.int64).view(np.uint64)
    else:
        words = clipped.astype(np.uint64)
    return words & np.uint64((1 << signal.length_bits) - 1), cut


def _count(name: str, rows: BoolArray) -> dict[str, int]:
    number = int(np.count_nonzero(rows))
    return {name: number} if number else {}
