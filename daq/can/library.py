"""python-can and cantools, each when it is needed, and without asammdf.

python-can imports asammdf, where it is installed, to read MF4 files by itself; with it come pandas and a second of
start-up. Ours are read in another process (`daq.logs.mf4`), so that every command is spared it. cantools imports
python-can for its tester of nodes: it is loaded when somebody asks for it. This is the one place that imports them:
use ``from daq.can.library import can``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import can as can
    from cantools import database as database
    from cantools.database import errors as errors

_PLACES = {"can": "can", "database": "cantools.database", "errors": "cantools.database.errors"}
"""Name here -> module."""
_TESTER = "cantools.tester"


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(name)
    if name != "can" and "cantools" not in sys.modules:
        with _stand_in(_TESTER, ModuleType(_TESTER)):
            names = vars(import_module("cantools"))
        names.pop("tester", None)
        names["__getattr__"] = _tester
    with _stand_in("asammdf", None):
        return globals().setdefault(name, import_module(_PLACES[name]))


def _tester(name: str) -> ModuleType:
    if name != "tester":
        raise AttributeError(f"module 'cantools' has no attribute {name!r}")
    return import_module(_TESTER)


@contextmanager
def _stand_in(name: str, module: ModuleType | None) -> Iterator[None]:
    """Have another module, or none, in the place of one that is not loaded yet."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = module  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]
