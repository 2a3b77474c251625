"""The beginning of a delimited text file: sign between the cells, header, units, decimal sign, kinds of the columns."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Literal

from daq import ConfigError, DataError, Quantity, SeriesSection, find_unit
from daq.can.roles import unit_behind
from daq.formatting import numbered
from daq.series.numerals import COMMA, POINT, Evidence
from daq.series.tables import MISSING
from daq.series.time_stamps import is_time_name, is_time_text

HEAD_BYTES = 256 << 10
_MOST_COLUMNS = 10_000
_SAMPLE_ROWS = 200
_USUAL_SHARE = 0.2
_DELIMITERS = "\t;|,"
"""The comma last: it may be in the numbers."""
NULLS = frozenset({*MISSING, *map(str.upper, MISSING), "NaN", "null", "NULL", "None", "#N/A", "#NV", "--"})
_NUMBER = re.compile(r"[+-]?(\d{1,3}([.,'\u2019 \u00a0\u202f]\d{3})+([.,]\d*)?|\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
_BOOLEANS = {"true", "false"}
_HALVES = re.compile(r"[+-]?\d+,\d+(?:,[+-]?\d+,\d+)*$")
_EXACT = 1 << 53

_Rows = Callable[[int], list[str]]
Kind = Literal["number", "integer", "boolean", "time", "text", "empty"]


@dataclass(frozen=True)
class Head:
    """What the beginning of a delimited file says of its layout.

    Attributes
    ----------
    columns, units : tuple of str
        Names as the file has them, made unique; units from the brackets behind a name or from a row of their own.
    kinds : mapping column -> what its first cells hold
    data_offset : int
        Bytes before the first row.
    first_line : int
        Number of the line of the first row.
    lost : mapping int -> str
        Lines above it that hold data, by their number.
    decimals : mapping sign -> columns
        Columns whose first cells have that decimal sign, and could have no other.
    rejoined : bool
        Whether a decimal comma makes two cells of each number.
    """

    columns: tuple[str, ...]
    units: tuple[str, ...]
    kinds: Mapping[str, Kind]
    delimiter: str
    decimal: str
    data_offset: int
    first_line: int
    lost: Mapping[int, str]
    decimals: Mapping[str, frozenset[str]]
    rejoined: bool = False


def read_head(head: bytes, layout: SeriesSection, source: str) -> Head:
    """Find delimiter, decimal sign, header, units and kinds of the columns in the beginning of a file.

    `DataError` where it is no table with a header and rows.
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise DataError.of("the file is UTF-16 text", source, expected="UTF-8", next_step="save it as UTF-8")
    raw = (head if len(head) < HEAD_BYTES else head[: head.rfind(b"\n") + 1]).split(b"\n")
    delimiter = _delimiter(raw, source)
    widths = _widths(raw, delimiter)
    rows = cache(lambda i: cells_of(_shown(raw[i]), delimiter))  # of most lines only the number of cells counts
    count = _usual_count(rows, widths, layout)
    if count > _MOST_COLUMNS:
        raise DataError.of("too many columns", source, f"{count}", f"at most {_MOST_COLUMNS}", "choose some of them")
    first = next((i for i, width in enumerate(widths) if width == count and _is_data(rows(i))), None)
    if first is None:
        raise DataError.of(
            "no row of numbers", source, f"begins with {_shown(raw[0], 80)!r}", "a header and rows of numbers"
        )
    named = [i for i in range(first) if abs(widths[i] - count) <= 1 and widths[i] > 1]
    sample = [rows(i) for i, width in enumerate(widths[: first + _SAMPLE_ROWS]) if i >= first and width == count]
    halves = [i for i in range(first) if delimiter == "," and count == 2 * widths[i] > 2]
    rejoined = bool(halves) and all(map(_HALVES.match, map(",".join, sample)))
    if rejoined:
        sample = [
            [f"{integer}.{fraction}" for integer, fraction in zip(row[::2], row[1::2], strict=True)] for row in sample
        ]
        named, count, delimiter = halves, count // 2, ";"
    header, unit_row = _header_rows(rows, named, layout)
    names, units = _names(rows(header) if named else (), rows(unit_row) if unit_row is not None else (), count)
    if named and widths[header] < count and sum(bool(row[-1]) for row in sample) > 0.5 * len(sample):
        found = f"{widths[header]} names, {count} cells: {_shown(raw[first], 80)!r}"
        step = "name every column in the header, or export with another sign between the cells"
        raise ConfigError.of("the rows have more cells than the header has names", source, found, next_step=step)
    lost = {
        i + 1: _shown(raw[i], 60)
        for i in range(first)
        if _is_lost(rows(i), i > header if named else True, i in (header, unit_row))
    }
    decimals = {
        sign: frozenset(n for i, n in enumerate(names) if _is_decimal(sign, sample, i)) for sign in (POINT, COMMA)
    }
    decimal = layout.decimal or _decimal(decimals, sample, delimiter)
    kinds = {name: _kind([row[i] for row in sample], decimal) for i, name in enumerate(names)}
    offset = sum(len(line) + 1 for line in raw[:first])
    kinds |= {n: "time" for n in names if kinds[n] == "text" and (n in layout.times or is_time_name(n))}
    return Head(tuple(names), tuple(units), kinds, delimiter, decimal, offset, first + 1, lost, decimals, rejoined)


def text_of(line: bytes) -> str:
    """Return a line as text, which may be UTF-8 or Windows's."""
    try:
        return line.decode("utf-8-sig")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def _shown(line: bytes, most: int | None = None) -> str:
    return text_of(line).rstrip("\r")[:most]


def _widths(lines: Sequence[bytes], delimiter: str) -> list[int]:
    """Return the number of cells of each line."""
    sign = delimiter.encode()
    return [len(cells_of(_shown(line), delimiter)) if b'"' in line else line.count(sign) + 1 for line in lines]


def _delimiter(lines: Sequence[bytes], source: str) -> str:
    """Return what stands between the cells of most lines; of several the one in front in `_DELIMITERS`."""
    stated = re.match(r"sep=(.)$", text_of(lines[0]).strip())
    if stated:
        return stated[1]
    full = [*islice(filter(bytes.strip, reversed(lines)), _SAMPLE_ROWS)][::-1]
    for delimiter in _DELIMITERS:
        counts = _widths(full, delimiter)
        usual = max(set(counts), key=counts.count, default=1)
        if usual > 1 and counts.count(usual) >= 0.5 * len(counts):
            return delimiter
    raise DataError.of(
        "not a table",
        source,
        f"begins with {_shown(lines[0], 80)!r}",
        "cells separated by comma, semicolon, tab or bar",
    )


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return line.split(delimiter)


def _usual_count(rows: _Rows, widths: Sequence[int], layout: SeriesSection) -> int:
    """Return the number of cells of most rows, or that of the header where many rows have as many."""
    counts = Counter(width for width in widths if width > 1)
    first = next((i for i, width in enumerate(widths) if width > 1 and _is_data(rows(i))), 0)
    named = [i for i in range(first) if counts[widths[i]] > _USUAL_SHARE * counts.total()]
    return widths[_header_rows(rows, named, layout)[0]] if named else counts.most_common(1)[0][0]


def _is_data(row: Sequence[str]) -> bool:
    """Return whether a row holds values: a number or a time in it, and no more words than those."""
    values = sum(bool(_NUMBER.match(cell)) or is_time_text(cell) for cell in row)
    words = sum(bool(cell) and cell not in NULLS and not _NUMBER.match(cell) and not is_time_text(cell) for cell in row)
    return values > 0 and values >= words


def _header_rows(rows: _Rows, named: Sequence[int], layout: SeriesSection) -> tuple[int, int | None]:
    """Return which of the lines above the rows has the names, and which the units: of equally good ones the last."""
    of_units = [i for i in named if _are_units(rows(i))]
    possible = [i for i in named if i not in of_units] or list(named)
    if not possible:
        return 0, None

    def merit(i: int) -> tuple[bool, bool, bool, int]:
        cells = [cell.lstrip("#% ") for cell in rows(i) if cell]
        times = any(cell in layout.times or is_time_name(cell) for cell in cells)
        return times, not any(_NUMBER.match(cell) for cell in cells), len(set(cells)) > 1, i

    header = max(possible, key=merit)
    return header, next((i for i in reversed(of_units) if i != header), None)


def _is_lost(row: Sequence[str], under_header: bool, is_header: bool) -> bool:
    """Return whether a line above the first row held data: any under the header, values above it."""
    return not is_header and any(row) and (under_header or (len(row) > 1 and _is_data(row)))


def _names(header: Sequence[str], units: Sequence[str], count: int) -> tuple[list[str], list[str]]:
    """Return unique names and the units of the columns."""
    names: list[str] = []
    for i in range(count):
        cell = header[i].strip() if i < len(header) else ""
        if i == 0:
            cell = cell.lstrip("#%").strip()
        names.append(numbered(cell or f"column_{i + 1}", names))
    stated = [units[i].strip("[]() ") if i < len(units) else "" for i in range(count)]
    return names, [unit or unit_behind(name) for unit, name in zip(stated, names, strict=True)]


def _are_units(cells: Sequence[str]) -> bool:
    found = [find_unit(cell.strip("[]() "), tuple(Quantity)) for cell in cells if cell.strip("[]()- ")]
    return bool(found) and sum(unit is not None for unit in found) >= 0.5 * len(found)


def _is_decimal(sign: str, sample: Sequence[Sequence[str]], column: int) -> bool:
    evidence = Evidence()
    evidence.take({row[column] for row in sample if sign in row[column]}, sign)
    return bool(evidence.decimal) and not evidence.thousands


def _decimal(decimals: Mapping[str, frozenset[str]], sample: Sequence[Sequence[str]], delimiter: str) -> str:
    """Return the decimal sign of most columns, and where no column decides that of most cells."""
    if len(decimals[POINT]) != len(decimals[COMMA]) or delimiter == ",":
        return COMMA if len(decimals[COMMA]) > len(decimals[POINT]) else POINT
    cells = [cell for row in sample for cell in row]
    commas = sum(bool(_DECIMAL_COMMA.match(cell)) for cell in cells)
    points = sum("." in cell and bool(_NUMBER.match(cell)) for cell in cells)
    return COMMA if commas > points else POINT


def _kind(cells: Sequence[str], decimal: str) -> Kind:
    filled = [cell for cell in cells if cell and cell not in NULLS]
    if not filled:
        return "empty"
    if all(cell.lower() in _BOOLEANS for cell in filled):
        return "boolean"
    numbers = [cell.replace(decimal, ".") for cell in filled if _NUMBER.match(cell)]
    if len(numbers) < 0.5 * len(filled):  # a number is no time
        return "time" if sum(map(is_time_text, filled)) > 0.5 * len(filled) else "text"
    if len(numbers) == len(cells) and all(cell.lstrip("+-").isdigit() and abs(int(cell)) > _EXACT for cell in numbers):
        return "integer"
    return "number"
