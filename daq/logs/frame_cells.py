"""Cells of a table of frames by columns: what is written as usual, many rows at once; None where a cell is not."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.arrays import BoolArray, IntArray

Bytes = NDArray[np.uint8]
_NONE = 255
"""In a table of digits: this is none."""
_BASE64 = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"


class Data(NamedTuple):
    """Bytes of frames: shape (rows, room), zero behind the length of each row."""

    values: Bytes
    lengths: IntArray

    def up_to(self, lengths: IntArray) -> Data:
        """Return at most so many bytes of each row."""
        kept = np.minimum(self.lengths, lengths)
        return Data(np.where(np.arange(self.values.shape[1]) < kept[:, None], self.values, np.uint8(0)), kept)


def columns_of_text(block: bytes, delimiter: str, places: Sequence[int]) -> dict[int, Any] | None:
    """Return some columns of whole lines as arrays of text; None where a line is longer, shorter, quoted or empty."""
    import pyarrow as pa
    from pyarrow import csv

    if b'"' in block:
        return None
    names = [str(place) for place in range(block.partition(b"\n")[0].count(delimiter.encode()) + 1)]
    chosen = [str(place) for place in dict.fromkeys(places)]
    if not set(chosen) <= set(names):
        return None
    try:
        table = csv.read_csv(
            pa.BufferReader(block),
            csv.ReadOptions(use_threads=False, block_size=len(block) + 1, column_names=names),
            csv.ParseOptions(delimiter=delimiter, quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                column_types=dict.fromkeys(chosen, pa.string()), include_columns=chosen, strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid:
        return None
    if table.num_rows != block.count(b"\n"):
        return None
    return {int(name): table[name].combine_chunks() for name in chosen}


def different_rows(columns: Sequence[Any]) -> tuple[IntArray, IntArray] | None:
    """Return the first row of each kind of rows, in order, and the kind of each row; None for very many kinds."""
    codes, most = np.zeros(len(columns[0]), np.int64), 1
    for column in columns:
        encoded = column.dictionary_encode()
        most *= max(len(encoded.dictionary), 1)
        if most > 1 << 62:
            return None
        codes = codes * len(encoded.dictionary) + encoded.indices.to_numpy()
    _, first, kind = np.unique(codes, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return first[order], place[kind.reshape(-1)]


def bytes_of_text(column: Any, form: str, rows: BoolArray, room: int) -> Data | None:
    """Return the bytes that cells hold, as hex digits (0x may stand before them) or in base64; other rows are empty."""
    found = Data(np.zeros((len(column), room), np.uint8), np.zeros(len(column), np.int64))
    _, offsets, text = column.buffers()
    if text is None:
        return found
    ends = np.frombuffer(offsets, np.int32)[column.offset : column.offset + len(column) + 1].astype(np.int64)
    digits, starts, sizes = np.frombuffer(text, np.uint8), ends[:-1].copy(), np.diff(ends)
    if form == "hex":
        prefixed = rows & (sizes >= 2)
        prefixed[prefixed] = (digits[starts[prefixed]] == ord("0")) & (digits[starts[prefixed] + 1] == ord("x"))
        starts[prefixed] += 2
        sizes[prefixed] -= 2
    decode = _hex if form == "hex" else _base64
    for size in np.unique(sizes[rows]).tolist():
        own = np.flatnonzero(rows & (sizes == size))
        part = decode(digits[starts[own, None] + np.arange(size)])
        if part is None or part.lengths.max(initial=0) > room:
            return None
        width = min(part.values.shape[1], room)
        found.values[own, :width], found.lengths[own] = part.values[:, :width], part.lengths
    return found


def bytes_of_cells(columns: Sequence[Any], base: int, rows: BoolArray, lengths: IntArray, room: int) -> Data | None:
    """Return the bytes of which each has a column; as many count as `lengths` says, all where that is negative."""
    found = Data(np.zeros((len(rows), room), np.uint8), np.zeros(len(rows), np.int64))
    going_on = rows.copy()
    for place, column in enumerate(columns):
        encoded = column.dictionary_encode()
        known = [_byte(cell, base) for cell in encoded.dictionary.to_pylist()]
        if None in known:
            return None
        values = np.array(known, np.int64)[encoded.indices.to_numpy()]
        if ((values >= 0) & rows & ~going_on).any():
            return None  # a cell is empty and one behind it is not
        going_on &= values >= 0
        counted = going_on & ((lengths < 0) | (place < lengths))
        if counted.any():
            if place >= room:
                return None
            found.values[counted, place] = values[counted]
            found.lengths[counted] += 1
    return found


def _byte(cell: str, base: int) -> int | None:
    """Return the value of a cell, -1 of an empty one; None where it is no byte."""
    try:
        value = int(cell, base) if cell.strip() else -1
    except ValueError:
        return None
    return value if value < 256 and (value >= 0 or not cell.strip()) else None


def _hex(digits: Bytes) -> Data | None:
    values = _values_of(b"0123456789abcdef")[digits | np.uint8(0x20) * (digits > ord("9"))]
    if digits.shape[1] % 2 or (values == _NONE).any():
        return None
    return Data(values[:, ::2] << 4 | values[:, 1::2], np.full(len(digits), digits.shape[1] // 2))


def _base64(digits: Bytes) -> Data | None:
    rows, width = digits.shape
    if width % 4:
        return None
    padding = np.logical_and.accumulate(digits[:, -1:-3:-1] == ord("="), axis=1).sum(axis=1)
    values = _values_of(_BASE64)[digits]
    last = np.arange(width) >= width - padding[:, None]
    if ((values == _NONE) & ~last).any():
        return None
    values[last] = 0
    four = values.reshape(rows, -1, 4)
    a, b, c, d = four[..., 0], four[..., 1], four[..., 2], four[..., 3]
    found = np.stack([a << 2 | b >> 4, b << 4 | c >> 2, c << 6 | d], axis=-1).reshape(rows, -1)
    lengths = width // 4 * 3 - padding
    found[np.arange(found.shape[1]) >= lengths[:, None]] = 0
    return Data(found, lengths)


@cache
def _values_of(alphabet: bytes) -> Bytes:
    """Return the value of each character."""
    values = np.full(256, _NONE, np.uint8)
    values[np.frombuffer(alphabet, np.uint8)] = np.arange(len(alphabet))
    return values
