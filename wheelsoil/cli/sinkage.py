"""``wheelsoil sinkage``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, Fault, number
from wheelsoil.cli.console import print_json, print_table, say, say_wrong_signs
from wheelsoil.cli.options import Json, LenientDbc, MinSpeed, Rename, RunsFile, Vehicle, Where, ZeroFile, chosen
from wheelsoil.wording.notes import note_text

if TYPE_CHECKING:
    from wheelsoil.workflows.sinkage import SinkageFacts


def sinkage_command(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Recordings, logs or campaign folders.")
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Single-wheel tests instead of runs: slip, load, pull, torque."),
    ] = None,
    rename: Rename = None,
    where: Where = None,
    vehicle: Vehicle = None,
    runs_file: RunsFile = None,
    zero: ZeroFile = None,
    min_speed: MinSpeed = None,
    lenient_dbc: LenientDbc = False,
    json: Json = False,
) -> None:
    """Estimate the sinkage of a driven wheel without a sinkage sensor.

    Load, drawbar pull, torque and radius give the sinkage with a 95 % band in bins of slip, and its growth with slip.
    A measured sinkage is printed beside it, and every driven row is checked against a bound that holds on every soil.
    """
    from wheelsoil.workflows.sinkage import sinkage_as_json

    if table is not None:
        if runs:
            raise ConfigError(Fault("RUN and --table exclude each other", next_step="evaluate one, then the other"))
        facts = _of_table(table, rename, where, vehicle)
    else:
        if rename or where:
            raise ConfigError(Fault("--rename and --where choose from a table", next_step="give --table FILE.csv"))
        facts = _of_runs(runs or [], vehicle, runs_file, zero, min_speed, lenient_dbc)
    if json:
        print_json(sinkage_as_json(facts))
    else:
        print_sinkage(facts)


def _of_runs(
    runs: list[Path],
    vehicle: Path | None,
    runs_file: Path | None,
    zero: Path | None,
    min_speed: float | None,
    lenient_dbc: bool,
) -> SinkageFacts:
    from wheelsoil.workflows.runs import open_and_process
    from wheelsoil.workflows.sinkage import sinkage_of_runs

    options = chosen(None, min_speed=min_speed).process_options("sinkage")
    processed = open_and_process(
        runs, options, vehicle=vehicle, runs_file=runs_file, zero=zero, lenient_dbc=lenient_dbc
    )
    say_wrong_signs(processed)
    return sinkage_of_runs(processed)


def _of_table(path: Path, rename: list[str] | None, where: list[str] | None, vehicle: Path | None) -> SinkageFacts:
    from daq import VehicleConfig, load_toml
    from daq.runs import Collected
    from daq.series import parse_rename, parse_where, read_wheel_table
    from wheelsoil.workflows.sinkage import sinkage_of_table

    collected = Collected()
    with collected.catch():
        if vehicle is None:
            raise ConfigError(Fault("the wheel is not known", next_step="give --vehicle FILE with [wheel] radius_m"))
        wheel = load_toml(vehicle, VehicleConfig).wheel
        if wheel is None:
            step = "add [wheel] with radius_m and width_m"
            raise ConfigError(Fault("the wheel is not described", str(vehicle), next_step=step))
    with collected.catch():
        rows = read_wheel_table(path, rename=parse_rename(rename or ()), where=parse_where(where or ()))
    collected.stop_if_any()
    assert wheel is not None
    return sinkage_of_table(rows, wheel)


def print_sinkage(facts: SinkageFacts) -> None:
    """Print the table of sinkage against slip, its growth and the bound; notes on stderr."""
    from wheelsoil.workflows.sinkage import IN_THE_BAND, growth_rows, growth_sentence

    measured = any(one.measured_m == one.measured_m for one in facts.bins)
    head = ["slip", "load N", "sinkage mm", "95 % band", "noise mm", *(["measured mm"] if measured else []), "samples"]
    rows = [
        [
            f"{one.slip:.2f}",
            f"{one.vertical_load_n:.0f}" if one.vertical_load_n >= 100 else number(one.vertical_load_n),
            number(1e3 * one.sinkage_m.value, 3),
            " .. ".join(number(1e3 * end, 3) for end in one.sinkage_m.interval95),
            number(1e3 * one.noise_m, 2),
            *([number(1e3 * one.measured_m, 3)] if measured else []),
            f"{one.samples}",
        ]
        for one in facts.bins
    ]
    print_table(head, rows)
    print()
    grown = growth_rows(facts.growth)
    if grown:
        print_table(["growth from no slip to full slip", "mm", "95 % interval"], grown)
    print(growth_sentence(facts.growth))
    if facts.checked:
        print(f"bound T/r - Dp <= W tan(theta_1): {_bound(facts)}")
    else:
        say("no measured sinkage: the bound T/r - Dp <= W tan(theta_1) cannot be checked")
    for note in (IN_THE_BAND, *facts.notes):
        say(note)


def _bound(facts: SinkageFacts) -> str:

    if not facts.inconsistent:
        return f"satisfied in all {facts.checked} driven rows with measured sinkage"
    return "; ".join(f"violated, suspect {item.channel}: {note_text(item.why)}" for item in facts.inconsistent)
