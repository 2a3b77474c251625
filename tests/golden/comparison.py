"""Where two kept outputs differ, by how much, and how it is reported."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from golden.kept import spread_rows
from golden.rules import FLOOR, tolerance

SHOWN = 20
ABSENT = "nothing"


@dataclass(frozen=True)
class Difference:
    """A value that is not as it was kept; `relative` is infinite where it is not a number against another."""

    place: str
    expected: Any
    got: Any
    relative: float = math.inf

    def __str__(self) -> str:
        size = f", relative difference {self.relative:.1e}" if math.isfinite(self.relative) else ""
        return f"{self.place}: expected {_short(self.expected)}, got {_short(self.got)}{size}"


def differences(expected: Any, got: Any, place: str) -> Iterator[Difference]:
    """Yield every difference between two kept outputs; a key or a value that one of them lacks is one."""
    if isinstance(expected, dict) and isinstance(got, dict):
        yield from _of_mappings(expected, got, place)
    elif isinstance(expected, list) and isinstance(got, list):
        yield from _of_lists(expected, got, place, range(len(expected)))
    else:
        yield from _of_values(expected, got, place)


def report(found: Iterable[Difference]) -> str:
    """Return the differences as lines, the largest first; those beyond `SHOWN` as a count."""
    ordered = sorted(found, key=lambda one: -one.relative)
    more = [f"... and {len(ordered) - SHOWN} more differences"] if len(ordered) > SHOWN else []
    return "\n".join([str(one) for one in ordered[:SHOWN]] + more)


def _of_mappings(expected: dict[str, Any], got: dict[str, Any], place: str) -> Iterator[Difference]:
    for key in [*expected, *(key for key in got if key not in expected)]:
        inner = f"{place}.{key}"
        if key not in got or key not in expected:
            yield Difference(inner, expected.get(key, ABSENT), got.get(key, ABSENT))
        elif key == "some_rows" and expected.get("count") == got.get("count"):
            yield from _of_lists(expected[key], got[key], place, spread_rows(expected["count"], len(expected[key])))
        elif key == "mean" and "some_rows" in expected:  # near zero as exact as its values
            yield from _of_values(expected[key], got[key], inner, expected["rms"] * tolerance(inner))
        else:
            yield from differences(expected[key], got[key], inner)


def _of_lists(expected: list[Any], got: list[Any], place: str, rows: Sequence[int]) -> Iterator[Difference]:
    if len(expected) != len(got):
        yield Difference(place, f"{len(expected)} values", f"{len(got)} values")
        return
    floor = FLOOR * max((abs(value) for value in expected if _is_number(value)), default=0.0)
    for row, was, now in zip(rows, expected, got, strict=True):
        inner = f"{place}[{row}]"
        if isinstance(was, dict | list):
            yield from differences(was, now, inner)
        else:
            yield from _of_values(was, now, inner, floor)


def _of_values(expected: Any, got: Any, place: str, floor: float = 0.0) -> Iterator[Difference]:
    if not (_is_number(expected) and _is_number(got)):
        if type(expected) is not type(got) or expected != got:
            yield Difference(place, expected, got)
        return
    if not (math.isfinite(expected) and math.isfinite(got)):
        if repr(expected) != repr(got):
            yield Difference(place, expected, got)
        return
    apart, size = abs(expected - got), max(abs(expected), abs(got))
    exact = isinstance(expected, int) and isinstance(got, int)
    if apart > (0 if exact else tolerance(place) * size + floor):
        yield Difference(place, expected, got, apart / size)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
