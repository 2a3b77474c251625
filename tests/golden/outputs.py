"""What a command wrote into a file, as plain values."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet


def contents(path: Path) -> Any:
    """Return what a command wrote into a file; None where there are no numbers to keep in it."""
    match path.suffix:
        case ".json":
            return json.loads(path.read_text(encoding="utf-8"))
        case ".toml":
            return tomllib.loads(path.read_text(encoding="utf-8"))
        case ".csv":
            return _csv(path)
        case ".parquet":
            return _parquet(path)
    return None


def _csv(path: Path) -> dict[str, Any]:
    with path.open(newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    columns = {name: _numbers([row[i] for row in rows]) for i, name in enumerate(names)}
    return {"names": names, "columns": columns}


def _numbers(texts: Sequence[str]) -> list[Any]:
    """Return a column's cells as integers, or else as numbers, or else as they are; an empty one as None."""
    for kind in (int, float):
        try:
            values = [kind(text) if text else None for text in texts]
        except ValueError:
            continue
        return [None if value != value else value for value in values]
    return [text or None for text in texts]


def _parquet(path: Path) -> dict[str, Any]:
    table = pyarrow.parquet.read_table(path)
    return {
        "fields": {field.name: _field(field) for field in table.schema},
        "columns": {name: [None if v != v else v for v in table[name].to_pylist()] for name in table.column_names},
    }


def _field(field: Any) -> dict[str, str]:
    metadata = {key.decode(): value.decode() for key, value in sorted((field.metadata or {}).items())}
    return {"type": str(field.type), **metadata}
