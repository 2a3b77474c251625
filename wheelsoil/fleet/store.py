"""The store: immutable Parquet files in a folder or a bucket, one writer for each campaign, its manifest last.

::

    STORE/store.json                               the schema's version
    STORE/TABLE/campaign=NAME/CONTENT.parquet      rows of one campaign; its name is the partition
    STORE/done/NAME.CONTENT.json                   the manifest: this campaign is whole
    STORE/packs/                                   many campaigns together (`wheelsoil.fleet.packs`)
    STORE/drafts/                                  files that are being written

CONTENT is a hash of everything the rows depend on, so that who writes a campaign a second time writes the same files.
A file that no manifest names belongs to a campaign that is not finished: queries do not see it.
"""

from __future__ import annotations

import gc
import json
import os
import platform
import stat
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from daq import ConfigError, not_installed
from wheelsoil import __version__
from wheelsoil.fleet.manifests import (
    DONE,
    PACKS,
    Damage,
    Manifest,
    Part,
    campaign_of,
    pack_of,
    part_of,
    single_of,
    sources_path,
    stated,
    unsealed,
)
from wheelsoil.fleet.tables import COLUMNS

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

SCHEMA = "wheelsoil/store/1"
DRAFTS, _DRAFT = "drafts", ".draft"
_ABANDONED_S = 3600.0
_HEAD = "store.json"
_AT_ONCE = 200


@dataclass(frozen=True)
class Listing:
    """What a store has by its manifests.

    Attributes
    ----------
    parts : tuple of Part
        In use: single ones by name, then packs.
    damaged : tuple of Damage
        Manifests that cannot be read.
    older : tuple of Part
        What newer parts replace.
    packs : tuple of Part
        All that can be read, as they were written.
    """

    parts: tuple[Part, ...]
    damaged: tuple[Damage, ...] = ()
    older: tuple[Part, ...] = ()
    packs: tuple[Part, ...] = ()


@dataclass(frozen=True)
class Store:
    """A store; open it with `open_store`."""

    files: AbstractFileSystem
    root: str
    url: str
    head_damaged: bool = False

    @property
    def is_local(self) -> bool:
        """Whether it is a folder of this machine."""
        return self.protocol == "file"

    @property
    def protocol(self) -> str:
        """Of its address: "file", "s3"."""
        known = self.files.protocol
        return known if isinstance(known, str) else str(known[0])

    @property
    def is_open_to_all(self) -> bool:
        """Whether everyone on this machine may write into it."""
        return self.is_local and os.name == "posix" and bool(Path(self.root).stat().st_mode & stat.S_IWOTH)

    def listing(self) -> Listing:
        """Return what was written of finished campaigns, by name.

        While a campaign's new rows replace older ones there are two for a moment. A single part counts more than a
        pack, of two the newer file; of two packs the one in which the campaign is newer.
        """
        with _reached(self.url), uncollected():
            self.files.invalidate_cache()
            singles, damaged, older = self._singles()
            packs, unread = self._packs()
        damaged = [damage for damage in damaged if damage.campaign not in singles]
        names = [manifest.campaign for pack in packs for manifest in pack.all]
        packed = set(names)
        newest = newest_of(packs) if len(packed) < len(names) else {}
        parts = [singles[name] for name in sorted(singles)]
        for pack in packs:
            won = own = list(pack.all)
            if singles or newest:
                alone = (0, pack.name)
                won = [
                    manifest
                    for manifest in own
                    if manifest.campaign not in singles and newest.get(manifest.campaign, alone)[1] == pack.name
                ]
            hidden = (
                {manifest.content for manifest in own}.difference(manifest.content for manifest in won)
                if len(won) < len(own)
                else ()
            )
            (parts if won else older).append(replace(pack, hidden=frozenset(hidden)))
        for name, campaigns in unread.items():
            left = [campaign for campaign in campaigns if campaign not in singles and campaign not in packed]
            damaged += [Damage(campaign, name, "manifest", name) for campaign in left]
            older += [] if left else [Part(name, (), {})]
        damaged += [Damage("", _HEAD, "manifest")] if self.head_damaged else []
        return Listing(tuple(parts), tuple(damaged), tuple(older), tuple(packs))

    def _singles(self) -> tuple[dict[str, Part], list[Damage], list[Part]]:
        """Return the parts of one campaign, manifests that cannot be read, and parts that newer ones replace."""
        found: dict[str, Part] = {}
        damaged: list[Damage] = []
        older: list[Part] = []
        for name, text in self._manifest_texts(DONE):
            file = name.rpartition("/")[2]
            try:
                manifest = single_of(file, text)
            except ValueError:
                damaged.append(Damage(campaign_of(file), name, "manifest", name))
                continue
            if manifest.campaign in found:
                older.append(found[manifest.campaign])
            found[manifest.campaign] = part_of(manifest)
        return found, damaged, older

    def _packs(self) -> tuple[list[Part], dict[str, list[str]]]:
        """Return the packs, and the campaigns of those whose manifest cannot be read."""
        found: list[Part] = []
        unread: dict[str, list[str]] = {}
        for name, text in self._manifest_texts(PACKS):
            try:
                found.append(pack_of(name, text))
            except ValueError:
                unread[name] = list(self.sources(name)) or [""]
        return sorted(found, key=lambda pack: pack.name), unread

    def sources(self, pack: str) -> dict[str, Any]:
        """Return the files and options of a pack's campaigns; nothing if they cannot be read."""
        try:
            values = unsealed(next(self.contents([sources_path(pack)])))
        except (OSError, ValueError):
            return {}
        return values if isinstance(values, dict) else {}

    def _manifest_texts(self, folder: str) -> Iterator[tuple[str, bytes]]:
        """Yield the manifests in a folder by name, with their text, the newest last."""
        listed = self.files.ls(f"{self.root}/{folder}", detail=True) if self._holds(folder) else []
        files = [entry for entry in listed if entry["type"] == "file"]  # a bucket says no time of its folders
        names = [entry["name"].rpartition("/")[2] for entry in sorted(files, key=_changed)]
        paths = [f"{folder}/{name}" for name in names if name.endswith(".json") and not name.startswith(".")]
        for path, text in zip(paths, self.contents(paths, gone=b"gone"), strict=True):
            if text != b"gone":
                yield path, text

    def sizes(self, paths: Sequence[str]) -> list[int | None]:
        """Return the bytes of files of one table; None of one that is not there."""
        with _reached(self.url):
            if self.is_local:
                return [_size(f"{self.root}/{path}") for path in paths]
            folders = {path.partition("/")[0] for path in paths}
            found = {name: entry["size"] for each in folders for name, entry in self._found(each).items()}
            return [found.get(f"{self.root}/{path}") for path in paths]

    def _found(self, folder: str) -> dict[str, Any]:
        return dict(self.files.find(f"{self.root}/{folder}", detail=True))

    def contents(self, paths: Sequence[str], *, start: int | None = None, gone: bytes | None = None) -> Iterator[bytes]:
        """Yield what files hold from `start` on, many at once of a bucket; `gone` for one that is no longer there."""
        for begin in range(0, len(paths), _AT_ONCE):
            some = [f"{self.root}/{path}" for path in paths[begin : begin + _AT_ONCE]]
            with _served(self.url):  # `cat` would take the brackets of a folder's name for a pattern
                read = self.files.cat_ranges(some, None, None) if start is None else list(self._tails(some, start))
            for found in read:
                if isinstance(found, FileNotFoundError) and gone is not None:
                    yield gone
                elif isinstance(found, BaseException):
                    raise found
                else:
                    yield found

    def _tails(self, paths: Sequence[str], start: int) -> Iterator[bytes | BaseException]:
        if not self.is_local:
            yield from self.files.cat_ranges(list(paths), [start] * len(paths), None)
            return
        for path in paths:
            try:
                with Path(path).open("rb") as file:
                    file.seek(max(0, file.seek(0, os.SEEK_END) + start))
                    yield file.read()
            except OSError as error:
                yield error

    def has(self, campaign: str, content: str) -> bool:
        """Return whether a campaign is there in full."""
        with _reached(self.url):
            return self._holds(f"{DONE}/{Manifest(campaign, content, '').name}", anew=True)

    def put(self, manifest: Manifest, tables: Mapping[str, pa.Table], older: Iterable[str] = ()) -> None:
        """Write a campaign: its tables, then its manifest; then remove the older manifests of it, and their files."""
        with _reached(self.url):
            made = {table: encoded(rows) for table, rows in tables.items()}
            parts = {table: stated(data) for table, data in made.items()}
            manifest = replace(manifest, parts=parts, made_at_ns=time.time_ns())
            for table, file in part_of(manifest).files.items():
                self._write(f"{self.root}/{file.path}", made[table])
            self._write(f"{self.root}/{DONE}/{manifest.name}", manifest.text(), once=True)
        self.remove(name for name in older if name != f"{DONE}/{manifest.name}")

    def withdraw(self, names: Iterable[str]) -> None:
        """Remove manifests, by the names of their files: these campaigns are no longer finished."""
        with _reached(self.url):
            for name in names:
                self._remove(name)
            self.files.invalidate_cache()

    def remove(self, names: Iterable[str]) -> None:
        """Remove the manifests of single campaigns, then the files that they name."""
        for name in names:
            self.withdraw([name])
            campaign, content = campaign_of(name.rpartition("/")[2]), name.rpartition(".")[0].rpartition(".")[2]
            everything = Manifest(campaign, content, "done", rows=dict.fromkeys(COLUMNS, 0))
            with _reached(self.url):
                for file in part_of(everything).files.values():
                    self._remove(file.path)

    def remove_pack(self, name: str) -> None:
        """Remove a pack, by the name of its manifest, and its files."""
        self.withdraw([name])
        folder = f"{self.root}/{name.removesuffix('.json')}"
        with _reached(self.url), suppress(FileNotFoundError):
            self.files.rm(folder, recursive=True)

    def discard(self, paths: Iterable[str]) -> None:
        """Remove files below the store."""
        with _reached(self.url):
            for path in paths:
                self._remove(path)

    def older_than(self, folder: str, seconds: float) -> list[str]:
        """Return files in a folder, however deep, that were written before some time, by their path below the store."""
        with _reached(self.url):
            found = self._found(folder) if self._holds(folder) else {}
        limit = time.time() - seconds
        return [
            name.removeprefix(f"{self.root}/") for name, entry in found.items() if _seconds(_changed(entry)) <= limit
        ]

    def remove_drafts(self) -> None:
        """Remove files over which their writers were killed."""
        for draft in Path(self.root, DRAFTS).glob(f"*{_DRAFT}") if self.is_local else ():
            with suppress(OSError, ValueError):
                if _is_abandoned(draft):
                    draft.unlink()

    def write(self, path: str, data: bytes) -> None:
        """Write a whole file or nothing, at a place below the store."""
        with _reached(self.url):
            self._write(f"{self.root}/{path}", data)

    def _remove(self, path: str) -> None:
        """Remove a file if it is there, and the folder of its campaign if nothing else is in it."""
        with suppress(FileNotFoundError):
            self.files.rm_file(f"{self.root}/{path}")
        if self.is_local and "/campaign=" in path:
            with suppress(OSError):
                Path(self.root, path).parent.rmdir()

    def _holds(self, name: str, *, anew: bool = False) -> bool:
        if anew:
            self.files.invalidate_cache()
        return bool(self.files.exists(f"{self.root}/{name}"))

    def _write(self, path: str, data: bytes, *, once: bool = False) -> None:
        """Write a whole file or nothing; of two that write one `once`, the first wins."""
        if self.is_local:
            _write_and_rename(Path(self.root, DRAFTS), Path(path), data)
            return
        try:
            self.files.pipe_file(path, data, mode="create" if once else "overwrite")
        except FileExistsError:
            return


def newest_of(packs: Iterable[Part]) -> dict[str, tuple[int, str]]:
    """Return when each campaign in packs was last made, ns, and the pack that has it so."""
    found: dict[str, tuple[int, str]] = {}
    for pack in packs:
        for manifest in pack.all:
            found[manifest.campaign] = max(found.get(manifest.campaign, (-1, "")), (manifest.made_at_ns, pack.name))
    return found


def encoded(rows: pa.Table, **options: Any) -> bytes:
    """Return rows as a Parquet file whose pages have checksums."""
    buffer = BytesIO()
    pq.write_table(rows, buffer, compression="zstd", write_page_checksum=True, **options)
    return buffer.getvalue()


def open_store(url: str, *, create: bool = False) -> Store:
    """Open a store.

    Parameters
    ----------
    url : str
        A folder, or what fsspec knows: ``s3://bucket/folder``.
    create : bool
        Make one where there is none.

    Raises
    ------
    ConfigError
        There is none, it cannot be reached or written, or it is of another schema version.
    """
    from fsspec.core import url_to_fs

    with _reached(url):
        try:
            files, root = url_to_fs(url)
        except ImportError as error:
            if url.startswith("s3:"):
                raise not_installed("S3 buckets", "s3fs", url, "s3") from None
            raise ConfigError.of(
                "the store's file system is not installed", url, str(error), "", "install the package named above"
            ) from None
        except ValueError as error:
            raise ConfigError.of("the store's address is not known", url, str(error), "a folder, or s3://...") from None
        store = Store(files, root.rstrip("/"), url)
        head = f"{store.root}/{_HEAD}"
        if not files.exists(head):
            if not create:
                step = "`wheelsoil fleet run ROOT --store STORE` makes one"
                raise ConfigError.of("there is no store", url, f"no {_HEAD}", next_step=step)
            if files.exists(store.root) and any(not str(name).endswith(f"/{DRAFTS}") for name in _names_in(store)):
                step = "name an empty or a new folder"
                raise ConfigError.of("the folder is no store, and not empty", url, next_step=step)
            store._write(head, _head(), once=True)
        schema = _schema_in(files.cat_file(head))
        if schema is None:
            if not (store._holds(DONE) or store._holds(PACKS)):
                step = f"remove {_HEAD} if no campaign was finished, or name another folder"
                raise ConfigError.of("there is no store", url, f"{_HEAD} cannot be read", SCHEMA, step)
            if create:
                store._write(head, _head())
            return replace(store, head_damaged=not create)
    if schema != SCHEMA:
        step = "name another store, or use the version of wheelsoil that made it"
        raise ConfigError.of("the store is of another schema version", url, str(schema), SCHEMA, step)
    return store


def _names_in(store: Store) -> list[str]:
    return [entry["name"] for entry in store.files.ls(store.root, detail=True)]


def _head() -> bytes:
    return json.dumps({"schema": SCHEMA, "made_by": f"wheelsoil {__version__}"}).encode()


def _schema_in(head: bytes) -> str | None:
    """Return the schema that a store's head states; None if it is damaged."""
    try:
        found = json.loads(head)["schema"]
    except (ValueError, LookupError, TypeError):
        return None
    return found if isinstance(found, str) else None


@contextmanager
def uncollected() -> Iterator[None]:
    """Pause the search for cyclic garbage, which looks at each of a million new values again and again."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()


@contextmanager
def _reached(url: str) -> Iterator[None]:
    """Raise what a file system says as `ConfigError`."""
    try:
        with _served(url):
            yield
    except ConfigError:
        raise
    except (OSError, ValueError) as error:
        step = "check the address, the rights (`aws s3 ls`, `ls -ld`) and the space that is left"
        raise ConfigError.of("the store cannot be read or written", url, str(error), next_step=step) from None


@contextmanager
def _served(url: str) -> Iterator[None]:
    """Raise what a bucket's server says as `ConfigError`."""
    try:
        yield
    except (ConfigError, OSError, ValueError):
        raise
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in ("botocore", "aiobotocore", "s3fs", "fsspec", "aiohttp"):
            raise
        step = "check the address and the credentials (AWS_ACCESS_KEY_ID, AWS_PROFILE, AWS_ENDPOINT_URL)"
        raise ConfigError.of("the store cannot be reached", url, str(error), next_step=step) from None


def _size(path: str) -> int | None:
    try:
        return Path(path).stat().st_size
    except OSError:
        return None


def _seconds(changed: Any) -> float:
    return float(changed.timestamp() if hasattr(changed, "timestamp") else changed)


def _changed(entry: Mapping[str, Any]) -> Any:
    return entry.get("mtime") or entry.get("LastModified") or 0


def _write_and_rename(drafts: Path, path: Path, data: bytes) -> None:
    for folder in (drafts, path.parent):
        folder.mkdir(parents=True, exist_ok=True)
    draft = drafts / f"{platform.node()}.{os.getpid()}.{threading.get_ident()}{_DRAFT}"
    for last in (False, True):
        try:
            with draft.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
            return
        except FileNotFoundError:  # another machine of the same name took it for abandoned
            if last:
                raise
        except BaseException:
            draft.unlink(missing_ok=True)
            raise


def _is_abandoned(draft: Path) -> bool:
    """Return whether the writer of a draft has ended; of another machine's, whether it is old."""
    machine, pid, _ = draft.name.removesuffix(_DRAFT).rsplit(".", 2)
    if machine != platform.node() or os.name != "posix":
        return time.time() - draft.stat().st_mtime > _ABANDONED_S
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False
