"""What is given to the analyst's page: a folder of campaigns stands for all of them."""

from __future__ import annotations

from pathlib import Path

from view_client import taken_from, viewing

ROOT = Path(__file__).parents[2]
CLAY, SANDY = ROOT / "recordings" / "clay", ROOT / "recordings" / "sandy"


def test_a_folder_of_campaigns_stands_for_all_and_runs_keep_their_names(tmp_path: Path) -> None:
    for campaign in (CLAY, SANDY):
        taken_from(campaign, tmp_path / "day" / campaign.name, 1)
    (tmp_path / "day" / "notes").mkdir()
    with viewing(tmp_path / "day") as view:
        found = view.settled()
    assert [campaign["name"] for campaign in found] == ["clay", "sandy"]
    ids = [[run["id"] for run in campaign["runs"]] for campaign in found]
    assert ids[0] == ids[1] and len(ids[0]) == 1
