"""Decoded time series as they come from a file: blocks of rows, and a report of what could not be used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from daq import Balance, BoolArray, FloatArray, IntArray, RecordingError, every_error_as
from daq.limits import EARLIEST_DATE_NS

BLOCK_ROWS = 1 << 16
_LISTED, _SHOWN = 6, 40
UNREADABLE, EMPTY = "unreadable", "empty rows"


@dataclass(frozen=True)
class SeriesBlock:
    """Rows of one topic: columns that share their time stamps.

    Attributes
    ----------
    time_ns : int64 array, shape (n,)
        UTC, or since a zero of the logger's own.
    columns : mapping name -> float64 array, shape (n,)
        NaN where the file has no number.
    """

    topic: str
    time_ns: IntArray
    columns: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.time_ns)

    def rows(self, which: slice | BoolArray) -> SeriesBlock:
        """Return some of the rows."""
        return SeriesBlock(
            self.topic, self.time_ns[which], {name: column[which] for name, column in self.columns.items()}
        )


Blocks = tuple[SeriesBlock, ...]
"""What came at about the same time: at most one block a topic."""


@dataclass
class SeriesReport:
    """Grows while a file is read, and is complete when the last block has been.

    Attributes
    ----------
    rows : mapping topic -> int
    share : float
        Of the file, read so far: 0 to 1.
    absolute_time : bool or None
        Whether time stamps are dates; None before the first.
    stamp_s : float
        Seconds of one of the time column, 0 where its stamps are no numbers.
    unzoned : bool
        Whether dates came without a time zone, and are taken for UTC.
    balance : Balance
        Of the rows: a row of each topic, and what is no row of the table.
    out_of_order : mapping topic -> int
        Rows earlier than the one before, which are kept.
    bad_cells : mapping column -> int
        Cells that should hold a number and do not; they are NaN.
    first_bad_cell : mapping column -> str
        Where the first of them is, and what is in it.
    skipped : mapping column -> reason
    damage : str
        Where the reading broke off, and why.
    known : list of str
        What was known of the file before its rows were read, a sentence each.
    readings : list of str
        How numbers and times were read that may be read in two ways, and why.
    """

    path: str
    format: str
    rows: dict[str, int] = field(default_factory=dict)
    share: float = 0.0
    absolute_time: bool | None = None
    stamp_s: float = 0.0
    unzoned: bool = False
    balance: Balance = field(default_factory=Balance)
    out_of_order: dict[str, int] = field(default_factory=dict)
    bad_cells: dict[str, int] = field(default_factory=dict)
    first_bad_cell: dict[str, str] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    damage: str = ""
    known: list[str] = field(default_factory=list)
    readings: list[str] = field(default_factory=list)
    _last_ns: dict[str, int] = field(default_factory=dict)

    def restart(self) -> None:
        """Forget what was counted; what is known of the columns stays."""
        fresh = SeriesReport(self.path, self.format, unzoned=self.unzoned, skipped=self.skipped, known=self.known)
        vars(self).update(vars(fresh))

    def note_bad_row(self, where: str, why: str, count: int = 1) -> None:
        """Count rows that cannot be read and keep the first example."""
        self.balance.lose(UNREADABLE, count, f"{where}: {why}")

    def note_reading(self, text: str) -> None:
        """Keep how something was read that may be read in two ways."""
        if text not in self.readings:
            self.readings.append(text)

    def note_bad_cells(self, column: str, count: int, where: str, cell: str) -> None:
        """Count cells that hold no number and keep the first example; `count` is 1 at least."""
        self.bad_cells[column] = self.bad_cells.get(column, 0) + count
        self.first_bad_cell.setdefault(column, f"{where}: {cell[:_SHOWN]!r}")

    def taken(self, block: SeriesBlock, usable: BoolArray) -> SeriesBlock:
        """Return the rows with a usable time stamp, counted."""
        topic = block.topic
        if not usable.all():
            filled = np.any([np.isfinite(column[~usable]) for column in block.columns.values()], axis=0)
            count = int(np.count_nonzero(filled))
            self.balance.lose(f"of {topic} without a usable time", count)
            self.balance.put_aside(EMPTY, len(filled) - count)  # such rows fill up a shorter table
            block = block.rows(usable)
        self.rows[topic] = self.rows.get(topic, 0) + len(block)
        self.balance.out += len(block)
        if len(block):
            if self.absolute_time is None:
                self.absolute_time = bool(block.time_ns[0] >= EARLIEST_DATE_NS)
            before = self._last_ns.get(topic, int(block.time_ns[0]))
            back = int(np.count_nonzero(np.diff(block.time_ns, prepend=before) < 0))
            if back:
                self.out_of_order[topic] = self.out_of_order.get(topic, 0) + back
            self._last_ns[topic] = int(block.time_ns[-1])
        return block

    def losses(self) -> list[str]:
        """Return what of the file is not in its samples, a sentence each."""
        lines = [*self.known, *([self.damage] if self.damage else [])]
        lines += [f"{self.balance.unit} {kind}, excluded: {loss}" for kind, loss in self.balance.losses.items()]
        cells = [
            f"{count} in {column!r}, the first in {self.first_bad_cell[column]}"
            for column, count in self.bad_cells.items()
        ]
        return lines + ([f"cells that hold no number: {_some(cells, '; ')}"] if cells else [])

    def remarks(self) -> list[str]:
        """Return what a user should know of this file, a sentence each."""
        lines = list(self.readings)
        if self.absolute_time is False:
            lines.append("times have no date: they count from a zero of the logger's own")
        if self.unzoned:
            lines.append("dates have no time zone: they are taken for UTC")
        lines += self.losses()
        lines += [f"{topic}: {count} rows are out of order" for topic, count in self.out_of_order.items()]
        reasons: dict[str, list[str]] = {}
        for column, why in self.skipped.items():
            reasons.setdefault(why, []).append(repr(column))
        return lines + [f"not imported ({why}): {_some(columns)}" for why, columns in reasons.items()]


def _some(texts: list[str], between: str = ", ") -> str:
    more = f" and {len(texts) - _LISTED} more" if len(texts) > _LISTED else ""
    return between.join(texts[:_LISTED]) + more


@dataclass(frozen=True)
class Series:
    """The decoded series of a file or of a recording.

    Attributes
    ----------
    topics : mapping topic -> mapping column -> unit
        A unit is empty where the file states none.
    report : SeriesReport
        Of the last reading.
    """

    topics: Mapping[str, Mapping[str, str]]
    _read: Callable[[], Iterator[Blocks]]
    report: SeriesReport

    def blocks(self) -> Iterator[Blocks]:
        """Read from the beginning, in bounded memory where the format allows it.

        Raises
        ------
        RecordingError, DataError
            The file cannot be read any further, or holds no row that can be used.
        """
        self.report.restart()
        with every_error_as(RecordingError, "the file cannot be read any further", self._place):
            yield from self._read()
            self.report.balance.close()

    def _place(self) -> str:
        return f"{self.report.path}, after row {sum(self.report.rows.values())}"


def together(streams: Iterable[Iterator[SeriesBlock]]) -> Iterator[Blocks]:
    """Merge streams of blocks, one a topic, so that what came at about the same time comes together.

    Rows stay in the order of their topic. One block of each topic is held.
    """
    waiting: dict[int, SeriesBlock] = {}
    running = dict(enumerate(streams))
    while True:
        for key in [key for key in running if key not in waiting]:
            block = next((piece for piece in running[key] if len(piece)), None)
            if block is None:
                del running[key]
            else:
                waiting[key] = block
        if not waiting:
            return
        limit_ns = min(int(waiting[key].time_ns.max()) for key in (running or waiting))
        ready = []
        for key, block in sorted(waiting.items()):
            early = np.flatnonzero(block.time_ns > limit_ns)
            cut = int(early[0]) if len(early) else len(block)
            if cut:
                ready.append(block.rows(slice(None, cut)))
            if cut < len(block):
                waiting[key] = block.rows(slice(cut, None))
            else:
                del waiting[key]
        yield tuple(ready)
