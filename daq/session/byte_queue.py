"""A queue with a limit in bytes between the threads that read the buses and the one that writes."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class ByteQueue(Generic[T]):
    """Hands items from several threads to one, in order.

    Parameters
    ----------
    limit_bytes : int
        Where a put begins to wait. A single item may be larger: it is taken when the queue is empty.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._items: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._most = 0
        self._changed = threading.Condition()

    @property
    def share(self) -> float:
        """How full it is, 0 to 1 (an item beyond the limit makes it more than 1)."""
        return self._bytes / self._limit

    @property
    def highest_share(self) -> float:
        """How full it has been at most."""
        return self._most / self._limit

    def put(self, item: T, size: int, timeout_s: float) -> bool:
        """Put an item of `size` bytes; say whether there was room for it within `timeout_s`."""
        with self._changed:
            if not self._changed.wait_for(lambda: not self._items or self._bytes + size <= self._limit, timeout_s):
                return False
            self._items.append((item, size))
            self._bytes += size
            self._most = max(self._most, self._bytes)
            self._changed.notify_all()
            return True

    def wait(self, timeout_s: float) -> None:
        """Wait until there is an item, at most `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._items, timeout_s)

    def take_some(self, most_bytes: int) -> list[T]:
        """Return the items that are there, in order, without waiting; at least one, if there is one."""
        with self._changed:
            taken: list[T] = []
            left = most_bytes
            while self._items and (left >= self._items[0][1] or not taken):
                item, size = self._items.popleft()
                taken.append(item)
                left -= size
            self._bytes -= most_bytes - left
            self._changed.notify_all()
            return taken
