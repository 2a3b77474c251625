"""Files of results, one JSON line each: several processes append, and a kill costs one line at most."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def append_line(path: Path, entry: dict[str, Any]) -> None:
    """Append an entry in one write; a line that a kill has cut off stays on its own."""
    with path.open("ab", buffering=0) as file:
        file.write(b"\n" * _cut(path) + json.dumps(entry).encode() + b"\n")


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole entries of a file, in order; none where there is no file."""
    return list(_entries(path.read_text(encoding="utf-8"))) if path.exists() else []


def _entries(text: str) -> Iterator[dict[str, Any]]:
    for line in text.splitlines():
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            continue


def _cut(path: Path) -> bool:
    """Return whether a file's last line has no end."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if not size:
            return False
        file.seek(size - 1)
        return file.read(1) != b"\n"
