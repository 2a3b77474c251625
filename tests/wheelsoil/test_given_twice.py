"""What is given twice counts once, or is an error: copies of runs, of tables, of a line of runs.toml."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from view_client import taken_from

from daq import DataError
from daq.runs import SetAsideRun
from wheelsoil.view.jobs import Member, fit_members, process_run
from wheelsoil.workflows import Choice, Files, process_runs
from wheelsoil.workflows.runs import repetitions

CLAY = Path(__file__).parents[2] / "recordings" / "clay"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two runs."""
    return taken_from(CLAY, tmp_path / "clay", 2)


def whole_copy(run: Path, copy: Path) -> None:
    shutil.copy(run, copy)


def cut_copy(run: Path, copy: Path) -> None:
    copy.write_bytes(run.read_bytes()[:1_000_000])


def recovered_copy(run: Path, copy: Path) -> None:
    cut = copy.with_name("cut.mcap")
    cut_copy(run, cut)
    ok("recover", cut, "-o", copy)
    cut.unlink()


@pytest.mark.parametrize("copied", [whole_copy, cut_copy, recovered_copy])
def test_a_copy_of_a_run_is_set_aside(folder: Path, copied: Callable[[Path, Path], None]) -> None:
    copied(folder / "run-1.mcap", folder / "another name.mcap")
    found = invoke("process", folder, "--json")
    assert found.code == 0
    assert [entry.get("set_aside", {}).get("cause") for entry in found.json] == [None, None, "repeated"]
    assert found.json[2]["samples"] == found.json[2]["used"] == 0
    [said] = [line for line in found.err.splitlines() if line.startswith("set aside")]
    assert "the same measurement as run" in said and "run-1.mcap" in said and "another name.mcap" in said


def test_who_processes_is_told_of_a_run_given_twice(folder: Path) -> None:
    said: list[SetAsideRun] = []
    opened = Files().open_runs([folder, folder / "run-2.mcap"], print)
    found = process_runs(opened, Choice().process_options(), set_aside=said.append)
    assert [run.id for run, _ in found] == ["run-1", "run-2"]
    assert [run.message.split(",")[0] for run in said] == ["set aside: run run-2-2"]
    assert [(run.run, run.cause, run.reason) for run in said] == [
        ("run-2-2", "repeated", "the same measurement as run-2")
    ]


def test_two_runs_of_a_bench_may_share_speed_and_load(folder: Path) -> None:
    """Only what is measured anew has noise of its own; without forces, all else must be the same."""
    [(_, run), _] = process_runs(Files().open_runs([folder], print), Choice().process_options())
    noise = np.random.default_rng(0).normal(size=(2, len(run)))
    pull = run.drawbar_pull_n + noise[0] * run.drawbar_pull_sigma_n
    torque = run.driving_torque_nm + noise[1] * run.driving_torque_sigma_nm
    anew = replace(run, drawbar_pull_n=pull, driving_torque_nm=torque)
    assert repetitions([run, run, anew]) == {1: 0}
    unknown = np.full(len(run), np.nan)
    bare = replace(run, drawbar_pull_n=unknown, driving_torque_nm=unknown)
    other = replace(bare, ground_speed_mps=run.ground_speed_mps + 1e-3 * noise[0])
    assert repetitions([bare, bare, other]) == {1: 0}


def test_the_page_names_the_run_to_switch_off(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "run-1.mcap", folder / "run-3.mcap")
    members = []
    for run in Files().open_runs([folder], print):
        members.append(Member(tmp_path / run.id, None))
        process_run(run, Choice().process_options(), None, members[-1].file)
    with pytest.raises(DataError, match="the same measurement as run"):
        fit_members(members, Choice().fit_choices(), None)


def test_a_file_stands_once_in_runs_toml(folder: Path) -> None:
    (folder / "runs.toml").write_text('[[run]]\nfile = "run-1.mcap"\n\n[[run]]\nfile = "run-1.mcap"\nid = "b"\n')
    found = invoke("info", folder)
    assert found.code == 2
    assert "run-1.mcap is there twice: leave one [[run]] of each file" in found.err


def test_what_is_not_used_of_a_folder_is_said_and_listed(folder: Path) -> None:
    shutil.copy(folder / "run-1.mcap", folder / "run-7.mcap")
    (folder / "runs.toml").write_text("".join(f'[[run]]\nfile = "run-{i}.mcap"\nid = "run-{i}"\n' for i in (1, 2, 22)))
    (folder / "terrain.toml").rename(folder / "terain.toml")
    (folder / "day-2").mkdir()
    shutil.copy(folder / "run-1.mcap", folder / "day-2" / "run-9.mcap")
    shutil.copytree(folder / "day-2", folder / "lifted")
    found = invoke("process", folder)
    assert f"{folder}: terain.toml is not read: is it terrain.toml?" in found.err.splitlines()
    assert "run-7.mcap: not used, because runs.toml does not name it; next: " in found.err
    assert "day-2: not read, because folders in a folder are not; next: name them too" in found.err
    assert "lifted" not in found.err, "of such a folder `wheelsoil zero` asks"
    assert "set aside  run-22: runs.toml names run-22.mcap, and there is no such file" in found.out


def test_a_table_given_twice_is_an_error(tmp_path: Path) -> None:
    table, wheel = tmp_path / "a.csv", tmp_path / "wheel.toml"
    table.write_text("slip,vertical_load_n,drawbar_pull_n\n0.1,25,3\n0.2,25,5\n0.3,25,6\n")
    wheel.write_text("[wheel]\nradius_m = 0.1\nwidth_m = 0.08\n")
    copy = shutil.copy(table, tmp_path / "b.csv")
    found = invoke("diagnose", "--table", table, "--table", copy, "--vehicle", wheel, "--soil", "lunar")
    assert found.code == 2
    assert f"the same test twice\n  where: {table} and {copy}" in found.err


def test_a_plate_given_twice_is_an_error(tmp_path: Path) -> None:
    plate = tmp_path / "plate.csv"
    plate.write_text("sinkage_m,pressure_pa\n" + "".join(f"0.0{i},{i}000\n" for i in range(1, 9)))
    found = invoke("soil", "--plate", plate, plate, "--radius", "0.05")
    assert found.code == 2
    assert "the same test twice" in found.err
