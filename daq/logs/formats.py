"""Which reader reads what: by suffix, checked against what the file looks like."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from daq.errors import Fault, RecordingError, nearest
from daq.frames import FrameBatch
from daq.logs.blf import read_blf
from daq.logs.candump import LINE, read_candump
from daq.logs.gunzip import MAGIC, Gunzip
from daq.logs.mf4 import read_mf4
from daq.logs.report import LogReport
from daq.logs.text import read_asc, read_csv, read_trc

Reader = Callable[[BinaryIO, LogReport], Iterator[FrameBatch]]
_HEAD_BYTES = 64 << 10


@dataclass(frozen=True)
class LogFormat:
    """A log format that can be read: its name, the suffixes it goes by, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    read: Reader


LOG_FORMATS = (
    LogFormat("candump -L text", (".log", ".candump"), read_candump),
    LogFormat("Vector BLF", (".blf",), read_blf),
    LogFormat("Vector ASC", (".asc",), read_asc),
    LogFormat("PEAK TRC", (".trc",), read_trc),
    LogFormat("MF4 (ASAM MDF 4)", (".mf4",), read_mf4),
    LogFormat("python-can CSV", (".csv",), read_csv),
)
_CANDUMP, _BLF, _ASC, _TRC, _MF4, _CSV = LOG_FORMATS
LOG_SUFFIXES = tuple(suffix for known in LOG_FORMATS for suffix in known.suffixes)
"""Suffixes of logs; each may be followed by ``.gz``, except for MF4."""

_MAGIC: tuple[tuple[bytes, LogFormat | str], ...] = (
    (b"LOGG", _BLF),
    (b"MDF     4", _MF4),
    (b"UnFinMF 4", _MF4),
    (b"MDF     ", "an MDF file older than version 4"),
    (b"\x89MCAP", "an MCAP recording"),
    (b"SQLite format 3", "an SQLite database"),
    (b"PAR1", "a Parquet file"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\xd4\xc3\xb2\xa1", "a packet capture (pcap)"),
    (b"\x0a\x0d\x0d\x0a", "a packet capture (pcapng)"),
    (b"\x89HDF", "an HDF5 file"),
    (b"MATLAB 5.0", "a MAT file"),
)
_TEXT: tuple[tuple[re.Pattern[bytes], LogFormat | str], ...] = (
    (re.compile(rb"\s*;\s*(\$FILEVERSION|#####)"), _TRC),
    (re.compile(rb"(?im)^\s*(date \w+ |base\s+(hex|dec)|begin\s+triggerblock)"), _ASC),
    (re.compile(rb"timestamp,arbitration_id,extended,remote,error,dlc,data"), _CSV),
    (re.compile(rb'\s*(VERSION\s+"|NS_\s*:|BO_ \d)'), "a DBC file"),
    (
        re.compile(rb"(?m)^\s*(\([\d.: -]+\)\s+)?\w+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]"),
        "candump's screen output (without -L)",
    ),
)


def chosen_format(path: Path, head: bytes) -> LogFormat:
    """Return the format of a log, by its suffix or else by what it looks like.

    Raises
    ------
    RecordingError
        If it looks like something else than its suffix says, or like nothing that can be read.
    """
    by_suffix = _by_suffix(path)
    seen = _look(head)
    if seen is None and by_suffix is not None:
        return by_suffix
    if isinstance(seen, LogFormat) and by_suffix in (None, seen):
        return seen
    if seen is None:
        faults = [Fault("no log format is known by this suffix, and it looks like none", str(path), _shown(head))]
        faults += [Fault(f"it is not {known.name}", expected=" or ".join(known.suffixes)) for known in LOG_FORMATS]
        raise RecordingError(*faults)
    if isinstance(seen, LogFormat):
        advice = f"rename it to end in {seen.suffixes[0]}"
    elif seen == "an MCAP recording":
        advice = "it needs no import: give it to the other commands as it is"
    elif seen.startswith("candump"):
        advice = "record with `candump -L`, which writes exact times"
    else:
        advice = "wheelsoil reads " + ", ".join(known.name for known in LOG_FORMATS)
    named = f"a name for {by_suffix.name}" if by_suffix else "no name of a log"
    text = seen.name if isinstance(seen, LogFormat) else seen
    raise RecordingError(Fault(f"this looks like {text}", str(path), named, next_step=advice))


def open_log(path: Path) -> tuple[io.BufferedReader, LogFormat]:
    """Open a log, unpacked where it is gzipped, and find its format.

    Raises
    ------
    RecordingError
        If there is no such file, it is empty, or is no log.
    """
    try:
        raw: Any = path.open("rb", buffering=0)
        file = io.BufferedReader(raw, _HEAD_BYTES)
        packed = file.peek().startswith(MAGIC)
        if packed:
            raw = Gunzip(file)
            file = io.BufferedReader(raw, _HEAD_BYTES)
        head = file.peek()
    except FileNotFoundError:
        names = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
        expected = nearest(path.name, names) if names else ""
        raise RecordingError(Fault("no such file", str(path), expected=expected, next_step="check the path")) from None
    except OSError as error:
        raise RecordingError(Fault("the log cannot be read", str(path), error.strerror or str(error))) from None
    try:
        if not head:
            raise RecordingError(Fault("the log is empty", str(path), next_step="record it again"))
        known = chosen_format(path, head)
        if packed and known is _MF4:
            raise RecordingError(Fault("a gzipped MF4 file", str(path), next_step="unpack it with gunzip"))
    except RecordingError:
        file.close()
        raise
    return file, known


def _by_suffix(path: Path) -> LogFormat | None:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes and suffixes[-1] == ".gz":
        suffixes.pop()
    last = suffixes[-1] if suffixes else ""
    return next((known for known in LOG_FORMATS if last in known.suffixes), None)


def _look(head: bytes) -> LogFormat | str | None:
    for magic, meaning in _MAGIC:
        if head.startswith(magic):
            return meaning
    if any(LINE.match(line) for line in head.splitlines()[:500]):
        return _CANDUMP
    for pattern, meaning in _TEXT:
        if pattern.search(head[:4096]):
            return meaning
    return None


def _shown(head: bytes) -> str:
    return f"begins with {head[:40]!r}"
