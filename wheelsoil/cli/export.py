"""``wheelsoil export``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from daq.errors import ConfigError, Fault
from wheelsoil.cli.options import Force, Json, LenientDbc, Runs, RunsFile, Vehicle
from wheelsoil.cli.talk import print_facts, print_json, progress, say


class TableFormat(StrEnum):
    """What a table is written as."""

    parquet = "parquet"
    csv = "csv"
    mat = "mat"


def command(
    runs: Runs,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write into.")],
    kind: Annotated[TableFormat, typer.Option("--format", help="Of the tables.")] = TableFormat.parquet,
    signal: Annotated[
        list[str] | None,
        typer.Option(metavar="MESSAGE.SIGNAL", help="Only these signals; may be repeated (default: all)."),
    ] = None,
    decode: Annotated[
        bool, typer.Option("--decode", help="Write recordings with every decoded sample as a topic, not tables.")
    ] = False,
    vehicle: Vehicle = None,
    runs_file: RunsFile = None,
    lenient_dbc: LenientDbc = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write decoded signals in full: a table for each run, bus and message, with time stamps and units.

    Values are physical, in the unit of the DBC; `process` gives them in SI and on one time base.
    """
    from daq.open import open_runs
    from wheelsoil.exporting import export_recording, export_tables

    if decode and signal:
        raise ConfigError(Fault("--decode writes every signal", next_step="leave out --signal"))
    if not output.parent.is_dir():
        raise ConfigError(Fault("no such folder", str(output.parent), next_step="create it or choose another output"))
    opened = open_runs(runs, vehicle=vehicle, runs=runs_file, lenient_dbc=lenient_dbc, left_out=say)
    without = [run for run in opened if not run.databases]
    if without:
        raise ConfigError(
            *(
                Fault("no DBC is known for this run", str(run.path), next_step="give --vehicle FILE, which names them")
                for run in without
            )
        )
    output.mkdir(exist_ok=True)
    written: list[Path] = []
    for run in progress(opened, "exporting", len(opened)):
        if decode:
            written.append(export_recording(run, output, overwrite=force))
        else:
            written += export_tables(run, output, kind.value, signal, overwrite=force)
    if json:
        print_json({"files": written})
    else:
        print_facts([(path.name, f"{path.stat().st_size / 1e6:.3f} MB") for path in written])
