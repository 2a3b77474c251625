"""Command lines that do by a saved choice what was done on the page: with the same recordings, the same files."""

from __future__ import annotations

import shlex
from pathlib import Path

from wheelsoil.view.campaigns import ViewedCampaign
from wheelsoil.view.opening import Files

_VERBS = (("fit", ()), ("diagnose", ()), ("report", ("-o", "report.html")))


def commands_of(campaign: ViewedCampaign, files: Files) -> list[str]:
    """Return `fit`, `diagnose` and `report` of a campaign as a shell takes them; none before its choice is saved.

    A campaign that was given as a folder is named so, one of recordings by these, for its folder may hold more.
    """
    if campaign.saved_at is None:
        return []
    runs = [campaign.folder] if campaign.whole else [run.run.path.resolve() for run in campaign.runs]
    given = [*map(str, runs), *_options(files), "--choice", str(campaign.saved_at)]
    return [shlex.join(["wheelsoil", verb, *given, *more]) for verb, more in _VERBS]


def _options(files: Files) -> list[str]:
    named: dict[str, Path | None] = {
        "--vehicle": files.vehicle,
        "--terrain": files.terrain,
        "--runs": files.runs,
        "--zero": files.zero,
    }
    found = [part for name, path in named.items() if path for part in (name, str(path.resolve()))]
    return [*found, *(["--soil", files.soil] if files.soil else []), *(["--lenient-dbc"] if files.lenient_dbc else [])]
