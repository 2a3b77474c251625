"""What a kept result depends on: its inputs' content, and the code that makes it (docs/decisions/cache.md)."""

from __future__ import annotations

import hashlib
import platform
import sys
import time
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from wheelsoil.cache.codec import NotKeptError, encode

OF_PROCESSING = ("daq", "processing", "wheelsoil.cache", "wheelsoil.workflows")
"""Packages whose code makes a processed run."""
OF_MODELS = (*OF_PROCESSING, "model")
"""Packages whose code makes a fit or a diagnosis."""
_LIBRARIES = ("cantools", "scipy")
_imported_s = time.time()


def key_of(kind: str, packages: tuple[str, ...], inputs: object) -> str:
    """Return the key of a result: the hash of its kind, the code that makes it and its inputs, in hexadecimal.

    Raises
    ------
    NotKeptError
        The inputs cannot be written (`wheelsoil.cache.codec.encode`), or the source of some code is not there.
    """
    text, arrays = encode(inputs)
    effects = _hash_of_effects() if "model" in packages else ""
    digest = hashlib.sha256(f"{kind} {_hash_of_code(packages)} {effects} {len(text)} ".encode())
    digest.update(text)
    for array in arrays:
        digest.update(array)
    return digest.hexdigest()


@cache
def _hash_of_code(packages: tuple[str, ...]) -> str:
    versions = [platform.machine(), sys.version, np.__version__, *map(version, _LIBRARIES)]
    digest = hashlib.sha256(repr(versions).encode())
    for package in packages:
        _take_sources(digest, package)
    return digest.hexdigest()


def _hash_of_effects() -> str:
    """Return the hash of the code of effects that installed packages bring."""
    from model.effects import EFFECTS

    brought = {effect.__module__.partition(".")[0] for effect in EFFECTS.values()} - {"model"}
    return _hash_of_packages(tuple(sorted(brought)))


@cache
def _hash_of_packages(packages: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for package in packages:
        _take_sources(digest, package)
    return digest.hexdigest()


def _take_sources(digest: hashlib._Hash, package: str) -> None:
    """Take up the source of a package with all that is in it, or of a module; it must be what this process runs."""
    try:
        spec = find_spec(package)
    except ValueError:  # as it is of __main__
        spec = None
    origin = Path(spec.origin) if spec and spec.origin else Path()
    if origin.suffix != ".py" or not origin.is_file():
        raise NotKeptError(f"no source of {package}")
    for file in sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin]:
        if file.stat().st_mtime > _imported_s:
            raise NotKeptError(f"{file} was changed while it was in use")
        content = file.read_bytes()
        digest.update(f"{package} {file.relative_to(origin.parent).as_posix()} {len(content)} ".encode())
        digest.update(content)


def content_of(paths: Iterable[Path]) -> tuple[str, ...]:
    """Return the hash of each file, in hexadecimal; OSError if one cannot be read."""
    found = []
    for path in paths:
        with path.open("rb") as file:
            found.append(hashlib.file_digest(file, "sha256").hexdigest())
    return tuple(found)
