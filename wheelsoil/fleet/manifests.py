"""What the store has of each campaign, and in which files: manifests, the parts they name, and what is damaged."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import islice, repeat
from typing import Any
from urllib.parse import quote, unquote

from wheelsoil import __version__
from wheelsoil.fleet.tables import COLUMNS

DONE, PACKS = "done", "packs"
TAIL_BYTES = 1 << 16
"""At the end of a Parquet file, read at once: most footers are shorter."""
_SEAL = "checksum"
_END = b', "checksum": "%s"}'


@dataclass(frozen=True)
class Manifest:
    """What the store has of one campaign.

    Attributes
    ----------
    campaign, content : str
        Name, and the hash of what the rows depend on.
    state : "done" or "failed"
    fault : str
        Why it failed, or of one that is done what its silent wheels lack.
    verdict, causes : str
        Of its diagnosis; of the causes the names, with a comma between, of those that are named or not improbable.
    files : mapping path -> [bytes, time of change in ns]
        Of its sources when it was made.
    rows : mapping table -> number of rows
    options : mapping
        How it was made.
    cpu_s, peak_bytes : float, int
        What it took.
    parts : mapping table -> [bytes, SHA-256, SHA-256 of the last TAIL_BYTES]
        Of its own files; empty in a pack. Stores of older versions have none, or not the last one.
    made_at_ns : int
        Of two packs with a campaign the one with the later time counts.
    wheels : int
        Number of wheels that its rows are of; 0: they were written before there was a column for it.
    """

    campaign: str
    content: str
    state: str
    fault: str = ""
    verdict: str = ""
    causes: str = ""
    files: dict[str, list[int]] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    cpu_s: float = 0.0
    peak_bytes: int = 0
    version: str = __version__
    parts: dict[str, list[Any]] = field(default_factory=dict)
    made_at_ns: int = 0
    wheels: int = 1

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{quoted(self.campaign)}.{self.content}.json"

    @property
    def families(self) -> tuple[str, ...]:
        """Names of `causes`."""
        return tuple(filter(None, self.causes.split(",")))

    def text(self) -> bytes:
        """Return what its file holds."""
        return sealed(asdict(self))

    @staticmethod
    def of(values: Any) -> Manifest:
        """Check what a file holds.

        Raises
        ------
        ValueError
            A key is missing or unknown, or a value is of another kind.
        """
        if not isinstance(values, dict):
            raise ValueError("no mapping")
        for key, value in values.items():
            if key not in _KINDS or not _KINDS[key](value):
                raise ValueError(key)
        if not values.keys() >= _NEEDED:
            raise ValueError("a key is missing")
        found = object.__new__(Manifest)  # of 100,000 campaigns each: 14 attributes at once
        vars(found).update(_DEFAULTS, **values)
        return found


def _is_count(value: object) -> bool:
    return type(value) is int and value >= 0


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _are_sources(value: object) -> bool:
    return isinstance(value, dict) and all(
        isinstance(pair, list) and len(pair) == 2 and _is_count(pair[0]) and isinstance(pair[1], int)
        for pair in value.values()
    )


def _are_files(value: object) -> bool:
    return isinstance(value, dict) and all(
        isinstance(own, list) and len(own) in (2, 3) and _is_count(own[0]) and all(map(_is_text, own[1:]))
        for own in value.values()
    )


def _is_rows(value: object) -> bool:
    return isinstance(value, dict) and value.keys() <= COLUMNS.keys() and all(map(_is_count, value.values()))


_KINDS: dict[str, Any] = {
    **dict.fromkeys(("campaign", "content", "fault", "verdict", "causes", "version"), _is_text),
    "state": lambda value: value in ("done", "failed"),
    "files": _are_sources,
    "rows": _is_rows,
    "options": lambda value: isinstance(value, dict),
    "cpu_s": lambda value: isinstance(value, int | float) and value >= 0,
    "peak_bytes": _is_count,
    "made_at_ns": _is_count,
    "wheels": _is_count,
    "parts": _are_files,
}


_NEEDED = {"campaign", "content", "state"}
_ELSEWHERE = {"files", "options", "parts"}
"""Of a manifest, what its pack has in sources.json or for all."""
_SCALARS = {str, int, float, type(None)}
_DEFAULTS = {key: value for key, value in vars(Manifest("", "", "done", wheels=0)).items() if key not in _NEEDED}


@dataclass(frozen=True)
class Damage:
    """What a campaign is set aside for; it is all in the store's head (store.json) where `campaign` is empty.

    Attributes
    ----------
    file : str
        Below the store.
    what : str
        "manifest", "missing", "size", "footer", "another table", "another campaign", "checksum" or "data".
    manifest : str
        File of the campaign's manifest, below the store.
    """

    campaign: str
    file: str
    what: str
    manifest: str = ""


@dataclass(frozen=True)
class PartFile:
    """One table of a part.

    Its size, and the checksums of all and of its last `TAIL_BYTES`, are None and empty where its manifest does not
    state them.
    """

    path: str
    bytes: int | None
    sha256: str
    tail_sha256: str = ""


@dataclass(frozen=True)
class Part:
    """Campaigns that are written together.

    Attributes
    ----------
    name : str
        Of its manifest's file, below the store.
    groups : tuple of tuple of Manifest
        Campaigns of each row group.
    files : mapping table -> PartFile
    hidden : set of str
        Contents that a newer part replaces.
    lost : set of int
        Groups that are damaged.
    """

    name: str
    groups: tuple[tuple[Manifest, ...], ...]
    files: dict[str, PartFile]
    hidden: frozenset[str] = frozenset()
    lost: frozenset[int] = frozenset()

    @property
    def is_pack(self) -> bool:
        """Whether it is of many campaigns, which are a column of its tables."""
        return self.name.startswith(PACKS)

    @property
    def has_wheels(self) -> bool:
        """Whether its tables have the column of the wheel."""
        return any(manifest.wheels for manifest in self.all)

    @property
    def all(self) -> Iterator[Manifest]:
        """All of its campaigns."""
        return (manifest for group in self.groups for manifest in group)

    def used(self, group: int) -> Iterator[Manifest]:
        """Return the campaigns of a group that are neither replaced nor damaged."""
        return (
            manifest
            for manifest in self.groups[group]
            if group not in self.lost and manifest.content not in self.hidden
        )

    @property
    def manifests(self) -> Iterator[Manifest]:
        """Campaigns that are neither replaced nor damaged."""
        return (manifest for group in range(len(self.groups)) for manifest in self.used(group))

    @cached_property
    def held(self) -> dict[str, dict[int, tuple[int, str, str]]]:
        """Number of rows, first and last campaign of each group that has rows of a table, by table."""
        found: dict[str, dict[int, tuple[int, str, str]]] = {}
        for i, group in enumerate(self.groups):
            ordered = sorted(group, key=lambda manifest: manifest.campaign)
            for table in {table: None for manifest in group for table in manifest.rows}:
                some = [(manifest.campaign, count) for manifest in ordered if (count := manifest.rows.get(table))]
                if some:
                    found.setdefault(table, {})[i] = sum(count for _, count in some), some[0][0], some[-1][0]
        return found

    def row_groups(self, table: str) -> dict[int, int]:
        """Return the row group that each group's rows of a table are in, where it has any."""
        return {group: row_group for row_group, group in enumerate(self.held.get(table, ()))}


def stated(data: bytes) -> list[Any]:
    """Return what a manifest states of a file with this in it."""
    return [len(data), *(hashlib.sha256(each).hexdigest() for each in (data, data[-TAIL_BYTES:]))]


def part_of(manifest: Manifest) -> Part:
    """Return the part of a campaign that has one of its own."""
    place = f"campaign={quoted(manifest.campaign)}/{manifest.content}.parquet"
    files = {table: PartFile(f"{table}/{place}", *manifest.parts.get(table, (None, ""))) for table in manifest.rows}
    return Part(f"{DONE}/{manifest.name}", ((manifest,),), files)


def pack_of(name: str, text: bytes) -> Part:
    """Return the pack whose manifest has a name below the store and this text; `ValueError` if it is damaged."""
    values = unsealed(text)
    if not isinstance(values, dict) or not _are_files(values.get("parts")):
        raise ValueError("no pack")
    groups = _groups_of(values)
    folder = name.removesuffix(".json")
    tables = {file.removesuffix(".parquet"): tuple(facts) for file, facts in values["parts"].items()}
    files = {table: PartFile(f"{folder}/{table}.parquet", *tables[table]) for table in COLUMNS if table in tables}
    return Part(name, groups, files)


def text_of_pack(groups: Sequence[Sequence[Manifest]], parts: Mapping[str, list[Any]]) -> bytes:
    """Return what a pack's manifest holds: its campaigns by column, which is read faster than one by one.

    `groups` has the campaigns of each row group, `parts` what `stated` returns of each file.
    """
    every = [manifest for group in groups for manifest in group]
    tables = dict.fromkeys(table for manifest in every for table in manifest.rows)
    columns: dict[str, Any] = {
        key: [getattr(manifest, key) for manifest in every] for key in _KINDS if key not in _ELSEWHERE and key != "rows"
    }
    columns["rows"] = {table: [manifest.rows.get(table) for manifest in every] for table in tables}
    return sealed({"campaigns": columns, "groups": [len(group) for group in groups], "parts": parts})


def _groups_of(values: Mapping[str, Any]) -> tuple[tuple[Manifest, ...], ...]:
    """Return the campaigns of each row group of a pack; `ValueError` if they are damaged."""
    groups = values.get("groups")
    if not isinstance(groups, list):
        raise ValueError("groups")
    if values.keys() == {"groups", "parts"} and all(isinstance(group, list) for group in groups):  # as once written
        return tuple(tuple(map(Manifest.of, group)) for group in groups)
    if values.keys() != {"campaigns", "groups", "parts"} or not all(map(_is_count, groups)):
        raise ValueError("groups")
    every = iter(_manifests_of(values["campaigns"], sum(groups)))
    return tuple(tuple(islice(every, count)) for count in groups)


def _manifests_of(columns: Any, count: int) -> list[Manifest]:
    if not isinstance(columns, dict) or not isinstance(columns.get("rows"), dict):
        raise ValueError("campaigns")
    rows = columns["rows"]
    flat = {key: column for key, column in columns.items() if key != "rows"}
    if not _NEEDED <= flat.keys() <= _KINDS.keys() or not rows.keys() <= COLUMNS.keys():
        raise ValueError("a key is missing or unknown")
    checks = [_KINDS[key] for key in flat] + [lambda value: value is None or _is_count(value)] * len(rows)
    if not all(map(_is_column, (*flat.values(), *rows.values()), checks, repeat(count))):
        raise ValueError("a value is of another kind")
    counted = zip(*rows.values(), strict=True) if rows else repeat((), count)
    whole = {key: repeat(value, count) for key, value in _DEFAULTS.items()} | flat | {"rows": _mappings(rows, counted)}
    found = []
    for values in zip(*whole.values(), strict=True):
        manifest = object.__new__(Manifest)
        vars(manifest).update(zip(whole, values, strict=True))
        found.append(manifest)
    return found


def _mappings(keys: Mapping[str, Any], rows: Iterable[tuple[int | None, ...]]) -> Iterator[dict[str, int]]:
    """Yield each row as a mapping, without what is None."""
    for row in rows:
        own = dict(zip(keys, row, strict=True))
        yield {key: value for key, value in own.items() if value is not None} if None in row else own  # type: ignore[misc]


def _is_column(values: object, check: Callable[[object], bool], count: int) -> bool:
    """Return whether it is a list of so many values of a kind; each different value is looked at once."""
    return (
        isinstance(values, list)
        and len(values) == count
        and set(map(type, values)) <= _SCALARS
        and all(map(check, set(values)))
    )


def sources_path(name: str) -> str:
    """Return where a pack has the files and options of its campaigns."""
    return f"{name.removesuffix('.json')}/sources.json"


def sealed(values: Mapping[str, Any]) -> bytes:
    """Return values as JSON with a checksum of all of it."""
    text = json.dumps(values, sort_keys=True).encode()
    return text[:-1] + _END % hashlib.sha256(text).hexdigest().encode()


def unsealed(text: bytes) -> Any:
    """Return values that were written with `sealed`, or by an older version without a checksum.

    `ValueError` where it is no JSON, or has another checksum.
    """
    values = json.loads(text)
    if isinstance(values, dict) and _SEAL in values:
        seal = values.pop(_SEAL)
        whole = hashlib.sha256(memoryview(text)[: -len(_END % (b"0" * 64))])
        whole.update(b"}")
        if seal == whole.hexdigest():
            return values
        if seal != hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest():
            raise ValueError("another checksum")
    return values


def single_of(name: str, text: bytes) -> Manifest:
    """Return the manifest in the file of one campaign; `ValueError` if it is none, or of another."""
    found = Manifest.of(unsealed(text))
    if found.name != name:
        raise ValueError("of another campaign")
    return found


def quoted(name: str) -> str:
    """Return a campaign's name as its files have it."""
    return quote(name, safe=" ,()+@").replace(".", "%2E")


def campaign_of(manifest_name: str) -> str:
    """Return the campaign that a manifest's file belongs to, by the name of the file."""
    return unquote(manifest_name.partition(".")[0])
