"""The log formats, each with its reader by suffix and content, and `read_log`, which reads any of them, gzipped too."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO, Self

from daq.can.frames import FrameBatch, concatenate, split
from daq.deferred import deferred
from daq.errors import Fault, RecordingError, every_error_as, nearest
from daq.gunzip import Gunzip, unpacked
from daq.logs.busmaster import MARK, read_busmaster
from daq.logs.candump import LINE, read_candump
from daq.logs.frame_tables import FrameColumns, is_frame_table, read_frame_table
from daq.logs.report import LogReport, share_of_file

Reader = Callable[[BinaryIO, LogReport], Iterator[FrameBatch]]
_HEAD_BYTES = 64 << 10


@dataclass(frozen=True)
class LogFormat:
    """A log format that can be read: its name, the suffixes it goes by, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    read: Reader


@dataclass(frozen=True)
class OtherFormat:
    """What a file is that is read in another way, or not at all, and what to do then."""

    name: str
    advice: str = ""


_CANDUMP = LogFormat("candump -L text", (".log", ".candump"), read_candump)
_BLF = LogFormat("Vector BLF", (".blf",), deferred("daq.logs.blf:read_blf"))
_ASC = LogFormat("Vector ASC", (".asc",), deferred("daq.logs.asc:read_asc"))
_TRC = LogFormat("PEAK TRC", (".trc",), deferred("daq.logs.trc:read_trc"))
_MF4 = LogFormat("MF4 (ASAM MDF 4)", (".mf4",), deferred("daq.logs.mf4:read_mf4"))
_CSV = LogFormat("CSV", (".csv",), read_frame_table)
_BUSMASTER = LogFormat("BusMaster text", (".log", ".txt"), read_busmaster)
LOG_FORMATS = (_CANDUMP, _BLF, _ASC, _TRC, _MF4, _CSV, _BUSMASTER)
"""Every format; a suffix that several have means the first of them, unless the content says otherwise."""
LOG_SUFFIXES = tuple(dict.fromkeys(suffix for known in LOG_FORMATS for suffix in known.suffixes))
"""Suffixes of logs; each may be followed by ``.gz``, except for MF4."""

_MAGIC: tuple[tuple[bytes, LogFormat | OtherFormat], ...] = (
    (b"LOGG", _BLF),
    (b"MDF     4", _MF4),
    (b"UnFinMF 4", _MF4),
    (b"MDF     ", OtherFormat("an MDF file older than version 4")),
    (
        b"\x89MCAP",
        OtherFormat("an MCAP recording", "it needs no import: give it to the other commands as it is"),
    ),
    (b"SQLite format 3", OtherFormat("an SQLite database")),
    (b"PAR1", OtherFormat("a Parquet file")),
    (b"PK\x03\x04", OtherFormat("a zip archive")),
    (b"\xd4\xc3\xb2\xa1", OtherFormat("a packet capture (pcap)")),
    (b"\x0a\x0d\x0d\x0a", OtherFormat("a packet capture (pcapng)")),
    (b"\x89HDF", OtherFormat("an HDF5 file")),
    (b"MATLAB 5.0", OtherFormat("a MAT file")),
)
_TEXT: tuple[tuple[re.Pattern[bytes], LogFormat | OtherFormat], ...] = (
    (re.compile(rb"\s*;\s*(\$FILEVERSION|#####)"), _TRC),
    (re.compile(rb"(?im)^\s*(date \w+ |base\s+(hex|dec)|begin\s+triggerblock)"), _ASC),
    (MARK, _BUSMASTER),
    (re.compile(rb'\s*(VERSION\s+"|NS_\s*:|BO_ \d)'), OtherFormat("a DBC file")),
    (
        re.compile(rb"(?m)^\s*(\([\d.: -]+\)\s+)?\w+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]"),
        OtherFormat("candump's screen output (without -L)", "record with `candump -L`, which writes exact times"),
    ),
)


def chosen_format(path: Path, head: bytes) -> LogFormat:
    """Return the format of a log, by its suffix or else by its content.

    Raises RecordingError if its content contradicts its suffix, or is of no known format.
    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes and suffixes[-1] == ".gz":
        suffixes.pop()
    last = suffixes[-1] if suffixes else ""
    by_suffix = next((known for known in LOG_FORMATS if last in known.suffixes), None)
    detected = _detected(head)
    if detected is None and by_suffix is not None:
        return by_suffix
    if isinstance(detected, LogFormat) and (by_suffix is None or set(by_suffix.suffixes) & set(detected.suffixes)):
        return detected
    if detected is None:
        what = "neither its suffix nor its content is of a known log format"
        faults = [Fault(what, str(path), f"begins with {head[:40]!r}", next_step="export it in one of these formats")]
        faults += [Fault(f"it is not {known.name}", expected=" or ".join(known.suffixes)) for known in LOG_FORMATS]
        raise RecordingError(*faults)
    if isinstance(detected, LogFormat):
        advice = f"rename it to end in {detected.suffixes[0]}"
    else:
        advice = detected.advice or "wheelsoil reads " + ", ".join(known.name for known in LOG_FORMATS)
    named = f"a name for {by_suffix.name}" if by_suffix else "no name of a log"
    raise RecordingError.of(f"this looks like {detected.name}", path, named, next_step=advice)


def open_log(path: Path, columns: FrameColumns | None = None) -> tuple[io.BufferedReader, LogFormat]:
    """Open a log, unpacked where it is gzipped, and find its format: a table of frames where `columns` are given.

    Raises RecordingError if there is no such file, it is empty, or is no log.
    """
    try:
        file = unpacked(path, _HEAD_BYTES)
        head = file.peek()
    except FileNotFoundError:
        raise no_such_file(path) from None
    except OSError as error:
        raise RecordingError.of(
            "the log cannot be read", path, error.strerror or str(error), "", "check the path and its permissions"
        ) from None
    try:
        if not head:
            what = (isinstance(file.raw, Gunzip) and file.raw.damage) or "the log is empty"
            raise RecordingError.of(what, path, next_step="copy it again, or record it again")
        known = (
            replace(_CSV, read=partial(read_frame_table, columns=columns))
            if columns is not None
            else chosen_format(path, head)
        )
        if isinstance(file.raw, Gunzip) and known is _MF4:
            raise RecordingError.of("a gzipped MF4 file", path, next_step="unpack it with gunzip")
    except RecordingError:
        file.close()
        raise
    return file, known


def is_frame_log(path: Path) -> bool:
    """Return whether the content of a file is that of a log of frames."""
    with unpacked(path, _HEAD_BYTES) as file:
        return isinstance(_detected(file.peek()), LogFormat)


def no_such_file(path: Path) -> RecordingError:
    """Return the error of a file that is not there, with names that are."""
    names = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
    return RecordingError.of("no such file", path, "", nearest(path.name, names) if names else "", "check the path")


def _detected(head: bytes) -> LogFormat | OtherFormat | None:
    for magic, meaning in _MAGIC:
        if head.startswith(magic):
            return meaning
    if any(LINE.match(line) for line in head.splitlines()[:500]):
        return _CANDUMP
    if is_frame_table(head):
        return _CSV
    for pattern, meaning in _TEXT:
        if pattern.search(head[:4096]):
            return meaning
    return None


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


def read_log(path: str | Path, *, batch_frames: int = 65_536, columns: FrameColumns | None = None) -> LogReading:
    """Read a CAN log: candump -L, BLF, ASC, TRC, MF4, CSV or BusMaster, the text ones and BLF gzipped too.

    Times are UTC where the log has a date (ASC, TRC and BLF dates are taken for UTC); otherwise they count from the
    logger's own zero, and ``report.absolute_time`` is False. Frames stay in the order of the file. What cannot be read
    is excluded, and counted in the report.

    Buses are called as in the log (candump), ``can0`` for the first channel of BLF, ASC and TRC, as python-can does,
    ``can<BusChannel>`` in MF4, and as the column of a CSV says, or ``can0``.

    Parameters
    ----------
    path : str or Path
    batch_frames : int
        Frames in a batch, at most; small pieces of a log are joined.
    columns : FrameColumns, optional
        Of a table whose header is of no known program.

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
    file, known = open_log(place, columns)
    file.close()  # opened again when it is read: a reading that nobody starts holds no file open
    report = LogReport(str(place), known.name)

    def batches() -> Iterator[FrameBatch]:
        file, _ = open_log(place, columns)
        with (
            file,
            every_error_as(RecordingError, "the log cannot be read", lambda: f"{place}, after frame {report.frames}"),
        ):
            yield from _regrouped(_guarded(known.read(file, report), file, report), batch_frames)
        report.close()
        if not report.frames:
            raise _nothing_readable(report)

    return LogReading(batches(), report)


def _guarded(batches: Iterator[FrameBatch], file: io.BufferedReader, report: LogReport) -> Iterator[FrameBatch]:
    """Report how far the reading is, and a gzipped file that is cut off; any failure of the disk is an error."""
    raw = file.raw
    try:
        for batch in batches:
            if not file.closed:
                report.share = share_of_file(file)
            yield batch
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError.of("the log cannot be read any further", report.path, str(error)) from None
    if isinstance(raw, Gunzip) and raw.damage:
        report.damage = raw.damage
        report.file_bytes.come("bytes", raw.unread_bytes())
        report.file_bytes.lose("of the packed file behind the damage", raw.unread_bytes())


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
    found = "; ".join(report.remarks()) or "no line that looks like a frame"
    step = "check that this is the right file; wheelsoil names a format by the file's suffix"
    return RecordingError.of(f"no frame could be read as {report.format}", report.path, found, next_step=step)
