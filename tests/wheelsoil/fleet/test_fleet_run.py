"""``wheelsoil fleet run``: what is found, what is done again, and what survives kills and a full disk."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from cli_support import invoke, ok
from fleet_support import contents, differing, in_one_process, killed_at, rows_of

from daq import ConfigError, DataError
from daq.runs import SetAsideRun
from processing import LOOK
from wheelsoil.cache import entries
from wheelsoil.fleet import FleetOptions, Shard, Source, find_sources, holdings_of, open_store, plan_fleet
from wheelsoil.fleet.rows import Found, tables_of
from wheelsoil.workflows import Choice

NAMES = ["autumn/day-2", "autumn/day-4", "autumn/day-6", "bench/wheel", "broken", "spring/day-1", "spring/day-3"]


NOBODY = 2**22 + 1
"""No process has this number."""


@pytest.fixture
def pair(fleet: Path, tmp_path: Path) -> Path:
    """Two campaigns of the fleet, to be changed."""
    shutil.copytree(fleet / "autumn", tmp_path / "pair")
    shutil.rmtree(tmp_path / "pair" / "day-6")
    return tmp_path / "pair"


def test_every_campaign_is_found_by_its_place_and_done(fleet: Path, store: Path) -> None:
    found = find_sources([fleet])
    assert [source.name for source in found] == [*NAMES, "spring/day-5"]
    for source, files in found.items():
        assert files is None or source.placed(files) == source.facts()
    manifests = holdings_of(open_store(str(store))).manifests
    assert list(manifests) == [source.name for source in found]
    assert {name: one.state for name, one in manifests.items() if one.state != "done"} == {"broken": "failed"}
    tables = rows_of(store)
    whole = [*(name for name in NAMES if name not in ("broken", "bench/wheel")), "spring/day-5"]
    assert tables["runs"]["campaign"].to_pylist() == whole
    assert set(tables["samples"]["campaign"].to_pylist()) == set(whole)
    assert tables["diagnoses"]["campaign"].to_pylist() == [n for n in [*NAMES, "spring/day-5"] if n != "broken"]
    for name, table in tables.items():
        for campaign, content in zip(table["campaign"].to_pylist(), table["content"].to_pylist(), strict=True):
            assert manifests[campaign].content == content, name
        for campaign, manifest in manifests.items():
            assert table["campaign"].to_pylist().count(campaign) == manifest.rows.get(name, 0)


def test_a_folder_of_series_is_a_campaign_where_a_vehicle_describes_it(tmp_path: Path) -> None:
    table, series = "slip,vertical_load_n,drawbar_pull_n\n0.1,10,1\n", "time_s,Fx [N],v [m/s]\n0,1,2\n0.1,2,2\n"
    for folder, files in (
        ("driven", {"vehicle.toml": "", "run.csv": series, "notes.csv": "a,b\n1,2\n"}),
        ("exported", {"run.csv": series}),
        ("tested", {"vehicle.toml": "", "terrain.toml": "", "soil.csv": table}),
    ):
        (tmp_path / folder).mkdir()
        for name, text in files.items():
            (tmp_path / folder / name).write_text(text, encoding="utf-8")
    assert [(one.name, one.is_table) for one in find_sources([tmp_path])] == [("driven", False), ("tested/soil", True)]
    (tmp_path / "driven" / "day" / "one").mkdir(parents=True)
    (tmp_path / "driven" / "day" / "one" / "run.mcap").touch()
    names = [one.name for one in find_sources([tmp_path])]
    assert names == ["driven/day/one", "tested/soil"], "a table beside folders with recordings hides none of them"


def test_what_looks_like_a_campaign_and_is_none_is_said(tmp_path: Path) -> None:
    series, roots = "time_s,Fx [N]\n0,1\n0.1,2\n", tmp_path / "all"
    for folder, names in (("typo", ["vehicel.toml", "run.csv"]), ("bare", ["run.csv"]), ("notes", ["README.txt"])):
        (roots / folder).mkdir(parents=True)
        for name in names:
            (roots / folder / name).write_text(series if name.endswith(".csv") else "", encoding="utf-8")
    (roots / "notes" / "table.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    lines = [
        "bare: not read, because it has series and no vehicle.toml; next: write one, or ignore it",
        "typo: not read, because it has series and no vehicle.toml; next: write one, or ignore it",
        "typo: vehicel.toml is not read: is it vehicle.toml?",
    ]
    with pytest.raises(ConfigError, match="there is no campaign") as caught:
        find_sources([roots])
    assert caught.value.faults[0].found == "; ".join(lines)
    (roots / "driven").mkdir()
    (roots / "driven" / "run.mcap").touch()
    (roots / "latest").symlink_to(roots / "driven")  # which is read
    (tmp_path / "disk").mkdir()
    (roots / "disk").symlink_to(tmp_path / "disk")
    lines.insert(1, "disk: not read, because it is a link to a folder; next: name the folder itself as a root")
    lines[1] += ", or move it here"
    not_read: list[str] = []
    assert [one.name for one in find_sources([roots], not_read)] == ["driven"]
    assert not_read == lines
    said = invoke("fleet", "run", roots, "--store", tmp_path / "store").err.splitlines()
    assert said[:5] == [*lines, "1 campaign, 0 in the store already"]


def test_samples_are_the_run_s_own_at_5_hz(fleet: Path, store: Path, tmp_path: Path) -> None:
    ok("process", fleet / "spring" / "day-3", "-o", tmp_path / "run.parquet")
    import pandas as pd

    run = pd.read_parquet(tmp_path / "run.parquet")
    samples = rows_of(store)["samples"].to_pandas().query("campaign == 'spring/day-3'")
    assert len(samples) == len(run[::20])
    for name in ("time_s", "slip", "drawbar_pull_n", "vertical_load_n", "latitude_deg"):
        pd.testing.assert_series_equal(samples[name], run[name][::20], check_index=False)


@pytest.mark.usefixtures("warm")
def test_evidence_is_what_the_diagnosis_weighed(fleet: Path, store: Path) -> None:
    from wheelsoil.workflows import campaigns_of, diagnose_campaigns, diagnosis_options, open_and_process

    folder = fleet / "spring" / "day-3"
    campaigns = campaigns_of([folder], open_and_process([folder], Choice().process_options(LOOK)))
    told = diagnose_campaigns(campaigns, diagnosis_options()).information
    assert told is not None
    rows = rows_of(store)["evidence"].to_pylist()
    [row] = [row for row in rows if row["campaign"] == "spring/day-3"]
    size = 1 + len(row["soil"]) + len(row["effects"])
    matrix = np.array(row["matrix"]).reshape(size, size)
    assert np.allclose(matrix, told.matrix, rtol=1e-9) and np.linalg.eigvalsh(matrix)[0] > -1e-6 * matrix[0, 0]
    assert row["effects"] == list(told.effects) and row["scales"] == list(told.scales)


@pytest.mark.usefixtures("warm", "one_process")
def test_nothing_is_done_twice_and_what_changed_is_done_again(pair: Path, tmp_path: Path) -> None:
    url = tmp_path / "store"
    assert "0 in the store already" in ok("fleet", "run", pair, "--store", url).err
    first = contents(url)
    (pair / "day-2" / "report.html").write_text("made of it")
    again = ok("fleet", "run", pair, "--store", url)
    assert "2 in the store already" in again.err and not re.search(r"\b1/\d", again.err)
    os.utime(pair / "day-4" / "terrain.toml")  # the same in it
    touched = ok("fleet", "run", pair, "--store", url)
    assert "day-4: done, was there already" in touched.err and contents(url) == first
    terrain = pair / "day-4" / "terrain.toml"
    terrain.write_text(terrain.read_text().replace('name = "clay"', 'name = "loam"'))
    assert "1/1 day-4" in ok("fleet", "run", pair, "--store", url).err
    assert contents(url)["day-2"] == first["day-2"] and contents(url)["day-4"] != first["day-4"]
    assert len(list(url.glob("runs/campaign=day-4/*"))) == len(list(url.glob("done/day-4.*"))) == 1
    assert plan_fleet([pair], str(url), FleetOptions(effects=("vasilev",))).todo  # other options


@pytest.mark.usefixtures("warm", "one_process")
def test_what_failed_is_tried_again_when_it_is_mended_or_on_request(pair: Path, tmp_path: Path) -> None:
    url, run = tmp_path / "store", pair / "day-2" / "run-1.mcap"
    whole = run.read_bytes()
    run.write_bytes(whole[:300])
    failed = invoke("fleet", "run", pair, "--store", url, "--json")
    assert failed.code == 1 and list(failed.json["failed"]) == ["day-2"] and "day-4: done" in failed.err
    assert "no frame" in failed.json["failed"]["day-2"] or "run-1.mcap" in failed.json["failed"]["day-2"]
    assert not plan_fleet([pair], str(url)).todo
    assert [source.name for source in plan_fleet([pair], str(url), retry_failed=True).todo] == ["day-2"]
    run.write_bytes(whole)
    ok("fleet", "run", pair, "--store", url)
    assert [one.state for one in holdings_of(open_store(str(url))).manifests.values()] == ["done", "done"]
    assert len(list(url.glob("campaigns/campaign=day-2/*"))) == 1


def test_shards_are_all_of_it_and_each_once(fleet: Path, store: Path) -> None:
    whole = {source.name for source in plan_fleet([fleet], str(store)).found}
    parts = [plan_fleet([fleet], str(store), shard=Shard(i, 3)).found for i in (1, 2, 3)]
    names = [source.name for part in parts for source in part]
    assert sorted(names) == sorted(whole) and sum(bool(part) for part in parts) > 1


@pytest.mark.usefixtures("warm", "one_process")
def test_a_call_that_is_killed_is_taken_up_again(fleet: Path, whole: dict[str, pa.Table], tmp_path: Path) -> None:
    call = ("fleet", "run", fleet / "spring", "--store", tmp_path / "s")
    killed_at(20, *call)
    before = contents(tmp_path / "s")
    assert 1 <= len(before) <= 2
    (tmp_path / "s" / "drafts" / f"{platform.node()}.{NOBODY}.1.draft").touch()
    again = ok(*call)
    assert f"{len(before)} in the store already" in again.err
    for name, table in rows_of(tmp_path / "s").items():  # campaigns of the fleet differ in the prefix
        expected = [row for row in whole[name].to_pylist() if row["campaign"].startswith("spring/")]
        assert [{**row, "campaign": f"spring/{row['campaign']}", "content": ""} for row in table.to_pylist()] == [
            {**row, "content": ""} for row in expected
        ], name
    assert not list((tmp_path / "s").rglob("*.draft"))


def test_a_diagnosis_is_kept_and_taken_and_a_task_says_what_it_cost(
    fleet: Path, place: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, request: pytest.FixtureRequest
) -> None:
    def run(name: str, *options: str) -> str:
        said = ok("fleet", "run", fleet / "bench", "--store", tmp_path / name, "--jobs", 1, *options).err
        assert re.search(r"1/1 wheel: done, .*, \d+\.\d s of CPU, \d+ MB", said)
        return said

    run("none", "--no-cache")
    assert not place.exists()
    request.getfixturevalue("one_process")
    run("first")
    [entry] = entries(place)
    assert entry.path.name.startswith("diagnosis-")
    os.utime(entry.path, (0, 0))
    run("second")
    assert entries(place)[0].used_at > 0
    place.chmod(0o777)
    os.utime(entry.path, (0, 0))
    run("open")
    assert "is not used, since anyone may write into it" in caplog.text
    assert next(place.iterdir()).stat().st_mtime == 0
    without = rows_of(tmp_path / "none")
    for name in ("first", "second", "open"):
        assert not differing(tmp_path / name, without)
    [task] = ok("fleet", "sql", tmp_path / "none", "from tasks", "--json").json
    status = ok("fleet", "status", tmp_path / "none", "--json").json
    assert (task["campaign"], task["cpu_s"], task["peak_memory_bytes"]) == (
        status["longest"],
        status["cpu_s"],
        status["peak_bytes"],
    )
    assert task["cpu_s"] > 0 and 30e6 < task["peak_memory_bytes"] < 1e9 and task["made_at"]


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_a_full_disk_costs_no_finished_campaign(fleet: Path, tmp_path: Path) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=160k", "tmpfs", small], capture_output=True)
    if mounted.returncode:
        pytest.skip("this machine does not let tests mount a file system of their own")
    try:
        full = invoke("fleet", "run", fleet / "spring", "--store", small / "s", "--jobs", 1)
        assert full.code == 2 and "No space left" in full.err and "Traceback" not in full.err
        finished = contents(small / "s")
        assert not list(small.rglob("*.draft"))
        subprocess.run(["mount", "-o", "remount,size=10m", small], check=True)
        with in_one_process():
            ok("fleet", "run", fleet / "spring", "--store", small / "s")
        assert finished and finished.items() <= contents(small / "s").items() and len(contents(small / "s")) == 3
    finally:
        subprocess.run(["umount", "-l", small], check=True)


def test_bad_input_is_said_and_leaves_nothing(fleet: Path, tmp_path: Path) -> None:
    url = tmp_path / "s"
    (tmp_path / "empty").mkdir()
    cases = [
        ([tmp_path / "empty"], url, 2, "there is no campaign"),
        ([tmp_path / "nowhere"], url, 2, "there is no such folder"),
        ([fleet, fleet / "spring", fleet / "autumn"], url, 0, ""),
        ([fleet / "spring", tmp_path / "copy"], url, 2, "two campaigns have the same name"),
        ([tmp_path / "latin"], url, 2, "this name of a campaign is no UTF-8"),
        ([fleet / "spring"], tmp_path / "copy", 2, "the folder is no store, and not empty"),
        ([fleet / "spring"], "foo://x", 2, "the store's address is not known"),
    ]
    shutil.copytree(fleet / "spring", tmp_path / "copy")
    shutil.copytree(fleet / "spring", tmp_path / "latin" / os.fsdecode(b"acker\xfc"))
    for roots, place, code, said in cases:
        if code:
            result = invoke("fleet", "run", *roots, "--store", place)
            assert result.code == code and said in result.err
    assert not url.exists()
    for option, said in (
        ("--shard=4/3", "no part"),
        ("--effects=lyaskos", "lyasko"),
        ("--scheduler=tcp://x:1", "Dask"),
    ):
        result = invoke("fleet", "run", fleet, "--store", url, option)
        assert result.code == 2 and said in result.err and not url.exists()
    other = tmp_path / "other"
    other.mkdir()
    (other / "store.json").write_text(json.dumps({"schema": "wheelsoil/store/0"}))
    for command in (("run", fleet, "--store", other), ("status", other), ("sql", other, "select 1")):
        result = invoke("fleet", *command)
        assert result.code == 2 and "another schema version" in result.err
    assert invoke("fleet", "status", tmp_path / "nowhere").code == 2


@pytest.mark.usefixtures("warm", "one_process")
def test_a_table_that_cannot_be_fitted_is_diagnosed_and_says_why(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> object:
        raise DataError.of("no fit", "wheel.csv", "two rows")

    monkeypatch.setattr("wheelsoil.fleet.campaign_task.fit_table", refused)
    ok("fleet", "run", fleet / "bench", "--store", tmp_path / "s")
    tables = rows_of(tmp_path / "s", ("notes", "diagnoses"))
    assert [(note["of"], note["text"]) for note in tables["notes"].to_pylist() if note["severity"] == "remark"] == [
        ("fit", "no fit, wheel.csv, two rows")
    ]
    assert tables["diagnoses"].num_rows == 1


def test_a_run_that_is_set_aside_is_a_note_with_its_name(tmp_path: Path) -> None:
    aside = SetAsideRun("run-9", "unreadable", "the file is empty", "drive it again")
    found = Found(Source("wet", str(tmp_path)), set_aside=(aside,))
    [note] = tables_of([found], "hash")["notes"].to_pylist()
    assert (note["run"], note["of"], note["code"]) == ("run-9", "opening", "unreadable")
    assert note["text"] == "set aside: the file is empty; next: drive it again"
