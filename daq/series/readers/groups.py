"""Named arrays of a file that is read whole or by random access (MAT, HDF5, TDMS, RPC III) -> series."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq import DataError, SeriesSection
from daq.limits import FASTEST_RATE_HZ, LAST_TIME_NS, SLOWEST_RATE_HZ
from daq.series.blocks import BLOCK_ROWS, Blocks, Series, SeriesBlock, SeriesReport, together
from daq.series.time_stamps import TimeStamps, at_rate, is_time_name, refuse_rate, time_columns

Cells = Callable[[int, int], NDArray[Any]]
"""Returns the values from one row to another."""


@dataclass(frozen=True)
class Column:
    """A named array; the values are read when they are needed."""

    name: str
    unit: str
    length: int
    cells: Cells
    time: str = ""
    """Name of the time column, where the file says so."""


@dataclass(frozen=True)
class Clock:
    """Time stamps of a group of columns: a start and a step."""

    start_ns: int
    rate_hz: float


def _check_clock(clock: Clock, count: int, where: str) -> None:
    """Refuse a rate, or a start, whose time stamps would leave what 64 bits of nanoseconds hold."""
    if not SLOWEST_RATE_HZ <= clock.rate_hz <= FASTEST_RATE_HZ:
        found, expected = f"{clock.rate_hz:g} Hz", f"{SLOWEST_RATE_HZ:g} to {FASTEST_RATE_HZ:g} Hz"
        raise DataError.of("a rate that no measurement has", where, found, expected, "export the file again")
    if not abs(clock.start_ns) + 1e9 * count / clock.rate_hz < LAST_TIME_NS:
        found = f"a start at {clock.start_ns} ns and {count} samples at {clock.rate_hz:g} Hz"
        raise DataError.of("times beyond the year 2116", where, found, next_step="export the file again")


def array_column(name: str, values: NDArray[Any], unit: str = "", time: str = "") -> Column:
    """Return a column of values in memory."""
    return Column(name, unit, len(values), lambda start, end: values[start:end], time)


def series_of(
    columns: Sequence[Column],
    layout: SeriesSection,
    report: SeriesReport,
    clocks: Mapping[str, Clock] | None = None,
) -> Series:
    """Put columns into topics: those of one time column, or of one clock.

    A column belongs to the time column that it names; else to the one that is as long, of several to the one with the
    longest beginning of the name in common, and of those to the last before it. `clocks` are, by topic, those of
    columns whose `time` is that topic. `DataError` where there is no time column, or nothing of the length of one.
    """
    clocks = dict(clocks or {})
    by_name = {column.name: column for column in columns}
    own = [column for column in columns if column.time in clocks]
    rest = [column for column in columns if column.time not in clocks]
    named = [column.name for column in rest if is_time_name(_leaf(column.name))]
    refuse_rate(
        layout,
        next(
            (column.time for column in own), next((column.time for column in rest if column.time), "".join(named[:1]))
        ),
        report.path,
    )
    groups: dict[str, list[Column]] = {}
    for column in own:
        groups.setdefault(column.time, []).append(column)
    if rest:
        _by_time(rest, by_name, layout, report, groups, required=not own)
    if layout.rate_hz is not None and "" in groups:
        clocks[""] = Clock(0, layout.rate_hz)
    for time, members in groups.items():
        if time in clocks:
            _check_clock(clocks[time], members[0].length, f"{report.path}, {time or 'rate_hz'}")
    stamped = {time: by_name[time] for time in groups if time not in clocks}
    names = {time: "table" if len(groups) == 1 else _topic(time) for time in groups}
    cells = sum(column.length for own in groups.values() for column in own)

    def stream(time: str) -> Iterator[SeriesBlock]:
        own = groups[time]
        stamps = TimeStamps(time, stamped[time].unit, layout, report) if time in stamped else None
        for start in range(0, own[0].length, BLOCK_ROWS):
            end = min(start + BLOCK_ROWS, own[0].length)
            if stamps:
                time_ns, usable = stamps.of(np.asarray(stamped[time].cells(start, end)))
            else:
                clock = clocks[time]
                time_ns = clock.start_ns + at_rate(end - start, start, clock.rate_hz)
                usable = np.ones(end - start, np.bool_)
            values = {
                column.name: np.asarray(column.cells(start, end)).astype(np.float64, copy=False) for column in own
            }
            report.share += len(own) * (end - start) / cells
            yield report.taken(SeriesBlock(names[time], time_ns, values), usable)

    def read() -> Iterator[Blocks]:
        report.balance.come("rows", sum(own[0].length for own in groups.values()))
        return together([stream(time) for time in groups])

    return Series(
        {names[time]: {column.name: column.unit for column in own} for time, own in groups.items()}, read, report
    )


def _by_time(
    columns: Sequence[Column],
    by_name: Mapping[str, Column],
    layout: SeriesSection,
    report: SeriesReport,
    groups: dict[str, list[Column]],
    *,
    required: bool,
) -> None:
    """Add columns to the group of their time column; a column of another length is skipped."""
    stated = {column.time for column in columns if column.time in by_name}
    if layout.times or (not stated and not any(is_time_name(_leaf(column.name)) for column in columns)):
        if not required and not layout.times:
            report.skipped |= {column.name: "no time column" for column in columns}
            return
        chosen = time_columns({column.name: column.unit for column in columns}, (), layout, report.path)
        times = list(dict.fromkeys(chosen.values())) or [""]
    else:
        times = [column.name for column in columns if column.name in stated or is_time_name(_leaf(column.name))]
    longest = max(column.length for column in columns)
    places = {column.name: i for i, column in enumerate(columns)}
    for i, column in enumerate(columns):
        if column.name in times:
            continue
        possible = [time for time in times if (by_name[time].length if time else longest) == column.length]
        if column.time in by_name:
            possible = [column.time] if by_name[column.time].length == column.length else []
        if not possible:
            report.skipped[column.name] = "of another length than the time"
            continue
        time = max(possible, key=partial(_nearness, column.name, i, places))
        groups.setdefault(time, []).append(column)
    if not groups:
        found = ", ".join(f"{column.name} ({column.length})" for column in columns[:12])
        raise DataError.of("no column is as long as a time column", report.path, found, next_step="see [series] time")


def _topic(time: str) -> str:
    """Return the name of a topic: that of the struct or group whose time it is, else of the time column."""
    return (time.rpartition(".")[0] if _leaf(time).lower() in ("time", "t", "timestamps") else "") or time or "table"


def _nearness(name: str, place: int, places: Mapping[str, int], time: str) -> tuple[int, int]:
    """Return how near a time column is to a column: by what their paths share, then by coming just before it."""
    at = places.get(time, -1)
    return _common(time, name), at if at < place else -1


def _leaf(name: str) -> str:
    return name.rpartition(".")[2].rpartition("/")[2]


def _common(name: str, other: str) -> int:
    """Return how much of the path of two names is the same."""
    left, right = name.replace("/", ".").split(".")[:-1], other.replace("/", ".").split(".")[:-1]
    return next((i for i, (a, b) in enumerate(zip(left, right, strict=False)) if a != b), min(len(left), len(right)))
