"""PartWriter: a run in one recording after the other, without losing or doubling a frame between them.

The files of a run's parts are ``R.mcap``, ``R.part2.mcap``, ``R.part3.mcap``, ...
"""

from __future__ import annotations

import math
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypedDict, Unpack

from daq import Fault, HardwareError, RecordingError, RunInfo
from daq.can.frames import FrameBatch
from daq.recording.chunks import Compression
from daq.recording.decoded_topics import DecodedTopics
from daq.recording.events import HostTopics
from daq.recording.format import LOSSES
from daq.recording.writer import RecordingWriter

_EVERY_S = 1.0

ROTATED = "rotated"
"""Exit status of a part that another one follows."""

_PART_NAME = re.compile(r"(?P<first>.+)\.part(?P<number>[1-9]\d*)")

_RETRY_AFTER_S = 10.0


def total(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sum of counts, key by key."""
    summed = Counter[str]()
    for count in counts:
        summed.update(count)
    return dict(summed)


def since(now: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """Return by how much counts have grown."""
    return {key: count - before.get(key, 0) for key, count in now.items()}


class LossWriter:
    """Keeps counts of lost frames, and writes them as a metadata record when they change.

    `drops` are the frames lost before they were recorded, per bus, since the session's first part.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.drops: dict[str, int] = {}
        self._drops_before: dict[str, int] = {}
        self._losses: dict[str, int] = {}
        self._written: dict[str, int] = {}
        self._written_at = -math.inf

    @property
    def part_drops(self) -> dict[str, int]:
        """The drops of this part."""
        return since(self.drops, self._drops_before)

    def note(self, drops: Mapping[str, int] | None, losses: Mapping[str, int] | None) -> None:
        """Take what has been lost so far; what was noted last holds where nothing is given."""
        self.drops = self.drops if drops is None else dict(drops)
        self._losses = self._losses if losses is None else dict(losses)

    def write_if_due(self, writer: RecordingWriter) -> None:
        """Write changed counts, at most once a second."""
        if self._clock() - self._written_at >= _EVERY_S:
            self.write(writer)

    def write(self, writer: RecordingWriter) -> None:
        """Write the counts if they have changed."""
        if self._losses != self._written:
            writer.add_metadata(LOSSES, {key: str(count) for key, count in self._losses.items()})
            self._written, self._written_at = dict(self._losses), self._clock()

    def begin_part(self) -> None:
        """Start the counts of the next part."""
        self._drops_before, self._written = self.drops, {}


def part_path(first: Path, number: int) -> Path:
    """Return the file of a part: ``R.mcap``, ``R.part2.mcap``, ...; `first` is that of the first part."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number}{first.suffix}")


def part_number(path: Path) -> tuple[Path, int]:
    """Return the first part's file and the number of a part; ``(path, 1)`` where the name has no part number."""
    match = _PART_NAME.fullmatch(path.stem)
    if match is None or match["number"] == "1":
        return path, 1
    return path.with_name(match["first"] + path.suffix), int(match["number"])


def parts_on_disk(first: Path) -> dict[int, Path]:
    """Return the parts of a run that are there, by number, in order; RecordingError if the folder cannot be read."""
    try:
        found = [path for path in first.parent.iterdir() if path.name.startswith(first.stem)]
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise RecordingError.of("the folder cannot be read", first.parent, error.strerror or str(error)) from None
    numbered = {part_number(path)[1]: path for path in found if part_number(path)[0] == first}
    return dict(sorted(numbered.items()))


def next_part(first: Path) -> tuple[Path, int]:
    """Return the file and the number of the part that comes after those that are there.

    Raises RecordingError if the folder cannot be read.
    """
    number = max(parts_on_disk(first), default=0) + 1
    return part_path(first, number), number


class WriterOptions(TypedDict, total=False):
    """Options of a `RecordingWriter` that all parts share."""

    compression: Compression
    chunk_bytes: int
    flush_every_s: float | None
    sync_every_s: float | None
    decoded_rate_hz: float | None
    clock: Callable[[], float]


class PartWriter:
    """Writes a run into one recording after the other, each complete in itself.

    The next file is opened before the one before it is closed. Where it cannot be opened, the run goes on in the
    old one, `rotation_fault` says why, and it is tried again.

    Parameters
    ----------
    path : str or Path
        Of the first part; the others are named by `part_path`.
    session_id : str
        One for each life of a logger: counts are since the session's first part.
    attachments : mapping str -> bytes, optional
        Every part carries them.
    metadata : mapping str -> str, optional
        Goes into every ``run_start`` record.
    rotate_bytes, rotate_s : int, float or None
        A part that has grown by so much, or is so old, is followed by the next; None: never.
    first_part : int
        Number of the part to begin with, see `next_part`.
    **options
        Of `RecordingWriter`.

    Attributes
    ----------
    part : int
        Number of the part that is written now.

    Raises
    ------
    RecordingError
        If the first file is there already or cannot be made, or its name is that of a later part.
    HardwareError
        From any method, if the disk fails or is full. What was written before stays readable.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        run: RunInfo,
        session_id: str,
        attachments: Mapping[str, bytes] | None = None,
        metadata: Mapping[str, str] | None = None,
        rotate_bytes: int | None = None,
        rotate_s: float | None = None,
        first_part: int = 1,
        **options: Unpack[WriterOptions],
    ) -> None:
        self.first_path = Path(path)
        if part_number(self.first_path)[1] > 1:
            what = "a run cannot be called as a part of another run is"
            raise RecordingError.of(what, path, next_step='leave ".part" and the number out of its name')
        self._run = run
        self._attachments = dict(attachments or {})
        self._metadata = {**(metadata or {}), "session": session_id}
        self._rotate_bytes = rotate_bytes
        self._rotate_s = rotate_s
        self._options = options
        self._clock = options.get("clock", time.monotonic)
        self._closed = False
        self._frames_before: dict[str, int] = {}
        self._counts_hold = True
        self._bytes_before = 0
        self._lost = LossWriter(self._clock)
        self.rotation_fault: Fault | None
        before = part_path(self.first_path, first_part - 1).name if first_part > 1 else None
        self._begin(first_part, self._opened(first_part, before))

    @property
    def path(self) -> Path:
        """The file that is written now."""
        return self._writer.path

    @property
    def frame_counts(self) -> dict[str, int]:
        """Frames taken so far in all parts of this session, per bus."""
        return total([self._frames_before, self._writer.frame_counts])

    @property
    def bytes_written(self) -> int:
        """Size of all parts of this session so far."""
        return self._bytes_before + self._writer.bytes_written

    def write_frames(self, batch: FrameBatch) -> None:
        """See `RecordingWriter.write_frames`."""
        self._writer.write_frames(batch)
        self._rotate_if_due()

    @property
    def decoded(self) -> DecodedTopics:
        """Decoded topics of the file that is written now."""
        return self._writer.decoded

    @property
    def host(self) -> HostTopics:
        """Topics about the logger and its machine in the file that is written now."""
        return self._writer.host

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record to this part; a run's later values win over its earlier ones."""
        self._writer.add_metadata(name, values)

    def note_losses(self, drops: Mapping[str, int], losses: Mapping[str, int]) -> None:
        """Take the counts of lost frames so far; changes are written at most once a second.

        Parameters
        ----------
        drops : mapping str -> int
            Frames lost before they came here, per bus, since this writer was made.
        losses : mapping str -> int
            ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>``, ``wrapped.<bus>.<message>``,
            ``missing.<bus>.<message>``, since then.
        """
        self._lost.note(drops, losses)
        self._lost.write_if_due(self._writer)

    def flush(self) -> None:
        """See `RecordingWriter.flush`."""
        self._writer.flush()

    @property
    def flush_due_s(self) -> float:
        """See `RecordingWriter.flush_due_s`."""
        return self._writer.flush_due_s

    def tick(self) -> None:
        """Flush, sync and rotate if it is time to; call it when there is nothing to write."""
        self._writer.tick()
        self._rotate_if_due()

    def rotate(self) -> None:
        """Go on in the next part.

        Raises RecordingError or HardwareError if the next file cannot be opened: the run then goes on in the old one.
        """
        self._writer.flush()
        number = max([self.part, *parts_on_disk(self.first_path)]) + 1
        following = self._opened(number, self.path.name)
        old = self._writer
        self._frames_before = total([self._frames_before, old.frame_counts])
        self._counts_hold &= old.counts_hold
        self._bytes_before += old.bytes_written
        try:
            self._lost.write(old)
            old.close(ROTATED, self._lost.part_drops, {"continued_in": following.path.name})
        finally:
            self._begin(number, following)

    def close(
        self,
        exit_status: str = "ok",
        drops: Mapping[str, int] | None = None,
        losses: Mapping[str, int] | None = None,
    ) -> None:
        """Close the last part, whose ``run_end`` record also has the session's totals; a second call does nothing.

        Parameters
        ----------
        exit_status : str
            ``"ok"``, ``"interrupted"`` or what went wrong.
        drops, losses : mapping str -> int, optional
            See `note_losses`; what was noted last where nothing is given.
        """
        if self._closed:
            return
        self._closed = True
        self._lost.note(drops, losses)
        ended = {f"total_drops.{bus}": str(count) for bus, count in self._lost.drops.items()}
        if self._counts_hold and self._writer.counts_hold:
            ended |= {f"total_frames.{bus}": str(count) for bus, count in self.frame_counts.items()}
        try:
            self._lost.write(self._writer)
        finally:
            self._writer.close(exit_status, self._lost.part_drops, ended)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._closed = True
            self._writer.__exit__(kind, error, traceback)

    def _opened(self, number: int, before: str | None) -> RecordingWriter:
        started = {**self._metadata, "part": str(number)} | ({"continues": before} if before else {})
        return RecordingWriter(
            part_path(self.first_path, number),
            run=self._run.model_copy(update={"file": self.first_path.name}),
            attachments=self._attachments,
            metadata=started,
            **self._options,
        )

    def _begin(self, number: int, writer: RecordingWriter) -> None:
        self.part, self._writer = number, writer
        self._begun_at = self._clock()
        self._retry_at = self._begun_at
        self._begun_bytes = writer.bytes_written
        self.rotation_fault = None
        self._lost.begin_part()

    def _rotate_if_due(self) -> None:
        now = self._clock()
        grown = self._writer.bytes_written - self._begun_bytes
        big = self._rotate_bytes is not None and grown >= self._rotate_bytes
        old = self._rotate_s is not None and now - self._begun_at >= self._rotate_s
        if not (big or old) or now < self._retry_at:
            return
        part = self.part
        try:
            self.rotate()
        except (RecordingError, HardwareError) as error:
            if self._writer.failed or self.part != part:
                raise
            self.rotation_fault = error.faults[0]
            self._retry_at = now + _RETRY_AFTER_S
