"""CSV as python-can writes it, through its reader, going on after a line that it cannot read."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING, BinaryIO

from daq.can.frames import FrameBatch, frames_from_messages
from daq.logs.report import LogReport

if TYPE_CHECKING:
    import can

_CHUNK = 8192
_UNREADABLE = (ValueError, IndexError, KeyError, TypeError, OverflowError)
_HEADER = "timestamp\n"


def read_csv(file: BinaryIO, report: LogReport) -> Iterator[FrameBatch]:
    """Yield the frames of a CSV file as python-can writes it; it names no bus, which is can0."""
    import can

    lines = _Lines(file, report)
    reader = can.CSVReader(lines)  # type: ignore[arg-type]  # it only iterates and closes
    return _batches(reader, lines)


class _Lines:
    """Lines of a text log for python-can's reader: counts them, and takes a line back in front."""

    def __init__(self, file: BinaryIO, report: LogReport) -> None:
        self._text = io.TextIOWrapper(file, encoding="utf-8", errors="replace")
        self.report = report
        self.number = 0
        self.current = ""
        self._pushed: list[str] = []

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        if self._pushed:
            return self._pushed.pop()
        self.current = next(self._text)
        self.number += 1
        return self.current

    def push(self, line: str) -> None:
        """Give this line before the next one of the file."""
        self._pushed.append(line)

    def note_bad(self) -> None:
        """Count the current line as unreadable."""
        self.report.note_bad(f"line {self.number}", self.current.strip()[:80])

    def close(self) -> None:
        """Close the file."""
        self._text.close()


def _batches(reader: can.CSVReader, lines: _Lines) -> Iterator[FrameBatch]:
    """Yield the messages of `reader` as frames.

    A line that cannot be read ends the generator of python-can's reader, but not the reader: the next generator goes
    on with the next line once it has been given a line where it expects the header.
    """
    report = lines.report
    try:
        iterator, ended, failed_at = iter(reader), False, 0
        while not ended:
            messages: list[can.Message] = []
            times: list[int] = []
            numbers: list[int] = []
            while len(messages) < _CHUNK:
                try:
                    message = next(iterator)
                    time_ns = round(message.timestamp * 1e6) * 1000  # its float seconds hold 0.24 us
                    if abs(time_ns) >= 1 << 62 or message.dlc < 0:
                        raise ValueError(message.timestamp)
                except StopIteration:
                    ended = True
                    break
                except _UNREADABLE:
                    if lines.number == failed_at:  # at the end of the file, the reader still misses its header
                        ended = True
                        break
                    failed_at = lines.number
                    lines.note_bad()
                    lines.push(_HEADER)
                    iterator = iter(reader)
                    continue
                messages.append(message)
                times.append(time_ns)
                numbers.append(lines.number)
            if messages:
                frames = frames_from_messages(messages, times, lambda _: report.bus("can0"))
                report.note_frames(frames, lambda i, numbers=numbers: f"line {numbers[i]}")  # type: ignore[misc]
                yield FrameBatch(frames, tuple(report.buses))
    finally:
        lines.close()
