"""Ways in which files are damaged on their way: cut, spliced, flipped, and numbers that nobody would write."""

from __future__ import annotations

import re

import numpy as np

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_ODD = (
    b"-1",
    b"0",
    b"nan",
    b"inf",
    b"1e308",
    b"9" * 40,
    b"4294967295",
    b"18446744073709551615",
    b"\x00",
    b"",
    b"x",
    b"0x",
)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the file after one to four damages."""
    for _ in range(int(rng.integers(1, 5))):
        data = _MUTATORS[rng.integers(len(_MUTATORS))](data, rng)
    return data


def _place(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def _without(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 64)) :]


def _twice(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    end = at + int(rng.integers(1, 200))
    return data[:end] + data[at:end] + data[end:]


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for at in rng.integers(0, max(len(out), 1), int(rng.integers(1, 9))).tolist():
        if at < len(out):
            out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _noise(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(1, 32))) + data[at:]


def _large(data: bytes, rng: np.random.Generator) -> bytes:
    """Write a large or negative length over four bytes, as a binary format may hold it anywhere."""
    out = bytearray(data)
    at = _place(data, rng)
    value = int(rng.choice([0, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, int(rng.integers(1 << 32))]))
    out[at : at + 4] = value.to_bytes(4, "little" if rng.integers(2) else "big")
    return bytes(out)


def _odd_number(data: bytes, rng: np.random.Generator) -> bytes:
    found = list(_NUMBER.finditer(data[:100_000]))
    if not found:
        return _noise(data, rng)
    start, end = found[rng.integers(len(found))].span()
    return data[:start] + _ODD[rng.integers(len(_ODD))] + data[end:]


def _shuffled(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.integers(len(lines), size=2).tolist()
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


_MUTATORS = (_cut, _without, _twice, _flipped, _flipped, _noise, _large, _odd_number, _odd_number, _shuffled)
