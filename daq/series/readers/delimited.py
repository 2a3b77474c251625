"""Delimited text (CSV, TSV) of decoded series -> blocks, through pyarrow."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from daq.arrays import FloatArray
from daq.can.roles import unit_behind
from daq.config import SeriesSection
from daq.errors import DataError, RecordingError
from daq.formatting import numbered
from daq.logs.report import share_of_file
from daq.series.blocks import Blocks, Series, SeriesBlock, SeriesReport
from daq.series.tables import MISSING
from daq.series.time_stamps import TimeStamps, at_rate, is_time_name, is_time_text, time_columns
from daq.units import Quantity, find_unit

HEAD_BYTES = 256 << 10
_PIECE = 4 << 20
_LONGEST_LINE = 1 << 20
_MOST_COLUMNS = 10_000
_SAMPLE_ROWS = 200
_DELIMITERS = "\t;|,"
"""The comma last: it may be in the numbers."""
_NULLS = sorted({*MISSING, *(text.upper() for text in MISSING), "NaN", "null", "NULL", "None", "#N/A", "#NV", "--"})
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
_BOOLEANS = {"true", "false"}
_COLUMN = re.compile(r"column #(\d+)")
_EXACT = 1 << 53

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
    """

    columns: tuple[str, ...]
    units: tuple[str, ...]
    kinds: Mapping[str, Kind]
    delimiter: str
    decimal: str
    data_offset: int
    first_line: int


def read_delimited(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a delimited text file of decoded series.

    Comma, semicolon, tab or bar between the cells, decimal points or commas, lines before the header, a row of units
    under it, quoted cells, several time columns.

    Raises
    ------
    DataError
        No rows, no time column, or more columns than we take.
    RecordingError
        The file cannot be read.
    """
    with _opened(path) as file:
        head = read_head(file.read(HEAD_BYTES), layout, str(path))
    dates = [name for name, kind in head.kinds.items() if kind == "time"]
    units = dict(zip(head.columns, head.units, strict=True))
    times = time_columns(units, dates, layout, str(path))
    report.skipped |= {
        name: "text" for name, kind in head.kinds.items() if kind == "text" and name not in times.values()
    }
    topics = _topics(head, times)

    def read() -> Iterator[Blocks]:
        stamps = {time: TimeStamps(time, units[time], layout, report) for time in dict.fromkeys(times.values())}
        return _blocks(path, head, topics, stamps, layout, report)

    described = {topic: {name: units[name] for name in columns} for topic, (_, columns) in topics.items()}
    return Series(described, read, report)


def read_head(head: bytes, layout: SeriesSection, source: str) -> Head:
    """Find delimiter, decimal sign, header, units and kinds of the columns in the beginning of a file.

    Raises
    ------
    DataError
        It is no table with a header and rows.
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise DataError.of("the file is UTF-16 text", source, expected="UTF-8", next_step="save it as UTF-8")
    whole = head if len(head) < HEAD_BYTES else head[: head.rfind(b"\n") + 1]
    raw = whole.split(b"\n")
    lines = [_text(line).rstrip("\r") for line in raw]
    delimiter = _delimiter(lines, source)
    rows = [_cells(line, delimiter) for line in lines]
    count = _usual_count(rows)
    if count > _MOST_COLUMNS:
        raise DataError.of("too many columns", source, f"{count}", f"at most {_MOST_COLUMNS}", "choose some of them")
    first = next((i for i, row in enumerate(rows) if len(row) == count and _is_data(row)), None)
    if first is None:
        raise DataError.of(
            "no row of numbers", source, f"begins with {lines[0][:80]!r}", "a header and rows of numbers"
        )
    named = [i for i in range(first) if abs(len(rows[i]) - count) <= 1 and len(rows[i]) > 1]
    names, units = _names(rows, named, count)
    sample = [row for row in rows[first : first + _SAMPLE_ROWS] if len(row) == count]
    decimal = layout.decimal or _decimal(sample, delimiter)
    kinds = {name: _kind([row[i] for row in sample], decimal) for i, name in enumerate(names)}
    offset = sum(len(line) + 1 for line in raw[:first])
    kinds |= {n: "time" for n in names if kinds[n] == "text" and (n in layout.times or is_time_name(n))}
    return Head(tuple(names), tuple(units), kinds, delimiter, decimal, offset, first + 1)


def _text(line: bytes) -> str:
    try:
        return line.decode("utf-8-sig")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def _delimiter(lines: Sequence[str], source: str) -> str:
    """Return what stands between the cells of most lines; of several the one in front in `_DELIMITERS`."""
    stated = re.match(r"sep=(.)$", lines[0].strip())
    if stated:
        return stated[1]
    full = [line for line in lines if line.strip()][-_SAMPLE_ROWS:]
    for delimiter in _DELIMITERS:
        counts = [len(_cells(line, delimiter)) for line in full]
        usual = max(set(counts), key=counts.count, default=1)
        if usual > 1 and counts.count(usual) >= 0.5 * len(counts):
            return delimiter
    found = f"begins with {lines[0][:80]!r}"
    raise DataError.of("not a table", source, found, "cells separated by comma, semicolon, tab or bar")


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return line.split(delimiter)


def _usual_count(rows: Sequence[Sequence[str]]) -> int:
    counts = [len(row) for row in rows if len(row) > 1][-_SAMPLE_ROWS:]
    return max(set(counts), key=counts.count)


def _is_data(row: Sequence[str]) -> bool:
    """Return whether a row holds values: a number or a time in it, and no more words than those."""
    values = sum(bool(_NUMBER.match(cell)) or is_time_text(cell) for cell in row)
    words = sum(
        bool(cell) and cell not in _NULLS and not _NUMBER.match(cell) and not is_time_text(cell) for cell in row
    )
    return values > 0 and values >= words


def _names(rows: Sequence[Sequence[str]], named: Sequence[int], count: int) -> tuple[list[str], list[str]]:
    """Return unique names and the units of the columns, from the last lines before the rows."""
    header: Sequence[str] = rows[named[-1]] if named else ()
    units: Sequence[str] = ()
    if len(named) > 1 and _are_units(header):
        header, units = rows[named[-2]], header
    names: list[str] = []
    for i in range(count):
        cell = header[i].strip() if i < len(header) else ""
        if i == 0:
            cell = cell.lstrip("#%").strip()
        names.append(numbered(cell or f"column_{i + 1}", names))
    stated = [units[i].strip("[]() ") if i < len(units) else "" for i in range(count)]
    return names, [one or unit_behind(name) for one, name in zip(stated, names, strict=True)]


def _are_units(cells: Sequence[str]) -> bool:
    found = [find_unit(cell.strip("[]() "), tuple(Quantity)) for cell in cells if cell.strip("[]()- ")]
    return bool(found) and sum(unit is not None for unit in found) >= 0.5 * len(found)


def _decimal(sample: Sequence[Sequence[str]], delimiter: str) -> str:
    if delimiter == ",":
        return "."
    cells = [cell for row in sample for cell in row]
    commas = sum(bool(_DECIMAL_COMMA.match(cell)) for cell in cells)
    points = sum("." in cell and bool(_NUMBER.match(cell)) for cell in cells)
    return "," if commas > points else "."


def _kind(cells: Sequence[str], decimal: str) -> Kind:
    filled = [cell for cell in cells if cell and cell not in _NULLS]
    if not filled:
        return "empty"
    if all(cell.lower() in _BOOLEANS for cell in filled):
        return "boolean"
    if sum(is_time_text(cell) for cell in filled) > 0.5 * len(filled):
        return "time"
    numbers = [cell.replace(decimal, ".") for cell in filled if _NUMBER.match(cell)]
    if len(numbers) < 0.5 * len(filled):
        return "text"
    if len(numbers) == len(cells) and all(cell.lstrip("+-").isdigit() and abs(int(cell)) > _EXACT for cell in numbers):
        return "integer"
    return "number"


def _topics(head: Head, times: Mapping[str, str]) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return for each topic its time column (empty: none) and its columns."""
    own = times or head.columns
    usable = [name for name in head.columns if name in own and head.kinds[name] not in ("text", "time")]
    groups = {time: tuple(n for n in usable if times[n] == time) for time in dict.fromkeys(times.values())}
    if not times:
        return {"table": ("", tuple(usable))}
    if len(groups) == 1:
        return {"table": next(iter(groups.items()))}
    return {time: (time, columns) for time, columns in groups.items() if columns}


def _opened(path: Path) -> BinaryIO:
    import gzip

    try:
        file = path.open("rb")
        if file.peek(2)[:2] == b"\x1f\x8b":
            file.close()
            return gzip.open(path, "rb")  # type: ignore[return-value]
    except OSError as error:
        raise RecordingError.of("the file cannot be read", path, error.strerror or str(error)) from None
    return file


def _pieces(path: Path, offset: int, report: SeriesReport) -> Iterator[bytes]:
    """Yield whole lines, some megabytes at a time."""
    with _opened(path) as file:
        file.read(offset)
        carry = b""
        while True:
            try:
                piece = file.read(_PIECE)
            except (EOFError, OSError) as error:
                report.damage = f"the file cannot be read any further ({error})"
                piece = b""
            if not piece:
                break
            report.share = share_of_file(file)
            end = piece.rfind(b"\n") + 1
            if end:
                yield carry + piece[:end]
                carry = piece[end:]
            else:
                carry += piece
            if len(carry) > _LONGEST_LINE:
                report.note_bad_row("a line", f"longer than {_LONGEST_LINE} bytes")
                carry = b""
        if carry.strip():
            yield carry


def _blocks(
    path: Path,
    head: Head,
    topics: Mapping[str, tuple[str, tuple[str, ...]]],
    stamps: Mapping[str, TimeStamps],
    layout: SeriesSection,
    report: SeriesReport,
) -> Iterator[Blocks]:
    reader = _Reader(head, {*stamps, *(name for _, columns in topics.values() for name in columns)}, report)
    done = 0
    for piece in _pieces(path, head.data_offset, report):
        cells = reader.read(piece)
        count = len(next(iter(cells.values()), ()))
        blocks = []
        for topic, (time, columns) in topics.items():
            numbers = {name: reader.numbers(name, cells[name]) for name in columns}
            if time:
                time_ns, usable = stamps[time].of(reader.times(time, cells[time]))
                if len(topics) > 1:  # a slower table ends before the others, or has rows of its own
                    there = np.any([np.isfinite(one) for one in numbers.values()], axis=0)
                    time_ns, usable = time_ns[there], usable[there]
                    numbers = {name: one[there] for name, one in numbers.items()}
            else:
                time_ns, usable = at_rate(count, done, layout.rate_hz or 1.0), np.ones(count, np.bool_)
            blocks.append(report.taken(SeriesBlock(topic, time_ns, numbers), usable))
        done += count
        yield tuple(blocks)
    if not any(report.rows.values()):
        raise DataError.of("no row could be read", path, "; ".join(report.remarks()), "rows under the header")


class _Reader:
    """Parses pieces of the file; a column with a cell that is no number is read as text from there on."""

    def __init__(self, head: Head, wanted: set[str], report: SeriesReport) -> None:
        import pyarrow as pa

        kinds = {"number": pa.float64(), "empty": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_()}
        self._head, self._report = head, report
        self._wanted = [name for name in head.columns if name in wanted]
        self._types = {name: kinds.get(head.kinds[name], pa.string()) for name in self._wanted}
        self._line = head.first_line

    def read(self, piece: bytes) -> dict[str, NDArray[Any]]:
        """Return the cells of each wanted column: numbers, or texts where it holds others."""
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        piece = _as_utf8(piece)
        bad: list[Any] = []

        def invalid(row: Any) -> str:
            bad.append(row)
            return "skip"

        parse = arrow_csv.ParseOptions(delimiter=self._head.delimiter, invalid_row_handler=invalid)
        options = arrow_csv.ReadOptions(column_names=self._head.columns, use_threads=False, block_size=len(piece) + 1)
        while True:
            bad.clear()
            convert = arrow_csv.ConvertOptions(
                column_types=self._types,
                include_columns=self._wanted,
                null_values=_NULLS,
                strings_can_be_null=True,
                decimal_point=self._head.decimal,
                check_utf8=False,
            )
            try:
                table = arrow_csv.read_csv(io.BytesIO(piece), options, parse, convert)
                break
            except pa.ArrowInvalid as error:
                place = _COLUMN.search(str(error))
                column = self._head.columns[int(place[1])] if place else ""
                if column not in self._types or self._types[column] == pa.string():
                    self._report.note_bad_row(f"lines from {self._line}", str(error)[:120], piece.count(b"\n") or 1)
                    table = pa.table({name: pa.array([], kind) for name, kind in self._types.items()})
                    break
                self._types[column] = pa.string()
        for row in bad:
            shown = (row.text or "")[:60]
            why = f"{row.actual_columns} cells in a table of {row.expected_columns} columns: {shown!r}"
            self._report.note_bad_row(f"line {self._line + row.number - 1}" if row.number else "a line", why)
        self._line += piece.count(b"\n")
        return {name: _as_numpy(table.column(name)) for name in self._wanted}

    def times(self, name: str, cells: NDArray[Any]) -> NDArray[Any]:
        """Return the cells of a time column: numbers, or texts where it holds dates."""
        return cells if self._head.kinds[name] == "time" or cells.dtype.kind != "O" else self.numbers(name, cells)

    def numbers(self, name: str, cells: NDArray[Any]) -> FloatArray:
        """Return cells as numbers; what is none is NaN, and counted."""
        if cells.dtype.kind != "O":
            return cells.astype(np.float64, copy=False)
        import pandas as pd

        texts = pd.Series(cells)
        if self._head.decimal != ".":
            texts = texts.str.replace(self._head.decimal, ".", regex=False)
        values: FloatArray = pd.to_numeric(texts.str.strip(), errors="coerce").to_numpy(np.float64)
        self._report.note_bad_cells(name, int(np.count_nonzero(np.isnan(values) & texts.notna().to_numpy())))
        return values


def _as_utf8(piece: bytes) -> bytes:
    try:
        if not piece.isascii():
            piece.decode()
    except UnicodeDecodeError:
        return piece.decode("cp1252", "replace").encode()
    return piece


def _as_numpy(column: Any) -> NDArray[Any]:
    import pyarrow as pa

    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8()).cast(pa.float64())
    values: NDArray[Any] = column.to_numpy()
    return values
