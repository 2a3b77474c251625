"""How many random examples a property test draws."""

from __future__ import annotations

from typing import Any

from hypothesis import settings

_USUAL = 100
"""Of a profile that states no number; the gate's has fewer."""


def examples(most: int, *, gate: int | None = None, **options: Any) -> settings:
    """Return settings with so many examples, and in the gate with no more than its profile has, or than `gate`.

    The gate draws the same examples every time: what further ones find, the slow set finds.
    """
    profile = settings().max_examples
    if profile < _USUAL:
        most = min(most, profile if gate is None else gate)
    return settings(max_examples=most, **options)
