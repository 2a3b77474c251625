"""Where the signals of a message lie: what reaches beyond it, and what overlaps.

cantools checks bit by bit, in time that grows with the square of a signal's start bit: a file with one signal can take
it a minute. Here the bits of a signal are one integer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

Placed = list[tuple[str, int]]
"""Names of signals with their bits, as `_bits` returns them."""


class _MisplacedError(Exception):
    pass


def misplaced(message: Any) -> str:
    """Return what is wrong with the places of a message of cantools, in its words; empty where nothing is.

    Signals of different values of a multiplexer may overlap.
    """
    try:
        _place(message, {signal.name: signal for signal in message.signals}, message.signal_tree, 0, ())
    except _MisplacedError as error:
        return str(error)
    return ""


def _place(
    message: Any, signals: Mapping[str, Any], tree: Sequence[Any], taken: int, outer: tuple[Placed, ...]
) -> tuple[int, Placed]:
    """Place a tree of signals beside the `outer` ones, which take the bits `taken`; return all bits, and the tree's."""
    own: Placed = []
    for node in tree:
        name = next(iter(node)) if isinstance(node, dict) else node
        bits = _bits(signals[name])
        if bits >> 8 * message.length:
            raise _MisplacedError(f"The signal {name} does not fit in message {message.name}.")
        if bits & taken:
            other = next(signal for signal, its_bits in chain(*outer, own) if its_bits & bits)
            raise _MisplacedError(f"The signals {name} and {other} are overlapping in message {message.name}.")
        taken |= bits
        own.append((name, bits))
        if isinstance(node, dict):
            cases = [_place(message, signals, case, taken, (*outer, own)) for _, case in sorted(node[name].items())]
            for of_case, placed in cases:
                taken |= of_case
                own += placed
    return taken, own


def _bits(signal: Any) -> int:
    """Return a number with the signal's bits set; bit 0 is the lowest one of the first byte."""
    if signal.byte_order != "big_endian":
        return ((1 << int(signal.length)) - 1) << int(signal.start)
    first = 8 * (int(signal.start) // 8) + 7 - int(signal.start) % 8  # counted from the highest bit of the first byte
    last = first + int(signal.length) - 1
    whole = (1 << 8 * (last // 8 + 1)) - (1 << 8 * (first // 8))  # all of the bytes that it touches
    before = ((1 << first % 8) - 1) << 8 * (first // 8) + 8 - first % 8
    behind = ((1 << 7 - last % 8) - 1) << 8 * (last // 8)
    return whole & ~before & ~behind
