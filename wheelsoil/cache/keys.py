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

    `NotKeptError` where the inputs cannot be written (`wheelsoil.cache.codec.encode`), or the source of some code is
    not there or was changed since it was imported.
    """
    text, arrays = encode(inputs)
    effects = _packages_of_effects() if "model" in packages else ()
    code = [_versions(), *map(_hash_of_package, (*packages, *effects))]
    digest = hashlib.sha256(f"{kind} {' '.join(code)} {len(text)} ".encode())
    digest.update(text)
    for array in arrays:
        digest.update(array)
    return digest.hexdigest()


@cache
def _versions() -> str:
    return repr([platform.machine(), sys.version, np.__version__, *map(version, _LIBRARIES)])


def _packages_of_effects() -> tuple[str, ...]:
    """Return the installed packages that bring effects."""
    from model.effects import EFFECTS

    return tuple(sorted({effect.__module__.partition(".")[0] for effect in EFFECTS.values()} - {"model"}))


def _hash_of_package(package: str) -> str:
    """Return the hash of the source of a package with all that is in it, or of a module; it must be what runs here."""
    digest, files = _source_of(package)
    for file in files:
        if file.stat().st_mtime > _imported_s:  # at every key: what is imported late is not what was hashed
            raise NotKeptError(f"{file} was changed while it was in use")
    return digest


@cache
def _source_of(package: str) -> tuple[str, tuple[Path, ...]]:
    """Return the hash of the source of a package or module, and its files."""
    try:
        spec = find_spec(package)
    except ValueError:  # as it is of __main__
        spec = None
    origin = Path(spec.origin) if spec and spec.origin else Path()
    if origin.suffix != ".py" or not origin.is_file():
        raise NotKeptError(f"no source of {package}")
    digest = hashlib.sha256()
    files = tuple(sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin])
    for file in files:
        content = file.read_bytes()
        digest.update(f"{package} {file.relative_to(origin.parent).as_posix()} {len(content)} ".encode())
        digest.update(content)
    return digest.hexdigest(), files


def content_of(paths: Iterable[Path]) -> tuple[str, ...]:
    """Return the hash of each file, in hexadecimal; OSError if one cannot be read."""
    found = []
    for path in paths:
        with path.open("rb") as file:
            found.append(hashlib.file_digest(file, "sha256").hexdigest())
    return tuple(found)
