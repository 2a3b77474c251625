"""How the numbers of a column of text are written: which sign is the decimal one, and which parts the thousands.

``1.289`` is 1289 beside ``999``, and 1.289 beside ``12.5``: what a cell means is decided by all cells of its column. A
cell decides where only one of the two signs can be what it is in; the others follow.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from daq import ConfigError, FloatArray

POINT, COMMA = ".", ","
_SIGN, _EXPONENT = r"[+-]?", r"(?:[eE][+-]?\d+)?"
_GROUPS = {sign: re.compile(rf"{_SIGN}[1-9]\d{{0,2}}(?:{re.escape(sign)}\d{{3}})+$") for sign in (POINT, COMMA)}
_GROUPS_AND_DECIMALS = {
    sign: re.compile(rf"{_SIGN}[1-9]\d{{0,2}}(?:{re.escape(other)}\d{{3}})+{re.escape(sign)}\d*$")
    for sign, other in ((POINT, COMMA), (COMMA, POINT))
}
_DECIMALS = {
    sign: re.compile(rf"{_SIGN}(?:\d+{re.escape(sign)}\d*|{re.escape(sign)}\d+){_EXPONENT}$") for sign in (POINT, COMMA)
}
_SPACES = r"['\u2019 \u00a0\u202f]"
_SPACED = rf"{_SIGN}\d{{1,3}}(?:{_SPACES}\d{{3}})+(?!\d)"
_WHOLE = re.compile(rf"{_SIGN}\d+$")
_LEAST_NEIGHBOUR = 100.0
"""A number without separator from here on is near to the thousands."""
MOST_UNSEPARATED = 1000.0


@dataclass
class Evidence:
    """What the cells of a column say of one sign.

    Attributes
    ----------
    decimal, thousands, either : str
        The first cell that can be read in one way only, or in both.
    unseparated : str
        The largest whole number without a sign, as long as none reaches 1000.
    """

    decimal: str = ""
    thousands: str = ""
    either: str = ""
    unseparated: str = ""
    largest: float = -1.0

    def take(self, cells: Iterable[str], sign: str) -> None:
        """Take the different cells of a column, or a part of them."""
        other = COMMA if sign == POINT else POINT
        for cell in cells:
            if _WHOLE.match(cell):
                self.largest, self.unseparated = max((self.largest, self.unseparated), (abs(float(cell)), cell))
            elif _GROUPS_AND_DECIMALS[sign].match(cell):
                self.decimal = self.decimal or cell
            elif _GROUPS_AND_DECIMALS[other].match(cell) or (_GROUPS[sign].match(cell) and cell.count(sign) > 1):
                self.thousands = self.thousands or cell
            elif _GROUPS[sign].match(cell):
                self.either = self.either or cell
            elif _DECIMALS[sign].match(cell):
                self.decimal = self.decimal or cell


def parts_thousands(found: Evidence, sign: str, column: str, where: str, decimal_elsewhere: str) -> str:
    """Return why a sign parts thousands in a column, empty where it is the decimal sign.

    `decimal_elsewhere` is the sign before decimals in other columns of the table, empty where none decides.
    `ConfigError` where both readings are equally good, or cells contradict each other.
    """
    if found.decimal and found.thousands:
        raise _undecided(sign, column, where, f"{found.thousands} and {found.decimal}")
    if found.thousands:
        return f"{found.thousands} is no number otherwise"
    if not found.either or found.decimal or found.largest >= MOST_UNSEPARATED:
        return ""
    if decimal_elsewhere not in ("", sign):
        return f"{COMMA if sign == POINT else POINT} is the decimal sign of the table"
    if found.largest >= _LEAST_NEIGHBOUR:
        return f"{found.either} is beside {found.unseparated}, and every separated cell has three digits behind it"
    if decimal_elsewhere == sign or (found.largest < 0 and sign == POINT):
        return ""  # three decimals
    beside = f" beside {found.unseparated}" if found.unseparated else ""
    raise _undecided(sign, column, where, f"{found.either}{beside}")


def _undecided(sign: str, column: str, where: str, found: str) -> ConfigError:
    what = f"column {column!r}: {sign!r} may part thousands or decimals"
    step = f'say which: vehicle.toml [series] thousands = "{sign}", or decimal = "{sign}"'
    return ConfigError.of(what, where, found, "numbers that can be read in one way", step)


def numbers_of(texts: Iterable[str], decimal: str, thousands: str) -> FloatArray:
    """Return texts as numbers, NaN for what is none."""
    import pandas as pd

    cells = pd.Series(texts, dtype=object)
    if thousands:
        parted = cells.str.match(rf"{_SIGN}\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+(?!\d)", na=False)
        cells = cells.where(~parted, cells.str.replace(thousands, "", regex=False))
    parted = cells.str.match(_SPACED, na=False)
    if parted.any():
        cells = cells.where(~parted, cells.str.replace(_SPACES, "", regex=True))
    if decimal != POINT:
        cells = cells.str.replace(decimal, POINT, regex=False)
    return np.asarray(pd.to_numeric(cells.str.strip(), errors="coerce").to_numpy(np.float64))
