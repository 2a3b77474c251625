"""read_log: any log, in batches of a known size."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from daq.errors import Fault, RecordingError
from daq.frames import FrameBatch, concatenate, split
from daq.logs.formats import open_log
from daq.logs.gunzip import Gunzip
from daq.logs.report import LogReport


class LogReading(Iterator[FrameBatch]):
    """The batches of a log, and the report that grows with them.

    Attributes
    ----------
    report : LogReport
        Complete when the last batch has been read.
    """

    def __init__(self, batches: Iterator[FrameBatch], report: LogReport) -> None:
        self._batches = batches
        self.report = report

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> FrameBatch:
        return next(self._batches)


def read_log(path: str | Path, *, batch_frames: int = 65_536) -> LogReading:
    """Read a CAN log: candump -L, BLF, ASC, TRC, MF4 or CSV, the text ones and BLF gzipped too.

    Times are UTC where the log has a date (ASC, TRC and BLF dates are taken for UTC); otherwise they count from the
    logger's own zero, and ``report.absolute_time`` is False. Frames stay in the order of the file. What cannot be read
    is left out, counted and shown in the report.

    Buses are called as in the log (candump), ``can0`` for the first channel of BLF, ASC and TRC, as python-can does,
    ``can<BusChannel>`` in MF4, and ``can0`` in CSV, which names none.

    Parameters
    ----------
    path : str or Path
    batch_frames : int
        Frames in a batch, at most; small pieces of a log are joined.

    Returns
    -------
    LogReading
        An iterator over `FrameBatch`. Each batch names the buses seen so far, the first ones first.

    Raises
    ------
    RecordingError
        At once if there is no such file, it is empty or no log; when reading if it breaks off or holds no frame.
    ConfigError
        If it is an MF4 file and asammdf is not installed.
    """
    place = Path(path)
    file, known = open_log(place)
    file.close()  # opened again when it is read: a reading that nobody starts holds no file open
    report = LogReport(str(place), known.name)

    def batches() -> Iterator[FrameBatch]:
        file, _ = open_log(place)
        with file:
            yield from _regrouped(_guarded(known.read(file, report), file, report), batch_frames)
        if not report.frames:
            raise _nothing_readable(report)

    return LogReading(batches(), report)


def _guarded(batches: Iterator[FrameBatch], file: io.BufferedReader, report: LogReport) -> Iterator[FrameBatch]:
    """Report a gzipped file that is cut off; any failure of the disk is an error."""
    raw = file.raw
    try:
        yield from batches
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(Fault("the log cannot be read any further", report.path, str(error))) from None
    if isinstance(raw, Gunzip) and raw.damage:
        report.damage = raw.damage


def _regrouped(batches: Iterator[FrameBatch], size: int) -> Iterator[FrameBatch]:
    pending: list[FrameBatch] = []
    for batch in batches:
        for piece in split(batch, size):
            if pending and sum(map(len, pending)) + len(piece) > size:
                yield concatenate(pending)
                pending = []
            pending.append(piece)
            if sum(map(len, pending)) >= size // 4:
                yield concatenate(pending) if len(pending) > 1 else piece
                pending = []
    if pending:
        yield concatenate(pending)


def _nothing_readable(report: LogReport) -> RecordingError:
    said = report.remarks()
    return RecordingError(
        Fault(
            f"no frame could be read as {report.format}",
            report.path,
            found="; ".join(said) or "no line that looks like a frame",
            next_step="check that this is the right file; wheelsoil names a format by the file's suffix",
        )
    )
