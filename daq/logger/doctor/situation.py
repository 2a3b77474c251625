"""The inputs of all checks, gathered once, and one line of the doctor: what was found, how bad it is, what to do."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from daq import BusSection, Channel, VehicleConfig, check_logging, load_toml
from daq.can import Decoder, FrameBatch, SignalRef, concatenate, split
from daq.can.databases import Database, load_for_vehicle
from daq.errors import ConfigError, DatabaseError, Fault
from daq.host_clock import monotonic_ns, realtime_ns
from daq.logger.doctor.links import Link, Reception, is_socketcan, listen, read_link
from daq.logger.health.watched_messages import usable_roles
from daq.recording import DecodedWriter, RecordingWriter


class Verdict(StrEnum):
    """Fail: the recording would not be made, or could not be used. Warn: something may go wrong."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Line:
    """What a check found at one place.

    Attributes
    ----------
    where : str
        The bus, the file, the role; may be empty.
    next_step : str
        What to do; empty where it is well.
    check : str
        Name of the check; `daq.logger.doctor.examine` fills it in.
    """

    verdict: Verdict
    where: str
    found: str
    next_step: str = ""
    check: str = ""


def passed(where: str, found: str) -> Line:
    """Return a line for what is well."""
    return Line(Verdict.PASS, where, found)


def warned(where: str, found: str, next_step: str) -> Line:
    """Return a line for what may go wrong."""
    return Line(Verdict.WARN, where, found, next_step)


def failed(where: str, found: str, next_step: str) -> Line:
    """Return a line for what is wrong."""
    return Line(Verdict.FAIL, where, found, next_step)


def from_fault(fault: Fault, where: str = "") -> Line:
    """Return a failed line that reports a fault."""
    details = [text for text in (fault.found, fault.expected) if text]
    found = fault.what + (f" ({'; '.join(details)})" if details else "")
    return failed(where or fault.where, found, fault.next_step or "see the text before")


@dataclass(frozen=True)
class Situation:
    """A vehicle's logger before a test.

    Attributes
    ----------
    vehicle_file, out : Path
        ``out`` is the folder to record into; it need not be there.
    page_port : int
        Of the status page.
    vehicle : VehicleConfig
        Empty where the file cannot be used.
    databases, receptions : mapping
        By bus.
    links : mapping bus -> Link
        Of the buses that are SocketCAN's.
    roles, channels : mapping
        By role, with the wheel of several; what was received of each, in SI units.
    clock_moved_s : float
        By how much the host's clock was set meanwhile.
    bytes_per_s : float
        How fast a recording of what was received grows; 0 where nothing was.
    """

    vehicle_file: Path
    out: Path
    page_port: int
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    vehicle_faults: tuple[Fault, ...] = ()
    database_faults: tuple[Fault, ...] = ()
    role_faults: tuple[Fault, ...] = ()
    databases: Mapping[str, tuple[Database, ...]] = field(default_factory=dict)
    roles: Mapping[str, SignalRef] = field(default_factory=dict)
    links: Mapping[str, Link] = field(default_factory=dict)
    receptions: Mapping[str, Reception] = field(default_factory=dict)
    channels: Mapping[str, Channel] = field(default_factory=dict)
    clock_moved_s: float = 0.0
    bytes_per_s: float = 0.0

    @property
    def sections(self) -> dict[str, BusSection]:
        """The buses by their channels."""
        return {bus.channel: bus for bus in self.vehicle.bus}

    @property
    def folder(self) -> Path:
        """Where the recordings go, or the nearest folder above it that is there."""
        out = self.out.absolute()
        return next(folder for folder in (out, *out.parents) if folder.is_dir())


def gather(
    vehicle_file: Path,
    out: Path,
    listen_s: float,
    page_port: int,
    *,
    about_to_listen: Callable[[], None] | None = None,
) -> Situation:
    """Load the files, query the interfaces, listen to the buses; `about_to_listen` is called where there are any.

    Raises
    ------
    ConfigError
        There is no such file, or this system cannot log (Windows). Faults inside the file are reported by the checks.
    """
    check_logging()
    if not vehicle_file.is_file():
        raise ConfigError.of("no such file", vehicle_file, next_step="check the path")
    try:
        vehicle = load_toml(vehicle_file, VehicleConfig)
    except ConfigError as error:
        return Situation(vehicle_file, out, page_port, vehicle_faults=error.faults)
    databases: dict[str, tuple[Database, ...]] = {}
    roles: dict[str, SignalRef] = {}
    database_faults: tuple[Fault, ...] = ()
    role_faults: dict[str, Fault] = {}
    try:
        databases = load_for_vehicle(vehicle, vehicle_file.parent)
        for wheel in vehicle.each_wheel:
            usable, faults = usable_roles(wheel, databases)
            roles |= {wheel.named(role): reference for role, reference in usable.items()}
            role_faults |= {wheel.named(role): fault for role, fault in faults.items()}
    except DatabaseError as error:
        database_faults = error.faults
    sections = {bus.channel: bus for bus in vehicle.bus}
    links = {name: read_link(name) for name, section in sections.items() if is_socketcan(section)}
    apart_ns = realtime_ns() - monotonic_ns()
    if sections and about_to_listen:
        about_to_listen()
    receptions = listen(sections, vehicle.logger, listen_s)
    moved_s = (realtime_ns() - monotonic_ns() - apart_ns) * 1e-9
    return Situation(
        vehicle_file,
        out,
        page_port,
        vehicle,
        database_faults=database_faults,
        role_faults=tuple(role_faults.values()),
        databases=databases,
        roles=roles,
        links=links,
        receptions=receptions,
        channels=_channels(roles, databases, [reception.frames for reception in receptions.values()]),
        clock_moved_s=moved_s,
        bytes_per_s=_growth(vehicle, databases, receptions),
    )


def _channels(
    roles: Mapping[str, SignalRef], databases: Mapping[str, tuple[Database, ...]], batches: list[FrameBatch]
) -> dict[str, Channel]:
    decoder = Decoder(databases, {reference.name for reference in roles.values()})
    decoded = decoder.decode(concatenate([FrameBatch.empty(tuple(databases)), *batches]))
    return {role: reference.to_si(decoded[reference.key]) for role, reference in roles.items()}


def _growth(
    vehicle: VehicleConfig, databases: Mapping[str, tuple[Database, ...]], receptions: Mapping[str, Reception]
) -> float:
    """Return how fast a recording grows, in bytes a second: what was received is recorded, and thrown away."""
    seconds = max((reception.seconds for reception in receptions.values()), default=0.0)
    frames = concatenate([reception.frames for reception in receptions.values()])
    if not len(frames) or not seconds:
        return 0.0
    decoder = Decoder(databases)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "received.mcap"
        with RecordingWriter(path, sync_every_s=None) as writer:
            decoded = DecodedWriter(writer, vehicle.model_copy(update={"signals": {}}), databases)
            for batch in split(frames, max(round(len(frames) * vehicle.logger.flush_s / seconds), 1)):
                writer.write_frames(batch)
                decoded.write(decoder.decode(batch))
                writer.flush()
        return path.stat().st_size / seconds
