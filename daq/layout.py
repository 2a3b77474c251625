"""What a DBC says of a message: plain values, so that decoding and encoding need no DBC library."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

EXTENDED_BIT = 0x8000_0000
"""Marks a 29-bit identifier where one number must hold both kinds, as in a DBC's ``BO_`` line."""


class RawKind(Enum):
    """How the bits of a signal are read."""

    UNSIGNED = "unsigned"
    SIGNED = "signed"
    FLOAT = "float"


@dataclass(frozen=True)
class Signal:
    """One ``SG_`` line with everything that the rest of the file says of it; equal when the layout is.

    Attributes
    ----------
    name : str
    unit : str
        As written, ``""`` where there is none.
    start_bit, length_bits : int
        As written: `start_bit` is the lowest bit of an Intel signal, the highest of a Motorola one.
    big_endian : bool
        Motorola byte order.
    kind : RawKind
    scale, offset : int or float
        physical = raw * scale + offset; integers where both are whole (then the arithmetic is exact).
    minimum, maximum : float or None
        Of the physical value, None where the DBC gives no range.
    labels : mapping int -> str
        Value table, raw value to name.
    multiplexer : str or None
        Name of the signal that decides whether this one is in the frame.
    multiplexer_ids : tuple of int
        Raw values of `multiplexer` that carry this signal.
    """

    name: str
    unit: str
    start_bit: int
    length_bits: int
    big_endian: bool
    kind: RawKind
    scale: float = 1
    offset: float = 0
    minimum: float | None = field(default=None, compare=False)
    maximum: float | None = field(default=None, compare=False)
    labels: dict[int, str] = field(default_factory=dict, compare=False)
    multiplexer: str | None = None
    multiplexer_ids: tuple[int, ...] = ()
    comment: str = field(default="", compare=False)

    @property
    def first_bit(self) -> int:
        """Position of the first bit in the order in which bytes are sent (Motorola: of the highest bit)."""
        return 8 * (self.start_bit // 8) + 7 - self.start_bit % 8 if self.big_endian else self.start_bit

    @property
    def end_byte(self) -> int:
        """Number of bytes a frame must have to carry this signal."""
        return (self.first_bit + self.length_bits + 7) // 8

    @property
    def raw_range(self) -> tuple[int, int]:
        """Lowest and highest raw integer (meaningless for floats)."""
        if self.kind is RawKind.SIGNED:
            return -(1 << (self.length_bits - 1)), (1 << (self.length_bits - 1)) - 1
        return 0, (1 << self.length_bits) - 1


@dataclass(frozen=True)
class Message:
    """One ``BO_`` block; equal when the layout is.

    Attributes
    ----------
    name : str
    can_id : int
        The bare 11- or 29-bit identifier.
    extended : bool
    length : int
        Bytes; 0 to 64, more for J1939 multi-packet messages (of which only single frames are decoded).
    signals : tuple of Signal
    cycle_time_s : float or None
    j1939 : bool
        The identifier stands for its parameter group: priority and source address are free.
    fd : bool
        Declared as CAN FD.
    """

    name: str
    can_id: int
    extended: bool
    length: int
    signals: tuple[Signal, ...]
    cycle_time_s: float | None = field(default=None, compare=False)
    j1939: bool = False
    fd: bool = False
    comment: str = field(default="", compare=False)

    @property
    def key(self) -> int:
        """Identifier with `EXTENDED_BIT` where it has 29 bits: unique on a bus."""
        return self.can_id | (EXTENDED_BIT if self.extended else 0)

    @cached_property
    def by_name(self) -> dict[str, Signal]:
        """Signals by name."""
        return {signal.name: signal for signal in self.signals}

    def id_text(self) -> str:
        """Return the identifier as people write it: ``0x1F0``, or eight digits for 29 bits."""
        return f"0x{self.can_id:08X}" if self.extended else f"0x{self.can_id:03X}"
