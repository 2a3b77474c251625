"""Messages and signals of a DBC as plain values, and the bit fields of signals, read and written as whole columns.

A field is read through the smallest aligned container (1, 2, 4 or 8 bytes) that holds it: then a byte or word
that fills its container is a strided view and costs one pass. What lies across two 8-byte words (CAN FD only)
is read through an unaligned word and, when it touches nine bytes, the ninth byte beside it.
Decoding and encoding need no DBC library.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    unit : str
        As written, ``""`` where there is none.
    start_bit, length_bits : int
        As written: `start_bit` is the lowest bit of an Intel signal, the highest of a Motorola one.
    big_endian : bool
        Motorola byte order.
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
    can_id : int
        The bare 11- or 29-bit identifier.
    length : int
        Bytes; 0 to 64, more for J1939 multi-packet messages (of which only single frames are decoded).
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


_SIZES = (1, 2, 4, 8)
_LETTERS = {RawKind.UNSIGNED: "u", RawKind.SIGNED: "i", RawKind.FLOAT: "f"}


@dataclass(frozen=True)
class BitField:
    """A signal's place in the payload, compiled.

    Attributes
    ----------
    offset, size : int
        First byte and number of bytes of the container.
    shift : int
        Bits of the container below the field's lowest bit.
    length : int
        Bits of the field.
    spill : int
        Bits of the field that lie in the byte behind the container.
    end_byte : int
        Number of payload bytes the field needs.
    word : dtype
        Of the container, unsigned, in the field's byte order.
    direct : dtype or None
        Of the container read as the value itself, where the field fills it.
    """

    offset: int
    size: int
    shift: int
    length: int
    big_endian: bool
    kind: RawKind
    spill: int
    end_byte: int
    word: np.dtype[Any]
    direct: np.dtype[Any] | None


def bit_field(signal: Signal) -> BitField:
    """Compile the place of a signal."""
    first = signal.first_bit
    first_byte, last_byte = first // 8, (first + signal.length_bits - 1) // 8
    size = next((s for s in _SIZES if first_byte // s == last_byte // s), 8)
    offset = first_byte // size * size
    if last_byte >= offset + size:
        offset = first_byte
    below = first - 8 * offset
    spill = max(0, below + signal.length_bits - 8 * size)
    shift = 8 * size + spill - below - signal.length_bits if signal.big_endian else below
    order = ">" if signal.big_endian else "<"
    direct = np.dtype(f"{order}{_LETTERS[signal.kind]}{size}") if signal.length_bits == 8 * size and not spill else None
    place = (offset, size, shift, signal.length_bits, signal.big_endian, signal.kind, spill, signal.end_byte)
    return BitField(*place, np.dtype(f"{order}u{size}"), direct)


def read_raw(field: BitField, data: NDArray[np.uint8]) -> NDArray[Any]:
    """Read one field of many payloads: the raw values, shape (n,), perhaps a view of `data` in foreign byte order.

    `data` has the bytes of a row side by side, shape (n, width); the width is at least the field's ``end_byte``.
    """
    if field.direct is not None:
        return _container(field, data, field.direct)
    if field.spill:
        bits, width, shift = _across_nine_bytes(field, data), 64, 0
    else:
        bits, width, shift = _container(field, data, field.word), 8 * field.size, field.shift
    if field.kind is RawKind.SIGNED:
        left = width - shift - field.length
        high = np.left_shift(bits, left) if left else bits.astype(bits.dtype.newbyteorder("="))
        return np.asarray(np.right_shift(high.view(f"i{high.dtype.itemsize}"), width - field.length))
    if shift:
        bits = np.right_shift(bits, shift)
    if shift + field.length < width:
        bits = np.bitwise_and(bits, (1 << field.length) - 1)
    if field.kind is RawKind.FLOAT:
        return bits.astype(f"u{field.length // 8}").view(f"f{field.length // 8}")
    return bits.view(np.int64) if bits.dtype == np.uint64 and field.length < 64 else bits  # casts 5x faster


def write_raw(field: BitField, data: NDArray[np.uint8], raw: NDArray[np.uint64]) -> None:
    """Set one field of many payloads; the field's bits must be zero before.

    `data` has the bytes of a row side by side, shape (n, width). `raw` has two's complement or IEEE bits, already cut
    to the field's length, shape (n,).
    """
    view = _container(field, data, field.word)
    if not field.spill:
        view |= np.left_shift(raw, field.shift).astype(view.dtype)
    elif field.big_endian:
        view |= np.right_shift(raw, field.spill)
        data[:, field.offset + 8] |= np.left_shift(raw, 8 - field.spill).astype(np.uint8)
    else:
        view |= np.left_shift(raw, field.shift)
        data[:, field.offset + 8] |= np.right_shift(raw, field.length - field.spill).astype(np.uint8)


def _container(field: BitField, data: NDArray[np.uint8], dtype: np.dtype[Any]) -> NDArray[Any]:
    return data[:, field.offset : field.offset + field.size].view(dtype)[:, 0]


def _across_nine_bytes(field: BitField, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return a 57- to 64-bit field that touches nine bytes, in the low bits (higher ones undefined when signed)."""
    word = _container(field, data, field.word)
    ninth = data[:, field.offset + 8].astype(np.uint64)
    if field.big_endian:
        high, low = np.left_shift(word, field.spill), np.right_shift(ninth, 8 - field.spill)
    else:
        high, low = np.left_shift(ninth, 64 - field.shift), np.right_shift(word, field.shift)
    return np.asarray(np.bitwise_or(high, low))
