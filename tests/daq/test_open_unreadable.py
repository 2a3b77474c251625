"""Folders that may not be read: each is skipped and reported, together with every other fault."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from closed_folders import as_nobody, closed

from daq import ConfigError, VehicleConfig, WheelsoilError
from daq.runs import Configuration, campaign_folders, open_runs

RUN = Path(__file__).parents[2] / "recordings" / "clay" / "run-1.mcap"


@pytest.fixture
def disk() -> Iterator[Path]:
    """Return a folder that everybody may read; pytest's own is its user's alone."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


def campaign(folder: Path) -> Path:
    folder.mkdir()
    shutil.copyfile(RUN, folder / RUN.name)
    return folder


def faults_of(*paths: Path) -> dict[str, str]:
    """Return what is wrong with paths, and what to do, by where it is."""
    with as_nobody(), pytest.raises(WheelsoilError) as caught:
        open_runs(paths)
    return {fault.where: f"{fault.what}; {fault.found}; {fault.next_step}" for fault in caught.value.faults}


def test_a_folder_inside_that_may_not_be_read_hides_no_other_fault(disk: Path) -> None:
    closed(disk / "lost+found")
    faults = faults_of(disk, disk / "gone.mcap")
    assert set(faults) == {str(disk), str(disk / "gone.mcap")}
    assert "the folder holds no run; lost+found (cannot be read); name the folder of a campaign" in faults[str(disk)]


def test_a_folder_of_tables_is_told_what_makes_them_runs(disk: Path) -> None:
    for name in ("pull", "speed"):
        (disk / f"{name}.csv").write_text("time [s],force [N]\n0.0,1\n0.5,1\n")
    said = faults_of(disk)[str(disk)]
    assert "pull.csv, speed.csv; no vehicle.toml, no runs.toml" in said
    assert "write vehicle.toml with [wheel] and [signals] beside pull.csv, speed.csv" in said
    wrong = VehicleConfig.model_validate({"signals": {"drawbar_pull": "pull", "vertical_load": "force"}})
    runs = open_runs([disk], given=Configuration(vehicle=wrong))
    assert [run.id for run in runs] == ["pull", "speed"], "a vehicle.toml from elsewhere is one as well"
    for run in runs:
        with pytest.raises(ConfigError, match=rf"{run.path.name}: no column is called 'pull'") as caught:
            run.channels(["drawbar_pull"])
        assert "wheelsoil import" in caught.value.faults[0].next_step


def test_a_folder_without_a_run_gives_the_reason_of_each_file(disk: Path) -> None:
    (disk / "vehicle.toml").write_text("[wheel]\nradius_m = 0.4\nwidth_m = 0.3\n")
    (disk / "values.csv").write_text("a,b\n1,2\n")
    (disk / "diary.txt").write_text("hello")
    for number in range(12):
        (disk / f"picture-{number:02}.png").write_text(f"\x89PNG {number}")
    shutil.copyfile(RUN, disk / "RUN7")
    (disk / "empty").mkdir()
    campaign(disk / "field")
    with pytest.raises(WheelsoilError) as caught:
        open_runs([disk])
    whole, *each = caught.value.faults
    assert "empty (holds no run), field (holds runs), picture-00.png" in whole.found and "10 more" in whole.found
    assert whole.next_step == f"name {disk / 'field'}"
    assert [Path(fault.where).name for fault in each][:4] == ["RUN7", "diary.txt", "picture-00.png", "picture-01.png"]
    assert len(each) == 8, "more are counted above"
    assert each[0].next_step == "rename it, or name it by itself"
    assert str(caught.value).count("known log format") == 1, "one reason of many files is given once"
    for picture in disk.glob("*.png"):
        picture.unlink()
    said = faults_of(disk)
    assert "no column looks like a time; columns a, b; name it in vehicle.toml" in said[str(disk / "values.csv")]
    assert "not a table" in said[str(disk / "diary.txt")]
    assert set(said) == {str(disk), *(str(disk / name) for name in ("RUN7", "diary.txt", "values.csv"))}


def test_a_folder_that_is_named_and_may_not_be_read_is_a_fault_among_others(disk: Path) -> None:
    shut = closed(disk / "shut")
    faults = faults_of(shut, disk / "gone.mcap")
    assert set(faults) == {str(shut), str(disk / "gone.mcap")}
    assert "the path cannot be read; Permission denied" in faults[str(shut)]
    faults = faults_of(shut / "run-1.mcap", disk / "gone.mcap")
    assert "cannot be read; Permission denied" in faults[str(shut / "run-1.mcap")] and len(faults) == 2


@pytest.mark.parametrize(("count", "more"), [(4, False), (6, True)])
def test_of_many_campaigns_the_first_are_named_and_the_rest_counted(disk: Path, count: int, more: bool) -> None:
    inside = [campaign(disk / f"field-{number}") for number in range(count)]
    closed(disk / "field-0-shut")
    faults = faults_of(disk)[str(disk)]
    assert " or ".join(map(str, inside[:4])) in faults and "shut" not in faults.rpartition(";")[2]
    assert faults.endswith(" or 2 more") == more


def test_campaigns_beside_a_folder_that_may_not_be_read_are_found(disk: Path) -> None:
    inside, shut = campaign(disk / "field"), closed(disk / "shut")
    (disk / "loop").symlink_to(disk / "loop")
    with as_nobody():
        assert campaign_folders(disk) == [inside, shut], "opening it reports the fault"
        assert campaign_folders(inside) == [inside]
        assert campaign_folders(shut) == [shut]
    shutil.rmtree(inside)
    with as_nobody():
        assert campaign_folders(disk) == [disk]
