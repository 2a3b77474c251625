"""Formatting of numbers, tables and file names for people."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from itertools import zip_longest
from math import floor, log10

import numpy as np

from daq.limits import EARLIEST_DATE_NS

_LEAST_COLUMN = 12
_POWER = re.compile(r"(?<![\w.])-?\d(?:\.\d+)?e[+-]\d\d(?!\w)")
_PLAIN, _COMMAS_FROM = (1e-4, 1e7), 1e4
_BREAK_AFTER = re.compile(r"[^\s._/]*[\s._/]+|[^\s._/]+")


def number(value: float, digits: int = 4) -> str:
    """Return a number with `digits` significant digits, or "-" where there is none.

    Written as people write it: 487,600 and 0.00031; a power of ten only above ten millions and below a ten-thousandth.
    """
    if value != value:
        return "-"
    if not _PLAIN[0] <= abs(value) < _PLAIN[1]:
        return f"{value:.{digits}g}"
    rounded = float(f"{value:.{digits}g}")
    comma = "," if abs(rounded) >= _COMMAS_FROM else ""
    text = f"{rounded:{comma}.{max(digits - 1 - floor(log10(abs(rounded))), 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def without_powers(text: str) -> str:
    """Return a text with its numbers written as `number` writes them: 81,200 for 8.12e+04."""

    def written(found: re.Match[str]) -> str:
        return number(float(found[0]), len(re.sub(r"e.*|[-.]", "", found[0])))

    return _POWER.sub(written, text)


def moment(time_ns: int) -> str:
    """Return nanoseconds since 1970 as a date in UTC; of a logger that counts from another moment, as seconds."""
    if time_ns < EARLIEST_DATE_NS:
        return f"{time_ns / 1e9:.3f} s, no date"
    return f"{np.datetime64(time_ns, 'ns').astype('datetime64[ms]')}Z"


def table_lines(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1, width: int | None = None
) -> list[str]:
    """Return aligned columns, the first `left` of them left-aligned, the others right-aligned.

    Where they are wider than `width` they move closer together, and then the widest left-aligned column is broken over
    lines, after a space, dot, slash or underscore where there is one.
    """
    lines = [list(head), *[list(row) for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    gap = 2
    if width is not None and left and _total(widths, gap) > width:
        gap = 1
        widest = max(range(left), key=lambda i: widths[i])
        excess = max(_total(widths, gap) - width, 0)
        widths[widest] = max(widths[widest] - excess, min(widths[widest], _LEAST_COLUMN))
    out = []
    for line in lines:
        pieces = [_pieces(text, widths[i]) if i < left else [text] for i, text in enumerate(line)]
        out += [
            (" " * gap)
            .join(text.ljust(widths[i]) if i < left else text.rjust(widths[i]) for i, text in enumerate(texts))
            .rstrip()
            for texts in zip_longest(*pieces, fillvalue="")
        ]
    return out


def _total(widths: Sequence[int], gap: int) -> int:
    return sum(widths) + gap * (len(widths) - 1)


def _pieces(text: str, width: int) -> list[str]:
    """Return a text as pieces of at most `width`."""
    if len(text) <= width:
        return [text]
    pieces = [""]
    for token in _BREAK_AFTER.findall(text):
        rest = token
        if len(pieces[-1]) + len(rest.rstrip()) > width and pieces[-1]:
            pieces.append("")
        while len(rest.rstrip()) > width:
            pieces[-1], rest = rest[:width], rest[width:]
            pieces.append("")
        pieces[-1] += rest
    return [piece.rstrip() for piece in pieces if piece.strip()]


# Names that Windows keeps for devices, whatever follows a dot.
_OF_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def file_name(name: str, otherwise: str = "run") -> str:
    """Return a name that stays in its folder on every system: letters, digits, ``_ . - @``, no leading dot."""
    plain = re.sub(r"[^\w.@-]+", "-", name).strip(".-") or otherwise
    return f"_{plain}" if _OF_DEVICES.fullmatch(plain) else plain


def numbered(name: str, taken: Collection[str], joint: str = "_") -> str:
    """Return `name`, or the first of ``name_2``, ``name_3``, ... that is not taken."""
    candidate, number = name, 2
    while candidate in taken:
        candidate, number = f"{name}{joint}{number}", number + 1
    return candidate
