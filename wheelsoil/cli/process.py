"""``wheelsoil process``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wheelsoil.cli.options import (
    ChoiceFile,
    Force,
    Json,
    LenientDbc,
    MinSpeed,
    Runs,
    RunsFile,
    Terrain,
    Vehicle,
    ZeroFile,
    chosen,
)
from wheelsoil.cli.talk import check_output, print_facts, print_json, say, say_folded

if TYPE_CHECKING:
    from processing.processed_run import ProcessedRun

_BLOCK_ROWS = 1 << 16


def command(
    runs: Runs,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Write the table: .parquet, .csv or .mat; all runs in one."
        ),
    ] = None,
    vehicle: Vehicle = None,
    terrain: Terrain = None,
    runs_file: RunsFile = None,
    zero: ZeroFile = None,
    lenient_dbc: LenientDbc = False,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Rate of the common time base.")] = 100.0,
    cutoff: Annotated[
        float | None, typer.Option(metavar="HZ", help="Low-pass of every channel (default: by the slowest channel).")
    ] = None,
    min_speed: MinSpeed = None,
    choice: ChoiceFile = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Bring each run onto one time base and say what came of it: slip, forces, segments, quality."""
    from wheelsoil.runs import open_and_process

    target = check_output(output, force=force) if output else None
    by_hand = chosen(choice, min_speed=min_speed, cutoff=cutoff)
    processed = open_and_process(
        runs,
        by_hand.process_options(rate_hz=rate),
        vehicle=vehicle,
        terrain=terrain,
        runs_file=runs_file,
        zero=zero,
        lenient_dbc=lenient_dbc,
        choice=by_hand,
    )
    if target:
        _write(target, [run for _, run in processed])
    if json:
        print_json([_as_json(run) for _, run in processed])
        return
    from processing.summary import summary_table

    for i, (_, run) in enumerate(processed):
        if i:
            print()
        print_facts(summary_table(run))
        for note in run.quality.notes:
            say_folded(f"{run.run.id}: {note}")


def _as_json(run: ProcessedRun) -> dict[str, Any]:
    from processing.summary import summary_table

    return {
        "run": run.run,
        "samples": len(run),
        "used": int(run.used.sum()),
        "rate_hz": run.rate_hz,
        "cutoff_hz": run.cutoff_hz,
        "start_ns": run.start_ns,
        "duration_s": len(run) / run.rate_hz,
        "quality": run.quality,
        "summary": dict(summary_table(run)),
    }


def _write(target: Path, processed: list[ProcessedRun]) -> None:
    from daq.export import write_blocks
    from processing.columns import units_of

    units = {name: unit for run in processed for name, unit in units_of(run).items()}
    write_blocks(target, _blocks(processed, units), units)
    say(f"wrote {target}")


def _blocks(processed: list[ProcessedRun], names: Iterable[str]) -> Iterator[dict[str, Any]]:
    import numpy as np

    from processing.columns import block_of

    for run in processed:
        for start in range(0, len(run), _BLOCK_ROWS):
            columns = block_of(run, names, slice(start, start + _BLOCK_ROWS))
            yield {"run": np.full(len(columns["time_ns"]), run.run.id), **columns}
