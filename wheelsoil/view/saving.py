"""Saving the choice beside the runs, and counting the samples that are selected on the page."""

from __future__ import annotations

import os
import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from daq import BoolArray, ConfigError, FloatArray
from processing import ProcessedRun, Reason
from wheelsoil.view.campaigns import ViewedCampaign
from wheelsoil.view.messages import SelectedAsked
from wheelsoil.workflows.choice import SCHEMA, Choice, ChosenRun
from wheelsoil.workflows.recordings import sha256_of

_REASONS = {why.name.lower(): why for why in Reason}

_SUFFIX = ".toml"
_OURS = ("vehicle.toml", "terrain.toml", "runs.toml", "zero.toml", "manifest.toml")
"""Files of a campaign's folder that a choice never replaces."""


def selected_of(run: ProcessedRun, asked: SelectedAsked) -> dict[str, Any]:
    """Return number and duration of the selected samples, their range of slip and their mean drawbar pull.

    The run is with the manual exclusions. The mean drawbar pull is that of the used samples; of all if none is used.
    """
    rows = _rows(run, asked)
    used = rows & run.used
    slip, pull = run.slip[rows], run.drawbar_pull_n[used if used.any() else rows]
    slip, pull = slip[np.isfinite(slip)], pull[np.isfinite(pull)]
    samples = int(rows.sum())
    return {
        "samples": samples,
        "of": len(run),
        "seconds": samples / run.rate_hz,
        "left_out": samples - int(used.sum()),
        "slip": [float(slip.min()), float(slip.max())] if len(slip) else None,
        "drawbar_pull_n": float(pull.mean(dtype=np.float64)) if len(pull) else None,
    }


def _rows(run: ProcessedRun, asked: SelectedAsked) -> BoolArray:
    if asked.kind == "reason":
        return np.asarray(run.reason == _REASONS.get(asked.code, -1))
    visible = run.used | asked.left_out
    if asked.kind == "time":
        return visible & _within(run.time_s, asked.low, asked.high)
    rows = visible & _within(run.slip, asked.low, asked.high)
    if asked.channel is None:
        return rows
    return rows & _within(getattr(run, asked.channel), asked.bottom, asked.top)


def _within(values: FloatArray, low: float, high: float) -> BoolArray:
    return np.asarray((values >= low) & (values <= high))


def saved(campaign: ViewedCampaign, name: str, *, replace_it: bool) -> Path:
    """Write a campaign's choice into its folder and return its path.

    Every run is listed with its sha256; runs of another terrain or wheel in the same folder are switched off, so that
    ``wheelsoil fit FOLDER --choice FILE`` takes the same runs.

    Raises
    ------
    ConfigError
        The name is not a file name, the file exists already or is not a choice, or it cannot be written.
    """
    path = _target(campaign.folder, name)
    if path.name.lower() in _OURS or (replace_it and _is_another(path)):
        raise ConfigError.of("this file is not a choice", path, next_step="choose another name")
    text = complete(campaign).to_toml().encode("utf-8", "replace")
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with (beside if replace_it else path).open("wb" if replace_it else "xb") as file:
            file.write(text)
        if replace_it:
            beside.replace(path)
    except FileExistsError:
        raise ConfigError.of("the file exists already", path, next_step="choose another name, or replace it") from None
    except OSError as error:
        why = error.strerror or str(error)
        raise ConfigError.of("the choice cannot be written", path, why, next_step="check the folder") from None
    finally:
        if replace_it:
            with suppress(OSError):
                beside.unlink()
    return path


def complete(campaign: ViewedCampaign) -> Choice:
    """Return the choice with every run of the folder."""
    choice, sections = campaign.choice, []
    for run in campaign.runs:
        given = campaign.section_of(run.run)
        digest = run.plot_data.sha256 if run.plot_data else sha256_of(*run.run.files)
        sections.append(replace(given, file=run.run.path.name, id=run.run.id, sha256=digest))
    sections += [ChosenRun(run.path.name, run.id, sha256_of(*run.files), use=False) for run in campaign.others]
    return replace(choice, runs=tuple(sections))


def _is_another(path: Path) -> bool:
    """Return whether the file exists and is not a choice, or is unreadable."""
    try:
        return tomllib.loads(path.read_bytes().decode()).get("schema") != SCHEMA
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True


def _target(folder: Path, name: str) -> Path:
    stripped = name.strip()
    unfit = (
        stripped != Path(stripped).name or stripped.startswith(".") or not stripped.isprintable() or "\\" in stripped
    )
    if unfit or not stripped.lower().endswith(_SUFFIX):
        expected = f"a file name without a folder that ends in {_SUFFIX}: the file is written beside the runs"
        raise ConfigError.of("the choice cannot have this name", "name", repr(name), expected)
    return folder / stripped
