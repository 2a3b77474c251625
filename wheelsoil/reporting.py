"""From paths to a report: open, process, fit, build."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from daq.errors import DataError
from daq.run import Run
from model.fit_result import CampaignFit
from processing.options import ProcessOptions
from processing.processed_run import ProcessedRun
from wheelsoil.fitting import FitChoices, fit_runs, one_terrain
from wheelsoil.report.build import Report, build_report
from wheelsoil.report.material import Material, command_line, source_of, versions
from wheelsoil.runs import open_and_process


def report_of(
    paths: Sequence[Path],
    choices: FitChoices,
    *,
    soil: str | None = None,
    min_speed_mps: float = 0.5,
    vehicle: Path | None = None,
    terrain: Path | None = None,
    runs_file: Path | None = None,
    zero: Path | None = None,
    lenient_dbc: bool = False,
) -> Report:
    """Open and process runs, fit the models and build the report.

    Parameters
    ----------
    paths : sequence of Path
    choices : FitChoices
    soil : str, optional
        A preset instead of terrain.toml.
    min_speed_mps : float
    vehicle, terrain, runs_file : Path, optional
        See `daq.open.open_runs`.
    zero : Path, optional
        See `wheelsoil.runs.open_and_process`.
    lenient_dbc : bool

    Raises
    ------
    WheelsoilError
        The runs cannot be opened or processed, or are of different soils. Runs that cannot be fitted give a report
        that says why.
    """
    options = ProcessOptions(min_speed_mps=min_speed_mps)
    processed = open_and_process(
        paths, options, vehicle=vehicle, terrain=terrain, runs_file=runs_file, zero=zero, lenient_dbc=lenient_dbc
    )
    return report_of_processed(processed, choices, options, soil=soil)


def report_of_processed(
    processed: Sequence[tuple[Run, ProcessedRun]],
    choices: FitChoices,
    options: ProcessOptions,
    *,
    soil: str | None = None,
    campaign: CampaignFit | None = None,
) -> Report:
    """Fit processed runs, unless they are already, and build the report; see `report_of`."""
    first = one_terrain([run for run, _ in processed])
    problem = ""
    if campaign is None:
        try:
            campaign = fit_runs(processed, choices, soil)
        except DataError as error:
            problem = "; ".join(fault.what for fault in error.faults)
    material = Material(
        runs=tuple(run for _, run in processed),
        campaign=campaign,
        no_fit=problem,
        vehicle=first.vehicle,
        terrain=campaign.soil.name if campaign else first.terrain.soil.name if first.terrain else "",
        sources=tuple(source_of(run) for run, _ in processed),
        command=command_line(),
        options={**asdict(choices), **asdict(options), **({"soil": soil} if soil else {})},
        versions=versions(),
    )
    return build_report(material)
