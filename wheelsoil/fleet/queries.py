"""Questions to a store: SQL by DuckDB over the tables of finished campaigns, and tables in one file each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq import ConfigError, Fault, nearest, not_installed
from daq.series import draft_of
from wheelsoil.fleet.store import Store
from wheelsoil.fleet.tables import COLUMNS, schema_of

if TYPE_CHECKING:
    import pyarrow as pa

FORMATS = (".parquet", ".csv")


def ask(store: Store, sql: str) -> pa.Table:
    """Return the answer to one query; the store's tables are views by their names.

    Raises
    ------
    ConfigError
        duckdb is not installed; the SQL is wrong, is not one statement, or would write.
    """
    with _connected(store) as connection:
        import duckdb

        try:
            statements = connection.extract_statements(sql)
        except duckdb.Error as error:
            raise _wrong(sql, error) from None
        kinds = [statement.type for statement in statements]
        if kinds not in ([duckdb.StatementType.SELECT], [duckdb.StatementType.EXPLAIN]):
            found = ", ".join(kind.name for kind in kinds) or "nothing"
            step = "to write an answer to a file give -o FILE"
            raise ConfigError.of("the store is only read", sql, found, "one SELECT", step)
        try:
            return connection.sql(sql).to_arrow_table()
        except duckdb.Error as error:
            raise _wrong(sql, error) from None


def _wrong(sql: str, error: Exception) -> ConfigError:
    step = f"tables: {', '.join(COLUMNS)}; `wheelsoil fleet sql STORE 'describe runs'` lists columns"
    return ConfigError.of("the query cannot be answered", sql, str(error).split("\n\n")[0], next_step=step)


@contextmanager
def _connected(store: Store) -> Iterator[Any]:
    """Yield a connection that knows the store's tables."""
    try:
        import duckdb
    except ImportError:
        raise not_installed("queries", "duckdb", store.url, "sql") from None
    with duckdb.connect(":memory:") as connection:
        connection.execute("set timezone = 'UTC'")
        prefix = "" if store.is_local else f"{store.protocol}://"
        if prefix:
            connection.register_filesystem(store.files)
        manifests = store.manifests()
        for table in COLUMNS:
            paths = [prefix + path for path in store.paths(table, manifests)]
            if paths:
                listed = ", ".join("'" + path.replace("'", "''") + "'" for path in paths)
                connection.execute(
                    f"create view {table} as select * from read_parquet([{listed}], hive_partitioning = true, "
                    "hive_types = {'campaign': varchar})"
                )
            else:
                empty = schema_of(table).empty_table()
                connection.register(f"no_{table}", empty)
                connection.execute(f"create view {table} as select *, ''::varchar as campaign from no_{table}")
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
        raise ConfigError.of("tables cannot be written so", target, target.suffix, " or ".join(FORMATS))
    with draft_of(target) as draft:
        write(answer, draft)


def export(store: Store, target: Path, tables: tuple[str, ...] = (), suffix: str = ".parquet") -> list[Path]:
    """Write tables of the store as one file each; all of them where none is named.

    Raises
    ------
    ConfigError
        There is no such table or format.
    """
    unknown = [name for name in tables if name not in COLUMNS]
    if unknown:
        raise ConfigError(*(Fault(f"no table is called {name!r}", expected=nearest(name, COLUMNS)) for name in unknown))
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for name in tables or COLUMNS:
        written.append(target / f"{name}{suffix}")
        write_answer(store.table(name), written[-1])
    return written
