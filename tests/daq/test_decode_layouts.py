"""Any place, length, order, type and scale of a signal, against cantools; multiplexing of both kinds."""

from __future__ import annotations

import math
from typing import Any

import cantools.database
import numpy as np
import pytest
from cantools_reference import Reference, assert_same, frames_of
from dbc_layouts import MULTIPLEXED, dbc, signals
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from daq.can import Decoder, decode, load_database


@examples(60)
@given(lines=st.lists(signals(), min_size=1, max_size=8), data=st.data())
def test_any_signal_equals_cantools(lines: list[tuple[int, str, str]], data: st.DataObject) -> None:
    content = dbc(lines)
    database = load_database(content, "made.dbc")
    reference = cantools.database.load_string(content.decode(), "dbc")
    for message in reference.messages:
        full = st.binary(min_size=message.length, max_size=message.length)
        payloads = data.draw(st.lists(st.one_of(full, st.binary(max_size=message.length)), min_size=1, max_size=6))
        compare(database, message, payloads)


def compare(database: Any, message: Any, payloads: list[bytes]) -> None:
    """Bit for bit; where cantools computes with integers beyond 2**53, to one unit in the last place."""
    (signal,) = message.signals
    if signal.length <= 53 or signal.conversion.is_float:
        assert_same(database, message, payloads)
        return
    got = Decoder({"can0": [database]}).decode(frames_of(message, payloads))["can0", f"{message.name}.{signal.name}"]
    want = np.array([Reference(message).decode(payload)[signal.name] for payload in payloads])
    np.testing.assert_array_equal(np.isnan(got.values), np.isnan(want))
    raw = max(abs(x) for x in (*want[~np.isnan(want)] - signal.offset, 1.0))
    ulp = math.ulp(max(raw, abs(float(signal.offset))))
    np.testing.assert_allclose(got.values, want, rtol=0, atol=ulp)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    "length", [pytest.param(n, marks=pytest.mark.study if n == 24 else pytest.mark.slow) for n in (1, 3, 8, 24, 64)]
)
def test_every_place_equals_cantools(length: int, big: bool) -> None:
    rng = np.random.default_rng(length)
    firsts = range(8 * length) if length <= 8 else sorted(rng.choice(8 * length, 60, replace=False))
    for first in firsts:
        most = min(64, 8 * length - int(first))
        start = 8 * (first // 8) + 7 - first % 8 if big else first
        lines = [
            (length, f'{start}|{bits}@{0 if big else 1}{sign} (1,0) [0|0] "" A', "0")
            for bits in range(1, most + 1)
            for sign in "+-"
        ]
        database = load_database(dbc(lines), "made.dbc")
        reference = cantools.database.load_string(dbc(lines).decode(), "dbc")
        decoder = Decoder({"can0": [database]})
        for message in reference.messages:
            payloads = [rng.bytes(length), bytes(length), b"\xff" * length, rng.bytes(max(0, length - 1))]
            assert_same(database, message, payloads, decoder)


@examples(40)
@given(payloads=st.lists(st.tuples(st.integers(0, 4), st.integers(0, 10), st.binary(max_size=6)), min_size=1))
def test_multiplexed_messages_equal_cantools(payloads: list[tuple[int, int, bytes]]) -> None:
    database = load_database(MULTIPLEXED.encode(), "mux.dbc")
    reference = cantools.database.load_string(MULTIPLEXED, "dbc")
    for message in reference.messages:
        assert_same(database, message, [bytes([outer, inner]) + rest for outer, inner, rest in payloads])


def test_a_multiplexer_is_compared_as_bits() -> None:
    database = load_database(MULTIPLEXED.encode(), "mux.dbc")
    message = cantools.database.load_string(MULTIPLEXED, "dbc").get_message_by_name("Negative")
    channels = decode(frames_of(message, [bytes([255, 7, *[0] * 6]), bytes([1, 8, *[0] * 6])]), {"can0": [database]})
    np.testing.assert_array_equal(channels["can0", "Negative.Left"].values, [7, math.nan])
    np.testing.assert_array_equal(channels["can0", "Negative.Right"].values, [math.nan, 8])
    np.testing.assert_array_equal(channels["can0", "Negative.Side"].values, [-1, 1])
