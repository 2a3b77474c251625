"""python-can and cantools, imported without asammdf.

python-can imports asammdf, where it is installed, to read MF4 files by itself; with it come pandas and a second of
start-up. Ours are read in another process (`daq.logs.mf4`), so that every command is spared it. This is the one
place that imports them: use ``from daq.can.library import can``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def _without(name: str) -> Iterator[None]:
    """Have a package that is not loaded yet seem not installed."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]


with _without("asammdf"):
    import can as can
    from cantools import database as database
    from cantools.database import errors as errors
