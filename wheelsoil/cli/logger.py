"""``wheelsoil doctor`` and ``wheelsoil log``."""

from __future__ import annotations

import os
import signal
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, DataError, Fault, HardwareError, check_logging
from wheelsoil.cli import options
from wheelsoil.console import hanging, print_json, print_pairs, printable_addresses, say

if TYPE_CHECKING:
    from daq import VehicleConfig
    from daq.logger import LogStatus, LogSummary, Progress
    from daq.logger.doctor import Line
    from wheelsoil.live import PagePanel


_PAGE_PORT = 8100

_SIGNAL_EXIT = 128
_LONGEST_ID_BYTES = 200
_SHOWN = 40
_VehicleFile = Annotated[
    Path, typer.Argument(metavar="VEHICLE.toml", help="Names the buses, their interfaces and DBCs.")
]


def doctor_command(
    vehicle: _VehicleFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", readable=False, help="Folder for the recordings.")
    ] = Path(),
    listen: Annotated[float, typer.Option(min=0.1, metavar="S", help="How long to listen to the buses.")] = 3.0,
    page_port: Annotated[
        int, typer.Option(min=1, max=65535, metavar="N", help="Port of the status page.")
    ] = _PAGE_PORT,
    json: options.Json = False,
) -> None:
    """Check whether this machine is ready to log the vehicle; each failed check comes with the next step.

    The exit code is 0 with warnings and 1 with a failed check, also for a missing interface: the other checks are
    still printed.
    """
    from daq.logger.doctor import Verdict, examine, gather

    def about_to_listen() -> None:
        say(f"listening for {listen:g} s")

    lines = list(examine(gather(vehicle, out, listen, page_port, about_to_listen=about_to_listen)))
    count = {verdict.value: sum(line.verdict is verdict for line in lines) for verdict in Verdict}
    if json:
        print_json({"schema": "wheelsoil/doctor/1", "ready": not count["fail"], "count": count, "lines": lines})
    else:
        _print(lines, count)
    if count["fail"]:
        raise typer.Exit(1)


_COLOURS = {"pass": "green", "warn": "yellow", "fail": "red"}


def _print(lines: list[Line], count: Mapping[str, int]) -> None:
    """Print whether it is ready and the first step, then every check; in colour on a terminal."""
    first = next((line for kind in ("fail", "warn") for line in lines if line.verdict.value == kind), None)
    counted = ", ".join(f"{number} {verdict}" for verdict, number in count.items())
    print(f"{'not ready' if count['fail'] else 'ready'} to log: {counted}")
    if first is not None and first.next_step:
        print("\n".join(hanging("Next: ", first.next_step)))
    print()
    width = max(len(line.check) for line in lines)
    for line in lines:
        verdict = line.verdict.value
        found = f"{line.where}: {line.found}" if line.where else line.found
        head, *more = hanging(f"{verdict}  {line.check.ljust(width)}  ", found)
        coloured = typer.style(verdict, _COLOURS[verdict]) + head.removeprefix(verdict)
        typer.echo(coloured, color=False if os.environ.get("NO_COLOR") else None)
        steps = hanging(f"{'':{width + 8}}-> ", line.next_step) if line.next_step else []
        for text in (*more, *steps):
            print(text)


def log_command(
    vehicle: _VehicleFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="PATH", help="Folder for the recordings, or a name (*.mcap).")
    ] = Path(),
    duration: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="How long (default: until Ctrl-C).")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Start no run until the status page does.")] = False,
    wheel: Annotated[
        str | None,
        typer.Option(
            "--wheel", metavar="ID", help="Of several [[wheel]], that on the status page (default: the first)."
        ),
    ] = None,
    terrain: options.Terrain = None,
    run_id: options.RunId = None,
    direction: options.DirectionOption = "out",
    pass_number: options.PassNumber = 1,
    added_load: options.AddedLoad = 0.0,
    inflation: options.Inflation = None,
    lenient_dbc: options.LenientDbc = False,
    view: Annotated[bool, typer.Option(help="Write decoded topics beside the raw frames.")] = True,
    page: Annotated[bool, typer.Option(help="Show a status page.")] = True,
    page_host: options.PageHost = "127.0.0.1",
    page_port: Annotated[
        int | None, typer.Option(min=0, max=65535, metavar="N", help=f"Its port (default: {_PAGE_PORT}).")
    ] = None,
    page_token_file: options.TokenFile = None,
    json: options.Json = False,
) -> None:
    """Record the vehicle's buses until the time is up or Ctrl-C; the recording is closed in either case.

    A bus that fails or is silent is reopened and does not end the recording. A run that was interrupted less than ten
    minutes ago continues in a new file. Limits are in vehicle.toml, [logger].

    Exit codes: 0 ok; 1 a bus was silent all the time; 2 usage or configuration; 3 the recording exists already;
    4 a bus was down at the end, the disk is full, no such interface, another logger in the folder, the port that
    --page-port gives is taken (if the default port is, it records without a page); 129 the terminal was closed,
    130 Ctrl-C, 143 SIGTERM (nothing is lost by any of them).
    """
    from daq.logger import log
    from daq.runs import LENIENT_KEY

    check_logging()
    known = options.configuration(vehicle, terrain, lenient_dbc=lenient_dbc)
    assert known.vehicle is not None
    _check_run_id(run_id)
    if wait and out.suffix.lower() == ".mcap":
        step = "give a folder with --out, and the run's name on the page or with --run-id"
        raise ConfigError.of("--wait begins between runs, where no file is named", out, next_step=step)
    info = options.run_info("", run_id or "", direction, pass_number, added_load, inflation)
    token = options.page_token(page_token_file)
    shown = known.vehicle.for_wheel(wheel or next(iter(known.vehicle.wheel_ids), None), str(vehicle))
    for zero_file in (each.transducer.zero_file for each in known.vehicle.each_wheel):
        if zero_file and zero_file not in known.attachments:
            what = "does not exist yet: the recording contains no zero, and `process` fails until the file exists"
            say(f"{zero_file} {what}")
    with (
        _page(page, page_host, page_port, token, known.vehicle.vehicle.name) as (panel, addresses),
        _status(panel, addresses) as progress,
    ):
        summary = log(
            shown,
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
        if summary.signal_number is not None and signal.Signals(summary.signal_number).name == "SIGHUP":
            _detach_from_terminal()
    _print_summary(summary, json)
    _exit(summary, known.vehicle)


def _check_run_id(run_id: str | None) -> None:
    """Check that a file can be named after a run."""
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
    raise ConfigError.of(what, found=shown, expected=expected, next_step="choose another name")


def _detach_from_terminal() -> None:
    """Redirect the output to the null device, because the terminal is closed."""
    with Path(os.devnull).open("wb") as null:
        for stream in (sys.stdout, sys.stderr):
            if stat.S_ISCHR(os.fstat(stream.fileno()).st_mode):
                os.dup2(null.fileno(), stream.fileno())


def _exit(summary: LogSummary, vehicle: VehicleConfig) -> None:
    """Exit with the code of the outcome; see `log_command`."""
    silence = [_silent(bus, vehicle) for bus in summary.silent]
    if summary.signal_number is not None:
        for fault in (*summary.faults, *silence):
            say(str(fault))
        raise typer.Exit(_SIGNAL_EXIT + summary.signal_number)
    HardwareError.stop_if_any(summary.faults)
    DataError.stop_if_any(silence)


def _print_summary(summary: LogSummary, json: bool) -> None:
    from wheelsoil.wording.losses import losses_as_texts

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
    facts += [(f"lost {key}", f"{count} frames") for key, count in losses_as_texts(summary.losses).items()]
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
) -> Iterator[tuple[PagePanel | None, tuple[str, ...]]]:
    """Open the status page and yield its addresses; none if the default port is taken and no other was given."""
    if not wanted:
        yield None, ()
        return
    from wheelsoil.live import PagePanel

    try:
        panel = PagePanel(host, _PAGE_PORT if port is None else port, token, vehicle)
    except HardwareError as error:
        if port is not None:
            raise
        say(f"no status page: {error.faults[0].what}; choose a port with --page-port")
        yield None, ()
        return
    try:
        yield panel, printable_addresses(panel.addresses, token)
    finally:
        panel.close()


@contextmanager
def _status(page: PagePanel | None, addresses: tuple[str, ...]) -> Iterator[Progress]:
    """Print changes line by line; show counters while recording, on a terminal only."""
    changes = _Changes(page, addresses)
    if not sys.stderr.isatty():
        yield changes.report
        return
    from rich.console import Console

    with Console(stderr=True).status("opening the buses") as status:

        def show(now: LogStatus) -> None:
            changes.report(now)
            parts = (f"{bus} {counts.received:,} ({counts.dropped or 0:,} lost)" for bus, counts in now.buses.items())
            what = f"run {now.run}" if now.run else "between runs"
            level = f"{now.level}: {now.what}" if now.what else now.level
            status.update(f"{what}, Ctrl-C ends: {', '.join(parts)}; {level}")

        yield show


class _Changes:
    """Reports the file, the state of the recording and a status page that is not there whenever they change."""

    def __init__(self, page: PagePanel | None, addresses: tuple[str, ...]) -> None:
        self._page = page
        self._page_fault = ""
        self._addresses = addresses
        self._path: Path | None = None
        self._level = "green"

    def report(self, now: LogStatus) -> None:
        """Print the changes; a closed terminal or pipe does not end the recording."""
        lines = []
        fault = "" if self._page is None else self._page.fault
        if not fault and (self._path is None or self._page_fault):
            lines += [f"status page: {address}" for address in self._addresses]
        elif fault != self._page_fault:
            lines.append(f"no status page: {fault}; it is tried again")
        if now.path != self._path:
            lines.append(_opened(now, first=self._path is None))
        if now.level != self._level:
            lines.append(f"{now.level}: {now.what}" if now.what else now.level)
        self._path, self._level, self._page_fault = now.path, now.level, fault
        with suppress(OSError):
            for line in lines:
                say(line)


def _opened(now: LogStatus, *, first: bool) -> str:
    from daq.recording import part_number

    part = part_number(now.path)[1]
    if not now.run:
        return f"recording between runs into {now.path}"
    if first and part > 1:
        return f"run {now.run} was interrupted and continues: recording into {now.path}"
    return f"recording run {now.run} into {now.path}"
