"""``wheelsoil process`` and ``wheelsoil fit``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq import REACTIONS, ConfigError, Fault, number
from wheelsoil.cli.console import check_output, print_json, print_pairs, print_table, say, say_folded
from wheelsoil.cli.options import (
    Channels,
    ChoiceFile,
    Force,
    Json,
    LenientDbc,
    MinSpeed,
    ModelFile,
    Rename,
    Runs,
    RunsFile,
    Sinkage,
    SlipThreshold,
    SoilPreset,
    SoilPrior,
    Terrain,
    Vehicle,
    Where,
    ZeroFile,
    chosen,
    processed_for,
)

if TYPE_CHECKING:
    from model import ExtendedModel
    from model.fit import CampaignFit
    from processing import ProcessedRun
    from wheelsoil.workflows.choice import Choice
    from wheelsoil.workflows.fit import FitChoices


_BLOCK_ROWS = 1 << 16


def process_command(
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
    """Bring each run onto one time base and print a summary: slip, forces, segments, quality."""
    from wheelsoil.workflows.runs import open_and_process

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
    from wheelsoil.wording.notes import texts_of
    from wheelsoil.wording.run_summary import summary_table

    for i, (_, run) in enumerate(processed):
        if i:
            print()
        print_pairs(summary_table(run))
        for text in texts_of(run.quality.notes):
            say_folded(f"{run.run.id}: {text}")


def _as_json(run: ProcessedRun) -> dict[str, Any]:
    from wheelsoil.wording.run_summary import summary_table

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
    from daq.series import write_blocks
    from processing import units_of

    units = {name: unit for run in processed for name, unit in units_of(run).items()}
    write_blocks(target, _blocks(processed, units), units)
    say(f"wrote {target}")


def _blocks(processed: list[ProcessedRun], names: Iterable[str]) -> Iterator[dict[str, Any]]:
    import numpy as np

    from processing import block_of

    for run in processed:
        for start in range(0, len(run), _BLOCK_ROWS):
            columns = block_of(run, names, slice(start, start + _BLOCK_ROWS))
            yield {"run": np.full(len(columns["time_ns"]), run.run.id), **columns}


def fit_command(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Recordings, logs or campaign folders.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Single-wheel tests instead of runs: slip, load, pull, ...")
    ] = None,
    rename: Rename = None,
    where: Where = None,
    vehicle: Vehicle = None,
    terrain: Terrain = None,
    runs_file: RunsFile = None,
    zero: ZeroFile = None,
    soil: SoilPreset = None,
    choice: ChoiceFile = None,
    sinkage: Sinkage = None,
    channels: Channels = None,
    soil_prior: SoilPrior = None,
    slip_threshold: SlipThreshold = None,
    model: ModelFile = None,
    min_speed: MinSpeed = None,
    lenient_dbc: LenientDbc = False,
    json: Json = False,
) -> None:
    """Fit Wong's model and the slip-sinkage laws of Vasil'ev, Lyasko and Ding.

    Prints the coefficients with their 95 % intervals, M0, R0 and R2 above the slip threshold, and the load that Eq. 7
    gives for each model's sinkage, relative to the measured one.
    """
    from wheelsoil.workflows.fit import fit_as_json
    from wheelsoil.workflows.model_files import load_model

    if table is not None and (runs or choice):
        other = "RUN" if runs else "--choice"
        raise ConfigError(Fault(f"{other} and --table exclude each other", next_step="fit one, then the other"))
    extended = load_model(model) if model else None
    by_hand = chosen(
        choice,
        sinkage=sinkage,
        channels=channels,
        soil_prior=soil_prior,
        slip_threshold=slip_threshold,
        min_speed=min_speed,
    )
    if table is not None:
        fit = _fit_table(table, rename, where, vehicle, terrain, soil, by_hand.fit_choices(extended))
    else:
        if rename or where:
            raise ConfigError(Fault("--rename and --where choose from a table", next_step="give --table FILE.csv"))
        fit = _fit_runs(runs or [], (vehicle, terrain, runs_file, zero), soil, by_hand, extended, lenient_dbc)
    comparison = _sinkages(fit) if table is not None else None
    if json:
        print_json(fit_as_json(fit) | ({"sinkage": comparison} if comparison else {}))
        return
    print_fit(fit)
    if comparison:
        _print_sinkages(comparison)


def _fit_runs(
    runs: list[Path],
    files: tuple[Path | None, Path | None, Path | None, Path | None],
    soil: str | None,
    by_hand: Choice,
    extended: ExtendedModel | None,
    lenient_dbc: bool,
) -> CampaignFit:
    from wheelsoil.workflows.fit import fit_runs

    choices = by_hand.fit_choices(extended)
    processed = processed_for(choices.purpose, runs, files, by_hand, lenient_dbc=lenient_dbc)
    return fit_runs(processed, choices, soil)


def _fit_table(
    path: Path,
    rename: list[str] | None,
    where: list[str] | None,
    vehicle: Path | None,
    terrain: Path | None,
    soil: str | None,
    choices: FitChoices,
) -> CampaignFit:
    from wheelsoil.workflows.fit import fit_table
    from wheelsoil.workflows.runs import read_bench

    bench = read_bench(path, vehicle=vehicle, terrain=terrain, soil=soil, rename=rename, where=where)
    return fit_table(bench.rows, bench.wheel, bench.soil, choices, bench.terrain)


def print_fit(fit: CampaignFit) -> None:
    """Print coefficients and criteria as tables, warnings on stderr."""
    from wheelsoil.wording.fit_text import coefficients, criteria_table, remarks
    from wheelsoil.workflows.fit import NOT_AT_AN_END, ended

    print_table(*coefficients(fit), left=2)
    for channel in REACTIONS:
        head, rows = criteria_table(fit, channel)
        if rows:
            print()
            print_table(head, rows)
    for text in remarks(fit):
        say_folded(text)
    if not all(ended(model) for model in fit.models):
        say(f"  next: {NOT_AT_AN_END}")


def _sinkages(fit: CampaignFit) -> dict[str, Any] | None:
    """Return the sinkage that each model predicts beside the measured one; None if it was not measured."""
    import numpy as np

    from wheelsoil.workflows.fit import predicted

    observed = fit.observations
    if not np.isfinite(observed.sinkage_m).any():
        return None
    predictions = {model.name: predicted(fit, model)["sinkage_m"] for model in fit.models}
    driven = (observed.slip >= 0) & np.isfinite(observed.sinkage_m)
    errors = {name: values[driven] - observed.sinkage_m[driven] for name, values in predictions.items()}
    return {
        "slip": observed.slip[driven],
        "measured_m": observed.sinkage_m[driven],
        "predicted_m": {name: values[driven] for name, values in predictions.items()},
        "mean_error_m": {name: float(np.nanmean(error)) for name, error in errors.items()},
        "rms_error_m": {name: float(np.sqrt(np.nanmean(error**2))) for name, error in errors.items()},
    }


def _print_sinkages(comparison: dict[str, Any]) -> None:
    models = list(comparison["predicted_m"])
    print()
    rows = [
        [number(slip, 3), number(1e3 * measured), *(number(1e3 * comparison["predicted_m"][m][i]) for m in models)]
        for i, (slip, measured) in enumerate(zip(comparison["slip"], comparison["measured_m"], strict=True))
    ]
    rows.append(["rms error", "", *(number(1e3 * comparison["rms_error_m"][m]) for m in models)])
    print_table(["sinkage mm at slip", "measured", *models], rows)
