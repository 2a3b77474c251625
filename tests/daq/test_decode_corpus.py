"""Every message of every DBC of the corpus that cantools loads, against cantools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cantools_reference import assert_same, load_reference
from support import data_dir

from daq.can import Decoder, Message, load_database
from daq.can.bits import EXTENDED_BIT, bit_field, write_raw
from daq.errors import DatabaseError

LOADABLE = 179
NOTHING_LEFT = ("issue_199", "issue_199_extended", "gm_global_a_lowspeed", "generator__honda__honda_crv_ex_2017_body")
"""Every message of these has an identifier that is too long."""


def corpus() -> list[Path]:
    return sorted(path for path in data_dir("dbc-corpus").rglob("*") if path.suffix.lower() == ".dbc")


def payloads_of(message: Message, rng: np.random.Generator, each: int) -> list[bytes]:
    """Random payloads of every length, up to one byte more than the message has."""
    longest = min(message.length + 1, 64)
    lengths = [*range(longest), *[message.length] * (3 * each), longest]
    return [_select(message, rng, rng.bytes(n)) for n in lengths for _ in range(each if n == message.length else 1)]


def _select(message: Message, rng: np.random.Generator, payload: bytes) -> bytes:
    """Half of the time, give every multiplexer a value that the DBC knows."""
    data = np.zeros((1, 64), np.uint8)
    data[0, : len(payload)] = np.frombuffer(payload, np.uint8)
    for name in {signal.multiplexer for signal in message.signals if signal.multiplexer}:
        ids = [i for signal in message.signals if signal.multiplexer == name for i in signal.multiplexer_ids]
        outer = message.by_name.get(name or "")
        if outer is None or not ids or outer.end_byte > len(payload) or rng.random() < 0.5:
            continue
        full, mask = (1 << outer.length_bits) - 1, np.zeros((1, 64), np.uint8)
        write_raw(bit_field(outer), mask, np.array([full], np.uint64))
        data &= ~mask
        write_raw(bit_field(outer), data, np.array([int(rng.choice(ids)) & full], np.uint64))
    return data[0, : len(payload)].tobytes()


def compare(part: int, parts: int, each: int) -> tuple[int, list[Path]]:
    """Compare every parts-th file; return how many cantools loads, and those that it refuses."""
    loaded, refused = 0, []
    for number, path in enumerate(corpus()):
        if number % parts != part:
            continue
        reference = load_reference(path)
        if reference is None:
            refused.append(path)
            continue
        loaded += 1
        database = load_database(path, lenient=True)
        ours = {message.key: message for message in database.messages}
        decoder = Decoder({"can0": [database]})
        for message in reference.messages:
            key = message.frame_id | (EXTENDED_BIT if message.is_extended_frame else 0)
            rng = np.random.default_rng([number, message.frame_id])
            if message.signals:
                assert_same(database, message, payloads_of(ours[key], rng, each), decoder)
    return loaded, refused


def test_decoder_equals_cantools_on_a_twelfth_of_the_corpus() -> None:
    loaded, _ = compare(0, 12, 1)
    assert loaded > 10


@pytest.mark.slow
def test_decoder_equals_cantools_on_the_corpus() -> None:
    loaded, refused = compare(0, 1, 1)
    assert loaded == LOADABLE
    assert len(refused) == 24
    for path in refused:
        if path.stem in NOTHING_LEFT:
            with pytest.raises(DatabaseError, match="nothing is left"):
                load_database(path, lenient=True)
            continue
        database = load_database(path, lenient=True)
        assert database.messages
        assert any("line" in note for note in database.left_out)


@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=pytest.mark.slow if part < 2 else pytest.mark.study) for part in range(8)]
)
def test_decoder_equals_cantools_on_the_corpus_thoroughly(part: int) -> None:
    loaded, _ = compare(part, 8, 6)
    assert loaded > 10
