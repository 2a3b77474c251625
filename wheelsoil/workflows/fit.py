"""From opened runs, or a bench table, to the fit of the four models: what `fit`, `report` and `demo` share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from daq import (
    TRANSDUCER_ROLES,
    ConfigError,
    DataError,
    Fault,
    Note,
    RunInfo,
    SensorSection,
    TerrainConfig,
    VehicleConfig,
    load_toml,
    near_names,
)
from daq.runs import Run
from daq.series import WheelTable
from model import ExtendedModel, FitCode
from model.effects import EFFECTS
from model.fit import CampaignFit, ModelFit, Observations, StopReason
from model.wheel_soil import REFERENCE_INFLATION_KPA, SOILS, Soil, Wheel, soil_from_terrain
from processing import ProcessedRun
from wheelsoil.cache.store import kept
from wheelsoil.wording.fit_text import criteria_json
from wheelsoil.wording.notes import runs_by_text
from wheelsoil.workflows.choice import FitChoices
from wheelsoil.workflows.model_files import refuse_mended

SCHEMA = "wheelsoil/fit/1"

NOT_AT_AN_END = (
    "the data ask for a sinkage beyond the axle, or the soil or the wheel is wrong: check cohesive_modulus_kn, "
    "frictional_modulus_kn, sinkage_exponent and the wheel's radius_m"
)
"""What to do where a fit stopped without an end: "no_progress" or "max_iterations"."""

_FEW_SAMPLES = 1_000_000
"""Of all runs, whose predictions by every model take 200 MB."""
_MOUNTING = ("side", "angle_offset_deg", "angle_direction")
"""Of a transducer whose axes turn with the wheel."""
_SAME_SIZE = 0.01
"""Share by which the wheel of a model file may differ from that of the runs."""


def wheel_of(vehicle: VehicleConfig, where: str = "vehicle.toml") -> Wheel:
    """Return the wheel as the model sees it; `where` is the file's name, for messages.

    Raises
    ------
    ConfigError
        vehicle.toml does not describe it.
    """
    if vehicle.wheel is None:
        fault = Fault("the wheel is not described", where, next_step="add [wheel] with radius_m and width_m")
        raise ConfigError(fault)
    return Wheel(vehicle.wheel.radius_m, vehicle.wheel.width_m)


def presets_near(name: str) -> str:
    """Return the presets for a message about an unknown one: those of a similar name first, then all."""
    close = near_names(name, SOILS)
    near = f"nearest: {', '.join(close)}; " if close else ""
    return f"{near}presets: {', '.join(SOILS)}"


def known_soil(name: str | None, terrain: TerrainConfig | None) -> Soil:
    """Return a preset, or the soil of terrain.toml.

    Raises
    ------
    ConfigError
        There is no such preset, or neither is given.
    """
    if name is not None:
        if name not in SOILS:
            raise ConfigError.of(
                f"no soil is called {name!r}",
                expected=presets_near(name),
                next_step="correct --soil, or give --terrain FILE",
            )
        return SOILS[name]
    if terrain is None:
        raise ConfigError.of(
            "the soil is not known",
            expected="terrain.toml in the campaign folder or the recording",
            next_step="give --terrain FILE (`wheelsoil soil` makes one of plate and shear tests), or --soil PRESET",
        )
    return soil_from_terrain(terrain)


def one_terrain(runs: Sequence[Run]) -> Run:
    """Return the run that stands for all of one terrain and vehicle; wheels with an id may be several of one size.

    A run on firm ground beside others has no soil, and stands for none; see `wheelsoil.workflows.runs.on_soil`.
    `ConfigError` where the runs are of different soils or wheels.
    """
    soft = [run for run in runs if run.info.ground == "soft"] or runs
    first = soft[0]
    together = first.vehicle.wheel and first.vehicle.wheel.id and of_one_size(soft)
    for what, kinds in (
        ("soils", [run.terrain and run.terrain.soil for run in soft]),
        ("wheels", [None if together else run.vehicle.wheel for run in soft]),
    ):
        others = [run.id for run, kind in zip(soft, kinds, strict=True) if kind != kinds[0]]
        if others:
            raise ConfigError.of(
                f"the runs are of different {what}",
                found=f"{', '.join(others)} differ from {first.id}",
                expected="runs of one terrain and one wheel",
                next_step="fit each terrain by itself, or give --terrain and --vehicle for all",
            )
    return first


def of_one_size(runs: Iterable[Run]) -> bool:
    """Return whether the wheels of these runs have one radius and one width, so that one law may be fitted to them."""
    return len({(wheel.radius_m, wheel.width_m) for run in runs if (wheel := run.vehicle.wheel)}) == 1


def fit_runs(
    processed: Sequence[tuple[Run, ProcessedRun]],
    choices: FitChoices,
    soil_name: str | None,
    *,
    keep_predictions: bool = False,
) -> CampaignFit:
    """Fit the four models to processed runs of one terrain; a note names those that lack a signal and are left out.

    Wheels of one vehicle share a law; what they have from one recording is not independent.

    Parameters
    ----------
    keep_predictions : bool
        See `model.fit.fit.fit_models`; a report needs them. Those of few samples are kept in any case, so that a
        report after a fit takes it as it is.

    Raises
    ------
    ConfigError, DataError
        See `model.fit.fit.fit_models`; the soil or the wheel is not known, or every run lacks a signal.
    """
    runs = [run for _, run in processed]
    if problem := nothing_whole(runs):
        raise DataError(problem)
    first = one_terrain([run for run, _ in processed])
    soil = known_soil(soil_name, first.terrain)
    options = choices.options(soil, None if soil_name else first.terrain)
    whole = [(run.path, done) for run, done in processed if whole_runs([done])]
    paths = [path for path, _ in whole]
    drives = tuple(map(paths.index, paths))
    wheel = wheel_of(first.vehicle, first.vehicle_source)
    if choices.extended:
        refuse_mended(choices.extended, processed)
    _refuse_another_wheel(choices.extended, wheel, first.vehicle_source)
    given = (tuple(done for _, done in whole), wheel, soil, options)

    def compute() -> CampaignFit:
        from model.fit import fit_models

        return fit_models(*given, keep_predictions=keep, drives=drives)

    keep = keep_predictions or sum(map(len, runs)) <= _FEW_SAMPLES
    fit = kept("fit", (*given, keep, drives), compute)
    passages = {(drive, done.passage) for drive, (_, done) in zip(drives, whole, strict=True)}
    if len(passages) > len(set(drives)):
        differ = Note(FitCode.SEVERAL_PASSAGES, values={"passages": sorted({passage for _, passage in passages})})
        fit = replace(fit, notes=(*fit.notes, differ))
    effects = [EFFECTS[key] for key in (*choices.effects, *(choices.extended.keys if choices.extended else ()))]
    conditions = {name for effect in effects for name in effect.needs.conditions}
    fit = replace(fit, notes=(*fit.notes, *defaults_taken(processed, conditions)))
    lacking = [(run.run.id, list(run.quality.missing)) for run in runs if run.quality.missing]
    if not lacking:
        return fit
    return replace(fit, notes=(Note(FitCode.RUNS_LACK_SIGNALS, values={"signals": lacking}), *fit.notes))


def defaults_taken(processed: Sequence[tuple[Run, ProcessedRun]], conditions: Set[str]) -> tuple[Note, ...]:
    """Return a note of what changes a result under these conditions and no file states; nothing if all is stated.

    Its values are by key, for the runs or wheels named; all of them: "".
    """
    lacking: dict[tuple[str, float | str], list[str]] = {}
    for run, done in processed:
        for key, value in _unstated(run.vehicle, done.run, conditions):
            name = "" if key.startswith("[[run]]") else " ".join(run.vehicle.wheel_ids)
            lacking.setdefault((key, value), []).append(name or run.id)
    taken: dict[str, dict[str, float | str]] = {}
    for (key, value), names in lacking.items():
        taken.setdefault("" if len(names) == len(processed) else ", ".join(dict.fromkeys(names)), {})[key] = value
    return (Note(FitCode.DEFAULTS_TAKEN, values={"values": taken}),) if taken else ()


def _unstated(vehicle: VehicleConfig, info: RunInfo, conditions: Set[str]) -> Iterator[tuple[str, float | str]]:
    """Yield keys of one run that no file states, and what is taken for each."""
    rotating, mounted = vehicle.transducer.frame == "wheel", vehicle.transducer.model_fields_set
    for table, section, keys in (
        *([("[wheel]", vehicle.wheel, ("outboard_mass_kg", "outboard_inertia_kgm2"))] if vehicle.wheel else []),
        *(
            (f"[sensors.{role}]", vehicle.sensors.get(role, SensorSection()), ("latency_s",))
            for role in ("wheel_speed", "ground_speed", *TRANSDUCER_ROLES)
            if role in vehicle.signals
        ),
        ("[transducer]", vehicle.transducer, _MOUNTING if rotating else ("frame",) if mounted & {*_MOUNTING} else ()),
        ("[[run]]", info, ("direction",) if conditions & {"direction", "line_position"} else ()),
        ("[[run]]", info, ("pass_number",) if "pass_number" in conditions else ()),
    ):
        yield from ((f"{table} {key}", getattr(section, key)) for key in keys if key not in section.model_fields_set)
    if "inflation_kpa" in conditions and not info.inflation_kpa:
        yield "[[run]] inflation_kpa", REFERENCE_INFLATION_KPA


def _refuse_another_wheel(extended: ExtendedModel | None, wheel: Wheel, where: str) -> None:
    """Raise ConfigError where a model file is of a wheel of another size."""
    if extended is None or all(
        isclose(getattr(extended.wheel, name), getattr(wheel, name), rel_tol=_SAME_SIZE)
        for name in ("radius_m", "width_m")
    ):
        return
    sizes = [f"radius {each.radius_m:g} m, width {each.width_m:g} m" for each in (extended.wheel, wheel)]
    raise ConfigError.of(
        "the model file is of another wheel",
        where,
        found=f"a file of {sizes[0]}",
        expected=sizes[1],
        next_step="give the model that `wheelsoil diagnose` left of this wheel, or correct [wheel] of vehicle.toml",
    )


def whole_runs(runs: Iterable[ProcessedRun]) -> tuple[ProcessedRun, ...]:
    """Return the runs that carry all that a fit needs."""
    return tuple(run for run in runs if not run.quality.missing)


def nothing_whole(runs: Sequence[ProcessedRun]) -> str:
    """Return which signals are missing, and what to do, where no run carries all that a fit needs; else nothing.

    What is so of all runs comes first; the rest begins with the names of those that it is about.
    """
    if whole_runs(runs):
        return ""
    about = runs_by_text((run.run.id, run.quality.missing.values()) for run in runs)
    of_all = [text for text, names in about.items() if len(names) == len(runs)]
    of_some = [f"{', '.join(names)}: {text}" for text, names in about.items() if len(names) < len(runs)]
    return ", and ".join([*of_all, *of_some])


def fit_table(
    table: WheelTable, wheel: Wheel, soil: Soil, choices: FitChoices, terrain: TerrainConfig | None
) -> CampaignFit:
    """Fit the four models to the rows of a bench table, each of which stands for itself.

    Raises
    ------
    ConfigError, DataError
        See `model.fit.fit.fit_observations`.
    """
    _refuse_another_wheel(choices.extended, wheel, table.name)
    given = (observations_of_table(table), wheel, soil, choices.options(soil, terrain))

    def compute() -> CampaignFit:
        from model.fit import fit_observations

        return fit_observations(*given)

    fit = kept("fit", given, compute)
    excluded = int(np.count_nonzero(table.slip <= 0))
    if not excluded:
        return fit
    used = fit.models[0].samples
    note = Note(FitCode.ROWS_NOT_DRIVEN, values={"used": used, "rows": len(table), "excluded": excluded})
    return replace(fit, notes=(note, *fit.notes))


def observations_of_table(table: WheelTable) -> Observations:
    """Return the rows of a bench table as independent samples; a sigma that is not given is zero."""
    nothing = np.zeros(len(table))
    return Observations(
        slip=table.slip,
        vertical_load_n=table.vertical_load_n,
        drawbar_pull_n=table.drawbar_pull_n,
        driving_torque_nm=table.driving_torque_nm,
        sinkage_m=table.sinkage_m,
        slip_sigma=np.nan_to_num(table.sigma.get("slip", nothing)),
        vertical_load_sigma_n=np.nan_to_num(table.sigma.get("vertical_load_n", nothing)),
        time_s=np.arange(len(table), dtype=float),
        run=table.group,
        names=table.group_names,
        independent=True,
    )


def ended(model: ModelFit) -> bool:
    """Return whether the fit of a model came to an end of its own; see `NOT_AT_AN_END`."""
    return model.stop_reason not in (StopReason.NO_PROGRESS, StopReason.MAX_ITERATIONS)


def load_terrain(path: Path | None) -> TerrainConfig | None:
    """Read terrain.toml where one is given."""
    return load_toml(path, TerrainConfig) if path else None


def fit_as_json(fit: CampaignFit) -> dict[str, Any]:
    """Return a fit as plain values for programs; the contract is `SCHEMA`."""
    return {
        "schema": SCHEMA,
        "soil": fit.soil,
        "wheel": fit.wheel,
        "reading": fit.options.reading,
        "channels": fit.options.channels,
        "soil_prior": fit.options.soil_prior.source if fit.options.soil_prior else None,
        "confidence": fit.options.confidence,
        "slip_threshold": fit.slip_threshold,
        "notes": fit.notes,
        "models": {model.name: model_as_json(model) for model in fit.models},
        "extended": fit.options.extended.to_mapping() if fit.options.extended else None,
    }


def model_as_json(model: ModelFit) -> dict[str, Any]:
    """Return the fit of one model as mappings."""
    return {
        "estimates": {estimate.name: estimate for estimate in model.estimates},
        "effects": model.effects,
        "held": model.fixed,
        "correlation": {" ".join(pair): value for pair, value in model.correlation.items()},
        "warnings": model.notes,
        "stop_reason": model.stop_reason,
        "iterations": model.iterations,
        "samples": model.samples,
        "independent_blocks": model.blocks.count,
        "block_length_s": model.blocks.length_s,
        "criteria": criteria_json(model),
        "load_ratio": model.load_ratio,
        "residual_floor": model.residual_floor,
        **({"predicted_sigma": model.predicted_sigma} if model.predicted_sigma else {}),
    }
