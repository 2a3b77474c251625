"""Saving the choice beside the runs."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

from daq import ConfigError
from daq.series import write_whole
from wheelsoil.view.campaigns import ViewedCampaign
from wheelsoil.workflows.choice import SCHEMA, Choice, ChosenRun
from wheelsoil.workflows.recordings import sha256_of

_SUFFIX = ".toml"
_OURS = ("vehicle.toml", "terrain.toml", "runs.toml", "zero.toml", "manifest.toml")
"""Files of a campaign's folder that a choice never replaces."""


def saved(campaign: ViewedCampaign, name: str, *, replace_it: bool) -> Path:
    """Write a campaign's choice into its folder and return its path.

    Every run is listed with its sha256; runs of another terrain or wheel in the same folder are switched off, so that
    ``wheelsoil fit FOLDER --choice FILE`` takes the same runs. `ConfigError` where the name is not a file name, the
    file exists already or is not a choice, or it cannot be written.
    """
    path = _target(campaign.folder, name)
    if path.name.lower() in _OURS or (replace_it and _is_another(path)):
        raise ConfigError.of("this file is not a choice", path, next_step="choose another name")
    text = complete(campaign).to_toml()
    try:
        if replace_it:
            write_whole(path, text)
        else:
            with path.open("xb") as file:
                file.write(text.encode(errors="replace"))
    except FileExistsError:
        raise ConfigError.of("the file exists already", path, next_step="choose another name, or replace it") from None
    except OSError as error:
        why = error.strerror or str(error)
        step = "check the folder, and whether another program holds the file"
        raise ConfigError.of("the choice cannot be written", path, why, next_step=step) from None
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
        return tomllib.loads(path.read_bytes().decode("utf-8-sig")).get("schema") != SCHEMA
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
