"""Run: the frames of one run with everything that is known of it, wherever it came from."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from daq import ROLES, Channel, Note, RecordingCode, Severity, find_unit
from daq.can import Decoder, FrameBatch
from daq.can.databases import Database, load_database, load_for_vehicle, messages_by_bus, signals_of
from daq.can.roles import SignalRef, resolve_columns, resolve_roles, unused_validity
from daq.config import OfWheel, RunInfo, RunsConfig, StaticTest, TerrainConfig, VehicleConfig, load_toml, parse_toml
from daq.errors import ConfigError, DatabaseError, Fault, RecordingError, nearest
from daq.logs import LogReading, read_log
from daq.recording import RunRecording
from daq.runs.commanded_slip import CommandedSlip, replaced_speed, with_commanded_slip
from daq.series import Series, SeriesBlock, read_series
from daq.series.time_stamps import unstretched
from daq.zero_file import ZERO_FILE, Determination, carried_zeros, load_zeros, parse_zeros

if TYPE_CHECKING:
    import pandas as pd

VEHICLE_FILE, TERRAIN_FILE, RUNS_FILE = "vehicle.toml", "terrain.toml", "runs.toml"
LENIENT_KEY = "lenient_dbc"
"""In the ``run_start`` metadata of a recording: "yes" where its DBCs must be loaded leniently."""

_load_attached = lru_cache(maxsize=64)(load_database)
"""A campaign's recordings all carry the same DBCs."""


@dataclass(frozen=True)
class Configuration:
    """What is known of runs beside their frames; None where nothing is.

    Attributes
    ----------
    databases : mapping bus -> databases
        Of `vehicle`.
    attachments : mapping str -> bytes
        The files behind it, as a recording carries them: ``vehicle.toml``, ``terrain.toml`` and the DBCs under the
        names that vehicle.toml gives them.
    vehicle_source : str
        Where `vehicle` was read, for messages.
    static : tuple of StaticTest
        Of the same runs.toml as `runs`.
    """

    vehicle: VehicleConfig | None = None
    databases: Mapping[str, tuple[Database, ...]] = field(default_factory=dict)
    terrain: TerrainConfig | None = None
    runs: tuple[RunInfo, ...] | None = None
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    vehicle_source: str = VEHICLE_FILE
    static: tuple[StaticTest, ...] = ()

    def over(self, other: Configuration) -> Configuration:
        """Return this configuration; what it lacks (vehicle, terrain, or all of runs.toml) is from `other`."""
        vehicle, terrain = (self if self.vehicle else other), (self if self.terrain else other)
        carried = {name: data for name, data in vehicle.attachments.items() if name != TERRAIN_FILE}
        if TERRAIN_FILE in terrain.attachments:
            carried[TERRAIN_FILE] = terrain.attachments[TERRAIN_FILE]
        listing = self if self.runs is not None or self.static else other
        return Configuration(
            vehicle=vehicle.vehicle,
            databases=vehicle.databases,
            terrain=terrain.terrain,
            runs=listing.runs,
            attachments=carried,
            vehicle_source=vehicle.vehicle_source,
            static=listing.static,
        )

    @property
    def lenient(self) -> bool:
        """Whether a DBC was loaded leniently."""
        return any(database.lenient for databases in self.databases.values() for database in databases)


def vehicle_from_file(path: Path, *, lenient_dbc: bool = False) -> Configuration:
    """Read vehicle.toml, the DBCs it names and its zero file where there is one; raises as `load_for_vehicle`."""
    vehicle = load_toml(path, VehicleConfig)
    databases = load_for_vehicle(vehicle, path.parent, lenient=lenient_dbc)
    attachments = {VEHICLE_FILE: path.read_bytes()} | {
        name: database.content
        for bus in {bus.channel: bus for bus in vehicle.bus}.values()
        for name, database in zip(_names(vehicle, bus.channel), databases[bus.channel], strict=True)
    }
    attachments |= carried_zeros(vehicle, path.parent)
    return Configuration(vehicle, databases, attachments=attachments, vehicle_source=str(path))


def terrain_from_file(path: Path) -> Configuration:
    """Read terrain.toml."""
    return Configuration(terrain=load_toml(path, TerrainConfig), attachments={TERRAIN_FILE: path.read_bytes()})


def runs_from_file(path: Path) -> Configuration:
    """Read runs.toml."""
    found = load_toml(path, RunsConfig)
    return Configuration(runs=None if found.static and not found.run else found.run, static=found.static)


def from_recording(recording: RunRecording, beside: Configuration, *, lenient_dbc: bool = False) -> Configuration:
    """Return what a recording carries of vehicle and terrain; what `beside` already has is not read.

    Raises ConfigError if an attached file is wrong, or a DBC that vehicle.toml names is not attached.
    """
    carried = recording.attachments
    vehicle, terrain = None, None
    databases: dict[str, tuple[Database, ...]] = {}
    where = f"{recording.path}: {VEHICLE_FILE}"
    if VEHICLE_FILE in carried and beside.vehicle is None:
        vehicle = parse_toml(carried[VEHICLE_FILE].decode(errors="replace"), VehicleConfig, where)
        lenient = lenient_dbc or recording.metadata.get("run_start", {}).get(LENIENT_KEY) == "yes"
        databases = _attached_databases(vehicle, carried, where, lenient=lenient)
    if TERRAIN_FILE in carried and beside.terrain is None:
        text = carried[TERRAIN_FILE].decode(errors="replace")
        terrain = parse_toml(text, TerrainConfig, f"{recording.path}: {TERRAIN_FILE}")
    return Configuration(vehicle, databases, terrain, attachments=carried, vehicle_source=where)


@dataclass(frozen=True)
class Run:
    """One run. Frames and channels are read anew each time they are asked for.

    Attributes
    ----------
    path : Path
        The recording or log; of a run in parts the first.
    vehicle : VehicleConfig
        Empty where nothing is known.
    databases : mapping bus -> databases
    attachments : mapping str -> bytes
        The files behind the configuration, for a recording to carry.
    recording : RunRecording or None
        None for a log, or a file of decoded series.
    series : Series or None
        Where the run is of decoded series, not of frames.
    lenient : bool
        Whether a DBC was loaded leniently.
    vehicle_source : str
        Where `vehicle` was read, for messages.
    static : tuple of StaticTest
        Of the folder's runs.toml; they hold for all its runs.
    """

    id: str
    path: Path
    info: RunInfo
    vehicle: VehicleConfig
    terrain: TerrainConfig | None
    databases: Mapping[str, tuple[Database, ...]]
    attachments: Mapping[str, bytes]
    recording: RunRecording | None
    lenient: bool = False
    vehicle_source: str = VEHICLE_FILE
    series: Series | None = None
    static: tuple[StaticTest, ...] = ()

    def for_wheel(self, name: str | None = None) -> Run:
        """Return the run of one wheel: its configuration, and the rut readings and static tests of it.

        Parameters
        ----------
        name : str, optional
            Its id; not needed where the vehicle has one wheel.

        Raises
        ------
        ConfigError
            There is no such wheel, or there are several and none is named, or a reading does not say of which it is.
        """
        vehicle = with_commanded_slip(self.vehicle.for_wheel(name, self.vehicle_source))
        ids = self.vehicle.wheel_ids
        unclear = [
            fault for readings in (self.info.rut, self.static) for fault in _of_no_wheel(readings, ids, self.path)
        ]
        if unclear:
            raise ConfigError(*dict.fromkeys(unclear))
        own = ("", vehicle.wheel.id if vehicle.wheel else "")
        rut = tuple(reading for reading in self.info.rut if reading.wheel in own)
        static = tuple(test for test in self.static if test.wheel in own)
        # an unchanged `info` stays as it was read, so that every command finds the kept results of a run
        info = self.info if rut == self.info.rut else self.info.model_copy(update={"rut": rut})
        return replace(self, vehicle=vehicle, info=info, static=static)

    def by_wheel(self) -> dict[str, Run]:
        """Return the run of each wheel by its id, of a single ``[wheel]`` under its id or an empty text.

        Raises
        ------
        ConfigError
            See `for_wheel`; also where the recording was made with fewer wheels than the vehicle has.
        """
        ids = self.vehicle.wheel_ids
        carried = _carried_vehicle(self.recording) if len(ids) > 1 else None
        made_with = carried.wheel_ids or ("one [wheel]",) if carried else ids
        if len(made_with) < len(ids):
            raise ConfigError.of(
                f"the recording was made with {', '.join(made_with)}, and {self.vehicle_source} has more wheels",
                self.path,
                ", ".join(ids),
                next_step=f"name the wheel that it has: --wheel {ids[0]}; or omit --vehicle",
            )
        return {name: self.for_wheel(name or None) for name in ids or ("",)}

    @property
    def files(self) -> tuple[Path, ...]:
        """The log, or the recording's parts in order."""
        return self.recording.files if self.recording else (self.path,)

    def zeros(self, given: Path | None = None) -> tuple[tuple[Determination, ...], str]:
        """Return the determinations that the run is to be zeroed with, and where they were read; no frame is read.

        Parameters
        ----------
        given : Path, optional
            A zero file in place of the one that vehicle.toml names.

        Raises
        ------
        ConfigError
            It is wrong, or vehicle.toml names one that neither the recording carries nor lies beside it.
        """
        name = self.vehicle.transducer.zero_file
        attached = {**(self.recording.attachments if self.recording else {}), **self.attachments}
        if given is not None:
            return load_zeros(given).zero, str(given)
        if not name:
            return (), ZERO_FILE
        if name in attached:
            return parse_zeros(attached[name], f"{self.path}: {name}").zero, name
        raise ConfigError.of(
            f"no {name!r} lies beside vehicle.toml, which names it as its zero file, and the run carries none",
            self.vehicle_source,
            next_step=f"determine it (wheelsoil zero RECORDING{self.vehicle.wheel_option}), give --zero FILE, or take "
            "zero_file out of [transducer]",
        )

    def frame_batches(self) -> Iterator[FrameBatch]:
        """Yield the raw frames in bounded memory; none where the run is of decoded series. A log gives a `LogReading`.

        Raises
        ------
        RecordingError
            The file cannot be read any further, or holds no raw frames.
        """
        if self.series:
            return iter(())
        if self.recording:
            return self.recording.frame_batches()
        return read_log(self.path)

    def channel_batches(
        self,
        roles: Collection[str] = ROLES,
        watch: Callable[[FrameBatch], None] | None = None,
        frames: Iterator[FrameBatch] | None = None,
    ) -> Iterator[dict[str, Channel]]:
        """Yield the channels of some roles piece by piece, in bounded memory; see `channels`, also for its errors.

        Raw frames are decoded, and only the signals of these roles; decoded topics are not read. The first piece is
        empty, so that every role is known even where no frame ever came.

        Parameters
        ----------
        watch : callable, optional
            Is shown the frames that are decoded.
        frames : iterator of FrameBatch, optional
            The run's `frame_batches`, for who wants to know afterwards what was lost (`reading_notes`).
        """
        role = replaced_speed(self.vehicle)
        if role is None or role not in roles:
            yield from self._measured_batches(roles, watch, frames)
            return
        commanded = CommandedSlip(self.vehicle, role)
        for channels in self._measured_batches({*roles, *commanded.needs} - {role}, watch, frames):
            speed = commanded.speed(channels)
            found = channels | ({role: speed} if speed else {})
            yield {name: channel for name, channel in found.items() if name in roles}

    def _measured_batches(
        self,
        roles: Collection[str],
        watch: Callable[[FrameBatch], None] | None,
        frames: Iterator[FrameBatch] | None,
    ) -> Iterator[dict[str, Channel]]:
        if self.series:
            yield from self._series_batches(self.series, roles)
            return
        references = resolve_roles(self.vehicle, self.databases, (), roles)
        decoder = Decoder(self.databases, {reference.name for reference in references.values()})
        for batch in chain([FrameBatch.empty(tuple(self.databases))], frames or self.frame_batches()):
            if watch:
                watch(batch)
            decoded = decoder.decode(batch)
            yield {role: _in_our_units(reference, decoded[reference.key]) for role, reference in references.items()}

    def _series_batches(self, series: Series, roles: Collection[str]) -> Iterator[dict[str, Channel]]:
        references = resolve_columns(self.vehicle, series.topics, (), roles, source=self.path.name)
        empty = {
            reference.message: SeriesBlock(reference.message, np.zeros(0, np.int64), {})
            for reference in references.values()
        }
        for blocks in chain([tuple(empty.values())], series.blocks()):
            by_topic = {block.topic: block for block in blocks}
            channels = (
                _in_our_units(reference, _column(reference, by_topic[reference.message]))
                for reference in references.values()
                if reference.message in by_topic
            )
            yield unstretched({channel.name: channel for channel in channels}, self.vehicle.series, series.report)

    def reading_notes(self, frames: Iterator[FrameBatch] | None = None) -> list[Note]:
        """Return notes on what a reading of a log or of series lost, and what it read in one of two ways.

        `frames` are those of the log, see `frame_batches`.
        """
        reports = [self.series.report] if self.series else [frames.report] if isinstance(frames, LogReading) else []
        lost = [(Severity.DOUBT, text) for report in reports for text in report.losses()]
        read = [(Severity.REMARK, text) for report in reports for text in report.readings]
        return [Note(RecordingCode.READ, severity, {"text": text}) for severity, text in lost + read]

    def signal_notes(self) -> list[Note]:
        """Return notes on a validity of the ground speed without a role and on replaced units; raises as `channels`."""
        roles = set(ROLES) - {replaced_speed(self.vehicle)}
        if self.series:
            references = resolve_columns(self.vehicle, self.series.topics, (), roles, source=self.path.name)
            signals = {("", topic): tuple(units) for topic, units in self.series.topics.items()}
        else:
            references = resolve_roles(self.vehicle, self.databases, (), roles)
            signals = signals_of(self.databases)
        unused = unused_validity(references, signals)
        replaced = [
            Note(RecordingCode.UNIT_REPLACED, values={"role": role, "unit": of.unit, "written": of.replaced_unit})
            for role, of in references.items()
            if of.replaced_unit
        ]
        return replaced + ([Note(RecordingCode.VALIDITY_UNUSED, values={"signal": unused})] if unused else [])

    def scales(self, roles: Collection[str]) -> dict[str, str]:
        """Return what one bit of the signal of some roles is in SI, and what is added; nothing without DBCs.

        Raises as `channels`.
        """
        messages = messages_by_bus(self.databases)
        measured = {*roles} - {replaced_speed(self.vehicle)} if messages and not self.series else ()
        found = resolve_roles(self.vehicle, self.databases, (), measured).values()
        pairs = (
            (reference, messages[reference.bus][reference.message].by_name[reference.signal]) for reference in found
        )
        return {
            to.role: f"{bit.scale * to.si_factor:.9g} {to.si_unit} a bit, offset "
            f"{bit.offset * to.si_factor + to.si_offset:.9g}"
            for to, bit in pairs
        }

    def factors(self, roles: Collection[str]) -> dict[str, str]:
        """Return what vehicle.toml makes of one of the unit of a file of series, for some roles; nothing of frames.

        Raises as `channels`.
        """
        topics = self.series.topics if self.series else {}
        measured = {*roles} - {replaced_speed(self.vehicle)} if topics else ()
        found = resolve_columns(self.vehicle, topics, (), measured, source=self.path.name)
        written = {
            to.role: find_unit(topics[to.message][to.signal], ROLES[to.role].quantities) for to in found.values()
        }
        return {role: f"{found[role].si_factor / (of.factor if of else 1.0):.9g}" for role, of in written.items()}

    def channels(self, roles: Collection[str] = ROLES) -> dict[str, Channel]:
        """Return the channels of some roles in SI units, angles in radians, but positions in degrees.

        Parameters
        ----------
        roles : collection of str
            A role without a signal in vehicle.toml is omitted; the command that needs it reports that.

        Returns
        -------
        dict
            Role to channel, in order of time; empty where no frame carried the signal.

        Raises
        ------
        ConfigError
            A role that vehicle.toml has names no signal, or one with an unknown unit.
        RecordingError
            The file cannot be read.
        """
        pieces: dict[str, list[Channel]] = {}
        for batch in self.channel_batches(roles):
            for role, channel in batch.items():
                pieces.setdefault(role, []).append(channel)
        return {role: _joined(parts) for role, parts in pieces.items()}

    def to_frames(self, roles: Collection[str] = ROLES) -> dict[str, pd.DataFrame]:
        """Return the channels of some roles as frames, each with its own time stamps; raises as `channels` does.

        Returns
        -------
        dict
            Role to frame with the columns ``time_ns`` and, for instance, ``drawbar_pull_n``.
        """
        return {role: channel.to_frame() for role, channel in self.channels(roles).items()}


def recording_run(path: Path, given: Configuration, *, lenient_dbc: bool = False) -> Run:
    """Open a recording with all parts of its run; `given` overrides what it carries."""
    recording = RunRecording.open(path)
    if recording.is_bare:
        size = sum(file.stat().st_size for file in recording.files)
        what = "there is nothing in it: the file ends just after it was begun"
        raise RecordingError.of(what, path, f"{size:,} bytes", "", "drive it again, or take the file away")
    known = given.over(from_recording(recording, given, lenient_dbc=lenient_dbc))
    return _run(recording.path, known, recording.run, recording)


def log_run(path: Path, given: Configuration) -> Run:
    """Open a log of another program (its first bytes are read, so that a wrong file is known at once)."""
    next(read_log(path), None)
    return _run(path, given, None, None)


def series_run(path: Path, given: Configuration) -> Run:
    """Open a file of decoded series."""
    return replace(_run(path, given, None, None), series=read_series(path, (given.vehicle or VehicleConfig()).series))


def _run(path: Path, known: Configuration, info: RunInfo | None, recording: RunRecording | None) -> Run:
    names = [file.name for file in recording.files] if recording else [path.name]
    listed = [run for run in known.runs or () if Path(run.file).name in names]
    listed = listed or [run for run in known.runs or () if info and not run.file and run.id == info.id]
    info = listed[0] if listed else info or RunInfo()
    name = info.id or path.name.partition(".")[0]
    return Run(
        id=name,
        path=path,
        info=info.model_copy(update={"id": name, "file": path.name}),
        vehicle=with_commanded_slip(known.vehicle or VehicleConfig()),
        terrain=known.terrain,
        databases=known.databases,
        attachments=known.attachments,
        recording=recording,
        lenient=known.lenient,
        vehicle_source=known.vehicle_source,
        series=recording.series if recording else None,
        static=known.static,
    )


def _of_no_wheel(readings: Iterable[OfWheel], ids: Sequence[str], path: Path) -> Iterator[Fault]:
    """Yield what is wrong with the wheels that readings of runs.toml are of."""
    where = f"{RUNS_FILE}, {path.name}"
    for reading in readings:
        if reading.wheel and reading.wheel not in ids:
            what = f"a reading is of wheel {reading.wheel!r}, which vehicle.toml does not have"
            expected = nearest(reading.wheel, ids) if ids else "no wheel: its [wheel] has no id"
            yield Fault(what, where, expected=expected, next_step="correct it")
        elif not reading.wheel and len(ids) > 1:
            what, expected = "a reading does not say of which wheel it is", f'wheel = "{ids[0]}" or another'
            yield Fault(what, where, expected=expected, next_step="add it to each [[run.rut]] and [[static]]")


def _carried_vehicle(recording: RunRecording | None) -> VehicleConfig | None:
    """Return the vehicle.toml in a recording; None where there is none that can be read."""
    content = recording.attachments.get(VEHICLE_FILE) if recording else None
    try:
        return parse_toml(content.decode(errors="replace"), VehicleConfig, VEHICLE_FILE) if content else None
    except ConfigError:
        return None


def _attached_databases(
    vehicle: VehicleConfig, carried: Mapping[str, bytes], where: str, *, lenient: bool
) -> dict[str, tuple[Database, ...]]:
    names = list(dict.fromkeys(name for bus in vehicle.bus for name in bus.dbc))
    missing = [name for name in names if name not in carried]
    what, step = "the recording does not carry the DBC", "give a vehicle.toml with its DBCs beside it: --vehicle"
    DatabaseError.stop_if_any(Fault(f"{what} {n!r}", where, "", nearest(n, carried), step) for n in missing)
    loaded = {name: _load_attached(carried[name], name, lenient=lenient) for name in names}
    databases = {bus.channel: tuple(loaded[name] for name in _names(vehicle, bus.channel)) for bus in vehicle.bus}
    messages_by_bus(databases)
    return databases


def _column(reference: SignalRef, block: SeriesBlock) -> Channel:
    values = block.columns.get(reference.signal)
    if values is None:
        values = np.full(len(block), np.nan)
    return Channel(reference.name, reference.unit, block.time_ns, values)


def _in_our_units(reference: SignalRef, decoded: Channel) -> Channel:
    channel = reference.to_si(decoded)
    if ROLES[reference.role].in_degrees:
        return replace(channel, unit="deg", values=np.degrees(channel.values))
    return channel


def _names(vehicle: VehicleConfig, channel: str) -> list[str]:
    """Return the DBCs of a bus; vehicle.toml may describe it in several sections."""
    return [name for bus in vehicle.bus if bus.channel == channel for name in bus.dbc]


def _joined(parts: list[Channel]) -> Channel:
    time_ns = np.concatenate([part.time_ns for part in parts])
    values = np.concatenate([part.values for part in parts])
    if np.any(np.diff(time_ns) < 0):
        order = np.argsort(time_ns, kind="stable")
        time_ns, values = time_ns[order], values[order]
    return Channel(parts[0].name, parts[0].unit, time_ns, values, parts[0].labels)
