"""RunRecording: the recordings that are the parts of one run, read as if they were one."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, pairwise
from pathlib import Path
from typing import Self

from daq import DataError, Note, RecordingCode, RecordingError, RunInfo, nearest
from daq.can.frames import FrameBatch, concatenate, renumbered
from daq.recording import Event, Loss, Recording, Topic
from daq.recording.format import LOSSES, RUN_END, RUN_START
from daq.recording.part_writer import ROTATED, part_number, part_path, parts_on_disk, total
from daq.series.blocks import Series


@dataclass(frozen=True)
class Gap:
    """What was not recorded between two parts.

    Attributes
    ----------
    before, after : int
        Numbers of the parts.
    from_ns, to_ns : int
        Last frame of the one, first frame of the other.
    """

    before: int
    after: int
    from_ns: int
    to_ns: int

    def note(self) -> Note:
        """Return it as a note."""
        length_s = (self.to_ns - self.from_ns) * 1e-9
        code = RecordingCode.PARTS_OVERLAP if length_s < 0 else RecordingCode.PARTS_APART
        return Note(code, values={"before": self.before, "after": self.after, "length_s": abs(length_s)})


class RunRecording:
    """The recordings of one run, in order. Make one with `RunRecording.open`.

    Parameters
    ----------
    parts : sequence of Recording
        One at least.
    missing : sequence of Loss
        Parts that are absent or unreadable.
    unreadable : sequence of Path
        Files of the unreadable ones.
    """

    def __init__(
        self, parts: Sequence[Recording], missing: Sequence[Loss] = (), unreadable: Sequence[Path] = ()
    ) -> None:
        self.parts = tuple(parts)
        self.unreadable = tuple(unreadable)
        self._missing = tuple(missing)

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a recording, and with it the other parts of its run that lie beside it.

        Parameters
        ----------
        path : str or Path
            Any part. The others are found by their names (`part_path`) and must have the run's id.

        Raises
        ------
        RecordingError
            If none of the parts is there, or none is an MCAP file.
        """
        path = Path(path)
        first, own = part_number(path)
        files = parts_on_disk(first) or {own: path}
        opened: dict[int, Recording] = {}
        faults: dict[int, RecordingError] = {}
        for number, file in files.items():
            try:
                opened[number] = Recording.open(file)
            except RecordingError as error:
                faults[number] = error
        if not opened:
            raise faults.get(own, next(iter(faults.values())))
        if own in opened and not _belongs(opened[own], own, None):
            return cls([opened[own]], _renamed(opened[own]))
        run_id = _run_id(opened[own] if own in opened else next(iter(opened.values())))
        parts = {number: part for number, part in opened.items() if _belongs(part, number, run_id)}
        missing = [Loss(f"{files[number].name}: {error.faults[0].what}", 0, 0) for number, error in faults.items()]
        return cls([*parts.values()], missing + _gaps(first, parts, faults), [files[number] for number in faults])

    @property
    def path(self) -> Path:
        """The first part's file."""
        return self.parts[0].path

    @property
    def files(self) -> tuple[Path, ...]:
        """The file of every part."""
        return tuple(part.path for part in self.parts)

    @property
    def library(self) -> str:
        """What wrote the first file."""
        return self.parts[0].library

    @property
    def loss(self) -> tuple[Loss, ...]:
        """What cannot be read, part by part; see `Recording.loss`."""
        if len(self.parts) == 1:
            return (*self.parts[0].loss, *self._missing)
        return (
            *(replace(loss, what=f"{part.path.name}: {loss.what}") for part in self.parts for loss in part.loss),
            *self._missing,
        )

    @property
    def is_bare(self) -> bool:
        """Whether it was cut off before anything but a beginning was written."""
        return all(not part.contents.has_summary and not part.contents.chunks for part in self.parts)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Times between two parts that were not recorded: the logger died, and the later part was begun anew."""
        if len(self.parts) == 1:
            return ()
        filled = [(part, span) for part in self.parts if part.has_raw_frames and (span := part.time_range_ns)]
        return tuple(
            Gap(part_number(before.path)[1], part_number(after.path)[1], before_ns[1], after_ns[0])
            for (before, before_ns), (after, after_ns) in pairwise(filled)
            if before.metadata.get(RUN_END, {}).get("exit_status") != ROTATED
        )

    @property
    def has_raw_frames(self) -> bool:
        """Whether there are wheelsoil's raw topics."""
        return any(part.has_raw_frames for part in self.parts)

    @cached_property
    def buses(self) -> tuple[str, ...]:
        """Names of the buses, in the order of the ``bus`` column."""
        return tuple(dict.fromkeys(bus for part in self.parts for bus in part.buses))

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Every topic of any part, with the messages of all of them."""
        merged: dict[tuple[str, str], Topic] = {}
        for topic in (topic for part in self.parts for topic in part.topics):
            before = merged.get((topic.name, topic.schema_name))
            count = topic.message_count + (before.message_count if before else 0)
            merged[topic.name, topic.schema_name] = replace(before or topic, message_count=count)
        return tuple(merged.values())

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """Attached files by name; of several with one name the last part's."""
        return {name: data for part in self.parts for name, data in part.attachments.items()}

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata records by name; later values win.

        ``run_start`` is the first part's, ``run_end`` the last one's with the run's `drops`, ``losses`` are the run's.
        """
        if len(self.parts) == 1:
            return self.parts[0].metadata
        merged: dict[str, dict[str, str]] = {}
        for name, values in (pair for part in self.parts for pair in part.metadata.items()):
            before = merged.get(name, {})
            merged[name] = {**values, **before} if name == RUN_START else {**before, **values}
        merged.pop(RUN_END, None)
        if RUN_END in self.parts[-1].metadata:
            ended = self.parts[-1].metadata[RUN_END].items()
            drops = {f"drops.{bus}": str(count) for bus, count in self.drops.items()}
            own = {key: value for key, value in ended if not key.startswith(("frames.", "drops.", "total_"))}
            merged[RUN_END] = own | drops
        if LOSSES in merged:
            merged[LOSSES] = {key: str(count) for key, count in self.losses.items()}
        return merged

    @property
    def series(self) -> Series | None:
        """Decoded series of an imported file; None where the recording is of frames."""
        return self.parts[0].series

    @cached_property
    def run(self) -> RunInfo | None:
        """What is known of the run; None where no part says."""
        return next((part.run for part in self.parts if part.run is not None), None)

    @cached_property
    def drops(self) -> dict[str, int]:
        """Frames lost before they were recorded, per bus that counts them; of a cut-off part, as recorded last."""
        return total(_session_drops(session) for session in self._sessions())

    @cached_property
    def losses(self) -> dict[str, int]:
        """What the logger counted as lost, by kind, bus and message: the ``losses`` records of all its sessions."""
        return total(_session_losses(session) for session in self._sessions())

    @cached_property
    def exit_status(self) -> str:
        """How the last part ended; empty where it was cut off."""
        return self.parts[-1].metadata.get(RUN_END, {}).get("exit_status", "")

    @cached_property
    def time_range_ns(self) -> tuple[int, int] | None:
        """Time of the first and the last frame; None when there is none."""
        spans = [span for part in self.parts if (span := part.time_range_ns) is not None]
        return (min(span[0] for span in spans), max(span[1] for span in spans)) if spans else None

    @cached_property
    def frame_counts(self) -> dict[str, int]:
        """Frames per bus."""
        return dict.fromkeys(self.buses, 0) | total(part.frame_counts for part in self.parts)

    def events(self) -> tuple[Event, ...]:
        """Return the events of all parts; see `Recording.events`."""
        return tuple(event for part in self.parts for event in part.events())

    def frames(self, bus: str | None = None) -> FrameBatch:
        """Return all frames at once; see `frame_batches`."""
        batches = list(self.frame_batches(bus))
        return concatenate(batches) if batches else FrameBatch.empty(self.buses)

    def frame_batches(
        self, bus: str | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[FrameBatch]:
        """Return an iterator over the raw frames of one part after the other; see `Recording.frame_batches`.

        Raises
        ------
        RecordingError
            If no part is one of wheelsoil's.
        DataError
            If there is no such bus.
        """
        if bus is not None and self.has_raw_frames and bus not in self.buses:
            raise DataError.of(
                f"no bus is called {bus!r}", self.path, "", nearest(bus, self.buses), "`wheelsoil info` lists the buses"
            )
        if not self.has_raw_frames:
            return self.parts[0].frame_batches(bus)
        return self._chained(bus, start_ns, end_ns)

    def _chained(self, bus: str | None, start_ns: int | None, end_ns: int | None) -> Iterator[FrameBatch]:
        for part in self.parts:
            if part.has_raw_frames and bus in (None, *part.buses):
                for batch in part.frame_batches(bus, start_ns, end_ns):
                    yield batch if batch.buses == self.buses else FrameBatch(renumbered(batch, self.buses), self.buses)

    def _sessions(self) -> list[list[Recording]]:
        """Return the parts in groups, one for each session of the logger."""
        return [list(parts) for _, parts in groupby(self.parts, _session)]


def _session(part: Recording) -> str:
    return part.metadata.get(RUN_START, {}).get("session", "")


def _session_losses(parts: Sequence[Recording]) -> dict[str, int]:
    """Return the counts of the last ``losses`` record, which are since the session began."""
    last = next((part.metadata[LOSSES] for part in reversed(parts) if LOSSES in part.metadata), {})
    return {key: int(count) for key, count in last.items() if count.isdecimal()}


def _session_drops(parts: Sequence[Recording]) -> dict[str, int]:
    """Return the larger of what the last part (else all parts) states at its end, and of `_session_losses`."""
    ended = [part.metadata.get(RUN_END, {}) for part in parts]
    known = _counts(ended[-1], "total_drops.") or total(_counts(values, "drops.") for values in ended)
    lost = _session_losses(parts)
    for bus in {key.partition(".")[2] for key in lost if key.startswith(("kernel.", "queue."))}:
        known[bus] = max(known.get(bus, 0), lost.get(f"kernel.{bus}", 0) + lost.get(f"queue.{bus}", 0))
    return known


def _counts(values: Mapping[str, str], prefix: str) -> dict[str, int]:
    return {
        key.removeprefix(prefix): int(text)
        for key, text in values.items()
        if key.startswith(prefix) and text.isdecimal()
    }


def _run_id(part: Recording) -> str | None:
    try:
        return part.run.id if part.run else None
    except RecordingError:
        return None


def _belongs(part: Recording, number: int, run_id: str | None) -> bool:
    """Return whether a file may be this part of the run: it states no other run, and no other number."""
    stated = part.metadata.get(RUN_START, {}).get("part")
    own_id = _run_id(part)
    right_id = own_id is None or run_id is None or own_id == run_id
    return right_id and (number == 1 or stated == str(number) or RUN_START not in part.metadata)


def _gaps(first: Path, parts: Mapping[int, Recording], unreadable: Collection[int]) -> list[Loss]:
    """Return the parts that are not there although a later one is, or an earlier one names them."""
    there = {*parts, *unreadable}
    gaps = [Loss(f"{part_path(first, n).name} is missing", 0, 0) for n in range(1, max(there)) if n not in there]
    gaps += _renamed(parts[1]) if 1 in parts else []
    last = parts[max(parts)]
    following = last.metadata.get(RUN_END, {}).get("continued_in")
    if following and max(there) == max(parts):
        gaps.append(Loss(f"{following} is missing, in which the run continues", 0, 0))
    return gaps


def _renamed(part: Recording) -> list[Loss]:
    """Return the part before a renamed part, whose place among the others its name does not show."""
    before = part.metadata.get(RUN_START, {}).get("continues")
    return [Loss(f"{before} is missing, which {part.path.name} continues", 0, 0)] if before else []
