"""``wheelsoil report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wheelsoil.cli.options import (
    Channels,
    ChoiceFile,
    Force,
    Json,
    LenientDbc,
    MinSpeed,
    ModelFile,
    Runs,
    RunsFile,
    Sinkage,
    SlipThreshold,
    SoilPreset,
    SoilPrior,
    Terrain,
    Vehicle,
    ZeroFile,
    chosen,
)
from wheelsoil.cli.talk import check_output, print_facts, print_json, say


def command(
    runs: Runs,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The page; its numbers go into FILE.json.")
    ] = Path("report.html"),
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
    diagnose: Annotated[
        bool, typer.Option("--diagnosis/--no-diagnosis", help="Whether to diagnose the runs, too.")
    ] = True,
    min_speed: MinSpeed = None,
    lenient_dbc: LenientDbc = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write the fitted-model report of a terrain's runs: one page that needs no network, and its numbers as JSON.

    A section whose channel is missing is left out with the reason; everything else is there.
    """
    from wheelsoil.model_files import load_model
    from wheelsoil.reporting import report_of

    target = check_output(output, force=force)
    extended = load_model(model) if model else None
    by_hand = chosen(
        choice,
        sinkage=sinkage,
        channels=channels,
        soil_prior=soil_prior,
        slip_threshold=slip_threshold,
        min_speed=min_speed,
    )
    report = report_of(
        runs,
        by_hand,
        extended=extended,
        soil=soil,
        diagnose=diagnose,
        vehicle=vehicle,
        terrain=terrain,
        runs_file=runs_file,
        zero=zero,
        lenient_dbc=lenient_dbc,
    )
    page, numbers = report.write(target)
    for key, why in report.left_out.items():
        say(f"section {key} left out: {why}")
    if json:
        print_json({"report": page, "numbers": numbers, "left_out": report.left_out, "result": report.sentence})
    else:
        print_facts([("report", str(page)), ("numbers", str(numbers))])
        say(report.sentence)
