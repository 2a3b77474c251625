"""Messages of the page: requests, validated; campaigns, runs and faults as JSON values."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from daq import ConfigError, Fault, parse_mapping
from wheelsoil.view.campaigns import ViewedCampaign, ViewedRun
from wheelsoil.workflows.grading import short_runs
from wheelsoil.workflows.runs import Files, wheel_id

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Key = Annotated[str, Field(strict=True, max_length=64)]
Channel = Literal[
    "drawbar_pull_n",
    "driving_torque_nm",
    "sinkage_m",
    "vertical_load_n",
    "ground_speed_mps",
    "rim_speed_mps",
]
Asked = TypeVar("Asked", bound="_Asked")

_VERBS = (("fit", ()), ("diagnose", ()), ("report", ("-o", "report.html")))


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    campaign: Key


class CampaignAsked(_Asked):
    """A request about a campaign."""


class CurveAsked(_Asked):
    """A model's curve; missing values are those of the run, of the campaign (without a run), or neutral."""

    run: Key | None = None
    sinkage: Literal["balanced", "literal"] | None = None
    effects: Annotated[tuple[Key, ...], Field(max_length=32)] = ()
    values: dict[Key, Finite] = {}
    soil: dict[Key, Finite] = {}
    load_n: Annotated[Finite, Field(gt=0, le=1e7)] | None = None


class PredictionAsked(CurveAsked):
    """A model at the drawn samples of a run."""

    run: Key


class SelectedAsked(_Asked):
    """Summarise a selection of a run: an interval of time, a box over slip, or the samples of one exclusion reason.

    `low` and `high` are seconds or slips; `bottom` and `top` are limits of `channel`, for a box. `left_out`: whether
    excluded samples are displayed, and so selected, too.
    """

    run: Key
    kind: Literal["time", "slip", "reason"]
    low: Finite = 0.0
    high: Finite = 0.0
    channel: Channel | None = None
    bottom: Finite = 0.0
    top: Finite = 0.0
    code: Key = ""
    left_out: Annotated[bool, Field(strict=True)] = True


class ChoiceAsked(_Asked):
    """A choice with the keys of choice.toml; `wheelsoil.workflows.choice` checks it."""

    choice: dict[str, Any]


class SaveAsked(_Asked):
    """Write the choice beside the runs, under a file name without a folder."""

    name: Annotated[str, Field(strict=True, min_length=1, max_length=120)]
    replace: Annotated[bool, Field(strict=True)] = False


def asked_of(body: bytes, kind: type[Asked]) -> Asked:
    """Return the request in a body; `ConfigError` if it is not a JSON object, or with every error in it."""
    try:
        raw = json.loads(body, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ConfigError.of("the body is not valid JSON", found=str(error)[:200]) from None
    if not isinstance(raw, dict):
        raise ConfigError.of("the body is not a JSON object", found=type(raw).__name__)
    return parse_mapping(raw, kind, "request")


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number in JSON")


def commands_of(campaign: ViewedCampaign, files: Files) -> list[str]:
    """Return the shell commands `fit`, `diagnose` and `report` of a campaign; none before its choice is saved.

    A campaign that was given as a folder is named by the folder, one of recordings by the recordings.
    """
    if campaign.saved_at is None:
        return []
    runs = [campaign.folder] if campaign.whole else [run.run.path.resolve() for run in campaign.runs]
    given = [
        *map(str, runs),
        *_options(replace(files, wheel=wheel_id(campaign.first) or files.wheel)),
        "--choice",
        str(campaign.saved_at),
    ]
    return [shlex.join(["wheelsoil", verb, *given, *more]) for verb, more in _VERBS]


def _options(files: Files) -> list[str]:
    named: dict[str, Path | None] = {
        "--vehicle": files.vehicle,
        "--terrain": files.terrain,
        "--runs": files.runs,
        "--zero": files.zero,
    }
    found = [part for name, path in named.items() if path for part in (name, str(path.resolve()))]
    wheel = ["--wheel", files.wheel] if files.wheel else []
    soil = ["--soil", files.soil] if files.soil else []
    return [*found, *wheel, *soil, *(["--lenient-dbc"] if files.lenient_dbc else [])]


def campaign_entry(campaign: ViewedCampaign, files: Files) -> dict[str, Any]:
    """Return a campaign's entry in the answer of /api/list."""
    terrain, wheel = campaign.first.terrain, campaign.first.vehicle.wheel
    keeps = campaign.keeps()
    processed = {run.key: run.plot_data.run for run in campaign.runs if run.plot_data is not None}
    short = dict(zip(processed, short_runs(list(processed.values())), strict=True))
    diagnosis = campaign.diagnosis
    found = diagnosis.found or {}
    return {
        "key": campaign.key,
        "name": campaign.name,
        "path": str(campaign.folder),
        "terrain": campaign.soil_name or (terrain.soil.name if terrain else None),
        "vehicle": campaign.first.vehicle.vehicle.name,
        "wheel": {"radius_m": wheel.radius_m, "width_m": wheel.width_m} if wheel else None,
        "runs": [
            _run_entry(run, run.key in keeps, keeps.get(run.key), short.get(run.key, [])) for run in campaign.runs
        ],
        "diagnosis": {
            "state": diagnosis.state,
            "share": diagnosis.share,
            "left_s": diagnosis.left_s,
            "verdict": found.get("words"),
            "sentence": found.get("sentence"),
            "why": fault_line(diagnosis.faults) or diagnosis.ended or None,
        },
        "choice": campaign.choice.to_mapping(),
        "chosen": campaign.chosen,
        "saved_at": str(campaign.saved_at) if campaign.saved_at else None,
        "commands": commands_of(campaign, files),
    }


def fault_line(faults: Iterable[Fault]) -> str | None:
    """Return faults as one line of text; None if there are none."""
    return "; ".join(f"{fault.what} ({fault.found})" if fault.found else fault.what for fault in faults) or None


def faults_as_json(faults: Iterable[Fault]) -> dict[str, Any]:
    """Return faults as the JSON object that the page expects."""
    return {"faults": [asdict(fault) for fault in faults]}


def fault_of_ours(error: BaseException, where: str = "") -> Fault:
    """Return an unexpected error as a fault, with the last line of its message."""
    lines = str(error).strip().splitlines()[-1:] or [type(error).__name__]
    return Fault("a fault in the page", where, lines[0], next_step="please report it")


def _run_entry(
    run: ViewedRun, use: bool, keep: tuple[tuple[float, float], ...] | None, short: list[str]
) -> dict[str, Any]:
    info, data = run.run.info, run.plot_data
    entry = {
        "key": run.key,
        "id": run.run.id,
        "file": run.run.path.name,
        "direction": info.direction,
        "pass_number": info.pass_number,
        "added_load_kg": info.added_load_kg,
        "inflation_kpa": info.inflation_kpa,
        "rut_readings": len(info.rut),
        "on_soil": run.on_soil,
        "state": run.state,
        "why": fault_line(run.faults) if run.state == "failed" else None,
        "use": use,
        "refused": run.refused or None,
        "duration_s": None,
        "usable_share": None,
        "grade": None,
        "notes": [],
        "sha256": None,
        "load_n": None,
        "speed_mps": None,
        "greatest_slip": None,
        "start_ns": None,
        "cutoff_hz": None,
    }
    if data is None:
        return entry
    grade, judged = run.grade(data, keep, short), run.on_soil or bool(run.refused)
    return entry | {
        "duration_s": len(data.run) / data.run.rate_hz,
        "usable_share": grade.usable_share,
        "grade": grade.level if judged else None,
        "notes": list(dict.fromkeys((*(grade.reasons if judged else ()), *data.notes))),
        "sha256": data.sha256,
        **data.medians,
        "start_ns": data.run.start_ns,
        "cutoff_hz": data.run.cutoff_hz,
    }
