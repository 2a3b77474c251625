"""``wheelsoil import``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wheelsoil.cli.options import (
    AddedLoad,
    Direction,
    DirectionOption,
    Force,
    Inflation,
    Json,
    LenientDbc,
    PassNumber,
    RunId,
    Terrain,
    Vehicle,
    run_info,
)
from wheelsoil.cli.talk import check_output, counter, print_facts, print_json, say

if TYPE_CHECKING:
    from daq.config import RunInfo
    from daq.run import Configuration

_OF_A_RUN = {
    "direction": "direction",
    "pass_number": "pass_number",
    "added_load": "added_load_kg",
    "inflation": "inflation_kpa",
}
"""Options and the keys of runs.toml that they override."""


def command(
    context: typer.Context,
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Logs of one run, in their order: candump -L, BLF, ASC, ...")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Recording to write (default: LOG.mcap here).")
    ] = None,
    vehicle: Vehicle = None,
    terrain: Terrain = None,
    dbc: Annotated[
        list[str] | None,
        typer.Option(metavar="BUS=FILE", help="A DBC of a bus, where there is no vehicle.toml; may be repeated."),
    ] = None,
    bus: Annotated[
        list[str] | None,
        typer.Option(metavar="OLD=NEW", help="Call a bus of the log as vehicle.toml does; may be repeated."),
    ] = None,
    lenient_dbc: LenientDbc = False,
    run_id: RunId = None,
    direction: DirectionOption = Direction.out,
    pass_number: PassNumber = 1,
    added_load: AddedLoad = 0.0,
    inflation: Inflation = None,
    view_rate: Annotated[
        float, typer.Option(min=0.0, metavar="HZ", help="Rate of the decoded topics; 0: raw frames only.")
    ] = 100.0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Turn log files of any format into a recording (MCAP) that needs no other file.

    vehicle.toml, terrain.toml and runs.toml that lie beside the (first) log go along; options override them. The raw
    frames are kept as they are, bit for bit. Decoded topics are a view of them for people and other tools.
    """
    from daq.convert import import_logs
    from daq.open import known_beside
    from wheelsoil.cli.vehicles import configuration, pairs

    given = configuration(vehicle, terrain, pairs(dbc, "--dbc", "BUS=FILE"), lenient_dbc=lenient_dbc)
    known = known_beside(logs[0], given, lenient_dbc=lenient_dbc)
    name = logs[0].name.partition(".")[0]
    target = check_output(output or Path(f"{name}.mcap"), force=force)
    info = run_info(target.name, run_id or name, direction, pass_number, added_load, inflation)
    info = _completed(info, context, known, logs[0].name)
    with counter("importing", "frames") as watch:
        done = import_logs(
            logs,
            target,
            known,
            run=info,
            rename_buses=dict(pairs(bus, "--bus", "OLD=NEW")),
            view_rate_hz=view_rate or None,
            overwrite=force,
            watch=watch,
        )
    for remark in done.remarks:
        say(remark)
    facts = {
        "recording": done.path,
        "bytes": done.path.stat().st_size,
        "frames": done.frames,
        "known_frames": done.coverage.known,
        "unknown_frames": done.coverage.unknown,
        "error_frames": done.coverage.error_frames,
        "remote_frames": done.coverage.remote_frames,
        "remarks": done.remarks,
    }
    if json:
        print_json(facts)
    else:
        print_facts(
            [
                ("recording", f"{done.path} ({done.path.stat().st_size / 1e6:.2f} MB)"),
                *((f"bus {name}", f"{count:,} frames") for name, count in done.frames.items()),
                ("known to the DBCs", f"{done.coverage.known:,} frames"),
                ("unknown", f"{done.coverage.unknown:,} frames"),
            ]
        )


def _completed(info: RunInfo, context: typer.Context, known: Configuration, log: str) -> RunInfo:
    """Return what the options say of a run over what runs.toml does, which beats what they are by default."""
    listed = [run for run in known.runs or () if Path(run.file).name == log]
    if not listed:
        return info
    sources = {key: context.get_parameter_source(option) for option, key in _OF_A_RUN.items()}
    said = [key for key, source in sources.items() if source is not None and source.name != "DEFAULT"]
    name = info.id if context.params["run_id"] else listed[0].id or info.id
    return listed[0].model_copy(update={"file": info.file, "id": name} | {key: getattr(info, key) for key in said})
