"""Every place of a field in a payload, against the arithmetic of one large integer."""

from __future__ import annotations

import cantools.database
import numpy as np
import pytest
from cantools_reference import frames_of
from dbc_layouts import dbc
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.can import RawKind, Signal, decode, load_database
from daq.can.bits import bit_field, read_raw, write_raw

WIDTH = 64
"""Bytes of a CAN FD frame."""


@st.composite
def fields(draw: st.DrawFn) -> tuple[int, Signal]:
    """Return the first bit in the order of sending and the signal; many fields touch nine bytes."""
    length = draw(st.one_of(st.integers(1, 64), st.integers(57, 64)))
    first = draw(st.integers(0, 8 * WIDTH - length))
    big = draw(st.booleans())
    start = 8 * (first // 8) + 7 - first % 8 if big else first
    kind = draw(st.sampled_from([RawKind.UNSIGNED, RawKind.SIGNED]))
    return first, Signal("S", "", start, length, big, kind)


def expected(payload: bytes, first: int, signal: Signal) -> int:
    if signal.big_endian:
        whole = int.from_bytes(payload, "big") >> (8 * WIDTH - first - signal.length_bits)
    else:
        whole = int.from_bytes(payload, "little") >> first
    raw = whole % (1 << signal.length_bits)
    negative = signal.kind is RawKind.SIGNED and raw >> (signal.length_bits - 1)
    return raw - (1 << signal.length_bits) if negative else raw


@settings(deadline=None)
@given(fields(), st.binary(min_size=WIDTH, max_size=WIDTH))
def test_a_field_is_read_where_it_lies_and_written_back(place: tuple[int, Signal], payload: bytes) -> None:
    first, signal = place
    data = np.frombuffer(payload, np.uint8).reshape(1, WIDTH).copy()
    wanted = expected(payload, first, signal)
    assert int(read_raw(bit_field(signal), data)[0]) == wanted
    empty = np.zeros((1, WIDTH), np.uint8)
    write_raw(bit_field(signal), empty, np.array([wanted % (1 << signal.length_bits)], np.uint64))
    assert expected(empty.tobytes(), first, signal) == wanted
    assert sum(byte.bit_count() for byte in empty.tobytes()) == (wanted % (1 << signal.length_bits)).bit_count()


@pytest.mark.parametrize(
    ("line", "raw", "value"),
    [
        ("0|54@1+ (1,-9007199254740992)", 2**53 + 1, 1.0),  # a double holds no 2^53 + 1
        ("0|52@1+ (3,5)", 2**52 - 1, float(3 * (2**52 - 1) + 5)),
        ("0|16@1+ (0.5,-40)", 100, 10.0),
    ],
)
def test_scale_comes_before_offset_and_integers_stay_exact(line: str, raw: int, value: float) -> None:
    content = dbc([(8, f'{line} [0|0] "" A', "0")])
    (message,) = cantools.database.load_string(content.decode(), "dbc").messages
    frames = frames_of(message, [raw.to_bytes(8, "little")])
    (channel,) = decode(frames, {"can0": [load_database(content, "made.dbc")]}).values()
    assert channel.values.tolist() == [value]
