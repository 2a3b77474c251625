"""Where a signal's bits lie, and how a whole column of them is read and written.

A field is read through the smallest aligned container (1, 2, 4 or 8 bytes) that holds it: then a byte or word
that fills its container is a strided view and costs one pass. What lies across two 8-byte words (CAN FD only)
is read through an unaligned word and, when it touches nine bytes, the ninth byte beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.layout import RawKind, Signal

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
    big_endian : bool
    kind : RawKind
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
    """Read one field of many payloads.

    Parameters
    ----------
    field : BitField
    data : uint8 array, shape (n, width), bytes of a row side by side
        ``width`` must be at least the field's ``end_byte``.

    Returns
    -------
    integer or float array, shape (n,)
        Raw values; may be a view of `data` in foreign byte order.
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

    Parameters
    ----------
    field : BitField
    data : uint8 array, shape (n, width), bytes of a row side by side
    raw : uint64 array, shape (n,)
        Two's complement or IEEE bits, already cut to the field's length.
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
