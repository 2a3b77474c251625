"""How far a long computation is, for whoever watches."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")

_watch: ContextVar[Callable[[float], None] | None] = ContextVar("watch", default=None)


@contextmanager
def watched(watch: Callable[[float], None]) -> Iterator[None]:
    """Have `watch` called with the share that is done, 0 to 1, of the fit or diagnosis inside, in this process."""
    mine = os.getpid()
    token = _watch.set(lambda share: watch(share) if os.getpid() == mine else None)
    try:
        yield
    finally:
        _watch.reset(token)


def note_share(share: float) -> None:
    """Say what share of the computation is done, 0 to 1."""
    if watch := _watch.get():
        watch(share)


def counted(items: Iterable[Item], total: int, before: float, after: float) -> Iterator[Item]:
    """Yield items, each of which takes an equal part of what lies between two shares."""
    for i, item in enumerate(items, 1):
        note_share(before + (after - before) * i / total)
        yield item
