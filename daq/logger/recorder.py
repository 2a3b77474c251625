"""The files of a session: runs, and what comes between them.

A machine without a clock of its own learns the date after the logger has started. The session's time then goes on
evenly; the time of the next run begins with the right date.
"""

from __future__ import annotations

import os
import uuid
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from daq import Channel, ClockFit, Fault, HardwareError, RecordingError, RunInfo, VehicleConfig
from daq.can import Database, FrameBatch
from daq.host_clock import HostClock
from daq.logger.listener import Arrival
from daq.logger.run_files import BETWEEN_FOLDER, VEHICLE_KEY, FolderLock, RunFiles, new_run
from daq.recording import DecodedWriter, DiagnosticStatus, Event, PartWriter
from daq.recording.events import Severity
from daq.recording.part_writer import since, total
from daq.recording.sink import make_folder

BETWEEN_KEY = "between_runs"
"""In the ``run_start`` metadata: "yes" in a recording of what came between two runs."""
CLOCK = "clock"
CLOCK_STEPS = "clock_steps"
"""Name of the metadata record of the host's clock: the fit to GNSS time, see `ClockFit.as_metadata`, and its steps."""
_MB = 1_000_000
_MARKS_KEPT = 5


class RunClock:
    """Brings the session's times to those of a run that begins now.

    Attributes
    ----------
    shift_ns : int
        File time of the run less that of the session.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        clock.observe()
        self.shift_ns = clock.realtime_minus_monotonic_ns - clock.base_ns if clock.steps else 0

    @property
    def base_ns(self) -> int:
        """File time less monotonic time."""
        return self._clock.base_ns + self.shift_ns

    def now_ns(self) -> int:
        """Return file time."""
        return self._clock.now_ns() + self.shift_ns

    def frames(self, batch: FrameBatch) -> FrameBatch:
        """Return frames with the run's times."""
        if not self.shift_ns:
            return batch
        moved = FrameBatch(batch.frames.copy(), batch.buses)
        moved.frames["time_ns"] += self.shift_ns
        return moved

    def channels(self, decoded: Mapping[tuple[str, str], Channel]) -> Mapping[tuple[str, str], Channel]:
        """Return decoded channels with the run's times."""
        if not self.shift_ns:
            return decoded
        return {key: replace(channel, time_ns=channel.time_ns + self.shift_ns) for key, channel in decoded.items()}

    def steps(self) -> list[tuple[int, str]]:
        """Return every time the clock was set, in the run's time, and by how much."""
        return [(step.time_ns + self.shift_ns, f"{step.step_s:+.6f} s") for step in self._clock.steps]

    def as_metadata(self, fit: ClockFit | None) -> dict[str, str]:
        """Return the fit to GNSS time in the run's time, and every time the clock was set, for a metadata record."""
        metadata = {f"step.{number}": f"{step} at {at_ns}" for number, (at_ns, step) in enumerate(self.steps(), 1)}
        if fit is not None:
            offset_s, reference_ns = fit.offset_s + self.shift_ns * 1e-9, fit.reference_ns + self.shift_ns
            metadata |= replace(fit, offset_s=offset_s, reference_ns=reference_ns).as_metadata()
        return metadata


@dataclass(frozen=True)
class RecorderOptions:
    """What every file of a session has in common.

    Attributes
    ----------
    folder : Path
        Of the runs; what comes between them goes into a folder in it.
    attachments, metadata
        See `daq.recording.PartWriter`.
    databases : mapping bus -> databases, or None
        None: no decoded topics.
    lock : FolderLock, optional
        On `folder`.
    """

    vehicle: VehicleConfig
    folder: Path
    attachments: Mapping[str, bytes]
    metadata: Mapping[str, str]
    databases: Mapping[str, tuple[Database, ...]] | None
    lock: FolderLock | None = None


class Recorder:
    """Writes one run after the other; used by the main thread only.

    Without a first run it begins between runs. `base` is what is known of every run that a person starts; its id is
    that of a run without a name. `paths` and `runs` are all files and run ids so far; `begun_ns` is the file time at
    which this run, or the time between runs, began.

    `RecordingError` if the first file cannot be made; `HardwareError` from every method that writes, if the disk fails
    or is full.
    """

    def __init__(self, options: RecorderOptions, clock: HostClock, run: RunFiles | None, base: RunInfo) -> None:
        self._options = options
        self._clock = clock
        self._base = base
        self._session_id = uuid.uuid4().hex
        self._frames_before: dict[str, int] = {}
        self._bytes_before = 0
        self._drops: Mapping[str, int] = {}
        self._losses: Mapping[str, int] = {}
        self._clock_fit: ClockFit | None = None
        self._clock_metadata: dict[str, str] = {}
        self._marks: deque[Event] = deque(maxlen=_MARKS_KEPT)
        self._rotation_fault: Fault | None = None
        self.paths: list[Path] = []
        self.runs: list[str] = []
        self._begin(run, self._writer_of(run))

    @property
    def between(self) -> bool:
        """Whether it is between two runs."""
        return self._run is None

    @property
    def run_id(self) -> str:
        """Id of the run; empty between runs."""
        return "" if self._run is None else self._run.run.id

    @property
    def path(self) -> Path:
        """The file that is written."""
        return self._writer.path

    @property
    def part(self) -> int:
        """Number of the part that is written."""
        return self._writer.part

    @property
    def run_bytes(self) -> int:
        """What this run has written."""
        return self._writer.bytes_written

    @property
    def run_frames(self) -> int:
        """Frames of this run."""
        return sum(self._writer.frame_counts.values())

    @property
    def bytes_written(self) -> int:
        """What the session has written."""
        return self._bytes_before + self._writer.bytes_written

    @property
    def frame_counts(self) -> dict[str, int]:
        """Frames of the session, per bus."""
        return total([self._frames_before, self._writer.frame_counts])

    @property
    def marks(self) -> tuple[Event, ...]:
        """The last few marks."""
        return tuple(self._marks)

    def now_ns(self) -> int:
        """Return the time now, as the file tells it."""
        return self._time.now_ns()

    def write(self, arrival: Arrival) -> None:
        """Write frames."""
        batch, offset_ns = self._time.frames(arrival.batch), arrival.realtime_minus_monotonic_ns
        self._writer.write_frames(batch)
        last_ns = int(batch.frames["time_ns"][-1])
        self._writer.host.write_clock(last_ns, arrival.bus, offset_ns, self._time.base_ns - offset_ns)
        self._note_part()

    def write_decoded(self, decoded: Mapping[tuple[str, str], Channel]) -> None:
        """Write decoded topics."""
        if self._view is not None:
            self._view.write(self._time.channels(decoded))

    def write_health(self, time_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Write the health statuses."""
        self._writer.host.write_diagnostics(time_ns + self._time.shift_ns, statuses)

    def event(self, name: str, text: str, severity: Severity = "info") -> None:
        """Write that something happened."""
        self._writer.host.write_event(Event(self.now_ns(), name, text, severity))

    def mark(self, text: str) -> None:
        """Put a mark into the file."""
        self._marks.append(Event(self.now_ns(), "mark", text))
        self._writer.host.write_event(self._marks[-1])
        self._writer.flush()

    def start(self, run_id: str) -> str:
        """Begin a run; a running one ends. Return a remark for the user, or nothing."""
        base = self._base.model_copy(update={"id": run_id or self._base.id})
        try:
            run = new_run(self._options.folder, base, self._options.vehicle)
        except RecordingError as error:
            return self._continues(error)
        return self._switch(run) or (run.remark if run_id else "")

    def stop(self) -> str:
        """End the run and record between runs; return a remark for the user, or nothing."""
        return "" if self.between else self._switch(None)

    def note_losses(self, drops: Mapping[str, int], losses: Mapping[str, int]) -> None:
        """Take the counts of the session's losses so far; see `daq.recording.PartWriter.note_losses`."""
        self._drops, self._losses = dict(drops), dict(losses)
        self._writer.note_losses(since(drops, self._drops_before), since(losses, self._losses_before))

    def note_clock(self, fit: ClockFit | None, more: Mapping[str, str]) -> None:
        """Take what is known of the host's clock; it is written into every run's last file."""
        self._clock_fit, self._clock_metadata = fit, dict(more)

    @property
    def flush_due_s(self) -> float:
        """In how many seconds it is time to flush."""
        return self._writer.flush_due_s

    def tick(self) -> None:
        """Flush, sync and rotate if it is time to."""
        self._writer.tick()
        self._note_part()

    def replace_lost_file(self) -> str:
        """Continue in another file where the current one was moved or removed; return a remark then, else nothing."""
        lost = self.path
        if not _is_gone(lost):
            return ""
        try:
            make_folder(lost.parent)
            self._writer.rotate()
        except (OSError, RecordingError, HardwareError) as error:
            return f"{lost.name} was moved or removed, and no other can be begun: {error}"
        self._note_part()
        text = f"{lost.name} was moved or removed while it was written: recording continues in {self.path.name}"
        try:
            if self._options.lock is not None:
                self._options.lock.renew()
        except HardwareError as error:
            text += f"; {error.faults[0].what}"
        self.event("part", text, "error")
        return text

    def folder_fault(self) -> str:
        """Return why no file can be made where the next part, run or time between runs begins; empty if one can."""
        if self._rotation_fault is not None:
            return f"{self._rotation_fault.what}: {self._rotation_fault.found}"
        folder = self._options.folder
        effective = os.access in os.supports_effective_ids
        for place in (folder, folder / BETWEEN_FOLDER):
            missing = place != self.path.parent and not place.exists()  # it is made when it is needed
            if not missing and not os.access(place, os.W_OK | os.X_OK, effective_ids=effective):
                return f"no file can be made in {place}"
        return ""

    def close(self, exit_status: str) -> None:
        """Close the file."""
        try:
            self._conclude()
        finally:
            self._writer.close(exit_status)

    def _begin(self, run: RunFiles | None, writer: PartWriter) -> None:
        """Write into this file from now on."""
        self._writer, self._run = writer, run
        self._view = None
        if self._options.databases is not None:
            self._view = DecodedWriter(writer, self._options.vehicle, self._options.databases)
        self._time = RunClock(self._clock)
        self.begun_ns = self.now_ns()
        self._drops_before, self._losses_before = self._drops, self._losses
        self.paths.append(writer.path)
        if run is not None:
            self.runs.append(run.run.id)
            self.event("run", run.remark or f"run {run.run.id!r} begins", "warning" if run.remark else "info")

    def _writer_of(self, run: RunFiles | None) -> PartWriter:
        options, logger = self._options, self._options.vehicle.logger
        metadata = {VEHICLE_KEY: options.vehicle.vehicle.name, **options.metadata}
        if run is None:
            folder = options.folder / BETWEEN_FOLDER
            try:
                make_folder(folder)
            except OSError as error:
                raise RecordingError.of("the folder cannot be made", folder, error.strerror or str(error)) from None
            run = new_run(folder, self._base.model_copy(update={"id": ""}), options.vehicle)
            metadata[BETWEEN_KEY] = "yes"
        return PartWriter(
            run.first,
            run=run.run,
            session_id=self._session_id,
            attachments=options.attachments,
            metadata=metadata,
            first_part=run.part,
            rotate_bytes=int(logger.rotate_mb * _MB),
            rotate_s=None if logger.rotate_min is None else logger.rotate_min * 60.0,
            flush_every_s=logger.flush_s,
            sync_every_s=logger.sync_s,
            decoded_rate_hz=logger.decoded_rate_hz,
            clock=lambda: self._clock.monotonic_ns() * 1e-9,
        )

    def _switch(self, run: RunFiles | None) -> str:
        """Open the next file, then close this one; where the next cannot be opened this one goes on."""
        old = self._writer
        try:
            following = self._writer_of(run)
        except (RecordingError, HardwareError) as error:
            return self._continues(error)
        try:
            self._conclude()
            old.close()
        finally:
            self._frames_before = total([self._frames_before, old.frame_counts])
            self._bytes_before += old.bytes_written
            self._begin(run, following)
        return ""

    def _continues(self, error: RecordingError | HardwareError) -> str:
        text = f"recording continues in {self.path.name}: {error.faults[0]}"
        self.event("run", text, "error")
        return text

    def _conclude(self) -> None:
        """Write the end of a run, and the fit and steps of the clock."""
        if self._run is not None:
            self.event("run", f"run {self.run_id!r} ends")
        metadata = self._time.as_metadata(self._clock_fit) | self._clock_metadata
        if metadata:
            self._writer.add_metadata(CLOCK, metadata)
        steps = {str(at_ns): step for at_ns, step in self._time.steps() if at_ns >= self.begun_ns}
        if steps:
            self._writer.add_metadata(CLOCK_STEPS, steps)

    def _note_part(self) -> None:
        """Write an event for a new part, or for the reason that there is none."""
        writer = self._writer
        if writer.path != self.paths[-1]:
            self.event("part", f"continues {self.paths[-1].name} in {writer.path.name}")
            self.paths.append(writer.path)
        if writer.rotation_fault != self._rotation_fault:
            self._rotation_fault = writer.rotation_fault
            if self._rotation_fault is not None:
                self.event("part", f"no new file can be begun: {self._rotation_fault}", "error")


def _is_gone(file: Path) -> bool:
    """Return whether a file is no longer where it was made; in a folder that may not be entered it counts as there."""
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    return False
