"""Delimited text (CSV, TSV) of decoded series -> blocks, through pyarrow."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import DataError, FloatArray, IntArray, RecordingError, SeriesSection
from daq.gunzip import Gunzip, unpacked
from daq.logs.report import share_of_file
from daq.series.blocks import EMPTY, Blocks, Series, SeriesBlock, SeriesReport
from daq.series.numerals import COMMA, MOST_UNSEPARATED, POINT, Evidence, numbers_of, parts_thousands
from daq.series.readers.table_head import HEAD_BYTES, NULLS, Head, cells_of, read_head, text_of
from daq.series.time_stamps import TimeStamps, at_rate, time_columns

_Bytes = bytes | bytearray
_PIECE = 4 << 20
_LONGEST_LINE = 1 << 20
_PART = 1 << 18
_VALUE = re.compile(r"\d")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\n|\r|$)")
_EMPTY_LINE = re.compile(rb"(?:(?<=\n)|(?<=\r)(?!\n)|\A)(?:\r\n|\n|\r)")
_PAIR = re.compile(rb"([+-]?\d+),(\d+)")
_IN_NUMBERS = b"0123456789.,;+-eEnNaAiIfF \t\r\n"
_LINE_FEED = ord("\n")
_OTHER_HEADER = "behind another header"
_NULLS_OF_NUMBERS = frozenset({""})  # with more of them numbers are slower to read, with a "-" negative ones
_COLUMN = re.compile(r"column #(\d+)")


def read_delimited(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a delimited text file of decoded series.

    Comma, semicolon, tab or bar between the cells, decimal points or commas, lines before the header, a row of units
    under it, quoted cells, several time columns. `DataError` without rows or a time column, or with more columns than
    we take; `RecordingError` where the file cannot be read.
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
        if head.rejoined:
            report.note_reading("commas read as decimal ones, because each line has two cells for each name")
        stamps = {time: TimeStamps(time, units[time], layout, report) for time in dict.fromkeys(times.values())}
        return _blocks(path, head, topics, stamps, layout, report)

    described = {topic: {name: units[name] for name in columns} for topic, (_, columns) in topics.items()}
    return Series(described, read, report)


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


def _opened(path: Path) -> io.BufferedReader:
    try:
        return unpacked(path, HEAD_BYTES)
    except OSError as error:
        raise RecordingError.of("the file cannot be read", path, error.strerror or str(error)) from None


def _pieces(path: Path, offset: int, report: SeriesReport) -> Iterator[_Bytes]:
    """Yield whole lines, some megabytes at a time."""
    with _opened(path) as file:
        file.read(offset)
        carry = b""
        while True:
            piece = bytearray(len(carry) + _PIECE)
            piece[: len(carry)] = carry
            try:
                count = file.readinto(memoryview(piece)[len(carry) :])
            except (EOFError, OSError) as error:
                report.damage = f"the file cannot be read any further ({error})"
                count = 0
            if not count:
                break
            report.share = share_of_file(file)
            end = piece.rfind(b"\n", 0, len(carry) + count) + 1
            carry = bytes(memoryview(piece)[end : len(carry) + count])
            if end:
                del piece[end:]
                yield piece
            del piece  # the next one lies where it was
            if len(carry) > _LONGEST_LINE:
                report.balance.come("rows", 1)
                report.note_bad_row("a line", f"longer than {_LONGEST_LINE} bytes")
                carry = b""
        if isinstance(file.raw, Gunzip) and file.raw.damage:
            report.damage = file.raw.damage
            if carry:  # nobody knows how many digits its last number has lost
                report.balance.come("rows", 1)
                report.balance.lose("that the file ends within")
        elif carry:
            yield carry


def _blocks(
    path: Path,
    head: Head,
    topics: Mapping[str, tuple[str, tuple[str, ...]]],
    stamps: Mapping[str, TimeStamps],
    layout: SeriesSection,
    report: SeriesReport,
) -> Iterator[Blocks]:
    wanted = {*stamps, *(name for _, columns in topics.values() for name in columns)}
    reader = _Reader(path, head, wanted, layout, report)
    done = 0
    report.balance.come("rows", head.first_line - 1)
    for line, text in head.lost.items():
        report.note_bad_row(f"line {line}", repr(text))
    report.balance.put_aside("lines above the rows", head.first_line - 1 - len(head.lost))
    for cells in map(reader.read, _pieces(path, head.data_offset, report)):
        count = len(next(iter(cells.values()), ()))
        report.balance.come("rows", (len(topics) - 1) * count)
        blocks = []
        for topic, (time, columns) in topics.items():
            numbers = {name: reader.numbers(name, cells[name]) for name in columns}
            if time:
                time_ns, usable = stamps[time].of(reader.times(time, cells[time]))
                if len(topics) > 1:  # a slower table ends before the others, or has rows of its own
                    there = np.any([np.isfinite(column) for column in numbers.values()], axis=0)
                    report.balance.put_aside(EMPTY, int(np.count_nonzero(~there)))
                    time_ns, usable = time_ns[there], usable[there]
                    numbers = {name: column[there] for name, column in numbers.items()}
            else:
                time_ns, usable = at_rate(count, done, layout.rate_hz or 1.0), np.ones(count, np.bool_)
            blocks.append(report.taken(SeriesBlock(topic, time_ns, numbers), usable))
        done += count
        yield tuple(blocks)
    if not any(report.rows.values()):
        raise DataError.of(
            "no row could be read",
            path,
            "; ".join(report.remarks()),
            "rows under the header",
            "check separator, decimal sign and header under [series]",
        )


class _Reader:
    """Parses pieces of the file; a column with a cell that is no number is read as text from there on."""

    def __init__(self, path: Path, head: Head, wanted: set[str], layout: SeriesSection, report: SeriesReport) -> None:
        import pyarrow as pa

        kinds = {"number": pa.float64(), "empty": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_()}
        self._path, self._head, self._layout, self._report = path, head, layout, report
        self._order = head.columns
        self._wanted = [name for name in head.columns if name in wanted]
        self._nulls, self._text = _NULLS_OF_NUMBERS, pa.string()
        self._types = {name: kinds.get(head.kinds[name], self._text) for name in self._wanted}
        self._numeric = [name for name in self._wanted if head.kinds[name] in ("number", "empty", "integer")]
        if layout.thousands:
            self._types |= dict.fromkeys(self._numeric, self._text)
        self._signs: dict[str, tuple[str, str]] = {}
        self._whole = set() if layout.decimal or layout.thousands else set(self._numeric)
        self._mark = max(head.columns, key=len).encode()
        self._rare = next((bytes([byte]) for byte in self._mark if byte not in _IN_NUMBERS), b"")
        self._line = head.first_line
        self._ended = False
        self._lines: list[Callable[[], IntArray]] = []
        """Of the rows that were read last."""

    def read(self, piece: _Bytes) -> dict[str, NDArray[Any]]:
        """Return the cells of each wanted column: numbers, or texts where it holds others."""
        import pyarrow as pa

        piece = _as_utf8(piece)
        self._lines = []
        tables = [self._table(part) for part in self._between_headers(piece)]
        if len(tables) > 1:  # some columns fell to text on the way
            tables = [pa.concat_tables([table.cast(pa.schema(self._types)) for table in tables])]
        return {name: _as_numpy(tables[0].column(name)) for name in self._wanted}

    def _between_headers(self, piece: _Bytes) -> Iterator[_Bytes]:
        """Part a piece at lines that repeat the header, and take the columns in the order that each of them has."""
        if self._rare in piece and self._mark in piece:  # one byte is looked for much faster
            start = 0
            for line in [match for match in _LINE.finditer(piece) if self._mark in match[0]]:
                cells = cells_of(text_of(line[0]).strip(), self._head.delimiter)
                if sorted(cells) == sorted(self._head.columns):
                    yield piece[start : line.start()]
                    self._report.balance.come("rows", 1)
                    self._report.balance.put_aside("headers among the rows", 1)
                    if tuple(cells) != self._order:
                        self._order = tuple(cells)
                        self._report.note_reading(
                            f"columns in another order from line {self._line} on: a header is there"
                        )
                    self._line += 1
                    start = line.end()
            piece = piece[start:]
        yield piece

    def _table(self, piece: _Bytes) -> Any:
        """Return the rows of whole lines, every line accounted for."""
        import pyarrow as pa

        if not piece:
            return pa.table({name: pa.array([], kind) for name, kind in self._types.items()})
        count = _lines_in(piece)
        self._report.balance.come("rows", count)
        if self._ended:
            self._report.balance.lose(_OTHER_HEADER, count)
            return pa.table({name: pa.array([], kind) for name, kind in self._types.items()})
        table, bad = self._parsed(_rejoined(piece, len(self._head.columns)) if self._head.rejoined else piece)
        empty = 0
        if table.num_rows + len(bad) < count:
            empty = len(_EMPTY_LINE.findall(piece))
        if table.num_rows + len(bad) + empty < count and b'"' in piece:  # a quotation mark swallows lines
            lines = _LINE.findall(piece)
            unclosed = [line for line in lines if line.count(b'"') % 2]
            shown = unclosed[0][:60].decode("utf-8", "replace") if unclosed else ""
            self._report.note_bad_row("a line", f"a quotation mark without its second: {shown!r}", len(unclosed))
            table, bad = self._parsed(b"".join(line for line in lines if not line.count(b'"') % 2))
        self._report.balance.put_aside(EMPTY, empty)
        for row in bad:
            shown = (row.text or "")[:60]
            why = f"{row.actual_columns} cells in a table of {row.expected_columns} columns: {shown!r}"
            self._report.note_bad_row(f"line {self._line + row.number - 1}" if row.number else "a line", why)
        self._line += count
        table = self._above_another_header(table)
        self._lines.append(
            partial(_row_lines, piece if empty else b"", self._line - count, count, bad, empty, table.num_rows)
        )
        return table

    def _parsed(self, piece: _Bytes) -> tuple[Any, list[Any]]:
        """Return the rows and what is none; a column with a cell that is no number becomes one of text."""
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        bad: list[Any] = []

        def invalid(row: Any) -> str:
            bad.append(row)
            return "skip"

        parse = arrow_csv.ParseOptions(delimiter=self._head.delimiter, invalid_row_handler=invalid)
        options = arrow_csv.ReadOptions(column_names=self._order, use_threads=False, block_size=len(piece) + 1)
        while True:
            bad.clear()
            convert = arrow_csv.ConvertOptions(
                column_types=self._types,
                include_columns=self._wanted,
                null_values=NULLS if self._text in self._types.values() else self._nulls,
                strings_can_be_null=True,
                decimal_point=self._head.decimal,
                check_utf8=False,
            )
            try:
                table = arrow_csv.read_csv(pa.BufferReader(piece), options, parse, convert)
            except pa.ArrowInvalid as error:
                if self._nulls != NULLS:
                    self._nulls = NULLS
                    continue
                place = _COLUMN.search(str(error))
                column = self._order[int(place[1])] if place else ""
                if column not in self._types or self._types[column] == self._text:
                    lines = _lines_in(piece) - len(_EMPTY_LINE.findall(piece))
                    self._report.note_bad_row(f"lines from {self._line}", str(error)[:120], lines)
                    bad.clear()
                    return pa.table({name: pa.array([], kind) for name, kind in self._types.items()}), bad
                self._types[column] = self._text
            else:
                parted = [name for name in self._whole if self._parts_thousands(name, table.column(name))]
                if not parted:
                    return table, bad
                self._types |= dict.fromkeys(parted, self._text)

    def _parts_thousands(self, name: str, column: Any) -> bool:
        """Return whether the decimal sign parts thousands in a column of whole numbers below 1000 so far."""
        if self._types[name] == self._text:
            return False
        values = _as_numpy(column)
        values = values[np.isfinite(values)]
        fractions = values[values != np.floor(values)]
        if not len(fractions) and (not len(values) or np.abs(values).max() < MOST_UNSEPARATED):
            return False
        self._whole = self._whole - {name}
        thousandths = fractions * 1000.0
        possible = len(fractions) and np.abs(fractions).min() > 1.0 and np.abs(values).max() < MOST_UNSEPARATED
        if not possible or np.abs(thousandths - np.rint(thousandths)).max() > 1e-6:
            return False
        return bool(self._signs_of(name)[1])

    def _signs_of(self, name: str) -> tuple[str, str]:
        """Return decimal sign and thousands sign of a column, by all its cells; empty where there is none."""
        if name not in self._signs:
            self._signs[name] = self._decided(name)
        return self._signs[name]

    def _decided(self, name: str) -> tuple[str, str]:
        layout, where = self._layout, str(self._path)
        usual = layout.decimal or self._head.decimal
        if layout.thousands:
            return layout.decimal or (COMMA if layout.thousands == POINT else POINT), layout.thousands
        found = {sign: Evidence() for sign in (POINT, COMMA)}
        for cells in self._cells_of(name):
            for sign, evidence in found.items():
                evidence.take(cells, sign)
        other = COMMA if usual == POINT else POINT
        elsewhere = usual if layout.decimal or self._head.decimals[usual] - {name} or found[usual].decimal else ""
        if found[other].decimal:
            if not found[usual].decimal and not found[other].thousands and not layout.decimal:
                self._report.note_reading(f"{name!r} has decimal {_called(other)}s, because of {found[other].decimal}")
                return other, ""
            return usual, ""
        parting = other if found[other].thousands or found[other].either else usual
        if layout.decimal and parting == usual:
            return usual, ""
        if parting == usual:
            elsewhere = next((sign for sign in (usual, other) if self._head.decimals[sign] - {name}), "")
        reason = parts_thousands(found[parting], parting, name, where, elsewhere)
        decimal = COMMA if parting == POINT else POINT
        if not reason:
            return parting, ""
        self._report.note_reading(f"the {_called(parting)}s of {name!r} read as parting thousands, because {reason}")
        return decimal, parting

    def _cells_of(self, name: str) -> Iterator[list[str]]:
        """Yield the different cells of a column, piece by piece."""
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        parse = arrow_csv.ParseOptions(delimiter=self._head.delimiter, invalid_row_handler=lambda _: "skip")
        convert = arrow_csv.ConvertOptions(column_types={name: pa.string()}, include_columns=[name], check_utf8=False)
        aside = SeriesReport(str(self._path), "")
        for piece in _pieces(self._path, self._head.data_offset, aside):
            piece = _as_utf8(_rejoined(piece, len(self._head.columns)) if self._head.rejoined else piece)
            options = arrow_csv.ReadOptions(column_names=self._order, use_threads=False, block_size=len(piece) + 1)
            try:
                column = arrow_csv.read_csv(pa.BufferReader(piece), options, parse, convert).column(name)
            except pa.ArrowInvalid:
                continue
            yield [cell.strip() for cell in column.unique().to_pylist() if cell]

    def _above_another_header(self, table: Any) -> Any:
        """Return the rows above one that looks like another header: nobody knows what the columns behind it are."""
        names = [name for name in self._numeric if self._types[name] == self._text]
        if len(names) < max(len(self._numeric), 2) or not table.num_rows:
            return table
        texts = [table.column(name).to_pylist() for name in names]
        for i, cells in enumerate(zip(*texts, strict=True)):
            words = {cell for cell in cells if cell and not _VALUE.search(cell)}
            if len(words) == len(cells):
                self._ended = True
                self._report.damage = (
                    f"a row of words is among the numbers, perhaps another header: {', '.join(cells[:4])}"
                )
                self._report.balance.lose(_OTHER_HEADER, table.num_rows - i)
                return table.slice(0, i)
        return table

    def times(self, name: str, cells: NDArray[Any]) -> NDArray[Any]:
        """Return the cells of a time column: numbers, or texts where it holds dates."""
        return cells if self._head.kinds[name] == "time" or cells.dtype.kind != "O" else self.numbers(name, cells)

    def numbers(self, name: str, cells: NDArray[Any]) -> FloatArray:
        """Return cells as numbers; what is none is NaN, and counted."""
        if cells.dtype.kind != "O":
            return cells.astype(np.float64, copy=False)
        import pandas as pd

        values = numbers_of(cells, *self._signs_of(name))
        bad = np.flatnonzero(np.isnan(values) & pd.notna(cells))
        if len(bad):
            where = f"line {np.concatenate([lines() for lines in self._lines])[bad[0]]}"
            self._report.note_bad_cells(name, len(bad), where, str(cells[bad[0]]))
        return values


def _row_lines(piece: _Bytes, first: int, count: int, bad: Sequence[Any], empty: int, rows: int) -> IntArray:
    """Return the line of each of the first rows of a piece; uncertain behind a row over several lines."""
    lines = np.arange(count)
    if empty:
        lines = np.flatnonzero([bool(line.strip(b"\r\n")) for line in _LINE.findall(piece)])
    lines = np.delete(lines, [row.number - 1 for row in bad if row.number and row.number <= len(lines)])
    return first + (lines[:rows] if len(lines) >= rows else np.arange(rows))


def _called(sign: str) -> str:
    return "comma" if sign == COMMA else "point"


def _lines_in(piece: _Bytes) -> int:
    """Return the number of lines, whatever ends each; the last one may end with the file."""
    ends = sum(  # in parts, whose comparison stays in the cache: five times as fast as to count
        int(np.count_nonzero(np.frombuffer(piece, np.uint8, min(_PART, len(piece) - at), at) == _LINE_FEED))
        for at in range(0, len(piece), _PART)
    )
    if b"\r" in piece:
        ends += piece.count(b"\r") - piece.count(b"\r\n")
    return ends + (not piece.endswith((b"\n", b"\r")))


def _rejoined(piece: _Bytes, columns: int) -> bytes:
    """Return lines in which two cells are one number, its decimal comma between them, as other tables are.

    A line with fewer cells can be read in several ways: it stays as it is, and is no row then.
    """
    whole = re.compile(rb"(?m)^" + rb",".join([_PAIR.pattern] * columns) + rb"(?=\r?$)")
    return whole.sub(lambda line: b";".join(b"%s.%s" % pair for pair in _PAIR.findall(line[0])), piece)


def _as_utf8(piece: _Bytes) -> _Bytes:
    try:
        if not piece.isascii():
            piece.decode()
    except UnicodeDecodeError:
        return piece.decode("cp1252", "replace").encode()
    return piece


def _as_numpy(column: Any) -> NDArray[Any]:
    numbers = column.cast("uint8").cast("float64") if column.type == "bool" else column
    return np.asarray(numbers.to_numpy())
