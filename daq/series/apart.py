"""Readers of series that lean on C libraries, in a process of their own; see `daq.child_process`."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from daq.child_process import answers
from daq.config import SeriesSection
from daq.series.blocks import Blocks, Series, SeriesReport

_OPEN, _ROWS = "open", "rows"


def apart(reader: str) -> Any:
    """Return a reader of series that works in a process of its own.

    Parameters
    ----------
    reader : str
        ``"module:function"``, of the signature that all readers share.
    """
    return partial(_read_apart, reader)


def _read_apart(reader: str, path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    topics = next(_answers(reader, path, layout, report, _OPEN))
    return Series(topics, lambda: _rows(reader, path, layout, report), report)


def _rows(reader: str, path: Path, layout: SeriesSection, report: SeriesReport) -> Iterator[Blocks]:
    found = _answers(reader, path, layout, report, _ROWS)
    next(found)
    yield from found


def _answers(reader: str, path: Path, layout: SeriesSection, report: SeriesReport, what: str) -> Iterator[Any]:
    """Yield the topics, then the blocks where `what` is ``"rows"``; the report is kept up with each."""
    fault, step = "the library that reads this file broke down on it", "export it again, in another format"
    arguments = (reader, layout.model_dump_json(), what)
    for value, now in answers("daq.series.apart:series_apart", path, *arguments, what=fault, next_step=step):
        vars(report).update(vars(now) | {"path": report.path, "format": report.format})
        yield value


def series_apart(path: str, reader: str, layout: str, what: str) -> Iterator[tuple[Any, SeriesReport]]:
    """Yield the topics of a file, then its blocks where `what` is ``"rows"``, each with the report."""
    report = SeriesReport(path, "")
    module, _, function = reader.partition(":")
    read = getattr(importlib.import_module(module), function)
    series: Series = read(Path(path), SeriesSection.model_validate_json(layout), report)
    yield series.topics, report
    if what == _ROWS:
        for blocks in series.blocks():
            yield blocks, report
        yield (), report  # as it is after the last row
