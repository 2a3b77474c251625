"""Which core computes: the compiled one (model/compiled.c), where it was built, or numpy.

A build of the package compiles it where there is a C compiler (model/core_build.py). Both give the same numbers.
``WHEELSOIL_CORE`` forces one: ``numpy`` or ``c``.
"""

from __future__ import annotations

import ctypes
import os
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from daq import ConfigError
from model.core_build import SOURCE, library_path, source_hash

VARIABLE = "WHEELSOIL_CORE"
_BUILD = "model/core_build.py"
_INT, _POINTER = ctypes.c_int64, ctypes.c_void_p
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "contact": (_INT, _POINTER, _POINTER, _INT, _POINTER, ctypes.c_uint32, _POINTER, _POINTER),
    "balance": (_INT, *[_POINTER] * 2, _INT, _POINTER, *[ctypes.c_double] * 3, *[_POINTER] * 3),
    "whiten": (_POINTER,) * 15,
    "smooth_back": (_POINTER,) * 10,
    "kernels": (_INT, _INT, *[_POINTER] * 4),
    "add_covariance": (_POINTER,) * 8,
    "slope_products": (_POINTER,) * 12,
    "slope_traces": (_POINTER,) * 12,
    "weigh": (_INT, _INT, _INT, *[_POINTER] * 8),
}


class Core(NamedTuple):
    """The library, or why there is none."""

    library: ctypes.CDLL | None
    reason: str


def core_in_use() -> str:
    """Return which core computes, "compiled" or "numpy" with the reason."""
    core = _core(os.environ.get(VARIABLE, ""))
    return "compiled" if core.library else f"numpy: {core.reason}"


def library() -> ctypes.CDLL | None:
    """Return the compiled core, or None where numpy computes.

    `ConfigError` where `VARIABLE` asks for something else than ``numpy`` and ``c``, or for the compiled core where
    there is none.
    """
    return _core(os.environ.get(VARIABLE, "")).library


@lru_cache
def _core(wanted: str) -> Core:
    if wanted not in ("", "c", "numpy"):
        raise ConfigError.of(f"{VARIABLE} is not understood", found=wanted, expected="c or numpy, or not set")
    if wanted == "numpy":
        return Core(None, f"{VARIABLE} says so")
    core = load(library_path())
    if wanted == "c" and core.library is None:
        raise ConfigError.of(
            f"{VARIABLE} asks for the compiled core",
            found=core.reason,
            next_step=f"install a C compiler, then wheelsoil again; or unset {VARIABLE}",
        )
    return core


def load(path: Path) -> Core:
    """Load a library, unless it was built from another source than the one that is here."""
    if not path.exists():
        return Core(None, "it was not built: at installation a C compiler was missing, or failed")
    try:
        found = ctypes.CDLL(str(path))
        found.source_hash.restype = ctypes.c_char_p
        built_from = found.source_hash().decode()
        for name, types in _ARGUMENTS.items():
            function = getattr(found, name)
            function.argtypes, function.restype = types, None
    except (OSError, AttributeError, ValueError) as error:
        return Core(None, f"{path.name} cannot be loaded: {error}")
    if SOURCE.exists() and built_from != source_hash():
        return Core(None, f"{path.name} was built from another {SOURCE.name}: install again, or python {_BUILD}")
    return Core(found, "")
