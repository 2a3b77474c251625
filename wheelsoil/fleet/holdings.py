"""What a store holds that can be read: campaigns, their tables, and what had to be set aside.

Before a table is read, each of its files has to be there, with the size that its manifest states and a footer of this
table and these campaigns. What a file holds has a checksum; it is compared where reading fails, and on request.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING, Any, TypeVar

from daq import ConfigError
from wheelsoil.fleet.manifests import Damage, Manifest, Part, PartFile
from wheelsoil.fleet.store import Store
from wheelsoil.fleet.tables import COLUMNS, schema_of

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow.dataset import Dataset

T = TypeVar("T")

_TAIL = 1 << 16
"""Bytes at the end of a file that are read at once: most footers are shorter."""
_MAGIC = b"PAR1"
_TRIES = 3


@dataclass(frozen=True)
class Holdings:
    """Campaigns of a store that can be read.

    Attributes
    ----------
    parts : tuple of Part
        Sound ones, in the order of their campaigns.
    damaged : tuple of Damage
        What was set aside.
    older : tuple of Part
        What newer parts replace.
    """

    store: Store
    parts: tuple[Part, ...]
    damaged: tuple[Damage, ...] = ()
    older: tuple[Part, ...] = ()

    @property
    def manifests(self) -> dict[str, Manifest]:
        """What the store has of each campaign, by name."""
        return {one.campaign: one for part in self.parts for one in part.manifests}

    def dataset(self, table: str) -> Dataset:
        """Return a table with its campaign as the first column; its files are read when it is."""
        import pyarrow as pa
        from pyarrow import dataset, fs

        store = self.store
        holding = [(part, part.files[table]) for part in self.parts if table in part.files]
        checks = dataset.ParquetFragmentScanOptions(page_checksum_verification=True)
        return dataset.FileSystemDataset.from_paths(
            [f"{store.root}/{file.path}" for _, file in holding],
            schema=schema_of(table).insert(0, pa.field("campaign", pa.string())),
            format=dataset.ParquetFileFormat(default_fragment_scan_options=checks),
            filesystem=fs.LocalFileSystem() if store.is_local else fs.PyFileSystem(fs.FSSpecHandler(store.files)),
            partitions=[dataset.field("campaign") == part.groups[0][0].campaign for part, _ in holding],
        )

    def table(self, name: str, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows of a table of all campaigns, with their campaign as a column."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = schema_of(name).names if columns is None else list(columns)
        none = pa.schema([schema_of(name).field(column) for column in columns]).empty_table()
        pieces = [_of_campaign("", none)]
        holding = [part for part in self.parts if name in part.files]
        paths = [part.files[name].path for part in holding]
        for part, data in zip(holding, self.store.contents(paths), strict=True):
            file = pq.ParquetFile(BytesIO(data), page_checksum_verification=True)
            pieces.append(_of_campaign(part.groups[0][0].campaign, file.read(columns, use_threads=False)))
        return pa.concat_tables(pieces)


def _of_campaign(name: str, rows: pa.Table) -> pa.Table:
    import pyarrow as pa

    return rows.add_column(0, "campaign", pa.array([name] * len(rows), pa.string()))


def holdings_of(store: Store, tables: Iterable[str] = tuple(COLUMNS), *, thorough: bool = False) -> Holdings:
    """Return what a store holds, with the files of some tables checked.

    Parameters
    ----------
    tables : iterable of str
        Whose files must be there, of the right size, and with the right footer.
    thorough : bool
        Compare checksums, too: every byte is read.
    """
    listing = store.listing()
    parts, damaged = list(listing.parts), list(listing.damaged)
    for table in tables:
        holding = [part for part in parts if table in part.files]
        wrong = _wrong_files(store, table, holding)
        if thorough:
            sound = [part for part in holding if part.name not in wrong]
            wrong |= {part.name: what for part in sound if (what := _wrong_data(store, part.files[table]))}
        damaged += [
            Damage(one.campaign, part.files[table].path, wrong[part.name], part.name)
            for part in holding
            if part.name in wrong
            for one in part.manifests
        ]
        parts = [part for part in parts if part.name not in wrong]
    return Holdings(store, tuple(parts), tuple(damaged), listing.older)


def read(store: Store, tables: Iterable[str], use: Callable[[Holdings], T]) -> tuple[T, tuple[Damage, ...]]:
    """Return what is made of some tables, and what was set aside for it.

    Where reading fails the files are compared with their checksums, and what is sound is read again.

    Raises
    ------
    ConfigError
        It cannot be read, and no file is damaged.
    """
    tables = tuple(tables)
    holdings = holdings_of(store, tables)
    for last in (False,) * _TRIES + (True,):
        try:
            return use(holdings), holdings.damaged
        except _failures() as error:
            found = holdings_of(store, tables, thorough=True)
            if last or found == holdings:
                step = "check the address, the rights and the memory; `wheelsoil fleet check STORE` reads every file"
                raise ConfigError.of("the store cannot be read", store.url, str(error), next_step=step) from None
            holdings = found
    raise AssertionError


def _failures() -> tuple[type[Exception], ...]:
    """Return what pyarrow raises for data that it cannot read."""
    import pyarrow as pa

    return (OSError, pa.ArrowException)


def _wrong_files(store: Store, table: str, parts: Sequence[Part]) -> dict[str, str]:
    """Return the parts whose file of a table is not as it should be, and why."""
    paths = [part.files[table].path for part in parts]
    sizes = store.sizes(paths)
    wrong = {}
    readable = []
    for part, size in zip(parts, sizes, strict=True):
        stated = part.files[table].bytes
        if size is None:
            wrong[part.name] = "missing"
        elif stated is not None and size != stated:
            wrong[part.name] = "size"
        else:
            readable.append(part)
    tails = store.contents([part.files[table].path for part in readable], start=-_TAIL, gone=b"")
    for part, tail in zip(readable, tails, strict=True):
        what = _wrong_footer(table, part, tail, store)
        if what:
            wrong[part.name] = what
    return wrong


def _wrong_footer(table: str, part: Part, tail: bytes, store: Store) -> str:
    """Return what is wrong with the footer at the end of a file; "" if nothing."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if len(tail) < 12 or tail[-4:] != _MAGIC:
        return "footer"
    length = struct.unpack("<I", tail[-8:-4])[0] + 8
    if length > len(tail):
        [tail] = store.contents([part.files[table].path], start=-length, gone=b"")
    try:
        footer = pq.read_metadata(pa.BufferReader(tail))
        if not footer.schema.equals(_schema(table)) and not _means(footer, table):
            return "another table"
        return "" if _has_rows(footer, table, part) else "another campaign"
    except (OSError, pa.ArrowException, ValueError, IndexError):
        return "footer"


@cache
def _schema(table: str) -> Any:
    """Return the schema of a table's files as Parquet has it."""
    import pyarrow.parquet as pq

    buffer = BytesIO()
    pq.write_table(schema_of(table).empty_table(), buffer)
    return pq.read_metadata(buffer).schema


def _means(footer: Any, table: str) -> bool:
    """Return whether a schema that another program wrote means the same."""
    return bool(footer.schema.to_arrow_schema().remove_metadata().equals(schema_of(table)))


def _has_rows(footer: Any, table: str, part: Part) -> bool:
    """Return whether the row groups are those of the part's campaigns, by their number of rows and statistics."""
    [[manifest]] = part.groups
    if footer.num_rows != manifest.rows[table]:
        return False
    return all(
        found is None or not found.has_min_max or found.min == found.max == manifest.content
        for found in (footer.row_group(i).column(0).statistics for i in range(footer.num_row_groups))
    )


def _wrong_data(store: Store, file: PartFile) -> str:
    """Return what is wrong with what a file holds; "" if nothing. Without a checksum it is read as a table."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with store.files.open(f"{store.root}/{file.path}", "rb") as opened:
            if file.sha256:
                return "" if hashlib.file_digest(opened, "sha256").hexdigest() == file.sha256 else "checksum"
            with pq.ParquetFile(opened, page_checksum_verification=True) as table:
                for i in range(table.num_row_groups):
                    table.read_row_group(i, use_threads=False)
    except (OSError, pa.ArrowException):
        return "data"
    return ""
