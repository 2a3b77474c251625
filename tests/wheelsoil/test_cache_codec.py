"""Values come back from bytes as they were, and bytes that are none of ours do nothing."""

from __future__ import annotations

import json
import os
import struct
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_dtypes, array_shapes, arrays, from_dtype, scalar_dtypes
from pydantic import BaseModel

from daq import Note, RunInfo, Severity
from processing import ProcessedRun, QualityReport, RunCode, SensorFacts, Standstill
from wheelsoil.cache.codec import DamagedError, NotKeptError, encode, from_bytes, to_bytes

FLOATS = st.floats(width=64)
NUMBERS = scalar_dtypes().filter(lambda dtype: dtype.kind in "biufc" and dtype.itemsize <= 16)
ARRAYS = NUMBERS.flatmap(lambda dtype: arrays(dtype, array_shapes(min_dims=0, min_side=0, max_side=4)))
PLAIN = st.one_of(st.none(), st.booleans(), st.integers(), FLOATS, st.text(), st.binary())
ODD = st.one_of(
    NUMBERS.flatmap(from_dtype),
    st.sampled_from([RunCode.LATE_STAMPS, Severity.FAULT, Path("a/b.mcap"), datetime(2026, 1, 2, 3, 4, 5, 6, UTC)]),
    ARRAYS,
)
VALUES = st.recursive(
    st.one_of(PLAIN, ODD),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.lists(inner, max_size=4).map(tuple),
        st.dictionaries(st.one_of(st.text(), st.integers(), st.tuples(st.text(), st.text())), inner, max_size=4),
    ),
    max_leaves=12,
)
NOTES = st.builds(
    Note,
    st.sampled_from(RunCode),
    st.sampled_from(Severity),
    st.dictionaries(st.text(max_size=5), st.one_of(PLAIN, st.tuples(st.text(), FLOATS)), max_size=3),
    st.tuples(st.text()),
)
FACTS = st.builds(
    SensorFacts, *[st.integers()] * 2, FLOATS, st.integers(), *[FLOATS] * 3, st.text(), st.integers(), FLOATS
)
QUALITIES = st.builds(
    QualityReport,
    shares=st.dictionaries(st.text(), FLOATS, max_size=2),
    residual_latency_s=FLOATS,
    notes=st.lists(NOTES, max_size=3).map(tuple),
    sensors=st.dictionaries(st.text(), FACTS, max_size=2),
    standstills=st.tuples(st.builds(Standstill, FLOATS, FLOATS, st.just({}), st.dictionaries(st.text(), FLOATS))),
)
_OF_ARRAYS = [field.name for field in fields(ProcessedRun) if field.type == "FloatArray"]


@st.composite
def processed_runs(draw: st.DrawFn) -> ProcessedRun:
    """Return a processed run with arrays of any numbers; one has all its samples in one place of memory."""
    size = draw(st.integers(0, 30))
    columns: dict[str, Any] = {name: draw(arrays(np.float64, size)) for name in _OF_ARRAYS}
    columns["latitude_deg"] = np.broadcast_to(np.float64(draw(FLOATS)), (size,))
    return ProcessedRun(
        run=draw(st.builds(RunInfo, id=st.text(), pass_number=st.integers(1, 9))),
        rate_hz=draw(FLOATS),
        cutoff_hz=draw(FLOATS),
        wheel_radius_m=draw(FLOATS),
        start_ns=draw(st.integers(0, 1 << 62)),
        segment=draw(arrays(np.uint8, size)),
        reason=draw(arrays(np.uint8, size)),
        quality=draw(QUALITIES),
        extras={"rut_depth_m": draw(arrays(np.float64, size))},
        **columns,
    )


def same(one: Any, two: Any) -> bool:
    """Return whether two values are the same to the last bit, with the same classes all through."""
    if type(one) is not type(two):
        return False
    if isinstance(one, float):
        return struct.pack("<d", one) == struct.pack("<d", two) or (one != one and two != two)
    if isinstance(one, np.generic):
        return one.dtype == two.dtype and one.tobytes() == two.tobytes()
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (two.dtype, two.shape, two.tobytes())
    if isinstance(one, tuple | list):
        return len(one) == len(two) and all(map(same, one, two))
    if isinstance(one, dict):
        return same(list(one.items()), list(two.items()))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(two, f.name)) for f in fields(one))
    if isinstance(one, BaseModel):
        return same(one.__dict__, two.__dict__) and one.model_fields_set == two.model_fields_set
    return bool(one == two)


def back(value: object) -> Any:
    """Return a value after a round trip."""
    return from_bytes(bytearray(to_bytes(value)))


@given(VALUES)
def test_any_value_comes_back(value: object) -> None:
    assert same(back(value), value)


@given(processed_runs())
def test_a_processed_run_comes_back(run: ProcessedRun) -> None:
    found = back(run)
    assert same(found, run)
    assert encode(found) == encode(run), "its key is the same"


@given(arrays(np.float64, array_shapes(max_dims=3)))
def test_the_layout_comes_back(values: np.ndarray) -> None:
    for one in (values, np.asfortranarray(values), values[::2], values.T):
        found = back(one)
        assert same(found, one)
        if one.flags.f_contiguous and not one.flags.c_contiguous and len(set(one.ravel().tolist())) > 1:
            assert found.flags.f_contiguous, "sums over it run in the same order"


def test_an_array_of_one_value_takes_no_room() -> None:
    everywhere = np.broadcast_to(np.float64(np.nan), (1 << 40,))
    assert len(to_bytes(everywhere)) < 100
    assert back(everywhere).shape == (1 << 40,) and np.isnan(back(everywhere)[-1])
    assert encode(np.full(9, 2.5)) == encode(np.broadcast_to(2.5, 9)), "one content, one key"


def test_an_enum_is_not_the_text_that_it_equals() -> None:
    assert type(back(RunCode.LATE_STAMPS)) is RunCode
    assert type(back(str(RunCode.LATE_STAMPS.value))) is str


@dataclass(frozen=True)
class Foreign:
    """A class of no room."""

    number: int = 1


class Colour(Enum):
    """An enum of no room."""

    RED = 1


@pytest.mark.parametrize(
    "value",
    [object(), {1, 2}, print, Foreign(), Colour.RED, np.array([None]), np.zeros(2, "V3"), range(3), Foreign, 1j],
    ids=lambda value: type(value).__name__,
)
def test_other_values_are_not_kept(value: object) -> None:
    with pytest.raises(NotKeptError):
        encode([value])


def written(value: Any) -> bytearray:
    """Return bytes that hold some JSON and no array."""
    text = json.dumps(value).encode()
    return bytearray(len(text).to_bytes(8, "little") + text)


HOSTILE = [
    "os:system",
    "posix:system",
    "builtins:eval",
    "subprocess:Popen",
    "pathlib:Path",
    "daq.runs.run:Path",
    "daq.runs.run:load_database",
    "daq.config:BaseModel",
    "wheelsoil.cli.app:Entry",
    "tests.wheelsoil.test_cache_codec:Foreign",
    "daq..os:system",
    "daq.no_such_module:Class",
    "daq.runs.run:Run.frame_batches",
    "daq.logger.recorder:Recorder",
    "daq",
    "",
]


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("kind", ["data", "enum", "settings"])
def test_a_foreign_name_is_refused(kind: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[object] = []
    monkeypatch.setattr(os, "system", called.append)
    for values in ([], ["echo 1"], [[], "echo 1"], [["list", "echo 1"]]):
        with pytest.raises(DamagedError):
            from_bytes(written([kind, name, *values]))
    assert not called


@pytest.mark.parametrize(
    "value",
    [
        ["array", "|O", "C", 1],
        ["array", "<f8", "C", 1],
        ["array", "<f8", "C", -1],
        ["array", "<f8", "1", 1 << 40],
        ["array", "<f8", "C", 1 << 62, 1 << 62],
        ["array", "f8,O", "C", 0],
        ["scalar", "|O", "00"],
        ["scalar", "<f8", "00"],
        ["data", "daq.notes:Note", "code"],
        ["data", "daq.notes:Note", "code", 0, ["dict"], ["tuple"], "more"],
        ["enum", "daq.notes:Severity", "NO_SUCH"],
        ["no_such_kind", 1],
        ["bytes", "x"],
        ["time", "noon"],
        [],
        {"a": 1},
        [["list"]],
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused(value: Any) -> None:
    with pytest.raises(DamagedError):
        from_bytes(written(value))


def test_deep_nesting_is_refused() -> None:
    text = b'["list",' * 100_000 + b"1" + b"]" * 100_000
    with pytest.raises(DamagedError):
        from_bytes(bytearray(len(text).to_bytes(8, "little") + text))


NOTED = replace(Note(RunCode.LATE_STAMPS), values={"count": 3, "role": "x", "at": np.arange(4.0)})


@given(st.integers(0, len(to_bytes(NOTED)) - 1), st.integers(0, 255))
def test_bytes_of_any_kind_end_in_a_value_or_an_error(at: int, byte: int) -> None:
    data = bytearray(to_bytes(NOTED))
    for changed in (data[:at], data[:at] + bytes([byte]) + data[at + 1 :]):
        with suppress(DamagedError):
            from_bytes(bytearray(changed))


@given(array_dtypes())
def test_no_structure_is_kept(dtype: np.dtype[Any]) -> None:
    with pytest.raises(NotKeptError):
        encode(np.zeros(2, dtype))
