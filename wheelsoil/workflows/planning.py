"""From the files of a campaign that is still to be driven to what it will be able to tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from daq import ConfigError, Fault, RunInfo, RunsConfig, VehicleConfig, load_toml
from daq.runs import RUNS_FILE, TERRAIN_FILE, VEHICLE_FILE, Collected
from model.diagnosis import Campaign, DiagnosisOptions, Plan, plan_for, plan_of, planned_campaign, usual_runs
from model.wheel_soil import prior_of
from wheelsoil.workflows.fit import known_soil, load_terrain, wheel_of

SHORTEST_S, LONGEST_S = 10.0, 600.0
MOST_RUNS = 40


@dataclass(frozen=True)
class PlanFiles:
    """What a plan is made from; None where the folder's file is taken, or the usual.

    Attributes
    ----------
    vehicle, terrain, runs : Path, optional
        In place of what lies in the folders.
    soil : str, optional
        A preset in place of terrain.toml.
    count : int, optional
        Runs to drive where no runs.toml lists them.
    duration_s : float
        Of each run.
    """

    vehicle: Path | None = None
    terrain: Path | None = None
    runs: Path | None = None
    soil: str | None = None
    count: int | None = None
    duration_s: float = 40.0


def plan_campaigns(folders: Sequence[Path], files: PlanFiles, options: DiagnosisOptions) -> Plan:
    """Say what planned campaigns will tell apart: one for each folder, or one where none is given.

    Parameters
    ----------
    folders : sequence of Path
        With vehicle.toml and, where they are there, terrain.toml and runs.toml; recordings are not looked at.

    Raises
    ------
    ConfigError
        Everything that is wrong with the files.
    DataError
        The soil cannot carry the wheel.
    """
    _check(files)
    collected = Collected()
    campaigns: list[Campaign] = []
    for folder in folders or (None,):
        with collected.catch():
            campaigns.append(_planned(folder, files, options.seed))
    collected.stop_if_any()
    return plan_of(campaigns, options)


def _check(files: PlanFiles) -> None:
    faults = []
    if files.count is not None and not 1 <= files.count <= MOST_RUNS:
        faults.append(Fault("--planned-runs is out of range", found=str(files.count), expected=f"1 to {MOST_RUNS}"))
    if not SHORTEST_S <= files.duration_s <= LONGEST_S:
        expected = f"{SHORTEST_S:g} to {LONGEST_S:g} s"
        faults.append(Fault("--planned-duration is out of range", found=f"{files.duration_s:g}", expected=expected))
    if faults:
        raise ConfigError(*faults)


def _planned(folder: Path | None, files: PlanFiles, seed: int) -> Campaign:
    if folder is not None and not folder.is_dir():
        raise ConfigError(
            Fault("a plan takes no recording", str(folder), expected="a folder with vehicle.toml and terrain.toml")
        )
    vehicle_file = files.vehicle or _in(folder, VEHICLE_FILE)
    if vehicle_file is None:
        raise ConfigError(
            Fault(
                "the vehicle is not known",
                str(folder or ""),
                next_step="give --vehicle FILE with [wheel] and mass_kg, or a folder with vehicle.toml",
            )
        )
    collected = Collected()
    with collected.catch():
        vehicle = load_toml(vehicle_file, VehicleConfig)
        wheel_of(vehicle, str(vehicle_file))
    with collected.catch():
        terrain = None if files.soil else load_terrain(files.terrain or _in(folder, TERRAIN_FILE))
        soil = known_soil(files.soil, terrain)
    with collected.catch():
        runs = _runs(files, folder)
    collected.stop_if_any()
    name = folder.resolve().name if folder else "plan"
    plan = plan_for(vehicle, soil, prior_of(soil, terrain), runs, duration_s=files.duration_s, name=name, seed=seed)
    return planned_campaign(plan)


def _in(folder: Path | None, name: str) -> Path | None:
    return folder / name if folder and (folder / name).is_file() else None


def _runs(files: PlanFiles, folder: Path | None) -> tuple[RunInfo, ...]:
    if files.count is not None:
        return usual_runs(files.count)
    listed = files.runs or _in(folder, RUNS_FILE)
    found = load_toml(listed, RunsConfig).run if listed else ()
    return tuple(run if run.id else run.model_copy(update={"id": f"run-{i}"}) for i, run in enumerate(found, 1))
