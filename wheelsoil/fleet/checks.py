"""Checks of a store's Parquet files: size and footer, and on request every byte."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Iterator, Sequence
from functools import cache
from io import BytesIO
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wheelsoil.fleet.manifests import TAIL_BYTES, Part, PartFile
from wheelsoil.fleet.store import Store
from wheelsoil.fleet.tables import packed_schema_of, schema_of

_MAGIC = b"PAR1"
_SHORTEST = 12

Wrong = dict[int, str]
"""What is wrong with groups of a part."""


def wrong_groups(store: Store, table: str, parts: Sequence[Part], *, thorough: bool) -> dict[str, Wrong]:
    """Return what is wrong with the files of a table, by the name of their part.

    `parts` are those that have the table; `thorough` compares checksums, too.
    """
    files = [part.files[table] for part in parts]
    found: dict[str, Wrong] = {}
    readable = []
    for part, file, size in zip(parts, files, store.sizes([file.path for file in files]), strict=True):
        if size is None or size != (file.bytes if file.bytes is not None else size):
            found[part.name] = _all(part, "missing" if size is None else "size")
        else:
            readable.append(part)
    tails = store.contents([part.files[table].path for part in readable], start=-TAIL_BYTES, gone=b"")
    for part, tail in zip(readable, tails, strict=True):
        as_written = hashlib.sha256(tail).hexdigest() == part.files[table].tail_sha256
        wrong = {} if as_written else _wrong_footer(store, table, part, tail)
        if thorough and not wrong:
            wrong = _wrong_data(store, table, part)
        if wrong:
            found[part.name] = wrong
    return found


def failures() -> tuple[type[Exception], ...]:
    """Return what pyarrow raises for data that it cannot read."""
    return (OSError, pa.ArrowException)


def _all(part: Part, what: str) -> Wrong:
    return dict.fromkeys(range(len(part.groups)), what)


def _wrong_footer(store: Store, table: str, part: Part, tail: bytes) -> Wrong:
    """Return what the footer at the end of a file shows."""
    if len(tail) < _SHORTEST or tail[-4:] != _MAGIC:
        return _all(part, "footer")
    length = struct.unpack("<I", tail[-8:-4])[0] + 8
    if length > len(tail):
        [tail] = store.contents([part.files[table].path], start=-length, gone=b"")
    try:
        footer = pq.read_metadata(pa.BufferReader(tail))
        schema = footer.schema
        expected, as_written = _schemas(table, packed=part.is_pack, wheels=part.has_wheels)
        if not schema.equals(as_written) and not _means(schema, expected):
            return _all(part, "another table")
        return dict.fromkeys(_others(footer, table, part), "another campaign")
    except (OSError, pa.ArrowException, ValueError, IndexError):
        return _all(part, "footer")


@cache
def _schemas(table: str, *, packed: bool, wheels: bool) -> tuple[Any, Any]:
    """Return the schema of a table's files, and the same as Parquet has it."""
    schema = (packed_schema_of if packed else schema_of)(table, wheels=wheels)
    buffer = BytesIO()
    pq.ParquetWriter(buffer, schema).close()
    return schema, pq.read_metadata(buffer).schema


def _means(schema: Any, expected: Any) -> bool:
    """Return whether a schema that another program wrote means the same."""
    return bool(schema.to_arrow_schema().remove_metadata().equals(expected))


def _others(footer: Any, table: str, part: Part) -> Iterator[int]:
    """Yield the groups whose number of rows or first column is not that of their campaigns."""
    if not part.is_pack:
        [[manifest]] = part.groups
        columns = [footer.row_group(i).column(0).statistics for i in range(footer.num_row_groups)]
        if footer.num_rows != manifest.rows[table] or any(_differs(each, {manifest.content}) for each in columns):
            yield 0
        return
    places = part.row_groups(table)
    if footer.num_row_groups != len(places):
        yield from range(len(part.groups))
        return
    for group, place in places.items():
        rows, *names = part.held[table][group]
        found = footer.row_group(place)
        if found.num_rows != rows or _differs(found.column(0).statistics, names):
            yield group


def _differs(statistics: Any, values: Collection[str]) -> bool:
    if statistics is None or not statistics.has_min_max:
        return False
    return bool((statistics.min, statistics.max) != (min(values), max(values)))


def _wrong_data(store: Store, table: str, part: Part) -> Wrong:
    """Return what a file's bytes show: its checksum, and which row groups cannot be read."""
    file = part.files[table]
    if file.sha256 and _checksum(store, file) == file.sha256:
        return {}
    unread: Wrong = {}
    try:
        with store.files.open(f"{store.root}/{file.path}", "rb") as opened:
            read = pq.ParquetFile(opened, page_checksum_verification=True)
            for group, place in part.row_groups(table).items():
                try:
                    read.read_row_group(place, use_threads=False)
                except failures():
                    unread[group] = "data"
    except failures():
        return _all(part, "data")
    return unread or (_all(part, "checksum") if file.sha256 else {})


def _checksum(store: Store, file: PartFile) -> str:
    try:
        with store.files.open(f"{store.root}/{file.path}", "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError:
        return ""
