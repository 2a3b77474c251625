"""Recordings and logs: a summary of the content (`info`, provenance in a report) and the export of decoded signals."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from daq import (
    ROLES,
    Balance,
    Channel,
    ConfigError,
    Fault,
    FloatArray,
    IntArray,
    RunInfo,
    UncertainTimestamps,
    data_frame,
    file_name,
)
from daq.can import Coverage, Decoder, FrameBatch, FrameFlag, NoData, coverage, messages_by_bus, no_data_of
from daq.logger import is_being_recorded
from daq.logs import LogReading, LogReport, interruption_remarks, lenient_remarks
from daq.recording import DecodedWriter, Event, Gap, Recording, RecordingWriter, RunRecording, Topic
from daq.runs import LENIENT_KEY, MOST_MESSAGES, MessageFacts, Run, SignalTally, replaced_speed
from daq.series import Series, SeriesReport, draft_of, write_frame
from wheelsoil.console import say

Sample = tuple[str, str, IntArray, Mapping[str, FloatArray], Mapping[str, str]]
"""Bus, name, time stamps, values and units of a message."""

Watch = Callable[[int, float], None]
"""Takes the number of frames or rows and the share of the file that has been read."""

_BLOCK_BYTES = 1 << 20
_ALL_VALUES = NoData()
_NO_END, _NO_END_YET = "no end of the run", "still being recorded"


@dataclass(frozen=True)
class PartFacts:
    """What is known of one file of a run.

    Attributes
    ----------
    session : str
        The life of the logger that wrote it.
    exit_status : str
        Empty where the end of the file is missing.
    recording_now : bool
        Whether that is because a logger is writing it.
    """

    file: str
    bytes: int
    sha256: str
    frames: int
    start_ns: int | None
    end_ns: int | None
    session: str
    exit_status: str
    recording_now: bool
    loss: tuple[str, ...]


@dataclass(frozen=True)
class FileFacts:
    """What is known of one recording, in parts or not, or log.

    Attributes
    ----------
    kind : str
        "recording", "recording of decoded series", "recording without raw frames", or the file's format.
    sha256 : str
        Of a run in parts: that of all its files, concatenated.
    parts : tuple of PartFacts
        Files of a recording, in order; empty for a log or a file of series.
    gaps : tuple of Gap
        What was not recorded between two parts.
    vehicle, terrain : str
        Names; empty where nothing is known.
    wheels : tuple of str
        Ids of its instrumented wheels, where vehicle.toml gives them.
    frames, drops : mapping bus -> number
        `drops` only of the buses whose recorder counted them.
    losses : mapping str -> int
        What the logger counted: ``kernel.<bus>``, ``queue.<bus>``, ``counter.<bus>.<message>``,
        ``missing.<bus>.<message>``, ``wrapped.<bus>.<message>``.
    events : tuple of Event
        Marks and what else happened, in their order.
    unsure_frames : int
        Frames that came while the host's clock was set.
    unsure_within_s : float
        By how much their times can be wrong; NaN where that is not known.
    messages : tuple of MessageFacts
        What came of each message that the DBCs know (without any: of each identifier), or of each topic of decoded
        series, with its signals.
    clock, clock_steps : mapping str -> str
        Metadata records of these names: host against GNSS time, steps of the host's clock.
    databases : mapping bus -> names
    attachments : mapping name -> bytes
    balance : Balance or None
        Of a log or a file of series: what was read is what came out and what was lost, by name.
    loss, remarks : tuple of str
        What cannot be read; what else a user should know.
    """

    run_id: str
    file: str
    kind: str
    bytes: int
    sha256: str
    parts: tuple[PartFacts, ...]
    gaps: tuple[Gap, ...]
    info: RunInfo
    vehicle: str
    wheels: tuple[str, ...]
    terrain: str
    start_ns: int | None
    end_ns: int | None
    frames: dict[str, int]
    drops: dict[str, int]
    losses: dict[str, int]
    events: tuple[Event, ...]
    unsure_frames: int
    unsure_within_s: float
    clock: dict[str, str]
    clock_steps: dict[str, str]
    coverage: Coverage
    databases: dict[str, list[str]]
    attachments: dict[str, int]
    topics: tuple[Topic, ...]
    messages: tuple[MessageFacts, ...]
    written_by: str
    exit_status: str
    balance: Balance | None
    loss: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame; NaN without frames."""
        return float("nan") if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) * 1e-9

    @property
    def recording_now(self) -> bool:
        """Whether a logger is writing one of its files."""
        return any(part.recording_now for part in self.parts)

    def rate_hz(self, bus: str) -> float:
        """Return the mean frame rate of a bus; NaN where the duration is 0."""
        return self.frames[bus] / self.duration_s if self.duration_s > 0 else float("nan")


def file_facts(run: Run, watch: Watch | None = None) -> FileFacts:
    """Read a run's file once and return what is in it.

    Parameters
    ----------
    watch : callable, optional
        Called now and then with the number of frames and the share of the file that has been read.

    Raises
    ------
    RecordingError
        The file cannot be read.
    """
    tally = _tally(run, watch)
    recording = run.recording
    metadata = recording.metadata if recording else {}
    events = recording.events() if recording else ()
    parts = tuple(map(_part_facts, recording.parts)) if recording else ()
    remarks = lenient_remarks(run.databases)
    if tally.report is not None:
        remarks += tally.report.remarks()
    if role := replaced_speed(run.vehicle):
        remarks.append(f"{ROLES[role].name} computed from the commanded slip ({run.vehicle.signals['slip']})")
    remarks += interruption_remarks(tally.interrupted)
    if tally.messages.passed_over:
        remarks.append(f"more than {MOST_MESSAGES:,} messages: {tally.messages.passed_over:,} samples are not listed")
    return FileFacts(
        run_id=run.id,
        file=str(run.path),
        kind=_kind(run, tally),
        bytes=sum(file.stat().st_size for file in run.files),
        sha256=parts[0].sha256 if len(parts) == 1 else sha256_of(*run.files),
        parts=parts,
        gaps=recording.gaps if recording else (),
        info=run.info,
        vehicle=run.vehicle.vehicle.name if run.vehicle.bus or run.vehicle.wheel or run.vehicle.wheels else "",
        wheels=run.vehicle.wheel_ids,
        terrain=run.terrain.soil.name if run.terrain else "",
        start_ns=tally.start_ns,
        end_ns=tally.end_ns,
        frames=tally.frames,
        drops=recording.drops if recording else {},
        losses=recording.losses if recording else {},
        events=events,
        unsure_frames=tally.unsure.frames,
        unsure_within_s=tally.unsure.within_s,
        clock=metadata.get("clock", {}),
        clock_steps=metadata.get("clock_steps", {}),
        coverage=tally.coverage,
        databases={bus: [database.name for database in files] for bus, files in run.databases.items()},
        attachments={name: len(data) for name, data in recording.attachments.items()} if recording else {},
        topics=recording.topics if recording else (),
        messages=tally.messages.facts(),
        written_by=recording.library if recording else "",
        exit_status=_exit_status(recording, parts) if recording else "",
        balance=tally.report.balance if tally.report else None,
        loss=tuple(str(item) for item in recording.loss) if recording else (),
        remarks=tuple(remarks),
    )


def _kind(run: Run, tally: _Tally) -> str:
    if run.recording is None:
        return tally.report.format if tally.report else ""
    if run.recording.has_raw_frames:
        return "recording"
    return "recording of decoded series" if run.series else "recording without raw frames"


def _exit_status(recording: RunRecording, parts: Sequence[PartFacts]) -> str:
    if recording.exit_status or not recording.has_raw_frames:
        return recording.exit_status
    return _NO_END_YET if parts[-1].recording_now else _NO_END


def sha256_of(*paths: Path) -> str:
    """Return the hash of files, concatenated, in hexadecimal."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                digest.update(block)
    return digest.hexdigest()


def _part_facts(part: Recording) -> PartFacts:
    start_ns, end_ns = part.time_range_ns or (None, None)
    exit_status = part.metadata.get("run_end", {}).get("exit_status", "")
    return PartFacts(
        file=str(part.path),
        bytes=part.path.stat().st_size,
        sha256=sha256_of(part.path),
        frames=sum(part.frame_counts.values()),
        start_ns=start_ns,
        end_ns=end_ns,
        session=part.metadata.get("run_start", {}).get("session", ""),
        exit_status=exit_status,
        recording_now=not exit_status and is_being_recorded(part.path),
        loss=tuple(map(str, part.loss)),
    )


class _Tally:
    """Counts, times and losses of a file, collected while it is read."""

    def __init__(self) -> None:
        self.frames: dict[str, int] = {}
        self.coverage = Coverage()
        self.unsure = UncertainTimestamps()
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.report: LogReport | SeriesReport | None = None
        self.messages = SignalTally()
        self.interrupted: dict[str, int] = {}

    def span(self, time_ns: IntArray) -> None:
        """Stretch begin and end over these stamps."""
        if len(time_ns):
            first, last = int(time_ns.min()), int(time_ns.max())
            self.start_ns = first if self.start_ns is None else min(first, self.start_ns)
            self.end_ns = last if self.end_ns is None else max(last, self.end_ns)


def _tally(run: Run, watch: Watch | None) -> _Tally:
    tally = _Tally()
    if run.series:
        _tally_series(run.series, tally, watch)
        return tally
    if run.recording and not run.recording.has_raw_frames:
        tally.start_ns, tally.end_ns = run.recording.time_range_ns or (None, None)
        return tally
    batches = run.frame_batches()
    if isinstance(batches, LogReading):
        tally.report = batches.report
    if run.recording:
        tally.frames = dict.fromkeys(run.recording.buses, 0)
    decoder = Decoder(run.databases) if run.databases else None
    no_data = _no_data(run)
    for batch in batches:
        counts = np.bincount(batch.frames["bus"], minlength=len(batch.buses))
        for bus, count in zip(batch.buses, counts.tolist(), strict=True):
            tally.frames[bus] = tally.frames.get(bus, 0) + count
        tally.coverage = tally.coverage + coverage(batch, run.databases)
        tally.unsure.take(batch)
        tally.span(batch.frames["time_ns"])
        for bus, name, time_ns, values, units in _messages(batch, decoder):
            tally.messages.take(bus, name, time_ns, values, units, no_data.get((bus, name), {}))
        if decoder:
            tally.interrupted = decoder.interrupted()
        if watch:
            share = batches.report.share if isinstance(batches, LogReading) else _share(run, tally)
            watch(sum(tally.frames.values()), share)
    return tally


def _no_data(run: Run) -> dict[tuple[str, str], dict[str, NoData]]:
    """Return the `NoData` of each signal that has any, by bus and message."""
    found = {
        (bus, name): {signal.name: no_data_of(message, signal) for signal in message.by_name.values()}
        for bus, messages in messages_by_bus(run.databases).items()
        for name, message in messages.items()
    }
    return {key: {name: no_data for name, no_data in of.items() if no_data != _ALL_VALUES} for key, of in found.items()}


def _share(run: Run, tally: _Tally) -> float:
    """Return how much of a recording's time has been read."""
    first, last = (run.recording and run.recording.time_range_ns) or (0, 0)
    return 0.0 if tally.end_ns is None else (tally.end_ns - first) / max(last - first, 1)


def _tally_series(series: Series, tally: _Tally, watch: Watch | None) -> None:
    tally.report = series.report
    for blocks in series.blocks():
        for block in blocks:
            tally.messages.take("", block.topic, block.time_ns, block.columns, series.topics[block.topic])
            tally.span(block.time_ns)
        if watch:
            watch(sum(series.report.rows.values()), series.report.share)


def _messages(batch: FrameBatch, decoder: Decoder | None) -> Iterator[Sample]:
    """Yield the samples of each message of the DBCs, or of each identifier where there are none."""
    if decoder is None:
        yield from _identifiers(batch)
        return
    signals: dict[tuple[str, str], dict[str, Channel]] = {}
    for (bus, name), channel in decoder.decode(batch).items():
        message, _, signal = name.rpartition(".")
        signals.setdefault((bus, message), {})[signal] = channel
    for (bus, message), channels in signals.items():
        values = {name: channel.values for name, channel in channels.items()}
        units = {name: channel.unit for name, channel in channels.items()}
        yield bus, message, next(iter(channels.values())).time_ns, values, units


def _identifiers(batch: FrameBatch) -> Iterator[Sample]:
    frames = batch.frames[(batch.frames["flags"] & (FrameFlag.ERROR | FrameFlag.REMOTE)) == 0]
    extended = frames["flags"] & FrameFlag.EXTENDED
    key = frames["bus"].astype(np.int64) << 40 | extended.astype(np.int64) << 32 | frames["can_id"]
    order = np.argsort(key, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(key[order])) + 1):
        if len(rows):
            can_id, bus, is_extended = (int(column[rows[0]]) for column in (frames["can_id"], frames["bus"], extended))
            name = f"0x{can_id:08X}" if is_extended else f"0x{can_id:03X}"
            yield batch.buses[bus], name, frames["time_ns"][rows], {}, {}


def export_tables(
    run: Run,
    folder: Path,
    suffix: str,
    signals: Collection[str] | None = None,
    *,
    overwrite: bool = False,
    taken: set[str] | None = None,
) -> list[Path]:
    """Write a table for each bus and message of a run: ``<run>.<bus>.<message>.<suffix>``.

    Names that are the same in a file's name (buses ``can/0`` and ``can-0``) are numbered: ``run-1.can-0.Wheel-2.csv``.

    The decoded columns of one run are held in memory.

    Parameters
    ----------
    suffix : str
        ``parquet``, ``csv`` or ``mat``.
    signals : collection of "Message.Signal", optional
        All by default.
    taken : set of str, optional
        Names that are used already, where several runs are exported; those of this run are added.

    Raises
    ------
    ConfigError
        A file is there already; a signal is in no DBC.
    RecordingError, HardwareError
        The run cannot be read, or a table cannot be written.
    """
    decoder, measured = Decoder(run.databases, signals or None), _Measured(run)
    pieces: dict[tuple[str, str], dict[str, list[Channel]]] = {}
    for batch in run.frame_batches():
        for (bus, name), channel in measured.of(decoder.decode(batch)).items():
            message, _, signal = name.rpartition(".")
            pieces.setdefault((bus, message), {}).setdefault(signal, []).append(channel)
    taken = set() if taken is None else taken
    targets = {key: folder / _free_name(f"{run.id}.{key[0]}.{key[1]}", suffix, taken) for key in sorted(pieces)}
    _refuse_existing(targets.values(), overwrite=overwrite)
    measured.say()
    return [_write_table(targets[key], columns) for key, columns in pieces.items()]


def _free_name(name: str, suffix: str, taken: set[str]) -> str:
    """Return a file's name, numbered when it is taken, also where upper and lower case are the same."""
    plain = free = file_name(name)
    number = 2
    while f"{free}.{suffix}".casefold() in taken:
        free, number = f"{plain}-{number}", number + 1
    taken.add(f"{free}.{suffix}".casefold())
    return f"{free}.{suffix}"


def export_recording(run: Run, folder: Path, *, overwrite: bool = False, taken: set[str] | None = None) -> Path:
    """Write a recording with the raw frames and every decoded sample as a topic; `taken` as in `export_tables`.

    Raises
    ------
    RecordingError, HardwareError
        The run cannot be read, or the recording cannot be written.
    """
    target = folder / _free_name(run.id, "mcap", set() if taken is None else taken)
    if target.exists() and any(target.samefile(file) for file in run.files):
        raise ConfigError.of("the output is the run itself", target, next_step="choose another folder")
    _refuse_existing([target], overwrite=overwrite)
    with draft_of(target) as draft:
        writer = RecordingWriter(
            draft,
            run=run.info.model_copy(update={"file": target.name}),
            attachments=run.attachments,
            metadata={"source": run.path.name} | ({LENIENT_KEY: "yes"} if run.lenient else {}),
            flush_every_s=None,
            sync_every_s=None,
            decoded_rate_hz=None,
            overwrite=True,
        )
        with writer:
            topics, decoder = DecodedWriter(writer, run.vehicle, run.databases), Decoder(run.databases)
            measured = _Measured(run)
            for batch in run.frame_batches():
                writer.write_frames(batch)
                topics.write(measured.of(decoder.decode(batch)))
    measured.say()
    return target


class _Measured:
    """Takes from decoded channels what their sender says is no value, and counts it."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._none = {
            (bus, f"{name}.{signal}"): no_data
            for (bus, name), signals in _no_data(run).items()
            for signal, no_data in signals.items()
        }
        self._counts: Counter[tuple[str, str, str]] = Counter()

    def of(self, channels: Mapping[tuple[str, str], Channel]) -> dict[tuple[str, str], Channel]:
        """Return the channels, NaN where there is no value."""
        return {key: self._measured(key, channel) for key, channel in channels.items()}

    def _measured(self, key: tuple[str, str], channel: Channel) -> Channel:
        masks = self._none[key].masks(channel.values) if key in self._none else {}
        if not masks:
            return channel
        values = channel.values.copy()
        for word, mask in masks.items():
            values[mask] = np.nan
            self._counts[*key, word] += int(np.count_nonzero(mask))
        return replace(channel, values=values)

    def say(self) -> None:
        for (bus, name, word), count in self._counts.items():
            say(f"run {self._run.id}: {name} on {bus}: {count} without a value ({word}) left empty")


def _refuse_existing(targets: Iterable[Path], *, overwrite: bool) -> None:
    there = [path for path in targets if path.exists() and not overwrite]
    if there:
        raise ConfigError(
            *(Fault("the output exists already", str(path), next_step="another folder, or --force") for path in there)
        )


def _write_table(path: Path, columns: dict[str, list[Channel]]) -> Path:
    first = next(iter(columns.values()))
    table = {"time_ns": np.concatenate([piece.time_ns for piece in first])}
    table |= {name: np.concatenate([piece.values for piece in parts]) for name, parts in columns.items()}
    units = {name: parts[0].unit for name, parts in columns.items()}
    return write_frame(path, data_frame(table, {"time_ns": "ns", **units}))
