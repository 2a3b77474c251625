"""Logs of other programs -> one recording that needs no other file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from daq import DataError, Fault, RunInfo, VehicleConfig
from daq.can import Coverage, Database, Decoder, FrameBatch, coverage, no_bus_in_common
from daq.logs import FrameColumns, LogReport, read_log
from daq.logs.report import share_of_all
from daq.recording import DecodedWriter, whole_recording
from daq.runs.run import LENIENT_KEY, Configuration

_BATCH_FRAMES = 1 << 17


@dataclass(frozen=True)
class Imported:
    """Result of an import: the recording at `path`, and what came into it.

    Attributes
    ----------
    frames : mapping bus -> number of frames
    coverage : Coverage
        What the DBCs know of them.
    remarks : tuple of str
        What a user should know: of the logs, of lenient DBCs, of buses that do not match.
    """

    path: Path
    frames: dict[str, int]
    coverage: Coverage
    remarks: tuple[str, ...]


def import_logs(
    logs: Sequence[Path],
    target: Path,
    known: Configuration,
    *,
    run: RunInfo,
    rename_buses: Mapping[str, str] | None = None,
    columns: FrameColumns | None = None,
    view_rate_hz: float | None = 100.0,
    overwrite: bool = False,
    watch: Callable[[int, float], None] | None = None,
) -> Imported:
    """Write the frames of logs into a recording, in bounded memory.

    Parameters
    ----------
    logs : sequence of Path
        Parts of one run, in their order.
    target : Path
        The recording to write.
    known : Configuration
        What goes along: vehicle, terrain, DBCs.
    rename_buses : mapping, optional
        Name of a bus in the log to the name that vehicle.toml has for it.
    columns : FrameColumns, optional
        Of tables whose header is of no known program.
    view_rate_hz : float or None
        Rate of the decoded topics; None: raw frames only.
    watch : callable, optional
        Called after each batch with the number of frames and the share of the logs' bytes that have been read.

    Raises
    ------
    RecordingError
        A log cannot be read, or `target` cannot be written; nothing is left behind then.
    DataError
        A bus that is to be renamed is in none of the logs.
    """
    rename = dict(rename_buses or {})
    reports: list[LogReport] = []
    seen = Coverage()
    metadata = {"source": ", ".join(log.name for log in logs)} | ({LENIENT_KEY: "yes"} if known.lenient else {})
    with whole_recording(
        target,
        run=run,
        attachments=known.attachments,
        metadata=metadata,
        decoded_rate_hz=view_rate_hz,
        overwrite=overwrite,
    ) as writer:
        vehicle = known.vehicle or VehicleConfig()
        view = DecodedWriter(writer, vehicle, known.databases) if known.databases and view_rate_hz else None
        decoder = Decoder(known.databases)
        sizes = [log.stat().st_size if log.is_file() else 0 for log in logs]
        for batch in _batches(logs, rename, columns, reports):
            writer.write_frames(batch)
            seen = seen + coverage(batch, known.databases)
            if view:
                view.write(decoder.decode(batch))
            if watch:
                watch(sum(report.frames for report in reports), share_of_all(sizes, reports))
        _check_renamed(rename, reports)
    frames = writer.frame_counts
    return Imported(
        target, frames, seen, (*_remarks(reports, known, frames), *interruption_remarks(decoder.interrupted()))
    )


def _batches(
    logs: Sequence[Path], rename: Mapping[str, str], columns: FrameColumns | None, reports: list[LogReport]
) -> Iterator[FrameBatch]:
    for log in logs:
        reading = read_log(log, batch_frames=_BATCH_FRAMES, columns=columns)
        reports.append(reading.report)
        for batch in reading:
            yield replace(batch, buses=tuple(rename.get(name, name) for name in batch.buses)) if rename else batch


def _check_renamed(rename: Mapping[str, str], reports: Sequence[LogReport]) -> None:
    there = {bus for report in reports for bus in report.buses}
    missing = [bus for bus in rename if bus not in there]
    if missing:
        found = ", ".join(sorted(there))
        raise DataError(*(Fault(f"no log has a bus {bus!r}", found=found, expected="--bus old=new") for bus in missing))


def _remarks(reports: Sequence[LogReport], known: Configuration, frames: Mapping[str, int]) -> list[str]:
    lines = [f"{Path(report.path).name}: {line}" for report in reports for line in report.remarks()]
    lines += lenient_remarks(known.databases)
    vehicle = known.vehicle or VehicleConfig()
    if strangers := no_bus_in_common(vehicle, frames):
        lines.append(f"{strangers}: nothing can be decoded; name them alike with --bus old=new")
    else:
        missing = sorted({bus.channel for bus in vehicle.bus} - set(frames))
        lines += [f"bus {bus} of vehicle.toml has no frame in the log" for bus in missing]
    return lines


def interruption_remarks(interrupted: Mapping[str, int]) -> list[str]:
    """Return what became of messages of several frames that were not completed, a sentence each bus."""
    what = "messages of several frames were begun and not completed: they are lost"
    return [f"bus {bus}: {count:,} {what}" for bus, count in interrupted.items()]


def lenient_remarks(databases: Mapping[str, tuple[Database, ...]]) -> list[str]:
    """Return what lenient loads excluded, a sentence each, every file once."""
    files = {database.name: database for bus in databases.values() for database in bus}
    return [f"{name}: {line}" for name, database in files.items() for line in database.left_out]
