"""Questions to a store, as its page in docs/ asks them; what would write is refused."""

from __future__ import annotations

import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path

import duckdb
import pandas as pd
import pytest
from cli_support import invoke, ok
from fleet_support import rows_of
from fsspec.registry import _registry

from wheelsoil.cli.fleet import _print_status, _summary
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
    found = {row["campaign"] for row in ask(open_store(str(own)), "select campaign from runs").rows.to_pylist()}
    assert found == {row["campaign"] for row in rows_of(store)["runs"].to_pylist()} - {"spring/day-1"}


STATEMENTS = """
alter table runs add column x int; comment on table runs is 'x'; analyze runs; vacuum; vacuum analyze
attach 'x.db'; attach 'https://x.invalid/x.db'; detach memory; use memory
call checkpoint(); checkpoint; force checkpoint; call enable_logging(); copy from database memory to x
copy runs to 'x.csv'; copy (select 1) to 'x' (format parquet); copy (select 1) to 's3://b/x'; copy runs from 'x.csv'
create table x as select 1; create view x as select 1; create function f() as 1; create macro f() as 1; create schema s
create secret (type s3); create persistent secret s (type s3); drop secret s; create type t as enum ('a')
delete from runs; truncate runs; drop view runs; insert into runs select * from runs; update runs set run = 'x'
merge into runs using runs r on true when matched then delete; pivot runs on grade using count(*)
execute x; prepare x as copy (select 1) to 'x.csv'; deallocate x; begin; commit
export database 'x'; import database 'x'; install httpfs; force install httpfs from 'http://x.invalid'; load httpfs
load './x.duckdb_extension'; update extensions; pragma database_list; pragma enable_profiling
set threads = 1; set enable_external_access = true; set global temp_directory = '.'; set variable x = 1; reset threads
explain copy (select 1) to 'x'; explain analyze copy (select 1) to 'x'; explain (analyze) copy runs to 'x'
explain analyze create table x as select 1; explain analyze vacuum; explain analyze install httpfs
explain analyze prepare x as copy (select 1) to 'x'; explain analyze create persistent secret s (type s3)
explain analyze update extensions; explain analyze drop view runs; /* x */ explain /* y */ analyze copy runs to 'x'
explain analyze call checkpoint(); explain analyze set threads = 1; explain explain select 1
"""
"""Every kind of statement of DuckDB's grammar that is not a SELECT, and what one may hide behind EXPLAIN."""
SELECTS = """
from 'STORE/store.json'; from 'STORE/runs/*/*.parquet'; from 'https://x.invalid/x.parquet'; from 's3://b/x.parquet'
from 'hf://datasets/x/y.csv'; from read_text('STORE/store.json'); from read_blob('STORE/store.json')
from read_csv('/etc/passwd'); from read_csv_auto('/etc/passwd'); from sniff_csv('/etc/passwd')
from read_json('STORE/store.json'); from read_json_objects('STORE/store.json'); from read_ndjson('STORE/store.json')
from read_parquet('STORE/runs/*/*.parquet'); from parquet_scan('x'); from parquet_metadata('x')
from parquet_file_metadata('x'); from parquet_kv_metadata('x'); from parquet_schema('x'); from read_duckdb('x.db')
from read_text('http://x.invalid/x'); from glob('/etc/*'); from glob('https://x.invalid/*'); select getenv('HOME')
from sqlite_scan('x.db', 't'); from postgres_scan('', 's', 't'); from st_read('x'); from iceberg_scan('x')
from delta_scan('x'); from read_xlsx('x.xlsx'); from duckdb_secrets(); from which_secret('s3://x', 's3')
from duckdb_extensions(); from enable_logging(); from enable_profiling(); from force_checkpoint()
from query('copy runs to ''x'''); from query('from read_text(''/etc/passwd'')'); from query_table('/etc/passwd')
from json_execute_serialized_sql(json_serialize_sql('from read_text(''/etc/passwd'')'))
with x as (insert into runs select 1) select 1; from (copy runs to 'x'); from sql; from store; from connection
from arrow_scan(1, 2, 3); from pandas_scan(1); from python_map_function(); select count(*) from read_csv('/dev/stdin')
explain analyze from read_text('/etc/passwd'); describe from read_csv('/etc/passwd'); summarize '/etc/passwd'
select (select content from read_text('/etc/passwd')); from runs, read_text('/etc/passwd'); select nextval('x')
"""
"""What reads files, addresses, the environment or this program's variables from within a SELECT."""


def _each(statements: str, store: Path) -> list[str]:
    return [one.replace("STORE", str(store)) for one in statements.strip().replace("\n", "; ").split("; ")]


@pytest.mark.parametrize(
    "statements",
    [pytest.param(STATEMENTS, id="statements"), pytest.param(SELECTS, id="selects", marks=pytest.mark.slow)],
)
def test_the_store_is_read_and_nothing_else(
    statements: str, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = shutil.copytree(store, tmp_path / "store")
    for manifest in one.glob("done/*.json"):  # one campaign is soon read
        if "day-1" not in manifest.name:
            manifest.unlink()
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HOME", str(here))  # where DuckDB keeps secrets and extensions
    before = {path: path.stat().st_mtime_ns for path in one.rglob("*")}
    for sql in _each(statements, one):
        result = invoke("fleet", "sql", one, sql)
        assert result.code == 2 and not result.out and "next:" in result.err, f"{sql}\n{result.out}{result.err}"
        assert "Traceback" not in result.err and "root:" not in result.err, sql
    assert not list(here.iterdir())
    assert before == {path: path.stat().st_mtime_ns for path in one.rglob("*")}


def test_every_kind_of_statement_is_tried() -> None:
    connection, tried = duckdb.connect(), set()
    for sql in _each(STATEMENTS, Path()):
        with suppress(duckdb.Error, ValueError):  # a kind that has no name
            tried |= {statement.type.name for statement in connection.extract_statements(sql)}
    of_no_text = {"INVALID", "RELATION", "LOGICAL_PLAN", "ANALYZE", "VARIABLE_SET", "CREATE_FUNC", "COPY_DATABASE"}
    assert set(duckdb.StatementType.__members__) - tried <= of_no_text | {"SELECT", "EXTENSION"}


@pytest.mark.parametrize(
    ("sql", "rows"),
    [
        ("describe runs", 24),
        ("show tables", len(COLUMNS)),
        ("explain select 1", 1),
        ("-- why\nEXPLAIN (analyze) select count(*) from samples", 1),
        ("pivot runs on grade in ('good', 'poor') using count(*) group by run", 1),
        ("with t as (select 1 as a) from t", 1),
        ("values (1), (2)", 2),
    ],
)
def test_what_only_reads_is_taken(sql: str, rows: int, store: Path) -> None:
    assert ask(open_store(str(store)), sql).rows.num_rows == rows


@pytest.mark.parametrize("sql", ["select 1; select 2", "", "select 1; copy runs to 'x'"])
def test_only_one_statement_is_taken(sql: str, store: Path) -> None:
    result = invoke("fleet", "sql", store, sql)
    assert result.code == 2 and "the store is only read" in result.err


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


def test_verdicts_are_called_in_the_terminal_what_the_page_calls_them(capsys: pytest.CaptureFixture[str]) -> None:
    _print_status({"store": "s", **_summary([]), "verdicts": {"one_of": 2, "named": 1}})
    assert "2 one of several, 1 named" in capsys.readouterr().out
