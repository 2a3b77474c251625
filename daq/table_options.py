"""What fits a foreign table to our names: the options ``--rename new=old*factor`` and ``--where column=value``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import NamedTuple

from daq.errors import ConfigError, Fault, nearest

MISSING = frozenset({"", "nan", "na", "n/a", "-"})
"""Cells that hold no number, in lower case."""


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
        where = {name: value for name, value in self._where.items() if name in there | set(rename)}
        return rename, where

    def refuse_unused(self) -> None:
        """Raise ConfigError for columns that were in no table so far."""
        known = self._columns | set(self._rename)
        wanted = [("--rename", source.column, self._columns) for source in self._rename.values()]
        wanted += [("--where", name, known) for name in self._where]
        faults = [
            Fault(f"{option}: no table has a column {column!r}", expected=nearest(column, names))
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
            faults.append(Fault(f"{option} {text.strip()}: not understood", expected=expected))


def number_of(cell: str) -> float | None:
    """Return the number of a cell, NaN where it holds none, None where it is not a finite number."""
    if cell.lower() in MISSING:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
