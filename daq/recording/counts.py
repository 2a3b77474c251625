"""Sums of counts that are kept per bus or per kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def total(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sum of counts, key by key."""
    summed: dict[str, int] = {}
    for one in counts:
        for key, count in one.items():
            summed[key] = summed.get(key, 0) + count
    return summed


def since(now: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """Return by how much counts have grown."""
    return {key: count - before.get(key, 0) for key, count in now.items()}
