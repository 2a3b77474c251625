"""``wheelsoil import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wheelsoil.cli.options import Force, Json, LenientDbc, Terrain, Vehicle
from wheelsoil.cli.talk import check_output, counter, print_facts, print_json, say


def command(
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
    run_id: Annotated[str | None, typer.Option(help="Name of the run (default: the log's).")] = None,
    direction: Annotated[str, typer.Option(help="out or back.")] = "out",
    pass_number: Annotated[int, typer.Option(min=1, help="How often the wheel has been in this track.")] = 1,
    added_load_kg: Annotated[float, typer.Option(help="Load added to the vehicle.")] = 0.0,
    inflation_kpa: Annotated[float | None, typer.Option(help="Inflation pressure of the tyre.")] = None,
    view_rate: Annotated[
        float, typer.Option(min=0.0, metavar="HZ", help="Rate of the decoded topics; 0: raw frames only.")
    ] = 100.0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Turn log files of any format into a recording (MCAP) that needs no other file.

    The raw frames are kept as they are, bit for bit. Decoded topics are a view of them for people and other tools.
    """
    from daq.config import RunInfo
    from daq.convert import import_logs
    from wheelsoil.cli.vehicles import configuration, pairs

    known = configuration(vehicle, terrain, pairs(dbc, "--dbc", "BUS=FILE"), lenient_dbc=lenient_dbc)
    name = logs[0].name.partition(".")[0]
    target = check_output(output or Path(f"{name}.mcap"), force=force)
    info = RunInfo.model_validate(
        {
            "file": target.name,
            "id": run_id or name,
            "direction": direction,
            "pass_number": pass_number,
            "added_load_kg": added_load_kg,
            "inflation_kpa": inflation_kpa,
        }
    )
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
