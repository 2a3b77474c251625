"""Packs: parts of up to 1,000 campaigns, which compaction makes of single ones.

::

    STORE/packs/ID/TABLE.parquet    rows of its campaigns, those of 50 in a row group
    STORE/packs/ID/sources.json     the files and options that each campaign was made of
    STORE/packs/ID.json             the manifest: this pack is whole

A pack is written whole and then named by its manifest; only then is removed what it replaces, manifests first. Killed
anywhere in between, a campaign is in the store twice, and its single part counts. ID is a hash of what is packed, so
that the next compaction writes the same files.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import groupby, islice
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from daq import ConfigError
from wheelsoil.fleet.checks import failures
from wheelsoil.fleet.holdings import Holdings, holdings_of, rows_of_group
from wheelsoil.fleet.manifests import DONE, PACKS, Manifest, Part, quoted, sealed, sources_path, stated, text_of_pack
from wheelsoil.fleet.store import Store, newest_of
from wheelsoil.fleet.tables import COLUMNS, packed_schema_of

T = TypeVar("T")

CAMPAIGNS_OF_A_PACK = 1000
CAMPAIGNS_OF_A_GROUP = 50
_LOCK = ".compact.lock"
_STALE_S = 3600.0
"""A file that no manifest names for so long belongs to no writer."""


@dataclass(frozen=True)
class Compacted:
    """What compaction did: campaigns that were packed, packs that were written, and all packs there are now."""

    campaigns: int
    written: int
    packs: int


def compact(store: Store) -> Compacted:
    """Put single parts, and packs that are small or hold rows that are no longer used, together into packs.

    Queries see the same rows before, while it works, and after it. What is damaged stays where it is.

    Raises
    ------
    ConfigError
        Another compaction is running (in a bucket this is not noticed), or the store cannot be written.
    """
    with _alone(store):
        holdings = holdings_of(store)
        sound = {manifest.campaign for part in holdings.parts for manifest in part.manifests}
        _remove(store, [part for part in holdings.older if {manifest.campaign for manifest in part.all} <= sound])
        store.remove_drafts()
        _sweep(holdings)
        parts = _to_pack(holdings)
        kept = sum(part.is_pack for part in holdings.parts) - sum(part.is_pack for part in parts)
        if not parts:
            return Compacted(0, 0, kept)
        made_of = replace(holdings, parts=tuple(parts)).sources()
        entries = [(part, group) for part in parts for group in range(len(part.groups))]
        try:
            newest = newest_of(holdings.packs)
            written = [_write(store, chunk, made_of, newest) for chunk in _chunks(entries)]
        except failures() as error:
            step = "`wheelsoil fleet run ROOT --store STORE --check` makes anew what is damaged"
            raise ConfigError.of("a file of the store cannot be read", store.url, str(error), next_step=step) from None
        _remove(store, [part for part in parts if part.name not in written])
        return Compacted(len(made_of), len(written), kept + len(written))


@contextmanager
def _alone(store: Store) -> Iterator[None]:
    """Hold the lock of a local store; the system frees it when the process ends, however it does."""
    if not store.is_local:
        yield
        return
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with Path(store.root, _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ConfigError.of("another compaction is running", store.url, next_step="wait for its end") from None
        yield


def _to_pack(holdings: Holdings) -> list[Part]:
    """Return the parts that are to be written anew: all single ones, and packs that are not full or not all used."""
    broken = {damage.manifest for damage in holdings.damaged}
    singles = [part for part in holdings.parts if not part.is_pack]
    packs = [part for part in holdings.parts if part.is_pack and part.name not in broken]
    dirty = [part for part in packs if part.hidden]
    small = [part for part in packs if not part.hidden and sum(1 for _ in part.all) < CAMPAIGNS_OF_A_PACK]
    return [*dirty, *small, *singles] if singles or dirty or len(small) > 1 else []


def _chunks(entries: Sequence[tuple[Part, int]]) -> Iterator[list[tuple[Part, int, Manifest]]]:
    """Yield the campaigns of each new pack, with the part and the row group that they are in."""
    every = ((part, group, manifest) for part, group in entries for manifest in part.used(group))
    yield from _batched(every, CAMPAIGNS_OF_A_PACK)


def _write(
    store: Store,
    chunk: Sequence[tuple[Part, int, Manifest]],
    made_of: Mapping[str, Any],
    newest: Mapping[str, tuple[int, str]],
) -> str:
    """Write one pack; return the name of its manifest."""
    buffers: dict[str, BytesIO] = {}
    writers: dict[str, Any] = {}
    groups: list[list[Manifest]] = []
    for some in _batched(chunk, CAMPAIGNS_OF_A_GROUP):
        for table, rows in _rows(store, some).items():
            _writer(table, buffers, writers).write_table(rows, row_group_size=len(rows))
        groups.append([_packed(manifest, newest if not part.is_pack else {}) for part, _, manifest in some])
    for writer in writers.values():
        writer.close()
    data = {f"{table}.parquet": buffer.getvalue() for table, buffer in buffers.items()}
    data["sources.json"] = sealed({manifest.campaign: made_of[manifest.campaign] for _, _, manifest in chunk})
    text = json.dumps(
        [[manifest.campaign, manifest.content, manifest.made_at_ns] for group in groups for manifest in group]
    )
    name = hashlib.sha256(text.encode()).hexdigest()[:16]
    parts = {file: stated(each) for file, each in data.items()}
    for file, each in data.items():
        store.write(f"{PACKS}/{name}/{file}", each)
    store.write(f"{PACKS}/{name}.json", text_of_pack(groups, parts))
    return f"{PACKS}/{name}.json"


def _packed(manifest: Manifest, newest: Mapping[str, tuple[int, str]]) -> Manifest:
    """Return a manifest as a pack holds it: it has to be newer than one of the same campaign in another pack."""
    made_at_ns = max(manifest.made_at_ns, newest.get(manifest.campaign, (-1, ""))[0] + 1)
    return replace(manifest, made_at_ns=made_at_ns, wheels=max(manifest.wheels, 1))


def _writer(table: str, buffers: dict[str, BytesIO], writers: dict[str, Any]) -> Any:
    if table not in writers:
        buffers[table] = BytesIO()
        writers[table] = pq.ParquetWriter(
            buffers[table], packed_schema_of(table), compression="zstd", write_page_checksum=True
        )
    return writers[table]


def _batched(items: Iterable[T], size: int) -> Iterator[list[T]]:
    iterator = iter(items)
    while some := list(islice(iterator, size)):
        yield some


def _rows(store: Store, some: Iterable[tuple[Part, int, Manifest]]) -> dict[str, pa.Table]:
    """Return the rows of some campaigns by table, in their order."""
    found: dict[str, list[pa.Table]] = {}
    for (_, group), entries in groupby(some, key=lambda entry: (entry[0].name, entry[1])):
        own = list(entries)
        part, contents = own[0][0], {manifest.content for _, _, manifest in own}
        for table in COLUMNS:
            rows = rows_of_group(store, part, group, table, contents)
            if rows is not None and len(rows):
                found.setdefault(table, []).append(rows)
    return {table: pa.concat_tables(pieces).combine_chunks() for table, pieces in found.items()}


def _sweep(holdings: Holdings) -> None:
    """Remove files that no manifest names: of a writer or a compaction that was killed some time ago."""
    parts = (*holdings.parts, *holdings.older)
    named = {file.path for part in parts for file in part.files.values()}
    named |= {sources_path(part.name) for part in parts if part.is_pack} | {part.name for part in parts}
    damaged = {damage.manifest for damage in holdings.damaged}  # which may be mended by hand
    spared = {f"campaign={quoted(damage.campaign)}" for damage in holdings.damaged}
    spared |= {name.removeprefix(f"{PACKS}/").removesuffix(".json") for name in damaged}
    holdings.store.discard(
        path
        for folder in (*COLUMNS, DONE, PACKS)
        for path in holdings.store.older_than(folder, _STALE_S)
        if path not in named and path not in damaged and path.split("/")[1] not in spared
    )


def _remove(store: Store, parts: Sequence[Part]) -> None:
    """Remove parts: their manifests first."""
    store.remove(part.name for part in parts if not part.is_pack)
    for part in parts:
        if part.is_pack:
            store.remove_pack(part.name)
