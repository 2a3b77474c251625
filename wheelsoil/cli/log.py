"""``wheelsoil log``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.errors import DataError, Fault, HardwareError
from wheelsoil.cli.options import (
    AddedLoad,
    Direction,
    DirectionOption,
    Inflation,
    Json,
    LenientDbc,
    PassNumber,
    RunId,
    Terrain,
    run_info,
)
from wheelsoil.cli.talk import print_facts, print_json, say
from wheelsoil.names import file_name

if TYPE_CHECKING:
    from daq.can_source import SourceCounters
    from daq.config import VehicleConfig
    from daq.logger import LogSummary, Progress

_SIGNAL_EXIT = 128


def command(
    vehicle: Annotated[
        Path, typer.Argument(metavar="VEHICLE.toml", help="Names the buses, their interfaces and DBCs.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="PATH", help="Folder for the recording, or its name (*.mcap).")
    ] = Path(),
    duration: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="How long (default: until Ctrl-C).")
    ] = None,
    terrain: Terrain = None,
    run_id: RunId = None,
    direction: DirectionOption = Direction.out,
    pass_number: PassNumber = 1,
    added_load: AddedLoad = 0.0,
    inflation: Inflation = None,
    lenient_dbc: LenientDbc = False,
    view: Annotated[bool, typer.Option(help="Write decoded topics beside the raw frames.")] = True,
    json: Json = False,
) -> None:
    """Record the vehicle's buses until the time is up or Ctrl-C; the recording is closed in either case.

    Ctrl-C ends with exit code 130, and nothing is lost by it. A bus that fails on the way ends with 4, one that was
    silent all the time with 1.
    """
    from daq.logger import log
    from daq.run import LENIENT_KEY
    from wheelsoil.cli.vehicles import configuration

    known = configuration(vehicle, terrain, lenient_dbc=lenient_dbc)
    assert known.vehicle is not None
    target = out / f"{file_name(run_id)}.mcap" if run_id and out.suffix.lower() != ".mcap" else out
    named = target.suffix.lower() == ".mcap"
    name = run_id or (
        target.stem if named else ""
    )  # else the recording is named after vehicle and time, and so is the run
    info = run_info(target.name if named else "", name, direction, pass_number, added_load, inflation)
    if named:
        target.parent.mkdir(parents=True, exist_ok=True)
    with _status() as progress:
        summary = log(
            known.vehicle,
            target,
            duration_s=duration,
            run=info,
            attachments=known.attachments,
            databases=known.databases if view else None,
            metadata={LENIENT_KEY: "yes"} if known.lenient else None,
            progress=progress,
        )
    _tell(summary, json)
    silence = [_silent(bus, known.vehicle) for bus in summary.silent]
    if summary.ended_by == "fault":
        raise HardwareError(*summary.faults)
    if summary.signal_number is not None:
        for fault in silence:
            say(str(fault))
        raise typer.Exit(_SIGNAL_EXIT + summary.signal_number)
    if silence:
        raise DataError(*silence)


def _tell(summary: LogSummary, json: bool) -> None:
    for text in (*summary.remarks, *map(str, summary.faults)):
        say(text)
    if json:
        print_json(summary)
        return
    facts = [("recording", str(summary.path)), ("duration", f"{summary.duration_s:.1f} s, ended by {summary.ended_by}")]
    for bus, count in summary.frames.items():
        lost = summary.drops.get(bus)
        loss = "losses not counted by this interface" if lost is None else f"{lost:,} lost"
        facts.append((f"bus {bus}", f"{count:,} frames, {summary.error_frames[bus]:,} error frames, {loss}"))
    print_facts(facts)


def _silent(bus: str, vehicle: VehicleConfig) -> Fault:
    section = next(section for section in vehicle.bus if section.channel == bus)
    interface, bitrate = section.interface or "socketcan", section.bitrate
    state = f" (`ip -details link show {bus}`)" if interface == "socketcan" else ""
    return Fault(
        f"no frame was received on {bus}",
        f"{interface} interface" + (f", {bitrate} bit/s by vehicle.toml" if bitrate else ""),
        next_step=f"check that the interface is up and has the bus's bitrate{state}, the cable and its termination, "
        "and that a node is sending",
    )


@contextmanager
def _status() -> Iterator[Progress | None]:
    """Show counters while recording, on a terminal only."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("opening the buses") as status:

        def show(counters: Mapping[str, SourceCounters]) -> None:
            parts = (f"{bus} {seen.received:,} ({seen.dropped or 0:,} lost)" for bus, seen in counters.items())
            status.update(f"recording, Ctrl-C ends: {', '.join(parts)}")

        yield show
