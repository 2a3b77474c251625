"""What is given to the analyst's page: a folder of campaigns stands for all of them."""

from __future__ import annotations

import tempfile
from pathlib import Path

from closed_folders import as_nobody, closed
from view_client import taken_from
from view_in_process import viewing_here

from wheelsoil.view.campaigns import open_campaigns
from wheelsoil.workflows import Files

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"


def test_a_folder_of_campaigns_stands_for_all_and_runs_keep_their_names(tmp_path: Path) -> None:
    for campaign in (CLAY, SANDY):
        taken_from(campaign, tmp_path / "day" / campaign.name, 1)
    (tmp_path / "day" / "notes").mkdir()
    with viewing_here(tmp_path / "day") as view:
        found = view.settled()
    assert [campaign["name"] for campaign in found] == ["clay", "sandy"]
    ids = [[run["id"] for run in campaign["runs"]] for campaign in found]
    assert ids[0] == ids[1] and len(ids[0]) == 1


def test_a_folder_that_may_not_be_read_is_reported_and_the_others_open() -> None:
    with tempfile.TemporaryDirectory() as folder:
        disk = Path(folder)
        disk.chmod(0o755)
        taken_from(CLAY, disk / "clay", 1)
        shut = closed(disk / "shut")
        open_campaigns([disk / "clay"], Files())  # what Python loads late lies where that user may not read
        for given in ([disk], [disk / "clay", shut], [disk / "clay", shut / "inside"]):
            with as_nobody():
                [campaign], remarks = open_campaigns(given, Files())
            path = given[-1] if len(given) > 1 else shut
            assert campaign.folder.name == "clay" and remarks == [f"{path} is skipped: the path cannot be read"]


def test_one_run_without_its_folder_is_a_campaign_of_that_name(tmp_path: Path) -> None:
    taken_from(CLAY, tmp_path / "field", 1)
    [campaign], _ = open_campaigns([tmp_path / "field" / "run-1.mcap"], Files())
    assert campaign.folder == (tmp_path / "field").resolve() and campaign.name == "field"
