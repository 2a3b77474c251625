"""The form in which an output is kept: words and timings put aside, long series thinned, floats rounded."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

from golden.rules import are_words, has_numbers, is_labelled, is_of_the_run

ROWS = 32
"""Longest list that is kept whole."""
SPREAD = 80
"""Rows that are kept at most of a longer one that a command prints or exports, beside its sums over all rows."""
DRAWN = 6
"""The same of a figure's trace: its numbers stand elsewhere, too."""
DIGITS = 13
ASIDE = "(put aside)"
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def kept(value: Any, place: str) -> Any:
    """Return the output at a place as it is kept; what is put aside leaves its key."""
    if is_of_the_run(place):
        return ASIDE
    if isinstance(value, dict):
        if is_labelled(place):
            return [kept(item, f"{place}.{i}") for i, item in enumerate(value.values())]
        return {name: kept(item, f"{place}.{name}") for name, item in value.items()}
    flat = list(_flat(value))
    if has_numbers(place) and isinstance(value, str):
        return [float(number) for number in _NUMBER.findall(value)]
    if are_words(place) and all(isinstance(item, str) for item in flat):
        return [ASIDE] * len(flat) if isinstance(value, list) else ASIDE
    drawn = ".figures." in place
    if len(flat) <= (DRAWN if drawn else ROWS) or any(isinstance(item, dict) for item in flat):
        return [kept(item, place) for item in value] if isinstance(value, list) else _rounded(value)
    return ({"lists": len(value)} if len(value) < len(flat) else {}) | _thinned(flat, DRAWN if drawn else SPREAD)


def _flat(value: Any) -> Iterator[Any]:
    """Yield what is in a list, its lists and so on; of anything else itself."""
    if isinstance(value, list):
        for item in value:
            yield from _flat(item)
    else:
        yield value


def spread_rows(count: int, kept_rows: int) -> list[int]:
    """Return the rows that are kept of a series of `count`, spread evenly from the first to the last."""
    return [round(i * (count - 1) / (kept_rows - 1)) for i in range(kept_rows)]


def _thinned(values: Sequence[Any], most: int) -> dict[str, Any]:
    """Return what is kept of a long series: what it is over all rows, and some rows.

    The row numbers of each text, and integers weighed by theirs, are summed: a stretch that moves by a row is seen.
    """
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    others: dict[str, list[int]] = {}
    for row, value in enumerate(values):
        if value is None or isinstance(value, bool | str):
            others.setdefault(str(value), []).append(row)
    found: dict[str, Any] = {"count": len(values)}
    if others:
        found["others"] = {name: {"count": len(rows), "rows": sum(rows)} for name, rows in sorted(others.items())}
    if all(isinstance(value, int) for value in numbers):
        found |= {"sum": sum(numbers), "by_row": sum(row * value for row, value in enumerate(numbers))}
    else:
        rms = math.sqrt(math.fsum(value * value for value in numbers) / len(numbers))
        found |= {"mean": _rounded(math.fsum(numbers) / len(numbers)), "rms": _rounded(rms)}
    return found | {"some_rows": [_rounded(values[row]) for row in spread_rows(len(values), min(most, len(values)))]}


def _rounded(value: Any) -> Any:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
