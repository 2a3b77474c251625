"""Tables that people write: a CSV file to named columns of numbers, with the line of every fault.

Comma, semicolon or tab between the cells; the first line that is neither empty nor a ``#`` comment names the columns.
Two options of the commands fit a foreign table to our names: ``--rename new=old*factor`` takes a column under another
name and, with a factor, in another unit or sign; ``--where column=value`` keeps the rows that have the value.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from daq import ConfigError, DataError, Fault, FloatArray, every_error_as, nearest
from daq.limits import MOST_COLUMNS

MISSING = frozenset({"", "nan", "na", "n/a", "-"})
"""Cells that hold no number, in lower case."""

_LISTED = 5  # bad cells of a column that are listed


class Source(NamedTuple):
    """Where a renamed column comes from: ``new = old * factor``."""

    column: str
    factor: float = 1.0


def parse_rename(texts: Iterable[str]) -> dict[str, Source]:
    """Parse ``new=old`` and ``new=old*factor``, several in one text separated by commas.

    Raises
    ------
    ConfigError
        All faults at once.
    """
    faults: list[Fault] = []
    renamed = {}
    for text, new, old in _assignments(texts, "--rename", "new=old or new=old*factor", faults):
        column, star, factor = old.rpartition("*")
        number = number_of(factor) if star else 1.0
        if number is None or not math.isfinite(number) or number == 0:
            faults.append(Fault(f"--rename {text}: the factor is not a number", found=factor, expected="e.g. *0.001"))
        else:
            renamed[new] = Source((column if star else old).strip(), number)
    if faults:
        raise ConfigError(*faults)
    return renamed


def parse_where(texts: Iterable[str]) -> dict[str, str]:
    """Parse ``column=value``, several in one text separated by commas.

    Raises
    ------
    ConfigError
        All faults at once.
    """
    faults: list[Fault] = []
    chosen = {column: value for _, column, value in _assignments(texts, "--where", "column=value", faults)}
    if faults:
        raise ConfigError(*faults)
    return chosen


class SharedOptions:
    """``--rename`` and ``--where`` of a command that reads several tables: each holds for the tables that it fits.

    Parameters
    ----------
    rename, where : iterable of str
        As they were typed.

    Raises
    ------
    ConfigError
        They are not understood.
    """

    def __init__(self, rename: Iterable[str], where: Iterable[str]) -> None:
        self._rename, self._where = parse_rename(rename), parse_where(where)
        self._columns: set[str] = set()

    def fitting(self, columns: Iterable[str]) -> tuple[dict[str, Source], dict[str, str]]:
        """Return what of both holds for a table with these columns."""
        there = set(columns)
        self._columns |= there
        rename = {new: source for new, source in self._rename.items() if source.column in there}
        return rename, {name: value for name, value in self._where.items() if name in there | set(rename)}

    def refuse_unused(self) -> None:
        """Raise ConfigError for columns that were in no table so far."""
        known = self._columns | set(self._rename)
        wanted = [("--rename", source.column, self._columns) for source in self._rename.values()]
        wanted += [("--where", name, known) for name in self._where]
        faults = [
            Fault(
                f"{option}: no table has a column {column!r}",
                expected=nearest(column, names),
                next_step="correct the name",
            )
            for option, column, names in wanted
            if column not in names
        ]
        if faults:
            raise ConfigError(*faults)


def _assignments(
    texts: Iterable[str], option: str, expected: str, faults: list[Fault]
) -> Iterator[tuple[str, str, str]]:
    for text in chain.from_iterable(text.split(",") for text in texts):
        left, sign, right = (part.strip() for part in text.partition("="))
        if sign and left and right:
            yield text, left, right
        elif text.strip():
            faults.append(Fault(f"{option} {text.strip()}: not understood", expected=expected, next_step="write it so"))


def number_of(cell: str) -> float | None:
    """Return the number of a cell, NaN where it holds none, None where it is not a finite number."""
    if cell.lower() in MISSING:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Table:
    """A CSV file as text, its rows chosen, its columns renamed.

    Attributes
    ----------
    source : str
        Name of the file, for messages.
    columns : mapping name -> cells
        All of the same length.
    lines : tuple of int
        Line of each row in the file.
    factors : mapping name -> float
        Of renamed columns.
    """

    source: str
    columns: dict[str, tuple[str, ...]]
    lines: tuple[int, ...]
    factors: dict[str, float]

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def numbers(self, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, FloatArray]:
        """Return columns as numbers, shape (rows,) each.

        Those of `required` must be there, or `ConfigError` names the nearest that is there, with a number in every
        cell, or `DataError` names the lines. Those of `optional` are not in the result where the table lacks them; a
        missing cell is NaN.
        """
        absent = [name for name in required if name not in self.columns]
        if absent:
            raise ConfigError(*(self._absent(name) for name in absent))
        faults: list[Fault] = []
        values = {name: self._column(name, True, faults) for name in required}
        values |= {name: self._column(name, False, faults) for name in optional if name in self.columns}
        if faults:
            raise DataError(*faults)
        return values

    def groups(self, name: str) -> Iterator[tuple[str, Table]]:
        """Yield the rows of each value of a column, in the order of the values' first rows; all where it is missing."""
        if name not in self.columns:
            yield "", self
            return
        rows: dict[str, list[int]] = {}
        for row, value in enumerate(self.columns[name]):
            rows.setdefault(value, []).append(row)
        for value, chosen in rows.items():
            yield value, self._rows(chosen)

    def kept(self, rows: Sequence[bool]) -> Table:
        """Return the table with only the rows that are True."""
        return self._rows([row for row, keep in enumerate(rows) if keep])

    def _rows(self, rows: Sequence[int]) -> Table:
        columns = {name: tuple(cells[row] for row in rows) for name, cells in self.columns.items()}
        return Table(self.source, columns, tuple(self.lines[row] for row in rows), self.factors)

    def _absent(self, name: str) -> Fault:
        found, step = ", ".join(self.columns), f"name the column that holds it: --rename {name}=COLUMN"
        return Fault(f"column {name!r} is missing", self.source, found, nearest(name, self.columns), step)

    def _column(self, name: str, required: bool, faults: list[Fault]) -> FloatArray:
        values, bad = np.full(len(self), np.nan), []
        for i, cell in enumerate(self.columns[name]):
            number = number_of(cell)
            if number is None or (required and math.isnan(number)):
                bad.append(i)
            else:
                values[i] = number
        if bad:
            faults.append(self._bad_cells(name, bad))
        return values * self.factors.get(name, 1.0)

    def _bad_cells(self, name: str, rows: Sequence[int]) -> Fault:
        cells = [f"line {self.lines[i]}: {self.columns[name][i]!r}" for i in rows[:_LISTED]]
        more = f" and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
        comma = any("," in self.columns[name][i] for i in rows)
        expected = "a number with a decimal point" if comma else "a number"
        step = "write decimal points instead of commas" if comma else "correct the cells or exclude the rows"
        what = f"column {name!r} has cells that are not a number"
        return Fault(what, self.source, ", ".join(cells) + more, expected, step)


def read_table(
    path: Path, *, rename: Mapping[str, Source] | None = None, where: Mapping[str, str] | None = None
) -> Table:
    """Read a CSV file, with columns renamed (see `parse_rename`) and only some rows kept.

    The columns of `where` may go by their old or their new names, their cells are as in the file. Numbers are compared
    as numbers. `ConfigError` where there is no such file, it is not a table, `rename` or `where` have unknown columns,
    or no row is left; `DataError` for rows that are longer or shorter than the head, or no row at all.
    """
    table = _renamed(_parsed(path), rename or {})
    return _chosen(table, where) if where else table


def column_names(path: Path) -> tuple[str, ...]:
    """Return the names of a CSV file's columns; raises as `read_table` does."""
    return tuple(_parsed(path).columns)


def _parsed(path: Path) -> Table:
    with every_error_as(DataError, "the table cannot be read", lambda: path):
        return _read(path)


def _read(path: Path) -> Table:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ConfigError.of("no such file", path, next_step="check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        fault = Fault("the file cannot be read as text", str(path), str(error), next_step="save it as CSV, UTF-8")
        raise ConfigError(fault) from None
    numbered = [
        (i, line)
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip(" ,;\t") and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise DataError.of("the table is empty", path, next_step="give a CSV file with a line of column names")
    delimiter = max(",;\t", key=numbered[0][1].count)
    columns = numbered[0][1].count(delimiter) + 1
    if columns > MOST_COLUMNS:
        where, expected = f"{path}, line {numbered[0][0]}", f"at most {MOST_COLUMNS:,}, a row for each sample"
        raise DataError.of("the table has too many columns", where, f"{columns:,}", expected, "transpose the table")
    try:
        rows = [next(csv.reader([line], delimiter=delimiter, strict=True)) for _, line in numbered]
    except csv.Error as error:
        raise DataError.of(
            "not a CSV file", path, str(error), "", "correct the quotation marks, or export it again"
        ) from None
    rows = [[cell.strip() for cell in row] for row in rows]
    return _squared(str(path), rows, [i for i, _ in numbered])


def _squared(source: str, rows: list[list[str]], lines: list[int]) -> Table:
    head, body = rows[0], rows[1:]
    while head and not head[-1]:  # a delimiter at the end of each line
        head.pop()
    faults = [
        Fault(f"column {name!r} is there twice", source, next_step="rename or remove one")
        for name, count in sorted(Counter(head).items())
        if count > 1
    ]
    for row, line in zip(body, lines[1:], strict=True):
        while len(row) > len(head) and not row[-1]:
            row.pop()
        if len(row) != len(head):
            faults.append(
                Fault(
                    f"{len(row)} cells in a table of {len(head)} columns",
                    f"{source}, line {line}",
                    next_step="correct the line",
                )
            )
    if not body:
        faults.append(
            Fault(
                "the table has no rows", source, found=f"columns {', '.join(head)}", next_step="export it with its rows"
            )
        )
    if faults:
        raise DataError(*faults[:_LISTED])
    return Table(source, dict(zip(head, zip(*body, strict=True), strict=True)), tuple(lines[1:]), {})


def _refuse_unknown(table: Table, columns: Mapping[str, str]) -> None:
    """Raise ConfigError for columns, by the option that names them, that the table does not have."""
    faults = [
        Fault(
            f"{option}: there is no column {name!r}", table.source, "", nearest(name, table.columns), "correct the name"
        )
        for option, name in columns.items()
        if name not in table
    ]
    if faults:
        raise ConfigError(*faults)


def _renamed(table: Table, rename: Mapping[str, Source]) -> Table:
    _refuse_unknown(table, {f"--rename {new}={source.column}": source.column for new, source in rename.items()})
    columns = {name: cells for name, cells in table.columns.items() if name not in rename}
    columns |= {new: table.columns[source.column] for new, source in rename.items()}
    return Table(table.source, columns, table.lines, {new: source.factor for new, source in rename.items()})


def _chosen(table: Table, where: Mapping[str, str]) -> Table:
    _refuse_unknown(table, {f"--where {name}={value}": name for name, value in where.items()})
    for name, value in where.items():
        kept = table.kept([_equal(cell, value) for cell in table.columns[name]])
        if not len(kept):
            found = f"{name}: {', '.join(list(dict.fromkeys(table.columns[name]))[:12])}"
            step = "choose one of the values that are there"
            raise ConfigError.of(f"--where {name}={value}: no row is left", table.source, found, next_step=step)
        table = kept
    return table


def _equal(cell: str, value: str) -> bool:
    left, right = number_of(cell), number_of(value)
    if left is None or right is None:
        return cell == value
    return left == right or (math.isnan(left) and math.isnan(right))
