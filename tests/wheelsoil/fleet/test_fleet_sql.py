"""Questions to a store, as its page in docs/ asks them; what would write is refused."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import duckdb
import pandas as pd
import pytest
from cli_support import invoke, ok
from fleet_support import rows_of
from fsspec.registry import _registry

from wheelsoil.fleet import COLUMNS, ask, open_store

PAGE = (Path(__file__).parents[3] / "docs" / "fleet.md").read_text(encoding="utf-8")
QUESTIONS = re.findall(r"```sql\n(.*?)```", PAGE, re.S)


def test_the_page_has_ten_questions_and_every_table() -> None:
    assert len(QUESTIONS) == 10
    assert re.findall(r"(?m)^\| `(\w+)` \|", PAGE) == list(COLUMNS)


@pytest.mark.parametrize("sql", QUESTIONS, ids=lambda sql: sql.split(" from ")[-1][:20])
def test_a_question_of_the_page_has_an_answer(sql: str, store: Path) -> None:
    found = ok("fleet", "sql", store, sql, "--json").json
    may_be_none = any(words in sql for words in ("role = 'named'", "'one_of'", "R0_base", "grade <> 'good'"))
    assert may_be_none or found


def test_answers_are_those_of_the_tables_and_of_any_duckdb(store: Path, tmp_path: Path) -> None:
    sql = "select run, campaign, used from runs order by campaign"
    runs = rows_of(store)["runs"]
    expected = runs.select(["run", "campaign", "used"]).to_pylist()
    assert ok("fleet", "sql", store, sql, "--json").json == expected
    files = f"read_parquet('{store}/runs/*/*.parquet', hive_partitioning = true)"
    assert duckdb.sql(sql.replace("from runs", f"from {files}")).to_arrow_table().to_pylist() == expected
    assert pd.read_parquet(store / "runs")["used"].tolist() == runs["used"].to_pylist()
    ok("fleet", "sql", store, sql, "-o", tmp_path / "runs.csv")
    assert pd.read_csv(tmp_path / "runs.csv").to_dict("records") == expected
    ok("fleet", "export", store, "-o", tmp_path / "tables", "--tables", "samples")
    assert pd.read_parquet(tmp_path / "tables" / "samples.parquet").shape[0] == rows_of(store)["samples"].num_rows


def test_what_no_manifest_names_is_not_there(store: Path, tmp_path: Path) -> None:
    import shutil

    own = shutil.copytree(store, tmp_path / "own")
    next((own / "done").glob("spring%2Fday-1.*")).unlink()  # as if its writer had been killed before the last file
    found = {row["campaign"] for row in ask(open_store(str(own)), "select campaign from runs").to_pylist()}
    assert found == {row["campaign"] for row in rows_of(store)["runs"].to_pylist()} - {"spring/day-1"}


@pytest.mark.parametrize(
    "sql",
    [
        "copy runs to 'stolen.csv'",
        "create table x as select 1",
        "drop view runs",
        "attach 'x.db'",
        "set threads = 1",
        "select 1; select 2",
        "",
    ],
)
def test_only_one_select_is_taken(sql: str, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke("fleet", "sql", store, sql)
    assert result.code == 2 and "the store is only read" in result.err and not list(tmp_path.iterdir())


def test_wrong_sql_and_names_are_said(store: Path, tmp_path: Path) -> None:
    for sql in ("select foo from runs", "selec", "select * from campains"):
        result = invoke("fleet", "sql", store, sql)
        assert result.code == 2 and "next:" in result.err and "Traceback" not in result.err
    assert "nearest: runs" in invoke("fleet", "export", store, "-o", tmp_path, "--tables", "run").err
    assert invoke("fleet", "sql", store, "select 1", "-o", tmp_path / "x.xls").code == 2


@pytest.mark.parametrize(
    ("package", "command", "extra"),
    [
        ("duckdb", ("sql", "STORE", "select 1"), "sql"),
        ("distributed", ("run", "STORE", "--store", "NEW", "--engine", "dask"), "dask"),
        ("s3fs", ("status", "s3://bucket/fleet"), "s3"),
    ],
)
def test_an_extra_that_is_missing_is_said(
    package: str,
    command: tuple[str, ...],
    extra: str,
    fleet: Path,
    store: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(_registry, "s3", raising=False)  # loaded by an earlier test of this process
    places = {"STORE": fleet if command[0] == "run" else store, "NEW": tmp_path / "s"}
    result = invoke("fleet", *(places.get(arg, arg) for arg in command))
    assert result.code == 2 and f"pip install 'wheelsoil[{extra}]'" in result.err and "Traceback" not in result.err


def test_a_store_may_stand_in_a_folder_with_brackets(store: Path, tmp_path: Path) -> None:
    other = tmp_path / "year [1] *"
    shutil.copytree(store, other)
    for command in (("status",), ("diagnose",), ("sql", "select campaign, verdict from diagnoses order by all")):
        here, there = (ok("fleet", command[0], at, *command[1:], "--json").out for at in (store, other))
        assert there.replace(str(other), str(store)) == here


def test_status_says_what_there_is(store: Path) -> None:
    said = ok("fleet", "status", store, "--json").json
    assert said["campaigns"] == 8 and list(said["failed"]) == ["broken"] and sum(said["verdicts"].values()) == 7
    assert said["rows"]["runs"] == 6 and said["cpu_s"] > 1 and said["peak_bytes"] > 1e7
    assert "failed: broken: " in ok("fleet", "status", store).out


def test_the_wrong_transducer_is_found_of_both(store: Path) -> None:
    said = ok("fleet", "diagnose", store, "--json").json
    sound, wrong = said["transducers"]
    assert (sound["serial"], sound["decision"]) == ("WFT-1", "nothing")
    assert wrong["serial"] == "WFT-2" and wrong["decision"] in ("flagged", "named")
    assert "drawbar_pull_gain" in wrong["effects"]
    assert set(wrong["campaigns"]) == {"autumn/day-2", "autumn/day-6"}  # too few samples in the other
    trend = wrong["trends"]["drawbar_pull_gain"]
    assert abs(trend["value"] - 0.25) < 4 * trend["sigma"] and trend["date"].startswith("20")
    lines = ok("fleet", "diagnose", store)
    assert "WFT-1: 3 campaigns" in lines.out and "nothing detectable" in lines.out
    assert "drawbar pull gain" in lines.out.partition("WFT-2")[2] and not lines.err
