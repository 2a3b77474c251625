"""What was opened to see the columns of a file waits there for the reading of its rows, so that it is opened once."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")
State = tuple[str, int, int]
"""Path, time of the last change and size of a file."""


def state_of(path: Path) -> State:
    """Return what changes when a file is written again."""
    status = path.stat()
    return str(path.absolute()), status.st_mtime_ns, status.st_size


class Held(Generic[T]):
    """Keeps the last thing that was opened, and closes the one before it: many opened files take one handle."""

    def __init__(self, close: Callable[[T], object]) -> None:
        self._close = close
        self._lock = Lock()
        self._kept: list[tuple[object, T]] = []
        atexit.register(self.clear)

    def keep(self, key: object, value: T) -> None:
        """Keep something under a key."""
        self._replace([(key, value)])

    def take(self, key: object) -> T | None:
        """Return what is kept under a key, which is the caller's then; None where there is nothing."""
        with self._lock:
            if not self._kept or self._kept[0][0] != key:
                return None
            return self._kept.pop()[1]

    def clear(self) -> None:
        """Close what is kept."""
        self._replace([])

    def _replace(self, kept: list[tuple[object, T]]) -> None:
        with self._lock:
            before, self._kept = self._kept, kept
        for _, value in before:
            self._close(value)
