"""ASC, TRC and CSV through python-can's readers, going on after a line that they cannot read."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, BinaryIO

from daq.can.frames import FrameBatch, frames_from_messages
from daq.errors import RecordingError
from daq.logs.report import LogReport

if TYPE_CHECKING:
    import can

_CHUNK = 8192
_UNREADABLE = (ValueError, IndexError, KeyError, TypeError)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_GERMAN_MONTHS = {"mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_DATE = re.compile(
    r"\s*(?:date|begin\s+triggerblock)\s+\S+\s+(?P<month>\S+)\s+(?P<day>\d+)\s+"
    r"(?P<hour>\d+):(?P<minute>\d+):(?P<second>\d+)(?:\.(?P<fraction>\d{1,9})\d*)?\s*(?P<half>[ap]m)?\s+(?P<year>\d{4})",
    re.IGNORECASE,
)
_RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.IGNORECASE)


def read_asc(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a Vector ASC file; its dates have no time zone and are taken for UTC."""
    import can

    lines = _Lines(file, report)
    reader = can.ASCReader(lines, relative_timestamp=True)  # type: ignore[arg-type]  # it only iterates and closes

    def time_ns(seconds: float) -> int:
        return lines.start_ns + round(seconds * 1e9)

    return _batches(reader, lines, "internal events logged\n", time_ns, first_channel=0)


def read_trc(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a PEAK TRC file; the bus that it calls 1 is can0."""
    import can

    lines = _Lines(file, report)
    reader = can.TRCReader(lines)  # type: ignore[arg-type]
    return _batches(reader, lines, None, _whole_microseconds, first_channel=1)


def read_csv(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a CSV file as python-can writes it; it names no bus, so all are on can0."""
    import can

    lines = _Lines(file, report)
    reader = can.CSVReader(lines)  # type: ignore[arg-type]
    return _batches(reader, lines, "timestamp\n", _whole_microseconds, first_channel=0)


def _whole_microseconds(seconds: float) -> int:
    """Undo the noise of a date in float seconds, which is 0.24 us."""
    return round(seconds * 1e6) * 1000


class _Lines:
    """Lines of a text log for python-can's readers: counts them, looks for dates, and takes a line back in front."""

    def __init__(self, file: BinaryIO, report: LogReport) -> None:
        self._text = io.TextIOWrapper(file, encoding="utf-8", errors="replace")
        self.report = report
        self.number = 0
        self.start_ns = 0
        self.current = ""
        self._pushed: list[str] = []

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        if self._pushed:
            return self._pushed.pop()
        line = next(self._text)
        self.number += 1
        self.current = line
        if line[:1].isalpha():
            self._read_date(line)
        return line

    def push(self, line: str | None) -> None:
        """Give this line before the next one of the file."""
        if line is not None:
            self._pushed.append(line)

    def close(self) -> None:
        """Close the file."""
        self._text.close()

    def _read_date(self, line: str) -> None:
        if _RELATIVE.match(line):
            what, where = "an ASC file whose times are relative to the line before", f"line {self.number}"
            step = "export it again with absolute time stamps"
            raise RecordingError.of(what, f"{self.report.path}, {where}", line.strip(), "timestamps absolute", step)
        if match := _DATE.match(line):
            self.start_ns = _utc_ns(match)


def _utc_ns(match: re.Match[str]) -> int:
    name = match["month"].lower()
    month = _GERMAN_MONTHS.get(name, 0)
    if not month:
        # March is Mär in any encoding
        month = 3 if name[0] == "m" and name[-1] == "r" else _MONTHS.index(name[:3]) + 1 if name[:3] in _MONTHS else 0
    hour = int(match["hour"])
    if match["half"]:
        hour = hour % 12 + (12 if match["half"].lower() == "pm" else 0)
    day, minute, second = (int(match[key]) for key in ("day", "minute", "second"))
    try:
        start = datetime(int(match["year"]), month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return 0
    return int(start.timestamp()) * 10**9 + int((match["fraction"] or "0").ljust(9, "0"))


class _TrcWarnings(logging.Handler):
    """python-can's TRC reader logs a line that it cannot read instead of raising."""

    def __init__(self, lines: _Lines) -> None:
        super().__init__(logging.WARNING)
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        line = str(record.args[0]) if isinstance(record.args, tuple) and record.args else ""
        if record.msg.startswith("TRCReader: Failed") and line and not line.startswith(";"):
            _note_bad(self._lines)


def _batches(
    reader: can.ASCReader | can.TRCReader | can.CSVReader,
    lines: _Lines,
    resume: str | None,
    time_ns: Callable[[float], int],
    first_channel: int,
) -> Iterator[FrameBatch]:
    """Yield the messages of `reader` as frames.

    A line that cannot be read ends the generator of python-can's reader, but not the reader: the next generator goes
    on with the next line once it has been given the `resume` line where it expects a header.
    """
    report = lines.report
    logger, complaints = logging.getLogger("can.io"), _TrcWarnings(lines)
    logger.addHandler(complaints)

    def bus(message: can.Message) -> int:
        return report.bus(_bus_name(message.channel, first_channel))

    try:
        iterator, ended, failed_at = iter(reader), False, 0
        while not ended:
            messages: list[can.Message] = []
            times: list[int] = []
            numbers: list[int] = []
            while len(messages) < _CHUNK:
                try:
                    message = next(iterator)
                except StopIteration:
                    ended = True
                    break
                except NotImplementedError as error:
                    what = "python-can cannot read this version"
                    raise RecordingError.of(what, report.path, str(error)) from None
                except _UNREADABLE:
                    if lines.number == failed_at:  # at the end of the file, the reader still misses its header
                        ended = True
                        break
                    failed_at = lines.number
                    _note_bad(lines)
                    lines.push(resume)
                    iterator = iter(reader)
                    continue
                messages.append(message)
                times.append(time_ns(message.timestamp))
                numbers.append(lines.number)
            if messages:
                frames = frames_from_messages(messages, times, bus)
                report.note_frames(frames, lambda i, numbers=numbers: f"line {numbers[i]}")  # type: ignore[misc]
                yield FrameBatch(frames, tuple(report.buses))
    finally:
        logger.removeHandler(complaints)
        lines.close()


def _bus_name(channel: object, first_channel: int) -> str:
    if channel is None:
        return "can0"
    return f"can{max(channel - first_channel, 0)}" if isinstance(channel, int) else str(channel)


def _note_bad(lines: _Lines) -> None:
    lines.report.note_bad(f"line {lines.number}", lines.current.strip()[:80])
