"""A message compiled once: where its signals lie, how they scale and what selects them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.arrays import BoolArray
from daq.can.bits import BitField, Message, RawKind, Signal, bit_field, read_raw

_EXACT = 1 << 53


@dataclass(frozen=True, eq=False)
class Selection:
    """What a multiplexed signal needs: each of these multiplexers holds one of its raw values, outermost first."""

    needs: tuple[tuple[BitField, NDArray[Any]], ...]

    def mask(self, data: NDArray[np.uint8]) -> BoolArray:
        """Return which payloads are selected."""
        masks = []
        for field, ids in self.needs:
            raw = read_raw(field, data)
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


@dataclass(frozen=True)
class MessagePlan:
    """A message, compiled: the plans of its signals by name."""

    message: Message
    signals: dict[str, SignalPlan]


@cache
def compile_plan(message: Message) -> MessagePlan:
    """Compile a message once; the plan serves decoding and encoding, live and offline."""
    selections: dict[tuple[str | None, tuple[int, ...]], Selection | None] = {}
    plans = {}
    for signal in message.signals:
        key = (signal.multiplexer, signal.multiplexer_ids)
        if key not in selections:
            selections[key] = _selection(signal, message)
        plans[signal.name] = _signal_plan(signal, selections[key])
    return MessagePlan(message, plans)


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
