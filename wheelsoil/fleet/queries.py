"""Questions to a store: SQL by DuckDB over the tables of finished campaigns, and tables in one file each.

DuckDB gets the tables as datasets of pyarrow, through the store's own file system. It needs no file itself, and may
open none.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from daq import ConfigError, Fault, nearest, not_installed
from daq.series import draft_of
from wheelsoil.fleet import COLUMNS, Damage, Store
from wheelsoil.fleet.holdings import Holdings, holdings_of, read

FORMATS = (".parquet", ".csv")
TASKS = "tasks"
"""The table of what each campaign cost, which is made of the manifests."""
_CLOSED = (
    "timezone = 'UTC'",
    "autoinstall_known_extensions = false",
    "autoload_known_extensions = false",
    "python_enable_replacements = false",  # a name in SQL is no variable of this program
    "temp_directory = ''",  # what memory does not hold is not written elsewhere
    "enable_external_access = false",
    "lock_configuration = true",
)
"""What a connection is set to before the query: the last one keeps the query from changing the others."""
_NAMES = ", ".join((*COLUMNS, TASKS))
_EXPLAIN = re.compile(
    r"""^(?P<gap>\s|--[^\n]*(\n|$)|/\*.*?\*/)*explain\b(\s*\([^()]*\)|\s*analyze\b)*""", re.IGNORECASE | re.DOTALL
)


@dataclass(frozen=True)
class Answer:
    """The answer to a query, and what was set aside for it."""

    rows: pa.Table
    damaged: tuple[Damage, ...] = ()


def ask(store: Store, sql: str) -> Answer:
    """Return the answer to one query, which sees the store's tables by their names and nothing else.

    No file, no address and no environment is read, nothing is written and nothing is installed.

    Raises
    ------
    ConfigError
        duckdb is not installed; the SQL is wrong, is not one SELECT, or asks for more than the store.
    """
    try:
        import duckdb
    except ImportError:
        raise not_installed("queries", "duckdb", store.url, "sql") from None
    named = {word.lower() for word in re.findall(r"\w+", sql)} & {*COLUMNS, TASKS}
    tables = tuple(named - {TASKS}) if named else tuple(COLUMNS)
    holdings = holdings_of(store, tables)
    try:
        return Answer(_answer(holdings, tables, sql), holdings.damaged)
    except duckdb.Error as error:
        unread = isinstance(error, duckdb.IOException | duckdb.InvalidInputException)
        found = holdings_of(store, tables, thorough=True) if unread else holdings
        if found.damaged == holdings.damaged:
            step = f"tables: {_NAMES}; `wheelsoil fleet sql STORE 'describe runs'` lists columns"
            raise ConfigError.of("the query cannot be answered", sql, _first(error), next_step=step) from None
    try:
        return Answer(_answer(found, tables, sql), found.damaged)
    except duckdb.Error as error:
        raise ConfigError.of(
            "the store cannot be read", store.url, _first(error), "", "`wheelsoil fleet check` names what is damaged"
        ) from None


def _answer(holdings: Holdings, tables: Iterable[str], sql: str) -> pa.Table:
    import duckdb

    with _connected(holdings, tables, sql) as connection:
        try:
            kinds = _kinds(connection, sql)
            if kinds != ["SELECT"]:
                found = ", ".join(kinds) or "nothing"
                step = "to write an answer to a file give -o FILE"
                raise ConfigError.of("the store is only read", sql, found, "one SELECT", step)
            return connection.sql(sql).to_arrow_table()
        except duckdb.PermissionException as error:
            step = f"ask for the store's tables: {_NAMES}"
            what = "a query reads the store and nothing else"
            raise ConfigError.of(what, sql, _first(error), next_step=step) from None


def _first(error: Exception) -> str:
    return str(error).split("\n\n")[0]


def _kinds(connection: Any, sql: str) -> list[str]:
    """Return the kinds of some statements; that of an EXPLAIN is what it explains, since ANALYZE also runs it."""
    kinds = [_kind(statement) for statement in connection.extract_statements(sql)]
    if kinds == ["EXPLAIN"]:
        kinds = [_kind(statement) for statement in connection.extract_statements(_EXPLAIN.sub("", sql, count=1))]
    return kinds


def _kind(statement: Any) -> str:
    try:
        return str(statement.type.name)
    except ValueError:  # a kind that the grammar has and the binding has no name for: UPDATE EXTENSIONS
        return "a statement of another kind"


def _tasks(holdings: Holdings) -> pa.Table:
    known = [manifest for part in holdings.parts for manifest in part.manifests]
    columns = {
        "campaign": pa.array([manifest.campaign for manifest in known], pa.string()),
        "content": pa.array([manifest.content for manifest in known], pa.string()),
        "state": pa.array([manifest.state for manifest in known], pa.string()),
        "verdict": pa.array([manifest.verdict or None for manifest in known], pa.string()),
        "wheels": pa.array([max(manifest.wheels, 1) for manifest in known], pa.int64()),
        "cpu_s": pa.array([manifest.cpu_s for manifest in known], pa.float64()),
        "peak_memory_bytes": pa.array([manifest.peak_bytes for manifest in known], pa.int64()),
        "made_at": pa.array([manifest.made_at_ns // 1000 or None for manifest in known], pa.timestamp("us", tz="UTC")),
        "version": pa.array([manifest.version for manifest in known], pa.string()),
    }
    return pa.table(columns)


@contextmanager
def _connected(holdings: Holdings, tables: Iterable[str], sql: str) -> Iterator[Any]:
    """Yield a connection that knows some tables, `tasks` if it is named, and cannot be opened for anything else."""
    import duckdb

    with duckdb.connect(":memory:") as connection:
        if TASKS in sql.lower():
            connection.register(TASKS, _tasks(holdings))
        for table in tables:
            whole, *partly = holdings.datasets(table)
            if not partly:
                connection.register(table, whole)
                continue
            for i, each in enumerate((whole, *partly)):
                connection.register(f"{table}_{i}", each)
            pieces = " union all ".join(f"select * from {table}_{i}" for i in range(1 + len(partly)))
            connection.execute(f"create temporary view {table} as {pieces}")
        for setting in _CLOSED:
            connection.execute(f"set {setting}")
        connection.execute("begin transaction read only")
        yield connection


def write_answer(answer: pa.Table, target: Path) -> None:
    """Write a table as its file's suffix says.

    Raises
    ------
    ConfigError
        There is no such format.
    """
    import pyarrow.csv
    import pyarrow.parquet

    write = {".parquet": pyarrow.parquet.write_table, ".csv": pyarrow.csv.write_csv}.get(target.suffix)
    if write is None:
        raise ConfigError.of(
            "tables cannot be written so",
            target,
            target.suffix,
            " or ".join(FORMATS),
            "give the file one of these suffixes",
        )
    with draft_of(target) as draft:
        write(answer, draft)


def export(
    store: Store, target: Path, tables: tuple[str, ...] = (), suffix: str = ".parquet"
) -> tuple[list[Path], tuple[Damage, ...]]:
    """Write tables of the store as one file each, all of them where none is named; return paths and what was set aside.

    Raises
    ------
    ConfigError
        There is no such table or format.
    """
    unknown = [name for name in tables if name not in COLUMNS]
    ConfigError.stop_if_any(Fault(f"no table is called {name!r}", expected=nearest(name, COLUMNS)) for name in unknown)
    target.mkdir(parents=True, exist_ok=True)
    chosen = tables or tuple(COLUMNS)

    def write(holdings: Holdings) -> list[Path]:
        written = [target / f"{name}{suffix}" for name in chosen]
        for name, path in zip(chosen, written, strict=True):
            write_answer(holdings.table(name), path)
        return written

    return read(store, chosen, write)
