"""What a store holds that can be read: campaigns, their tables, and what had to be set aside.

Before a table is read, each of its files has to be there, with the size that its manifest states and a footer of this
table and these campaigns. What a file holds has a checksum; it is compared where reading fails, and on request.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from daq import ConfigError
from wheelsoil.fleet.checks import failures, wrong_groups
from wheelsoil.fleet.manifests import Damage, Manifest, Part
from wheelsoil.fleet.store import Listing, Store
from wheelsoil.fleet.tables import COLUMNS, packed_schema_of, schema_of, with_later_columns

if TYPE_CHECKING:
    from pyarrow.dataset import Dataset, Expression

T = TypeVar("T")

_TRIES = 3


@dataclass(frozen=True)
class Holdings(Listing):
    """Campaigns of a store that can be read: of its parts those that are sound."""

    store: Store = field(kw_only=True)

    @property
    def manifests(self) -> dict[str, Manifest]:
        """What the store has of each campaign, by name; without files and options of those in packs."""
        return dict(sorted((manifest.campaign, manifest) for part in self.parts for manifest in part.manifests))

    def sources(self) -> dict[str, Any]:
        """Return the files and options of each campaign by name, also of those in packs; nothing of those unknown."""
        found: dict[str, Any] = {}
        for part in self.parts:
            of_pack = self.store.sources(part.name) if part.is_pack else {}
            for manifest in part.manifests:
                own = {"files": manifest.files, "options": manifest.options}
                found[manifest.campaign] = of_pack.get(manifest.campaign, own) if part.is_pack else own
        return found

    def datasets(self, table: str) -> list[Dataset]:
        """Return a table with its campaign as the first column; its files are read when it is.

        The first one has all rows but those of packs of which some campaigns are replaced.
        """
        from pyarrow import dataset

        holding = [part for part in self.parts if table in part.files]
        whole = self._dataset(table, [part for part in holding if not part.hidden])
        content = dataset.field("content")
        return [
            whole,
            *(
                self._dataset(table, [part]).filter(~content.isin(sorted(part.hidden)))
                for part in holding
                if part.hidden
            ),
        ]

    def where(self, table: str, columns: Sequence[str], wanted: Expression) -> pa.Table:
        """Return the rows of a table that a condition holds for."""
        found = [each.to_table(columns=list(columns), filter=wanted) for each in self.datasets(table)]
        return pa.concat_tables(found)

    def _dataset(self, table: str, parts: Sequence[Part]) -> Dataset:
        from pyarrow import dataset, fs

        store = self.store
        files = fs.LocalFileSystem() if store.is_local else fs.PyFileSystem(fs.FSSpecHandler(store.files))
        checks = dataset.ParquetFragmentScanOptions(page_checksum_verification=True)
        format = dataset.ParquetFileFormat(default_fragment_scan_options=checks)
        fragments = []
        for part in parts:
            path = f"{store.root}/{part.files[table].path}"
            known = dataset.scalar(True) if part.has_wheels else dataset.field("wheel") == ""
            if part.is_pack:
                groups = [place for group, place in part.row_groups(table).items() if group not in part.lost]
                fragments += [format.make_fragment(path, files, known, groups)] if groups else []
            else:
                named = dataset.field("campaign") == part.groups[0][0].campaign
                fragments.append(format.make_fragment(path, files, partition_expression=named & known))
        return dataset.FileSystemDataset(fragments, packed_schema_of(table), format, files)

    def table(self, name: str, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows of a table of all campaigns, by campaign, which is its first column."""
        columns = schema_of(name).names if columns is None else list(columns)
        wanted = ["campaign", *columns]
        holding = [part for part in self.parts if name in part.files]
        pieces = [pa.schema([packed_schema_of(name).field(column) for column in wanted]).empty_table()]
        singles = [part for part in holding if not part.is_pack]
        for part, data in zip(
            singles, self.store.contents([single.files[name].path for single in singles]), strict=True
        ):
            rows = pq.ParquetFile(BytesIO(data), page_checksum_verification=True).read(columns, use_threads=False)
            pieces.append(_of_campaign(part, rows).select(wanted))
        packs = replace(self, parts=tuple(part for part in holding if part.is_pack))
        if packs.parts:
            pieces += [each.to_table(columns=wanted, use_threads=False) for each in packs.datasets(name)]
        rows = pa.concat_tables(pieces)
        return rows.sort_by("campaign") if packs.parts else rows


def _of_campaign(part: Part, rows: pa.Table) -> pa.Table:
    campaign = pa.array([part.groups[0][0].campaign] * len(rows), pa.string())
    return with_later_columns(rows).add_column(0, "campaign", campaign)


def rows_of_group(store: Store, part: Part, group: int, table: str, contents: set[str]) -> pa.Table | None:
    """Return the rows of some campaigns of a group, with their campaign; None where it has none."""
    place = part.row_groups(table).get(group)
    if table not in part.files or place is None:
        return None
    with store.files.open(f"{store.root}/{part.files[table].path}", "rb") as opened:
        file = pq.ParquetFile(opened, page_checksum_verification=True)
        if not part.is_pack:
            rows = _of_campaign(part, file.read(use_threads=False))
        else:
            rows = with_later_columns(file.read_row_group(place, use_threads=False))
            rows = rows.filter(pc.is_in(rows["content"], pa.array(sorted(contents))))
    schema = packed_schema_of(table)
    return rows.select(schema.names).cast(schema)


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
        wrong = wrong_groups(store, table, holding, thorough=thorough)
        if not wrong:
            continue
        for part in holding:
            for group, what in sorted(wrong.get(part.name, {}).items()):
                path = part.files[table].path
                damaged += [Damage(manifest.campaign, path, what, part.name) for manifest in part.used(group)]
        parts = [replace(part, lost=part.lost | wrong.get(part.name, {}).keys()) for part in parts]
        parts = [part for part in parts if any(part.manifests)]
    return Holdings(tuple(parts), tuple(damaged), listing.older, listing.packs, store=store)


def read(store: Store, tables: Iterable[str], use: Callable[[Holdings], T]) -> tuple[T, tuple[Damage, ...]]:
    """Return what is made of some tables, and what was set aside for it.

    Where reading fails the files are compared with their checksums, and what is sound is read again. `ConfigError`
    where they cannot be read and no file is damaged.
    """
    tables = tuple(tables)
    holdings = holdings_of(store, tables)
    for last in (False,) * _TRIES + (True,):
        try:
            return use(holdings), holdings.damaged
        except failures() as error:
            found = holdings_of(store, tables, thorough=True)
            if last or found == holdings:
                step = "check the address, the rights and the memory; `wheelsoil fleet check STORE` reads every file"
                raise ConfigError.of("the store cannot be read", store.url, str(error), next_step=step) from None
            holdings = found
    raise AssertionError
