"""Which frames are decoded as what: buses, identifiers, J1939, flags, blocks, and what was asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from daq.can import (
    CLASSIC_DTYPE,
    Coverage,
    Database,
    Decoder,
    FrameBatch,
    FrameFlag,
    concatenate,
    coverage,
    decode,
    load_database,
)
from daq.can import codec as decode_module
from daq.errors import DatabaseError

DBC = """VERSION ""
BU_: A
BO_ 256 Short: 8 A
 SG_ Speed : 0|16@1+ (0.1,0) [0|0] "km/h" A
 SG_ Gear : 16|4@1+ (1,0) [0|0] "" A
BO_ 2147483904 Long: 8 A
 SG_ Speed : 7|16@0+ (0.5,0) [0|0] "km/h" A
VAL_ 256 Gear 0 "neutral" 1 "first" ;
"""
J1939 = """VERSION ""
BU_: A
BO_ {ccvs} CCVS1: 8 A
 SG_ Speed : 8|16@1+ (0.00390625,0) [0|250.996] "km/h" A
BO_ {tsc} TSC1: 8 A
 SG_ Torque : 24|8@1+ (1,-125) [-125|125] "%" A
{more}
BA_DEF_ BO_  "VFrameFormat" ENUM  "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_  "VFrameFormat" "J1939PG";
"""


def database(text: str = DBC, name: str = "made.dbc") -> Database:
    return load_database(text.encode(), name)


def j1939(more: str = "") -> Database:
    return database(J1939.format(ccvs=0x80000000 | 0x18FEF1FE, tsc=0x80000000 | 0x0C0000FE, more=more))


def batch(*rows: tuple[int, int, int, bytes], buses: tuple[str, ...] = ("can0",)) -> FrameBatch:
    """Frames (identifier, bus number, flags, payload), a second apart."""
    frames = np.zeros(len(rows), CLASSIC_DTYPE)
    for i, (can_id, bus, flags, payload) in enumerate(rows):
        frames[i] = (i * 10**9, can_id, bus, flags, len(payload), 0, np.frombuffer(payload.ljust(8, b"\0"), np.uint8))
    return FrameBatch(frames, buses)


def test_standard_and_extended_identifiers_are_different_messages() -> None:
    channels = decode(
        batch((256, 0, 0, b"\x0a\x00"), (256, 0, FrameFlag.EXTENDED, b"\x00\x04")), {"can0": [database()]}
    )
    assert channels["can0", "Short.Speed"].values.tolist() == [1.0]
    assert channels["can0", "Long.Speed"].values.tolist() == [2.0]
    assert channels["can0", "Long.Speed"].time_ns.tolist() == [10**9]
    assert math.isnan(channels["can0", "Short.Gear"].values[0])  # the frame is too short for it


def test_units_labels_and_shared_times() -> None:
    channels = decode(batch((256, 0, 0, bytes([1, 0, 1]))), {"can0": [database()]})
    gear, speed = channels["can0", "Short.Gear"], channels["can0", "Short.Speed"]
    assert gear.labels == {0: "neutral", 1: "first"}
    assert gear.values.tolist() == [1.0]
    assert speed.unit == "km/h"
    assert gear.time_ns is speed.time_ns


@pytest.mark.parametrize("flag", [FrameFlag.ERROR, FrameFlag.REMOTE])
def test_error_and_remote_frames_are_never_decoded(flag: FrameFlag) -> None:
    assert decode(batch((256, 0, flag, b"\1\0\0")), {"can0": [database()]}) == {}
    assert decode(batch((256, 0, flag | FrameFlag.EXTENDED, b"\1\0")), {"can0": [database()]}) == {}


def test_one_dbc_on_several_buses_and_a_bus_without_dbc() -> None:
    frames = batch((256, 0, 0, b"\1\0"), (256, 1, 0, b"\2\0"), (256, 2, 0, b"\3\0"), buses=("a", "b", "c"))
    channels = decode(frames, {"a": [database()], "c": [database()]})
    assert channels["a", "Short.Speed"].values.tolist() == [0.1]
    assert channels["c", "Short.Speed"].values.tolist() == [3 * 0.1]
    assert ("b", "Short.Speed") not in channels
    assert decode(frames[:0], {"z": [database()]}) == {}


def test_only_what_is_wanted_and_empty_channels_for_what_never_came() -> None:
    decoder = Decoder({"can0": [database()]}, ["Short.Gear", "Long.Speed"])
    channels = decoder.decode(batch((256, 0, 0, bytes([0, 0, 2]))))
    assert set(channels) == {("can0", "Short.Gear"), ("can0", "Long.Speed")}
    assert len(channels["can0", "Long.Speed"]) == 0


def test_a_wanted_signal_that_no_dbc_has_is_a_fault_with_the_nearest_name() -> None:
    with pytest.raises(DatabaseError, match=r"Short\.Gaer(.|\n)*nearest: Short\.Gear"):
        Decoder({"can0": [database()]}, ["Short.Gaer"])


def test_times_are_put_in_order() -> None:
    frames = batch((256, 0, 0, b"\1\0"), (256, 0, 0, b"\2\0"), (256, 0, 0, b"\3\0"))
    channel = decode(frames[np.array([2, 0, 1])], {"can0": [database()]})["can0", "Short.Speed"]
    assert channel.time_ns.tolist() == [0, 10**9, 2 * 10**9]
    np.testing.assert_array_equal(channel.values, np.array([1, 2, 3]) * 0.1)


def test_blocks_pieces_and_records_of_either_size_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    frames = batch(*((int(rng.choice([256, 77])), 0, int(rng.choice([0, 1])), rng.bytes(8)) for _ in range(300)))
    decoder = Decoder({"can0": [database()]})
    whole, wide = decoder.decode(frames), decoder.decode(frames.widened())
    pieces = [decoder.decode(frames[i : i + 70]) for i in range(0, 300, 70)]
    monkeypatch.setattr(decode_module, "BLOCK", 32)
    blocks, strided = decoder.decode(frames), decoder.decode(concatenate([frames[::2], frames[1::2]]))
    for key, channel in whole.items():
        joined = np.concatenate([piece[key].values for piece in pieces if key in piece])
        for other in (wide[key].values, joined, blocks[key].values, strided[key].values):
            np.testing.assert_array_equal(channel.values, other)


def test_j1939_matches_the_parameter_group() -> None:
    ext = FrameFlag.EXTENDED
    speed = (256).to_bytes(2, "little")
    frames = batch(
        (0x18FEF100, 0, ext, b"\0" + speed),  # another source
        (0x0CFEF127, 0, ext, b"\0" + speed),  # another priority and source
        (0x18FEF200, 0, ext, b"\0" + speed),  # another group
        (0x0C000327, 0, ext, b"\0\0\0\x80"),  # destination 3: PDU format below 240
        (0x18FEF1FE & 0x7FF, 0, 0, b"\0" + speed),  # 11 bits
    )
    channels = decode(frames, {"can0": [j1939()]})
    assert channels["can0", "CCVS1.Speed"].time_ns.tolist() == [0, 10**9]
    assert channels["can0", "CCVS1.Speed"].values.tolist() == [1.0, 1.0]
    assert channels["can0", "TSC1.Torque"].values.tolist() == [3.0]


def test_j1939_sources_are_separated_by_messages_of_their_own() -> None:
    own = f'BO_ {0x80000000 | 0x18FEF10B} CCVS1_EBS: 8 A\n SG_ Speed : 8|16@1+ (0.00390625,0) [0|0] "km/h" A'
    ext, payload = FrameFlag.EXTENDED, b"\0\0\1"
    frames = batch((0x18FEF1FE, 0, ext, payload), (0x18FEF10B, 0, ext, payload), (0x18FEF133, 0, ext, payload))
    channels = decode(frames, {"can0": [j1939(own)]})
    assert channels["can0", "CCVS1.Speed"].time_ns.tolist() == [0]
    assert channels["can0", "CCVS1_EBS.Speed"].time_ns.tolist() == [10**9]
    wanted = decode(frames, {"can0": [j1939(own)]}, ["CCVS1.Speed"])
    assert wanted["can0", "CCVS1.Speed"].time_ns.tolist() == [0]  # what else is wanted does not matter


def test_messages_of_one_name_get_their_identifier() -> None:
    twin = DBC.replace("BO_ 256 ", "BO_ 512 ").replace("VAL_ 256", "VAL_ 512").replace("2147483904", "2147483905")
    channels = decode(
        batch((256, 0, 0, b"\1\0"), (512, 0, 0, b"\2\0")), {"can0": [database(), database(twin, "twin.dbc")]}
    )
    assert channels["can0", "Short@0x100.Speed"].values.tolist() == [0.1]
    assert channels["can0", "Short@0x200.Speed"].values.tolist() == [0.2]


def test_coverage_counts_known_and_unknown_and_adds_up() -> None:
    frames = batch(
        (256, 0, 0, b""),
        (256, 0, 0, b""),
        (7, 1, 0, b""),
        (256, 0, FrameFlag.EXTENDED, b""),
        (4, 0, FrameFlag.ERROR, b""),
        (256, 0, FrameFlag.REMOTE, b""),
        buses=("a", "b"),
    )
    databases = {"a": [database()]}
    whole = coverage(frames, databases)
    assert [(r.bus, r.can_id, r.extended, r.frames, r.message) for r in whole.ids] == [
        ("a", 256, False, 2, "Short"),
        ("a", 256, True, 1, "Long"),
        ("b", 7, False, 1, None),
    ]
    assert (whole.known, whole.unknown, whole.error_frames, whole.remote_frames) == (3, 1, 1, 1)
    pieces = sum((coverage(frames[i : i + 1], databases) for i in range(len(frames))), Coverage())
    assert pieces == whole
