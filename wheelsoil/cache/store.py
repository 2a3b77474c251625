"""The folder of kept results: one file an entry, those not used for longest removed first."""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import os
import re
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from daq import ConfigError, Fault
from wheelsoil.cache.codec import DamagedError, NotKeptError, from_bytes, to_bytes
from wheelsoil.cache.keys import OF_MODELS, key_of

T = TypeVar("T")

VARIABLE, LIMIT_VARIABLE = "WHEELSOIL_CACHE", "WHEELSOIL_CACHE_LIMIT"
OFF = "off"
"""As the folder: nothing is kept, and nothing that was kept is used."""
DEFAULT_LIMIT = "2 GB"
_UNITS = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([KMGT]B)?")

_MAGIC = b"wheelsoil kept 1\n"
_HEAD = len(_MAGIC) + hashlib.sha256().digest_size
_SUFFIX, _DRAFT = ".kept", ".draft"
_ABANDONED_S = 3600.0
"""Age from which a draft belongs to a command that was killed."""
_log = logging.getLogger(__name__)
_named: set[Path] = set()
"""Folders that are open to all, and were named."""
_kinds: frozenset[str] | None = None
"""Kinds of results that are kept; None: all."""


@dataclass(frozen=True)
class Entry:
    """A file of the folder; `used_at` in seconds since 1970."""

    path: Path
    bytes: int
    used_at: float


def folder() -> Path | None:
    """Return where results are kept: WHEELSOIL_CACHE, else the user's cache folder; None where nothing is kept.

    Nor is anything kept in a folder that everyone may write into: the name of an entry says what is taken for it.
    """
    place = _chosen()
    if place is None or not _open_to_all(place):
        return place
    if place not in _named and multiprocessing.parent_process() is None:
        _named.add(place)
        step = f"`chmod o-w {place}`, or {VARIABLE} names another folder"
        _log.warning("note: the cache folder %s is not used, since anyone may write into it: %s", place, step)
    return None


def _open_to_all(place: Path) -> bool:
    try:
        return os.name == "posix" and bool(place.stat().st_mode & stat.S_IWOTH)
    except OSError:
        return False


def _chosen() -> Path | None:
    named = os.environ.get(VARIABLE, "")
    if named == OFF:
        return None
    if named:
        return Path(named)
    from platformdirs import user_cache_dir

    place = Path(user_cache_dir("wheelsoil", appauthor=False))
    return place if place.is_absolute() else None


def limit_bytes() -> int:
    """Return how much may be kept.

    Raises
    ------
    ConfigError
        WHEELSOIL_CACHE_LIMIT is no size.
    """
    text = os.environ.get(LIMIT_VARIABLE) or DEFAULT_LIMIT
    found = _SIZE.fullmatch(text.strip().upper())
    if not found:
        step = f"unset it for {DEFAULT_LIMIT}; {VARIABLE}={OFF} keeps nothing"
        raise ConfigError(
            Fault(f"{LIMIT_VARIABLE} is no size", found=repr(text), expected="a size such as 2 GB", next_step=step)
        )
    return round(float(found[1]) * _UNITS[found[2] or ""])


@contextmanager
def nothing_kept() -> Iterator[None]:
    """Have everything computed anew and nothing kept, here and in processes that are started here."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = OFF
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


@contextmanager
def keeping_only(*kinds: str) -> Iterator[None]:
    """Have this process keep results of some kinds only; those of other kinds that are there are used."""
    global _kinds
    before, _kinds = _kinds, frozenset(kinds)
    try:
        yield
    finally:
        _kinds = before


def kept(kind: str, inputs: object, compute: Callable[[], T]) -> T:
    """Return what a function of the model returns for some inputs, from the folder if it was kept there.

    `kind` is the result's name, without spaces; `inputs` is all that `compute` depends on.
    """
    there: T | None = known(kind, inputs)
    if there is not None:
        return there
    made = compute()
    put(key_for(kind, OF_MODELS, inputs), made)
    return made


def known(kind: str, inputs: object) -> Any:
    """Return what `kept` has for some inputs; None where there is nothing."""
    return get(key_for(kind, OF_MODELS, inputs))


def key_for(kind: str, packages: tuple[str, ...], inputs: object) -> str:
    """Return the name of an entry (`wheelsoil.cache.keys.key_of`); empty where nothing is kept.

    `ConfigError` as from `limit_bytes`.
    """
    if folder() is None:
        return ""
    limit_bytes()
    try:
        return f"{kind}-{key_of(kind, packages, inputs)}"
    except (NotKeptError, OSError) as error:
        _log.debug("%s is not kept: %s", kind, error)
        return ""


def get(key: str) -> Any:
    """Return what is kept under a name; None where there is nothing, or what there is is damaged."""
    place = folder()
    if place is None or not key:
        return None
    path = place / f"{key}{_SUFFIX}"
    try:
        value = _read(path)
    except FileNotFoundError:
        return None
    except (DamagedError, OSError, MemoryError) as error:
        _log.debug("%s cannot be used: %s", path, error)
        return None
    with suppress(OSError):
        os.utime(path)
    return value


def _read(path: Path) -> Any:
    with path.open("rb") as file:
        head = file.read(_HEAD)
        data = bytearray(max(os.fstat(file.fileno()).st_size - _HEAD, 0))
        file.readinto(data)
    if head != _head(path.name, data):
        raise DamagedError("its checksum is wrong")
    return from_bytes(data)


def _head(name: str, data: bytes | bytearray) -> bytes:
    """Return what an entry begins with; its checksum is that of its name, too."""
    digest = hashlib.sha256(name.encode())
    digest.update(data)
    return _MAGIC + digest.digest()


def put(key: str, value: object) -> None:
    """Keep a value under a name, where that is possible; entries that were not used for longest go."""
    place = folder()
    if place is None or not key or not (_kinds is None or key.partition("-")[0] in _kinds):
        return
    most = limit_bytes()
    try:
        data = to_bytes(value)
        if _HEAD + len(data) <= most:
            place.mkdir(parents=True, exist_ok=True)
            _write(place / f"{key}{_SUFFIX}", data)
            _shrink(place, most)
    except (NotKeptError, OSError, MemoryError) as error:
        _log.debug("%s is not kept: %s", key, error)


def _write(path: Path, data: bytes) -> None:
    descriptor, draft = tempfile.mkstemp(_DRAFT, path.name, path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(_head(path.name, data))
            file.write(data)
        Path(draft).replace(path)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise


def entries(place: Path) -> list[Entry]:
    """Return what is kept in a folder, that which was not used for longest first."""
    found = []
    with suppress(OSError), os.scandir(place) as files:
        for file in files:
            with suppress(OSError):
                if file.name.endswith((_SUFFIX, _DRAFT)):
                    facts = file.stat()
                    found.append(Entry(Path(file.path), facts.st_size, facts.st_mtime))
    return sorted(found, key=lambda entry: entry.used_at)


def _shrink(place: Path, most: int) -> None:
    """Remove abandoned drafts, and entries until the rest is within the limit."""
    there = entries(place)
    total = sum(entry.bytes for entry in there)
    now = time.time()
    for entry in there:
        draft = entry.path.suffix == _DRAFT
        if now - entry.used_at > _ABANDONED_S if draft else total > most:
            with suppress(OSError):
                entry.path.unlink()
            total -= entry.bytes


def clear() -> int:
    """Remove all that is kept; return how many entries that were.

    Raises
    ------
    OSError
        One cannot be removed.
    """
    place = folder()
    there = entries(place) if place else []
    for entry in there:
        entry.path.unlink(missing_ok=True)
    return len(there)
