"""Any of our values as plain JSON values: NaN becomes null, arrays become lists, dataclasses become objects."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from pathlib import PurePath
from typing import Any

from daq import Note
from wheelsoil.wording.notes import note_text


def plain(value: Any) -> Any:
    """Return `value` as dicts, lists, strings, numbers, booleans and None; `TypeError` if it has no plain form.

    Numbers that JSON cannot hold (NaN, infinities) become None, a note its sentence. A sequence, array or set becomes a
    list.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, Note):
        return note_text(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    return _plain_object(value)


def _plain_object(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    for method in ("model_dump", "tolist"):  # pydantic models; numpy arrays and scalars
        if hasattr(value, method):
            return plain(getattr(value, method)())
    raise TypeError(f"{type(value).__name__} has no plain form")


def streamed(values: Mapping[str, Any], lists: Mapping[str, Iterable[Any]]) -> Iterator[str]:
    """Yield a JSON object piece by piece: `values`, which are not empty, and lists that are never whole in memory."""
    yield to_json(values, indent=None, escaped=True)[:-1]
    for key, items in lists.items():
        yield f", {json.dumps(key)}: ["
        for i, item in enumerate(items):
            yield (",\n" if i else "") + to_json(item, indent=None, escaped=True)
        yield "]"
    yield "}\n"


def to_json(value: Any, *, indent: int | None = 2, escaped: bool = False) -> str:
    """Return `value` as strict JSON text (see `plain`); `escaped` where only ASCII can be written."""
    return json.dumps(plain(value), indent=indent, ensure_ascii=escaped, allow_nan=False)
