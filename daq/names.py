"""Names from data as names of files."""

from __future__ import annotations

import re


def file_name(name: str, fallback: str = "run") -> str:
    """Return a name that stays in its folder: letters, digits, ``_ . - @``, no leading dot."""
    return re.sub(r"[^\w.@-]+", "-", name).strip(".-") or fallback
