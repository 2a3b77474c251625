"""Channels -> frames: inverse of the decoder, with the same plans, in whole columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.arrays import BoolArray, FloatArray
from daq.can.bits import Message, RawKind, Signal, write_raw
from daq.can.decode_plan import SignalPlan, compile_plan
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameBatch, FrameFlag, concatenate
from daq.errors import DatabaseError, Fault, nearest

_FD_LENGTHS = np.array([*range(9), 12, 16, 20, 24, 32, 48, 64])
_BELOW_2_63 = float(np.nextafter(2.0**63, 0.0))
_BELOW_2_64 = float(np.nextafter(2.0**64, 0.0))


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
    plan = compile_plan(message)
    _check(message, values)
    times = np.asarray(time_ns, np.int64)
    fd = message.fd or message.length > 8
    frames = np.zeros(len(times), FD_DTYPE if fd else CLASSIC_DTYPE)
    frames["time_ns"] = times
    frames["can_id"] = message.can_id
    frames["length"] = _FD_LENGTHS[np.searchsorted(_FD_LENGTHS, message.length)]
    frames["flags"] = (FrameFlag.EXTENDED if message.extended else 0) | (FrameFlag.FD if fd else 0)
    saturated: dict[str, int] = {}
    missing: dict[str, int] = {}
    data = np.zeros((len(times), frames["data"].shape[1]), np.uint8)
    for part in _outer_first(plan.signals):
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
    """Return the values of a counter that wraps at the signal's range.

    Parameters
    ----------
    count : int
        How many.
    start : int
        Raw value of the first.
    """
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
    if faults:
        raise DatabaseError(*faults)


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
