"""Columns -> frames: against cantools, and there and back."""

from __future__ import annotations

import math

import cantools.database
import numpy as np
import pytest
from dbc_layouts import HEAD, MULTIPLEXED, dbc, signals
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from daq.can import (
    Database,
    FrameFlag,
    Message,
    RawKind,
    decode,
    encode,
    load_database,
    merge,
    rolling_counter,
    shipped_dbc,
)
from daq.errors import DatabaseError


def message_of(database: Database, name: str) -> Message:
    return next(message for message in database.messages if message.name == name)


@examples(60)
@given(line=signals(), numbers=st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_what_is_encoded_is_decoded_again(line: tuple[int, str, str], numbers: list[float]) -> None:
    database = load_database(dbc([line]), "made.dbc")
    (message,) = database.messages
    (signal,) = message.signals
    if signal.kind is RawKind.FLOAT:
        values = np.array(numbers) * signal.scale + signal.offset
    else:
        low, high = signal.raw_range
        raw = np.floor(low + np.array(numbers) * (float(high) - low))
        values = (
            np.clip(raw, low, math.nextafter(float(high), 0) if high >> 53 else high) * signal.scale + signal.offset
        )
    sent = encode(message, {"S0": values}, np.arange(len(values)), "can0")
    got = decode(sent.frames, {"can0": [database]})["can0", "M0.S0"]
    step = abs(signal.scale) if signal.kind is not RawKind.FLOAT else 0.0
    size = {16: 2.0**-10, 32: 2.0**-23}.get(signal.length_bits, 2.0**-52) if signal.kind is RawKind.FLOAT else 2.0**-52
    slack = 4 * size * (np.abs(values).max() + abs(signal.offset) + abs(signal.scale))
    np.testing.assert_allclose(got.values, values, rtol=0, atol=0.5 * step + slack)
    again = encode(message, {"S0": got.values}, np.arange(len(values)), "can0")
    if signal.length_bits <= 48 and signal.kind is not RawKind.FLOAT and abs(signal.offset) < 1e6 * abs(signal.scale):
        np.testing.assert_array_equal(again.frames.frames, sent.frames.frames)
    assert sent.missing == {}


@examples(40)
@given(st.data())
def test_frames_equal_those_of_cantools(data: st.DataObject) -> None:
    for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc"):
        database = load_database(shipped_dbc(name))
        reference = cantools.database.load_file(shipped_dbc(name))
        message = data.draw(st.sampled_from(database.messages))
        values = {}
        for signal in message.signals:
            assert signal.minimum is not None and signal.maximum is not None
            values[signal.name] = data.draw(st.floats(signal.minimum, signal.maximum))
        sent = encode(message, values, [7], "can0").frames.frames[0]
        assert sent["data"][: sent["length"]].tobytes() == reference.encode_message(message.name, values)
        assert (sent["time_ns"], sent["can_id"], sent["length"]) == (7, message.can_id, message.length)


def test_a_value_beyond_the_raw_range_saturates_and_is_counted() -> None:
    database = load_database(shipped_dbc("wft.dbc"))
    forces = message_of(database, "WFT_Forces")
    sent = encode(forces, {"Fz": [70e3, -70e3, 10.0, math.inf], "Fx": 4.0}, np.arange(4), "can0")
    channels = decode(sent.frames, {"can0": [database]})
    assert channels["can0", "WFT_Forces.Fz"].values.tolist() == [65534, -65536, 10, 65534]
    assert channels["can0", "WFT_Forces.Fx"].values.tolist() == [4, 4, 4, 4]
    assert channels["can0", "WFT_Forces.Fy"].values.tolist() == [0, 0, 0, 0]
    assert sent.saturated == {"Fz": 3}


def test_a_missing_value_is_counted_and_sent_as_zero() -> None:
    database = load_database(shipped_dbc("wft.dbc"))
    sent = encode(message_of(database, "WFT_Forces"), {"Fz": [math.nan, 2.0]}, [0, 1], "can0")
    assert decode(sent.frames, {"can0": [database]})["can0", "WFT_Forces.Fz"].values.tolist() == [0, 2]
    assert (sent.saturated, sent.missing) == ({}, {"Fz": 1})


def test_multiplexed_signals_go_only_into_frames_that_select_them() -> None:
    database = load_database(MULTIPLEXED.encode(), "mux.dbc")
    values = {"Outer": [3, 3, 1, 9], "Inner": [5, 7, 0, 0], "Plain": 8, "Deep": -2, "Ranged": 200}
    sent = encode(message_of(database, "Nested"), values, np.arange(4), "can0")
    channels = decode(sent.frames, {"can0": [database]})
    got = {name: channels["can0", f"Nested.{name}"].values for name in values}
    nan = math.nan
    np.testing.assert_array_equal(got["Inner"], [5, 7, nan, nan])
    np.testing.assert_array_equal(got["Deep"], [-2, -2, nan, nan])
    np.testing.assert_array_equal(got["Ranged"], [nan, 200, nan, nan])
    np.testing.assert_array_equal(got["Plain"], [nan, nan, 8, nan])
    assert sent.frames.frames["data"][3].tolist() == [9, 0, 0, 0, 0, 0, 0, 0]


def test_long_and_extended_messages() -> None:
    text = f'{HEAD}BO_ {0x80000000 | 0x1ABCDEF} Long: 13 A\n SG_ X : 90|13@1- (0.5,1) [0|0] "" A\n'
    database = load_database(text.encode(), "long.dbc")
    sent = encode(database.messages[0], {"X": [-3.5, 4.0]}, [1, 2], "can0")
    row = sent.frames.frames[0]
    assert (row["length"], row["can_id"], row["flags"]) == (16, 0x1ABCDEF, FrameFlag.EXTENDED | FrameFlag.FD)
    assert decode(sent.frames, {"can0": [database]})["can0", "Long.X"].values.tolist() == [-3.5, 4.0]


def test_merging_keeps_the_order_of_time() -> None:
    database = load_database(shipped_dbc("wft.dbc"))
    one = encode(message_of(database, "WFT_Forces"), {}, [0, 10, 20], "can0").frames
    two = encode(message_of(database, "WFT_Moments"), {}, [5, 10], "can1").frames
    merged = merge([one, two])
    assert merged.frames["time_ns"].tolist() == [0, 5, 10, 10, 20]
    assert merged.frames["can_id"].tolist() == [256, 257, 256, 257, 256]
    assert [merged.buses[i] for i in merged.frames["bus"]] == ["can0", "can1", "can0", "can1", "can0"]


def test_the_counter_rolls_over() -> None:
    counter = message_of(load_database(shipped_dbc("wft.dbc")), "WFT_Forces").by_name["Counter"]
    assert rolling_counter(20, counter, start=14).tolist() == [14, 15, *range(16), 0, 1]


def test_wrong_names_and_messages_that_do_not_fit_are_faults() -> None:
    forces = message_of(load_database(shipped_dbc("wft.dbc")), "WFT_Forces")
    with pytest.raises(DatabaseError, match=r"2 faults(.|\n)*FX(.|\n)*nearest: F"):
        encode(forces, {"FX": 1.0, "Gz": 1.0}, [0], "can0")
    long = load_database(f'{HEAD}BO_ 5 Many: 80 A\n SG_ X : 0|8@1+ (1,0) [0|0] "" A\n'.encode(), "many.dbc")
    with pytest.raises(DatabaseError, match="does not fit a frame"):
        encode(long.messages[0], {"X": 1}, [0], "can0")
