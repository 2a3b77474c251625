"""``wheelsoil doctor`` and ``wheelsoil log``."""

from __future__ import annotations

import os
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, DataError, Fault, HardwareError
from wheelsoil.cli.console import print_json, print_pairs, printable_addresses, say
from wheelsoil.cli.options import (
    TOKEN_VARIABLE,
    AddedLoad,
    Direction,
    DirectionOption,
    Inflation,
    Json,
    LenientDbc,
    PassNumber,
    RunId,
    Terrain,
    page_token,
    run_info,
)

if TYPE_CHECKING:
    from daq import VehicleConfig
    from daq.logger import LogStatus, LogSummary, Panel, Progress
    from daq.logger.doctor import Line


_PAGE_PORT = 8100


def doctor_command(
    vehicle: Annotated[
        Path, typer.Argument(metavar="VEHICLE.toml", help="Names the buses, their interfaces and DBCs.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", readable=False, help="Folder that will be recorded into.")
    ] = Path(),
    listen: Annotated[float, typer.Option(min=0.1, metavar="S", help="How long to listen to the buses.")] = 3.0,
    page_port: Annotated[
        int, typer.Option(min=1, max=65535, metavar="N", help="Port that the status page will have.")
    ] = _PAGE_PORT,
    json: Json = False,
) -> None:
    """Say whether this machine is ready to log the vehicle, line by line, and what to do where it is not.

    Warnings end with 0, a failed check with 1: also an interface that is missing, for the other lines are still told.
    """
    from daq.logger.doctor import Verdict, examine, gather

    def about_to_listen() -> None:
        say(f"listening for {listen:g} s")

    lines = list(examine(gather(vehicle, out, listen, page_port, about_to_listen=about_to_listen)))
    count = {verdict.value: sum(line.verdict is verdict for line in lines) for verdict in Verdict}
    if json:
        print_json({"schema": "wheelsoil/doctor/1", "ready": not count["fail"], "count": count, "lines": lines})
    else:
        _print(lines)
        print(", ".join(f"{number} {verdict}" for verdict, number in count.items()))
    if count["fail"]:
        raise typer.Exit(1)


def _print(lines: list[Line]) -> None:
    width = max(len(line.check) for line in lines)
    for line in lines:
        where = f"{line.where}: " if line.where else ""
        print(f"{line.verdict.value}  {line.check.ljust(width)}  {where}{line.found}")
        if line.next_step:
            print(f"{' ' * (width + 8)}-> {line.next_step}")


_SIGNAL_EXIT = 128
_LONGEST_ID_BYTES = 200
_SHOWN = 40


def log_command(
    vehicle: Annotated[
        Path, typer.Argument(metavar="VEHICLE.toml", help="Names the buses, their interfaces and DBCs.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="PATH", help="Folder for the recordings, or a name (*.mcap).")
    ] = Path(),
    duration: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="How long (default: until Ctrl-C).")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Begin no run until the status page starts one.")] = False,
    terrain: Terrain = None,
    run_id: RunId = None,
    direction: DirectionOption = Direction.out,
    pass_number: PassNumber = 1,
    added_load: AddedLoad = 0.0,
    inflation: Inflation = None,
    lenient_dbc: LenientDbc = False,
    view: Annotated[bool, typer.Option(help="Write decoded topics beside the raw frames.")] = True,
    page: Annotated[bool, typer.Option(help="Show a status page.")] = True,
    page_host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Where it listens; beyond this machine it asks for a token.")
    ] = "127.0.0.1",
    page_port: Annotated[
        int | None, typer.Option(min=0, max=65535, metavar="N", help=f"Its port (default: {_PAGE_PORT}).")
    ] = None,
    page_token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help=f"Holds its token (or: environment {TOKEN_VARIABLE}).")
    ] = None,
    json: Json = False,
) -> None:
    """Record the vehicle's buses until the time is up or Ctrl-C; the recording is closed in either case.

    A bus that fails or is silent never ends it, and is opened again. A run that was cut off less than ten minutes
    ago goes on in a new file. Limits are in vehicle.toml, [logger].

    Exit codes: 0 ok; 1 a bus was silent all the time; 2 usage or configuration; 3 the recording is there already;
    4 a bus was down at the end, the disk is full, no such interface, another logger in the folder, the port that
    --page-port gives is taken (where its usual one is, it goes on without a page); 129 the terminal was closed,
    130 Ctrl-C, 143 SIGTERM (nothing is lost by any of them).
    """
    from daq.logger import log
    from daq.runs import LENIENT_KEY
    from wheelsoil.cli.options import configuration

    known = configuration(vehicle, terrain, lenient_dbc=lenient_dbc)
    assert known.vehicle is not None
    _check_run_id(run_id)
    if wait and out.suffix.lower() == ".mcap":
        step = "give a folder with --out, and the run's name on the page or with --run-id"
        raise ConfigError(Fault("--wait begins between runs, where no file is named", str(out), next_step=step))
    info = run_info("", run_id or "", direction, pass_number, added_load, inflation)
    token = page_token(page_token_file)
    zero_file = known.vehicle.transducer.zero_file
    if zero_file and zero_file not in known.attachments:
        say(f"{zero_file} is not there yet: the recording carries no zero, and `process` refuses until it is there")
    with (
        _page(page, page_host, page_port, token, known.vehicle.vehicle.name) as (panel, addresses),
        _status(addresses) as progress,
    ):
        summary = log(
            known.vehicle,
            out,
            duration_s=duration,
            run=info,
            wait=wait,
            attachments=known.attachments,
            databases=known.databases,
            view=view,
            metadata={LENIENT_KEY: "yes"} if known.lenient else None,
            panel=panel,
            progress=progress,
        )
        if summary.signal_number == signal.SIGHUP:
            _hang_up()
    _tell(summary, json)
    _leave(summary, known.vehicle)


def _check_run_id(run_id: str | None) -> None:
    """See that a file can be named after a run.

    Raises
    ------
    ConfigError
        Nothing is left of its name, or it is too long.
    """
    if not run_id:
        return
    if not any(letter.isalnum() for letter in run_id):
        what, expected = "--run-id names no file", "a letter or a digit in it"
    elif not run_id.isprintable():
        what, expected = "--run-id has characters that cannot be shown", "letters and digits, in UTF-8"
    elif len(run_id.encode()) > _LONGEST_ID_BYTES:
        what, expected = "--run-id is too long", f"at most {_LONGEST_ID_BYTES} bytes: files are named after it"
    else:
        return
    shown = ascii(run_id if len(run_id) < _SHOWN else f"{run_id[:_SHOWN]}...")
    raise ConfigError(Fault(what, found=shown, expected=expected, next_step="choose another name"))


def _hang_up() -> None:
    """Say nothing more to a terminal that is gone."""
    with Path(os.devnull).open("wb") as nobody:
        for stream in (sys.stdout, sys.stderr):
            if stat.S_ISCHR(os.fstat(stream.fileno()).st_mode):
                os.dup2(nobody.fileno(), stream.fileno())


def _leave(summary: LogSummary, vehicle: VehicleConfig) -> None:
    """End with the exit code that tells how it went."""
    silence = [_silent(bus, vehicle) for bus in summary.silent]
    if summary.signal_number is not None:
        for fault in (*summary.faults, *silence):
            say(str(fault))
        raise typer.Exit(_SIGNAL_EXIT + summary.signal_number)
    if summary.faults:
        raise HardwareError(*summary.faults)
    if silence:
        raise DataError(*silence)


def _tell(summary: LogSummary, json: bool) -> None:
    for text in summary.remarks:
        say(text)
    if json:
        print_json(summary)
        return
    facts = [("recording", str(path)) for path in summary.paths]
    facts.append(("duration", f"{summary.duration_s:.1f} s, ended by {summary.ended_by}"))
    for bus, count in summary.frames.items():
        lost = summary.drops.get(bus)
        loss = "losses not counted by this interface" if lost is None else f"{lost:,} lost"
        facts.append((f"bus {bus}", f"{count:,} frames, {summary.error_frames[bus]:,} error frames, {loss}"))
    facts += [(f"lost {key}", f"{count:,} frames") for key, count in summary.losses.items()]
    print_pairs(facts)


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
def _page(
    wanted: bool, host: str, port: int | None, token: str | None, vehicle: str
) -> Iterator[tuple[Panel | None, tuple[str, ...]]]:
    """Open the status page and yield its addresses; where its usual port is taken, and no other was asked for, none."""
    if not wanted:
        yield None, ()
        return
    from wheelsoil.live import open_page

    try:
        panel = open_page(host, _PAGE_PORT if port is None else port, token, vehicle)
    except HardwareError as error:
        if port is not None:
            raise
        say(f"there is no status page: {error.faults[0].what}; choose a port with --page-port")
        yield None, ()
        return
    try:
        yield panel, printable_addresses(panel.addresses, token)
    finally:
        panel.close()


@contextmanager
def _status(addresses: tuple[str, ...]) -> Iterator[Progress]:
    """Tell changes line by line; show counters while recording, on a terminal only."""
    changes = _Changes(addresses)
    if not sys.stderr.isatty():
        yield changes.tell
        return
    from rich.console import Console

    with Console(stderr=True).status("opening the buses") as status:

        def show(now: LogStatus) -> None:
            changes.tell(now)
            parts = (f"{bus} {seen.received:,} ({seen.dropped or 0:,} lost)" for bus, seen in now.buses.items())
            what = f"run {now.run}" if now.run else "between runs"
            level = f"{now.level}: {now.what}" if now.what else now.level
            status.update(f"{what}, Ctrl-C ends: {', '.join(parts)}; {level}")

        yield show


class _Changes:
    """Says where it records into, and how well, whenever that changes."""

    def __init__(self, addresses: tuple[str, ...]) -> None:
        self._addresses = addresses
        self._path: Path | None = None
        self._level = "green"

    def tell(self, now: LogStatus) -> None:
        """Say what is new; a terminal or a pipe that is gone ends no recording."""
        lines = []
        if self._path is None:
            lines += [f"status page: {address}" for address in self._addresses]
        if now.path != self._path:
            lines.append(_opened(now, first=self._path is None))
        if now.level != self._level:
            lines.append(f"{now.level}: {now.what}" if now.what else now.level)
        self._path, self._level = now.path, now.level
        with suppress(OSError):
            for line in lines:
                say(line)


def _opened(now: LogStatus, *, first: bool) -> str:
    from daq.recording import part_number

    part = part_number(now.path)[1]
    if not now.run:
        return f"recording between runs into {now.path}"
    if first and part > 1:
        return f"run {now.run} was cut off, and goes on: recording into {now.path}"
    return f"recording run {now.run} into {now.path}"
