"""The store: immutable Parquet files in a folder or a bucket, one writer for each campaign, its manifest last.

::

    STORE/store.json                               the schema's version
    STORE/TABLE/campaign=NAME/CONTENT.parquet      rows of one campaign; its name is the partition
    STORE/done/NAME.CONTENT.json                   the manifest: this campaign is whole

CONTENT is a hash of everything the rows depend on, so that who writes a campaign a second time writes the same files.
A file that no manifest names belongs to a campaign that is not finished: queries do not see it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

from daq import ConfigError, not_installed
from wheelsoil import __version__
from wheelsoil.fleet.tables import schema_of

if TYPE_CHECKING:
    import pyarrow as pa
    from fsspec import AbstractFileSystem
    from pyarrow.dataset import Dataset

SCHEMA = "wheelsoil/store/1"
_HEAD, _DONE = "store.json", "done"
_AT_ONCE = 200


@dataclass(frozen=True)
class Manifest:
    """What the store has of one campaign.

    Attributes
    ----------
    campaign, content : str
        Name, and the hash of what the rows depend on.
    state : "done" or "failed"
    fault : str
        Why it failed.
    verdict : str
        Of its diagnosis.
    files : mapping path -> (bytes, time of change in ns)
        Of its sources when it was made.
    rows : mapping table -> number of rows
    options : mapping
        How it was made.
    cpu_s, peak_bytes : float, int
        What it took.
    """

    campaign: str
    content: str
    state: str
    fault: str = ""
    verdict: str = ""
    files: dict[str, tuple[int, int]] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    cpu_s: float = 0.0
    peak_bytes: int = 0
    version: str = __version__

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{_quoted(self.campaign)}.{self.content}.json"

    @staticmethod
    def of(text: str | bytes) -> Manifest:
        """Read one."""
        values = json.loads(text)
        values["files"] = {path: (size, changed) for path, (size, changed) in values["files"].items()}
        return Manifest(**values)


@dataclass(frozen=True)
class Store:
    """A store; open it with `open_store`."""

    files: AbstractFileSystem
    root: str
    url: str

    @property
    def is_local(self) -> bool:
        """Whether it is a folder of this machine."""
        return self.protocol == "file"

    @property
    def protocol(self) -> str:
        """Of its address: "file", "s3"."""
        known = self.files.protocol
        return known if isinstance(known, str) else str(known[0])

    def manifests(self) -> dict[str, Manifest]:
        """Return the manifest of each campaign, by name.

        While a campaign's new rows replace older ones there are two for a moment: the newer file is taken.
        """
        with _reached(self.url):
            self.files.invalidate_cache()
            found = self.files.ls(f"{self.root}/{_DONE}", detail=True) if self._holds(_DONE) else []
            paths = [one["name"] for one in sorted(found, key=_changed) if one["name"].endswith(".json")]
            read = [Manifest.of(text) for text in self._contents(paths, gone=b"") if text]
        return dict(sorted((one.campaign, one) for one in read))

    def _contents(self, paths: Sequence[str], gone: bytes | None = None) -> Iterator[bytes]:
        """Yield what files hold, many at once of a bucket; `gone` for one that is no longer there."""
        for start in range(0, len(paths), _AT_ONCE):
            # `cat` would take the brackets of a folder's name for a pattern
            for found in self.files.cat_ranges(list(paths[start : start + _AT_ONCE]), None, None):
                if isinstance(found, FileNotFoundError) and gone is not None:
                    yield gone
                elif isinstance(found, BaseException):
                    raise found
                else:
                    yield found

    def has(self, campaign: str, content: str) -> bool:
        """Return whether a campaign is there in full."""
        with _reached(self.url):
            return self._holds(f"{_DONE}/{Manifest(campaign, content, '').name}", anew=True)

    def put(self, manifest: Manifest, tables: Mapping[str, pa.Table]) -> None:
        """Write a campaign: its tables, then its manifest; then remove what it replaces."""
        import pyarrow.parquet as pq

        with _reached(self.url):
            for table, rows in tables.items():
                buffer = BytesIO()
                pq.write_table(rows, buffer, compression="zstd")
                self._write(self._path(table, manifest), buffer.getvalue())
            text = json.dumps(asdict(manifest), indent=1).encode()
            self._write(f"{self.root}/{_DONE}/{manifest.name}", text, once=True)
            self._remove_older(manifest, tables)

    def dataset(self, table: str, manifests: Mapping[str, Manifest] | None = None) -> Dataset:
        """Return a table of finished campaigns, with their campaign as the first column; its files are read later."""
        import pyarrow as pa
        from pyarrow import dataset, fs

        known = self.manifests() if manifests is None else manifests
        holding = [one for one in known.values() if table in one.rows]
        files = fs.LocalFileSystem() if self.is_local else fs.PyFileSystem(fs.FSSpecHandler(self.files))
        return dataset.FileSystemDataset.from_paths(
            [self._path(table, one) for one in holding],
            schema=schema_of(table).insert(0, pa.field("campaign", pa.string())),
            format=dataset.ParquetFileFormat(),
            filesystem=files,
            partitions=[dataset.field("campaign") == one.campaign for one in holding],
        )

    def table(self, name: str, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of a table of all campaigns, with their campaign as a column."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = schema_of(name).names if columns is None else columns
        none = pa.schema([schema_of(name).field(column) for column in columns]).empty_table()
        pieces = [_of_campaign("", none)]
        holding = {self._path(name, one): one.campaign for one in self.manifests().values() if one.rows.get(name)}
        with _reached(self.url):
            for campaign, data in zip(holding.values(), self._contents(list(holding)), strict=True):
                rows = pq.ParquetFile(BytesIO(data)).read(columns, use_threads=False)
                pieces.append(_of_campaign(campaign, rows))
        return pa.concat_tables(pieces)

    def _path(self, table: str, manifest: Manifest) -> str:
        return f"{self.root}/{table}/campaign={_quoted(manifest.campaign)}/{manifest.content}.parquet"

    def _holds(self, name: str, *, anew: bool = False) -> bool:
        if anew:
            self.files.invalidate_cache()
        return bool(self.files.exists(f"{self.root}/{name}"))

    def _write(self, path: str, data: bytes, *, once: bool = False) -> None:
        """Write a whole file or nothing; of two that write one `once`, the first wins."""
        if self.is_local:
            _write_beside_and_rename(Path(path), data)
            return
        try:
            self.files.pipe_file(path, data, mode="create" if once else "overwrite")
        except FileExistsError:
            return

    def _remove_older(self, manifest: Manifest, tables: Mapping[str, pa.Table]) -> None:
        begins = f"{_quoted(manifest.campaign)}."
        self.files.invalidate_cache()
        for path in self.files.ls(f"{self.root}/{_DONE}", detail=False):
            name = path.rpartition("/")[2]
            if not name.startswith(begins) or name == manifest.name:
                continue
            old = Manifest.of(self.files.cat_file(path))
            self.files.rm(path)
            for table in old.rows:
                self.files.rm(self._path(table, old))


def _of_campaign(name: str, rows: pa.Table) -> pa.Table:
    import pyarrow as pa

    return rows.add_column(0, "campaign", pa.array([name] * len(rows), pa.string()))


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
            raise ConfigError.of("the store's file system is not installed", url, str(error)) from None
        except ValueError as error:
            raise ConfigError.of("the store's address is not known", url, str(error), "a folder, or s3://...") from None
        store = Store(files, root.rstrip("/"), url)
        head = f"{store.root}/{_HEAD}"
        if not files.exists(head):
            if not create:
                step = "`wheelsoil fleet run ROOT --store STORE` makes one"
                raise ConfigError.of("there is no store", url, f"no {_HEAD}", next_step=step)
            if files.exists(store.root) and files.ls(store.root):
                step = "name an empty or a new folder"
                raise ConfigError.of("the folder is no store, and not empty", url, next_step=step)
            store._write(
                head, json.dumps({"schema": SCHEMA, "made_by": f"wheelsoil {__version__}"}).encode(), once=True
            )
        schema = json.loads(files.cat_file(head)).get("schema")
    if schema != SCHEMA:
        step = "name another store, or use the version of wheelsoil that made it"
        raise ConfigError.of("the store is of another schema version", url, str(schema), SCHEMA, step)
    return store


@contextmanager
def _reached(url: str) -> Iterator[None]:
    """Raise what a file system says as `ConfigError`."""
    try:
        yield
    except ConfigError:
        raise
    except (OSError, ValueError) as error:
        step = "check the address, the rights (`aws s3 ls`, `ls -ld`) and the space that is left"
        raise ConfigError.of("the store cannot be read or written", url, str(error), next_step=step) from None
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in ("botocore", "aiobotocore", "s3fs", "fsspec", "aiohttp"):
            raise
        step = "check the address and the credentials (AWS_ACCESS_KEY_ID, AWS_PROFILE, AWS_ENDPOINT_URL)"
        raise ConfigError.of("the store cannot be reached", url, str(error), next_step=step) from None


def _quoted(name: str) -> str:
    return quote(name, safe=" ,()+@").replace(".", "%2E")


def campaign_of(path: str) -> str:
    """Return the campaign that a file of the store belongs to."""
    return unquote(path.rpartition("/campaign=")[2].partition("/")[0])


def _changed(entry: Mapping[str, Any]) -> Any:
    return entry.get("mtime") or entry.get("LastModified") or 0


def _write_beside_and_rename(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        with draft.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
