"""Long messages over J1939 transport and ISO-TP: what was sent whole comes back whole, and nothing else does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.can import CLASSIC_DTYPE, Database, Decoder, FrameBatch, FrameFlag, Message, RawKind, Signal
from daq.can.transport import Payload, Transport

GROUP = 0xFEE3
ISO_ID = 0x7E8
Sent = tuple[int, bool, bytes]
"""Identifier, whether it is extended, data."""


def by_bam(source: int, group: int, data: bytes) -> list[Sent]:
    """Segment a message as J1939-21 says."""
    packets = -(-len(data) // 7)
    head = bytes([32, len(data) & 255, len(data) >> 8, packets, 255]) + group.to_bytes(3, "little")
    parts = [bytes([i + 1]) + data[7 * i : 7 * i + 7].ljust(7, b"\xff") for i in range(packets)]
    return [(0x1CECFF00 | source, True, head), *((0x1CEBFF00 | source, True, part) for part in parts)]


def by_rts(source: int, destination: int, group: int, data: bytes) -> list[Sent]:
    packets = -(-len(data) // 7)
    head = bytes([16, len(data) & 255, len(data) >> 8, packets, 255]) + group.to_bytes(3, "little")
    down, up = 0x18EC0000 | destination << 8 | source, 0x18EC0000 | source << 8 | destination
    cleared = bytes([17, packets, 1, 255, 255]) + group.to_bytes(3, "little")
    frames = [(down, True, head), (up, True, cleared)]
    for i in range(packets):
        part = bytes([i + 1]) + data[7 * i : 7 * i + 7].ljust(7, b"\xff")
        frames.append((0x18EB0000 | destination << 8 | source, True, part))
    return [*frames, (up, True, bytes([19]) + head[1:4] + b"\xff" + head[5:])]


def by_iso_tp(can_id: int, data: bytes) -> list[Sent]:
    """Segment a message as ISO 15765-2 says, padded to eight bytes."""
    if len(data) <= 7:
        return [(can_id, False, (bytes([len(data)]) + data).ljust(8, b"\xaa"))]
    frames = [(can_id, False, bytes([0x10 | len(data) >> 8, len(data) & 255]) + data[:6])]
    for i, start in enumerate(range(6, len(data), 7), 1):
        frames.append((can_id, False, (bytes([0x20 | i & 15]) + data[start : start + 7]).ljust(8, b"\xaa")))
    return frames


def batch_of(sent: Sequence[Sent], step_ns: int = 10_000_000) -> FrameBatch:
    frames = np.zeros(len(sent), CLASSIC_DTYPE)
    for i, (can_id, extended, data) in enumerate(sent):
        frames[i]["can_id"], frames[i]["length"] = can_id, len(data)
        frames[i]["flags"] = FrameFlag.EXTENDED if extended else 0
        frames[i]["data"][: len(data)] = np.frombuffer(data, np.uint8)
    frames["time_ns"] = np.arange(len(sent)) * step_ns
    return FrameBatch(frames, ("can0",))


def received(sent: Sequence[Sent], cut: int = 10**9, step_ns: int = 10_000_000) -> tuple[list[Payload], Transport]:
    transport = Transport({"can0": {(ISO_ID, False): 4095}}, ["can0"])
    batch = batch_of(sent, step_ns)
    pieces = [batch[start : start + cut] for start in range(0, len(batch), cut)]
    return [one for piece in pieces for one in transport.take(piece)], transport


@given(st.lists(st.binary(min_size=9, max_size=300), min_size=1, max_size=4), st.integers(1, 20), st.data())
def test_interleaved_messages_come_back(messages: list[bytes], cut: int, data: st.DataObject) -> None:
    streams = []
    for source, message in enumerate(messages):
        how = data.draw(st.sampled_from(["bam", "rts", "iso"])) if source else "iso"
        if how == "iso" and source:
            how = "bam"
        streams.append(
            by_iso_tp(ISO_ID, message)
            if how == "iso"
            else by_bam(source, GROUP, message)
            if how == "bam"
            else by_rts(source, 0x80, 0xEF00, message)
        )
    order = data.draw(st.permutations([i for i, stream in enumerate(streams) for _ in stream]))
    positions = [iter(stream) for stream in streams]
    found, transport = received([next(positions[i]) for i in order], cut, step_ns=1_000_000)
    assert sorted(one.data for one in found) == sorted(messages)
    assert not transport.interrupted()
    for one in found:
        source = one.can_id & 0xFF
        assert one.can_id == ISO_ID or (one.can_id >> 8 & 0x3FFFF in (GROUP, 0xEF80) and one.data == messages[source])


@given(st.binary(min_size=9, max_size=200), st.data())
def test_a_lost_frame_costs_its_message_and_is_counted(message: bytes, data: st.DataObject) -> None:
    for frames in (by_iso_tp(ISO_ID, message), by_bam(3, GROUP, message)):
        lost = data.draw(st.integers(0, len(frames) - 1))
        whole = by_iso_tp(ISO_ID, b"0123456789") if frames[0][0] == ISO_ID else by_bam(3, GROUP, b"0123456789")
        found, transport = received([*frames[:lost], *frames[lost + 1 :], *whole])
        assert [one.data for one in found] == [b"0123456789"]
        assert transport.interrupted()["can0"] == (lost > 0)


def test_short_frames_of_a_long_message_are_no_pieces() -> None:
    """A sender may leave out the end of a message: nothing says that it uses ISO-TP before a transfer is complete."""
    message = long_message("Long", ISO_ID, extended=False, j1939=False)
    decoder = Decoder({"can0": (Database("x", b"", (message,)),)})
    decoded = decoder.decode(batch_of([(ISO_ID, False, bytes([5, 1, 0, 0, 0, 0, 0, 0]))] * 3))
    assert decoded["can0", "Long.First"].values.tolist() == [2 * 0x0105] * 3
    assert np.isnan(decoded["can0", "Long.Last"].values).all()


@pytest.mark.parametrize(("size", "whole"), [(7, False), (8, True), (4095, True)])
def test_a_message_of_several_iso_tp_frames_is_longer_than_one_holds(size: int, whole: bool) -> None:
    first, *rest = by_iso_tp(ISO_ID, bytes(max(size, 9)))
    frames = [(ISO_ID, False, bytes([0x10 | size >> 8, size & 255]) + first[2][2:]), *rest]
    assert [len(one.data) for one in received(frames)[0]] == [size] * whole


@pytest.mark.parametrize(("followed_by", "counted"), [(0, 0), (1, 1), (2, 1)])
def test_a_transfer_that_went_on_is_counted_when_another_begins(followed_by: int, counted: int) -> None:
    """A first frame that nothing follows may be no ISO-TP."""
    frames = by_iso_tp(ISO_ID, bytes(30))
    found, transport = received([*frames[: 1 + followed_by], frames[0]])
    assert not found and transport.interrupted()["can0"] == counted


def test_a_short_message_comes_back_once_a_long_one_has_shown_what_is_spoken() -> None:
    messages = [bytes(range(size)) for size in (5, 9, 1, 2, 7)]
    found, transport = received([frame for one in messages for frame in by_iso_tp(ISO_ID, one)])
    assert [one.data for one in found] == messages[1:] and not transport.interrupted()


def test_a_message_that_stalls_is_dropped() -> None:
    found, transport = received(by_bam(1, GROUP, bytes(20)), step_ns=2_000_000_000)
    assert not found and transport.interrupted()["can0"] == 1
    for group, whole in ((0x3FFFF, True), (0x40000, False)):
        found, transport = received(by_bam(1, group, bytes(20)))
        assert (len(found), transport.interrupted()["can0"]) == (whole, not whole), "a group has 18 bits"
    head, first, *rest = by_bam(1, GROUP, bytes(20))
    found, transport = received([head, first, (first[0], True, bytes(8)), *rest])
    assert not found and transport.interrupted()["can0"] == 1, "no packet has the number 0"


@given(st.lists(st.tuples(st.sampled_from([ISO_ID, 0x1CECFF01, 0x1CEBFF01]), st.binary(max_size=8)), max_size=60))
def test_noise_never_raises_and_never_gives_more_than_was_sent(noise: list[tuple[int, bytes]]) -> None:
    found, _ = received([(can_id, can_id != ISO_ID, data) for can_id, data in noise])
    assert sum(len(one.data) for one in found) <= sum(len(data) for _, data in noise)


def long_message(name: str, can_id: int, *, extended: bool, j1939: bool) -> Message:
    places = {"First": 0, "Last": 8 * 17}
    signals = tuple(
        Signal(name, "N", start, 16, False, RawKind.UNSIGNED, 2, 0, None, None, {}, None, (), "")
        for name, start in places.items()
    )
    return Message(name, can_id, extended=extended, length=20, signals=signals, j1939=j1939)


@pytest.mark.parametrize("j1939", [True, False])
def test_a_long_message_of_a_database_is_decoded(j1939: bool) -> None:
    can_id = 0x18FEE300 if j1939 else ISO_ID
    message = long_message("Long", can_id, extended=j1939, j1939=j1939)
    decoder = Decoder({"can0": (Database("x", b"", (message,)),)})
    payload = bytes(range(20))
    sent = by_bam(7, GROUP, payload) if j1939 else by_iso_tp(ISO_ID, payload)
    batch = batch_of([*sent, *sent])
    halves = [decoder.decode(batch[: len(sent) + 1]), decoder.decode(batch[len(sent) + 1 :])]
    for half in halves:
        assert half["can0", "Long.First"].values.tolist() == [2 * 0x0100]
        assert half["can0", "Long.Last"].values.tolist() == [2 * 0x1211]
    assert halves[0]["can0", "Long.Last"].time_ns.tolist() == [(len(sent) - 1) * 10_000_000]


@pytest.mark.parametrize("sent", [by_bam(1, GROUP, bytes(20)), by_iso_tp(ISO_ID, bytes(30))])
def test_a_message_that_never_ends_is_counted(sent: list[Sent]) -> None:
    found, transport = received(sent[:-1])
    assert not found and transport.interrupted() == {"can0": 1}
