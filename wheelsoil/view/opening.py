"""Opening of recordings and grouping into campaigns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from daq import ConfigError, WheelsoilError
from daq.runs import Collected, Run, campaign_folders, readable
from wheelsoil.view.campaigns import ViewedCampaign, ViewedRun
from wheelsoil.wording.notes import texts_of
from wheelsoil.workflows.choice import CHOICE_FILE, is_called, load_choice, runs_in_use
from wheelsoil.workflows.diagnosis import Together, together
from wheelsoil.workflows.runs import Files as Files


def open_campaigns(paths: Sequence[Path], files: Files) -> tuple[list[ViewedCampaign], list[str]]:
    """Open recordings and group them: one campaign for each folder, soil and wheel.

    A folder of campaign folders means all of them. As on the command line, run ids are unique within a campaign only.
    A `choice.toml` in a folder is loaded; one that cannot be used is reported and not changed.

    Returns
    -------
    remarks : list of str
        Unreadable files and folders, which are skipped, and the parts of a choice that do not fit.

    Raises
    ------
    WheelsoilError
        Nothing is readable; see `daq.runs.open_runs`.
    """
    remarks: list[str] = []
    folders: list[Path] = []
    loose: list[Path] = []
    collected = Collected()
    for path in paths:
        with collected.catch(), readable(path):
            if path.is_dir():
                folders += campaign_folders(path)
            else:
                loose.append(path)
    opened: list[Run] = []
    for part in [*([folder] for folder in folders), *([loose] if loose else [])]:
        with collected.catch():
            opened += files.open_runs(part, remarks.append)
    if not opened:
        collected.stop_if_any()
    faults = dict.fromkeys(fault for error in collected.errors for fault in error.faults)
    remarks += [f"{fault.where} is skipped: {fault.what}" for fault in faults]
    groups: dict[Together, list[ViewedRun]] = {}
    once = {run.path.resolve(): run for run in opened}
    for number, run in enumerate(once.values(), 1):
        groups.setdefault(together(run, folders, files.soil), []).append(ViewedRun(f"r{number}", run))
    loose_groups = [group for shared, group in groups.items() if not shared.folder]
    if len(loose_groups) > 1:
        for group in loose_groups:
            alone = files.open_runs([viewed.run.path for viewed in group], left_out=lambda _: None)
            for viewed, run in zip(group, alone, strict=True):
                viewed.run = run
    campaigns = [
        _campaign(f"c{number}", folder, runs, [r for o, g in groups.items() if o.folder == folder for r in g], files)
        for number, ((folder, _, _), runs) in enumerate(groups.items(), 1)
    ]
    for campaign in campaigns:
        remarks += _load_choice(campaign)
    return campaigns, remarks


def _campaign(
    key: str, folder: str, runs: list[ViewedRun], all_runs: Sequence[ViewedRun], files: Files
) -> ViewedCampaign:
    place = Path(folder).resolve() if folder else runs[0].run.path.resolve().parent
    others = tuple(run.run for run in all_runs if folder and run not in runs)
    terrain = runs[0].run.terrain
    name = f"{place.name}, {terrain.soil.name}" if others and terrain else place.name
    return ViewedCampaign(key, name, place, runs, others, files.soil, whole=bool(folder))


def _load_choice(campaign: ViewedCampaign) -> list[str]:
    """Load the choice beside the runs; return the errors of it, and its warnings about the runs."""
    path = campaign.folder / CHOICE_FILE
    if not path.is_file():
        return []
    try:
        choice = load_choice(path)
        own = [run.run for run in campaign.runs]
        in_use, faults = runs_in_use(choice, [*own, *campaign.others])
        if faults:
            raise ConfigError(*faults)
        choice.process_options()
    except WheelsoilError as error:
        return [f"{path} is not used: " + "; ".join(fault.what for fault in error.faults)]
    choice = replace(choice, runs=tuple(r for r in choice.runs if any(is_called(r, run) for run in own)))
    if runs_in_use(choice, own)[1]:
        return []  # it belongs to the other terrain of the folder
    campaign.choice, campaign.saved_at = choice, path
    return [text for chosen in in_use for text in texts_of(chosen.warnings)]
