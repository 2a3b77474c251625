"""Functions of modules that are imported when the function is called: a command reads files of one format or two."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any


def deferred(name: str) -> Any:
    """Return a function as ``"module:function"`` that imports it when it is called."""
    return lambda *args, **named: resolve_name(name)(*args, **named)
