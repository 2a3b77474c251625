"""Values to bytes and back, exactly: numbers, texts, arrays, and the program's own dataclasses, enums and settings.

A value becomes JSON, with its arrays' bytes behind it. Reading runs nothing that the bytes name: a class is looked up
by its name among those that a module of `ROOMS` defines, and its fields are set as they are.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from datetime import datetime
from enum import Enum
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

ROOMS = ("daq", "processing", "model")
"""Packages whose classes may be kept."""
_MODULE = re.compile(rf"({'|'.join(ROOMS)})(\.[a-z][a-z0-9_]*)+")
_PLAIN = (bool, int, float, str, type(None))
_NUMBERS = "biufcSU"
_ALIGNED = 16


class NotKeptError(TypeError):
    """A value of a class that is not kept."""


class DamagedError(ValueError):
    """Bytes that hold no value."""


def encode(value: object) -> tuple[bytes, list[memoryview]]:
    """Return a value as JSON, and the bytes of its arrays.

    `NotKeptError` where it holds something else than numbers, texts, times, paths, arrays, tuples, lists, mappings, and
    dataclasses, enums and settings of `ROOMS`.
    """
    arrays: list[memoryview] = []
    return json.dumps(_Writer(arrays).of(value), separators=(",", ":")).encode(), arrays


def to_bytes(value: object) -> bytes:
    """Return a value as bytes; see `encode`."""
    text, arrays = encode(value)
    parts: list[bytes | memoryview] = [len(text).to_bytes(8, "little"), text]
    at = 8 + len(text)
    for array in arrays:
        gap = -at % _ALIGNED
        parts += [bytes(gap), array]
        at += gap + array.nbytes
    return b"".join(parts)


def from_bytes(data: bytearray) -> Any:
    """Return the value of `to_bytes`; its arrays are parts of `data`.

    `DamagedError` where the bytes are cut off, are none of `to_bytes`, or name a class that is not kept.
    """
    try:
        end = 8 + int.from_bytes(data[:8], "little")
        if end > len(data):
            raise DamagedError("cut off")
        return _Reader(data, end).of(json.loads(data[8:end]))
    except DamagedError:
        raise
    except (ValueError, TypeError, LookupError, AttributeError, ImportError, OverflowError, RecursionError) as error:
        raise DamagedError(str(error)) from None


class _Writer:
    """Makes JSON of values; numbers and texts stand for themselves, the rest is a list that begins with its kind."""

    def __init__(self, arrays: list[memoryview]) -> None:
        self._arrays = arrays

    def of(self, value: Any) -> Any:
        kind = type(value)
        if kind in _PLAIN:
            return value
        if kind is tuple or kind is list:
            return [kind.__name__, *map(self.of, value)]
        if kind is dict:
            return ["dict", *([self.of(key), self.of(item)] for key, item in value.items())]
        if kind is np.ndarray:
            return self._array(value)
        if isinstance(value, np.generic) and value.dtype.kind in _NUMBERS and value.dtype.itemsize:
            return ["scalar", value.dtype.str, value.tobytes().hex()]
        if isinstance(value, Enum):
            return ["enum", _name(kind), value.name]
        if isinstance(value, BaseModel):
            set_there = sorted(value.model_fields_set)
            return ["settings", _name(kind), set_there, *(self.of(getattr(value, f)) for f in kind.model_fields)]
        if is_dataclass(value):
            return ["data", _name(kind), *(self.of(getattr(value, f.name)) for f in fields(value))]
        if kind is bytes:
            return ["bytes", value.hex()]
        if isinstance(value, Path):
            return ["path", str(value)]
        if kind is datetime:
            return ["time", value.isoformat()]
        raise NotKeptError(f"{kind.__module__}.{kind.__qualname__}")

    def _array(self, value: NDArray[Any]) -> list[Any]:
        """Write an array as it lies in memory: "C", or "F" (column by column), or "1" where all is one value."""
        if value.dtype.kind not in _NUMBERS or not value.dtype.itemsize:
            raise NotKeptError(f"array of {value.dtype}")
        order: Any = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        if value.size > 1 and not any(value.strides):
            rows = value[(slice(0, 1),) * value.ndim].reshape(1, -1).view(np.uint8)
        else:
            rows = value.ravel(order=order).view(np.uint8).reshape(-1, value.dtype.itemsize)
        if value.size > 1 and (len(rows) == 1 or (np.array_equal(rows[0], rows[-1]) and bool((rows == rows[0]).all()))):
            order, rows = "1", rows[:1]
        self._arrays.append(rows.reshape(-1).data)
        return ["array", value.dtype.str, order, *value.shape]


class _Reader:
    """Makes values of JSON and the bytes from `at` on."""

    def __init__(self, data: bytearray, at: int) -> None:
        self._data, self._at = data, at
        self._readers: dict[str, Callable[..., Any]] = {
            "tuple": lambda *items: tuple(map(self.of, items)),
            "list": lambda *items: list(map(self.of, items)),
            "dict": lambda *items: {self.of(key): self.of(item) for key, item in items},
            "array": self._array,
            "scalar": lambda kind, text: np.frombuffer(bytes.fromhex(text), _dtype(kind))[0],
            "enum": lambda name, member: _class(name, Enum)[member],
            "settings": self._settings,
            "data": self._of_dataclass,
            "bytes": bytes.fromhex,
            "path": Path,
            "time": datetime.fromisoformat,
        }

    def of(self, value: Any) -> Any:
        if not isinstance(value, list):
            if isinstance(value, dict):
                raise DamagedError("a mapping")
            return value
        return self._readers[value[0]](*value[1:])

    def _array(self, kind: str, order: str, *shape: int) -> NDArray[Any]:
        dtype = _dtype(kind)
        count = 1 if order == "1" else prod(shape)
        start = self._at + -self._at % _ALIGNED
        self._at = start + count * dtype.itemsize
        if count < 0 or self._at > len(self._data):
            raise DamagedError("cut off")
        values = np.frombuffer(self._data, dtype, count, start) if count else np.zeros(0, dtype)
        if order == "1":
            return np.broadcast_to(values.reshape(()), shape)
        return values.reshape(shape, order="F" if order == "F" else "C")

    def _settings(self, name: str, set_there: list[str], *values: Any) -> Any:
        kind = _class(name, BaseModel)
        named = dict(zip(kind.model_fields, map(self.of, values), strict=True))
        return kind.model_construct(_fields_set=set(set_there), **named)

    def _of_dataclass(self, name: str, *values: Any) -> Any:
        made = object.__new__(_class(name, object))
        for field, value in zip(fields(made), values, strict=True):
            object.__setattr__(made, field.name, self.of(value))
        return made


def _dtype(kind: str) -> np.dtype[Any]:
    dtype = np.dtype(kind)
    if dtype.kind not in _NUMBERS or not dtype.itemsize:
        raise DamagedError(f"an array of {dtype}")
    return dtype


def _name(kind: type) -> str:
    """Return the name of a class of ours, by which `_class` finds it."""
    name = f"{kind.__module__}:{kind.__qualname__}"
    if not _MODULE.fullmatch(kind.__module__):
        raise NotKeptError(name)
    return name


def _class(name: str, base: type) -> Any:
    """Return a class of ours by its name; it must be defined in the module that is named, and derive from `base`."""
    module, _, own = name.partition(":")
    if not _MODULE.fullmatch(module):
        raise DamagedError(f"a value of {name}")
    found = getattr(import_module(module), own)
    ours = isinstance(found, type) and found.__module__ == module and issubclass(found, base)
    if not ours or (base is object and not is_dataclass(found)):
        raise DamagedError(f"a value of {name}")
    return found
