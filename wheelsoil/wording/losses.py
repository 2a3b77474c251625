"""Counts of lost frames as people read them."""

from __future__ import annotations

from collections.abc import Mapping

WRAPPED = "wrapped"
"""Kind of a count of gaps so long that a rolling counter may have wrapped around."""


def losses_as_texts(losses: Mapping[str, int]) -> dict[str, str]:
    """Return what was lost, by the keys of the ``losses`` of a recording or of a logger's summary.

    What a rolling counter that may have wrapped around counts is a lower bound: "at least 63".
    """
    return {
        key: f"{'at least ' if _is_least(key, losses) else ''}{count:,}"
        for key, count in losses.items()
        if count and not key.startswith(f"{WRAPPED}.")
    }


def _is_least(key: str, losses: Mapping[str, int]) -> bool:
    kind, _, where = key.partition(".")
    return kind == "counter" and losses.get(f"{WRAPPED}.{where}", 0) > 0
