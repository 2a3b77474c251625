"""Names that turn the direction of writing are isolated in a page, so that the rest of a sentence reads as it is."""

from __future__ import annotations

import re
from collections.abc import Callable

_TURNING = "\u0590-\u08ff\u200e\u200f\u202a-\u202e\u2066-\u2069\ufb1d-\ufdff\ufe70-\ufefc"
"""Letters that are written from right to left, and signs that turn, embed or isolate what is behind them."""
_TURNS = re.compile(f"[{_TURNING}]")
_WORDS = re.compile(rf"[^\s{_TURNING}]*[{_TURNING}]\S*(?:\s+[^\s{_TURNING}]*[{_TURNING}]\S*)*")
_PARTS = re.compile(r"<(script|style|title|option|svg|code|pre)\b.*?</\1>|<[^>]*>|[^<]+", re.DOTALL)
"""What holds no markup, tags, and the text between them; a text in a drawing stands alone."""


def isolated(page: str) -> str:
    """Return a page, or a part of one, in which such words stand in a `bdi` of their own."""
    if not _TURNS.search(page):
        return page
    return in_texts(page, lambda text: _WORDS.sub(r"<bdi>\g<0></bdi>", text))


def in_texts(page: str, change: Callable[[str], str]) -> str:
    """Return a page, or a part of one, with its texts changed; code and drawings are left."""
    return _PARTS.sub(lambda part: part[0] if part[0][0] == "<" else change(part[0]), page)
