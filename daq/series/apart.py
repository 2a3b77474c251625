"""Readers of series that lean on C libraries, in a process of their own; see `daq.child_process`.

The process that says what the columns are goes on to the rows: a file is opened and read once.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from daq.child_process import answers
from daq.config import SeriesSection
from daq.series.blocks import Blocks, Series, SeriesReport
from daq.series.held import Held, state_of

_Answers = Iterator[tuple[Any, SeriesReport]]


@dataclass(frozen=True)
class _Opened:
    topics: Mapping[str, Mapping[str, str]]
    report: SeriesReport
    rest: _Answers
    """The blocks, and the report with each."""

    def close(self) -> None:
        """End the process."""
        self.rest.close()  # type: ignore[attr-defined]


_WAITING: Held[_Opened] = Held(_Opened.close)


def apart(reader: str) -> Any:
    """Return a reader of series (``"module:function"``) that works in a process of its own."""
    return partial(_read_apart, reader)


def _read_apart(reader: str, path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    key, opened = _opened(reader, path, layout)
    _follow(report, opened.report)
    _WAITING.keep(key, opened)
    return Series(opened.topics, lambda: _rows(reader, path, layout, report), report)


def _rows(reader: str, path: Path, layout: SeriesSection, report: SeriesReport) -> Iterator[Blocks]:
    _, opened = _opened(reader, path, layout)
    _follow(report, opened.report)
    try:
        for blocks, now in opened.rest:
            _follow(report, now)
            yield blocks
    finally:
        opened.close()


def _opened(reader: str, path: Path, layout: SeriesSection) -> tuple[object, _Opened]:
    """Return a file whose rows have not been read, opened now or before, and the key under which it may wait."""
    text = layout.model_dump_json()
    key = (reader, text, state_of(path))
    waiting = _WAITING.take(key)
    if waiting is not None:
        return key, waiting
    found = answers(
        "daq.series.apart:series_apart",
        path,
        reader,
        text,
        what="the library that reads this file broke down on it",
        next_step="export it again, in another format",
    )
    topics, report = next(found)
    return key, _Opened(topics, report, found)


def _follow(report: SeriesReport, now: SeriesReport) -> None:
    vars(report).update(vars(now) | {"path": report.path, "format": report.format})


def series_apart(path: str, reader: str, layout: str) -> Iterator[tuple[Any, SeriesReport]]:
    """Yield the topics of a file, then its blocks, each with the report."""
    report = SeriesReport(path, "")
    series: Series = pkgutil.resolve_name(reader)(Path(path), SeriesSection.model_validate_json(layout), report)
    yield series.topics, report
    for blocks in series.blocks():
        yield blocks, report
    yield (), report  # as it is after the last row
