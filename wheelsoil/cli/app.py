"""The ``wheelsoil`` command: subcommands that are imported when they are called, and one error boundary."""

from __future__ import annotations

import atexit
import codecs
import errno
import gc
import importlib
import os
import sys
import unicodedata
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Annotated, Any, NamedTuple

import typer
import typer.core
import typer.main

from daq import ConfigError, HardwareError, WheelsoilError, nearest
from wheelsoil import __version__

_SIGNS = {
    "\N{MINUS SIGN}": "-",
    "\N{EN DASH}": "-",
    "\N{MULTIPLICATION SIGN}": "x",
    "\N{PLUS-MINUS SIGN}": "+-",
    "\N{LESS-THAN OR EQUAL TO}": "<=",
    "\N{GREATER-THAN OR EQUAL TO}": ">=",
    "\N{RIGHTWARDS ARROW}": "->",
    "\N{MICRO SIGN}": "u",
    "\N{MIDDLE DOT}": "*",
    "\N{DEGREE SIGN}": "deg",
}
"""In ASCII."""


class Entry(NamedTuple):
    """Module of a subcommand (with a function such as ``log_command``) and its summary in one line."""

    module: str
    summary: str


COMMANDS: dict[str, Entry] = {
    "demo": Entry("simulation", "Simulate a vehicle and process its CAN frames end to end, up to a report."),
    "sample": Entry("recordings", "Write a sample campaign of six runs, to try the other commands on."),
    "doctor": Entry("logger", "Check whether this machine is ready to log the vehicle."),
    "log": Entry("logger", "Record the vehicle's buses until the time is up or Ctrl-C."),
    "zero": Entry("zero", "Determine a transducer's zero from a lifted wheel, and its drift."),
    "replay": Entry("frames", "Send a recording's frames onto buses, with their timing."),
    "import": Entry("frames", "Turn log files of any format into a recording."),
    "info": Entry("recordings", "List the contents of a recording."),
    "recover": Entry("recordings", "Recover the readable part of a damaged recording."),
    "export": Entry("recordings", "Write decoded signals as Parquet, CSV or MAT."),
    "simulate": Entry("simulation", "Drive a simulated instrumented vehicle over a soil."),
    "process": Entry("runs", "Bring a run onto one time base: slip, forces, quality."),
    "soil": Entry("soil", "Determine terrain parameters from plate and shear tests."),
    "fit": Entry("runs", "Fit Wong's model and three slip-sinkage laws."),
    "sinkage": Entry("runs", "Estimate the sinkage of a driven wheel from its forces alone."),
    "diagnose": Entry(
        "diagnose", "Identify the cause of the simulation's error, or report why it is not identifiable."
    ),
    "report": Entry("pages", "Write the fitted-model report of a terrain's runs."),
    "view": Entry("pages", "Explore recordings in the browser: select, fit and diagnose."),
    "fleet": Entry("fleet", "Diagnose many campaigns, and ask what was found in all of them."),
    "cache": Entry("cache", "List or remove the results that are kept so that nothing is computed twice."),
}
"""Every subcommand, in the order of a test campaign."""

_PREFIX = "Value error, "
"""Of the library that checks values, before the message of typer."""
_LIBRARIES = {"OPENBLAS_NUM_THREADS": "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
"""Environment of libraries, before they are imported: no threads that wait for work, which cost 0.03 s of a core each
(`model.cores`), and no search for plugins in every package that is installed.
"""
_BEFORE_CYCLES = 200_000
"""Objects before the first search for cycles among them; the modules that a command imports are half as many."""
BROKEN_PIPE_EXIT = 141
INTERRUPTED_EXIT = 130


class LazyGroup(typer.core.TyperGroup):
    """A group that imports the module of a subcommand only when it is called, not to list it."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in `COMMANDS` order."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import and return one subcommand, or None for an unknown name."""
        del ctx
        return load(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the subcommand that `args` starts with; an unknown name comes with the nearest known."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            ctx.fail(f"No such command {args[0]!r} ({nearest(args[0], COMMANDS, label='known: ')}).")
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Complete a subcommand from the table, without importing any; options as usual."""
        if incomplete.startswith("-"):
            return list(super().shell_complete(ctx, incomplete))
        from click.shell_completion import CompletionItem

        return [
            CompletionItem(name, help=command.summary)
            for name, command in COMMANDS.items()
            if name.startswith(incomplete)
        ]

    def invoke(self, ctx: Any) -> Any:
        """Run the subcommand inside the error boundary: every failure ends with a message and an exit code."""
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except typer.BadParameter as error:
            error.message = error.message.removeprefix(_PREFIX)
            raise
        except WheelsoilError as error:
            raise SystemExit(_report(error)) from None
        except KeyboardInterrupt:
            raise SystemExit(INTERRUPTED_EXIT) from None
        except OSError as error:
            raise SystemExit(_silence_stdout() if _has_no_reader(error) else _report(_from_system(error))) from None
        return result

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of subcommands from the table."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in COMMANDS.items()])


def load(name: str) -> Any:
    """Return the click command of a subcommand: ``fleet_app``, or ``soil_command``, of class ``SoilCommand`` if any."""
    from wheelsoil.cli.options import with_shared

    module = importlib.import_module(f"wheelsoil.cli.{COMMANDS[name].module}")
    if group := getattr(module, f"{name}_app", None):
        return typer.main.get_command(group)
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(name, cls=getattr(module, f"{name.capitalize()}Command", None))(
        with_shared(name, getattr(module, f"{name}_command"))
    )
    return typer.main.get_command(app)


def run(args: Sequence[str] | None = None) -> int:
    """Run the command line (``sys.argv[1:]`` by default) in this process and return its exit code.

    0 ok, 1 a check failed, 2 usage or configuration, 3 unreadable recording, 4 hardware, 130 interrupted, 141 the
    reader of stdout has closed it.
    """
    try:
        app = typer.Typer(cls=LazyGroup, rich_markup_mode=None, no_args_is_help=True, pretty_exceptions_enable=False)
        app.callback()(_root)
        typer.main.get_command(app).main(args=args, prog_name="wheelsoil")
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    return 0


def main() -> None:
    """Run the command line and exit with its exit code; a character that the output cannot show is written out."""
    for name, value in _LIBRARIES.items():
        os.environ.setdefault(name, value)
    usual = gc.get_threshold()
    gc.set_threshold(_BEFORE_CYCLES)

    def as_usual(*_: object) -> None:
        gc.callbacks.remove(as_usual)
        gc.set_threshold(*usual)

    gc.callbacks.append(as_usual)
    atexit.register(gc.freeze)  # what ends with the process need not be searched for cycles
    codecs.register_error("wheelsoil.plain", _in_plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="wheelsoil.plain")
    sys.exit(run())


def _in_plain(error: UnicodeError) -> tuple[str, int]:
    """Return characters in ASCII, and where they end: "-" of a minus, "phi" of the letter, "1" of an index."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(character: str) -> str:
    if character in _SIGNS:
        return _SIGNS[character]
    words = unicodedata.name(character, "").split()
    if words[:1] == ["GREEK"]:
        return words[-1].lower()
    return unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode() or "?"


def _version(asked: bool) -> None:
    if asked:
        from model import core_in_use

        try:
            typer.echo(f"wheelsoil {__version__} (core: {core_in_use()})")
        except WheelsoilError as error:
            raise typer.Exit(_report(error)) from None
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """From CAN frames of a wheel force transducer to a wheel-soil model, and to the cause of its errors.

    Exit codes: 0 ok, 1 a check failed, 2 usage or configuration, 3 unreadable recording, 4 hardware, 130 interrupted.
    """
    del version


def _report(error: WheelsoilError) -> int:
    print(f"wheelsoil: {error}", file=sys.stderr)
    return error.exit_code


def _has_no_reader(error: OSError) -> bool:
    """Return whether the reader of stdout has closed it; Windows calls every write into it an invalid argument."""
    if os.name != "nt" or error.errno != errno.EINVAL:
        return isinstance(error, BrokenPipeError)
    try:
        sys.stdout.flush()
    except OSError:
        return True
    return False


def _silence_stdout() -> int:
    """Redirect stdout to the null device, so that the interpreter's last flush raises no error."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return BROKEN_PIPE_EXIT


def _from_system(error: OSError) -> WheelsoilError:
    """Return an error of the operating system as a WheelsoilError: a path is usage, the rest is hardware."""
    what = error.strerror or str(error) or type(error).__name__
    where = str(error.filename or "")
    if isinstance(
        error, FileNotFoundError | FileExistsError | PermissionError | IsADirectoryError | NotADirectoryError
    ):
        step = "check the path and its permissions, and whether another program holds it open"
        return ConfigError.of(what, where, next_step=step)
    return HardwareError.of(what, where, next_step="check the disk and the device")
