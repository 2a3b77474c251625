from __future__ import annotations

import io
import re
import struct
import zlib
from pathlib import Path

import can
import numpy as np
import pytest
from frames_support import content, some_frames
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from daq import RecordingError
from daq.can import FrameBatch, FrameFlag, concatenate, messages_from_frames
from daq.limits import MOST_KINDS
from daq.logs import LogReport, blf, read_log
from daq.logs.blf import _search, read_blf


def written(batch: FrameBatch, **options: int) -> bytes:
    """Return the BLF file that python-can writes."""
    room = io.BytesIO()
    writer = can.BLFWriter(room, **options)
    for message, bus in zip(messages_from_frames(batch.frames), batch.frames["bus"].tolist(), strict=True):
        message.channel = bus
        writer(message)
    writer._flush()
    size = room.tell()
    room.seek(0)
    writer._write_header(size)
    return room.getvalue()


def parsed(content_of_file: bytes) -> tuple[FrameBatch, LogReport]:
    report = LogReport("bytes", "BLF")
    back = concatenate(list(read_blf(io.BytesIO(content_of_file), report)))
    assert report.balance.open == 0
    return back, report


def usable(seed: int, count: int, buses: tuple[str, ...] = ("can0", "can1")) -> FrameBatch:
    """Return frames as BLF keeps them: python-can writes no ESI of error frames, and no length of remote ones."""
    return some_frames(np.random.default_rng(seed), count, buses=buses)


@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 400),
    container=st.sampled_from([150, 1000, 128 << 10]),
    level=st.sampled_from([0, 6]),
)
@examples(40)
def test_what_python_can_writes_is_read(seed: int, count: int, container: int, level: int) -> None:
    batch = usable(seed, count)
    back, report = parsed(written(batch, max_container_size=container, compression_level=level))
    assert content(back) == content(batch)
    assert np.abs(back.frames["time_ns"] - batch.frames["time_ns"]).max() < 1000
    assert report.remarks() == []


@pytest.mark.parametrize("wrong", range(4))
def test_an_object_begins_with_all_of_its_magic_bytes(wrong: int) -> None:
    whole = np.frombuffer(b"LOBJ" + struct.pack("<HHLL", 32, 1, 64, 1) + bytes(48), np.uint8).copy()
    assert len(_search(whole, 0, [])[0]) == 1
    whole[wrong] ^= 1
    assert len(_search(whole, 0, [])[0]) == 0


def test_a_payload_may_hold_the_magic_bytes() -> None:
    batch = usable(1, 200)
    batch.frames["data"][::3, :8] = np.frombuffer(b"LOBJLOBJ", np.uint8)
    batch.frames["length"][::3] = 8
    batch.frames["flags"][::3] = 0
    batch.frames["data"][::3, 8:] = 0
    batch.frames["can_id"][::3] &= 0x7FF
    back, report = parsed(written(batch))
    assert content(back) == content(batch)
    assert report.remarks() == []


@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
@examples(60)
def test_of_a_cut_file_everything_before_the_cut_is_read(seed: int, share: float) -> None:
    batch = usable(seed, 300)
    whole = written(batch, max_container_size=2000)
    cut = 144 + int(share * (len(whole) - 145))
    back, report = parsed(whole[:cut])
    assert content(back) == content(batch)[: len(back)]
    assert len(back) >= 300 * (cut - 144) // len(whole) - 45  # a container holds fewer than 45 of these frames
    assert "is cut off" in report.damage


@given(seed=st.integers(0, 10**6), places=st.lists(st.floats(0.0, 0.9999), min_size=1, max_size=4))
@examples(60)
def test_damage_is_reported_and_never_a_traceback(seed: int, places: list[float]) -> None:
    batch = usable(seed, 200)
    damaged = bytearray(written(batch, max_container_size=1500, compression_level=0))
    for place in places:
        damaged[144 + int(place * (len(damaged) - 144))] ^= 0x5A
    back, _ = parsed(bytes(damaged))
    assert len(back) <= 400


def test_a_container_that_cannot_be_unpacked_costs_only_itself() -> None:
    batch = usable(2, 400)
    whole = bytearray(written(batch, max_container_size=4000))
    second = whole.index(b"LOBJ", whole.index(b"LOBJ", 144) + 4)
    whole[second + 40 : second + 44] = b"\xff\xff\xff\xff"
    back, report = parsed(bytes(whole))
    assert 250 < len(back) < 400
    assert len(report.lost) == 1
    assert f"byte {second} of the file: this container cannot be decompressed" in report.lost[0]
    estimate = int(re.search(r"about (\d+) frames are lost", report.lost[0])[1])  # type: ignore[index]
    assert estimate == pytest.approx(400 - len(back), abs=15)
    known = content(batch)
    assert [frame for frame in content(back) if frame not in known] == []


def numbered(count: int) -> FrameBatch:
    """Return frames whose data are their number, four times."""
    batch = usable(5, count, buses=("can0",))
    frames = batch.frames
    frames["flags"], frames["length"] = 0, 8
    frames["can_id"] = 0x100
    frames["data"] = 0
    frames["data"][:, :8] = np.repeat(np.arange(count, dtype="<u2"), 4).view(np.uint8).reshape(-1, 8)
    return batch


def never_recorded(back: FrameBatch, batch: FrameBatch) -> int:
    """Return how many frames are not one of the numbered ones, with its data and its time."""
    number = np.ascontiguousarray(back.frames["data"][:, :8]).view("<u2")
    known = (number == number[:, :1]).all(1) & (number[:, 0] < len(batch)) & (back.frames["can_id"] == 0x100)
    late_ns = back.frames["time_ns"] - batch.frames["time_ns"][np.minimum(number[:, 0], len(batch) - 1)]
    return int(np.count_nonzero(~known | (np.abs(late_ns) > 1000)))


def container_places(whole: bytes) -> list[tuple[int, int]]:
    """Return start and end of each container."""
    places, at = [], 144
    while at < len(whole):
        size = int.from_bytes(whole[at + 8 : at + 12], "little")
        places.append((at, at + size + size % 4))
        at = places[-1][1]
    return places


@pytest.mark.parametrize("level", [0, 6])
@pytest.mark.parametrize("bytes_kept", [0, 40, 200])
def test_a_container_that_is_cut_short_is_dropped_whole(level: int, bytes_kept: int) -> None:
    """Its length is right for what is left of it, as a program that repairs files would write it."""
    batch = numbered(300)
    whole = written(batch, max_container_size=2000, compression_level=level)
    start, end = container_places(whole)[2]
    head = bytearray(whole[start : start + 32])
    head[8:12] = (32 + bytes_kept).to_bytes(4, "little")
    back, report = parsed(whole[:start] + bytes(head) + whole[start + 32 : start + 32 + bytes_kept] + whole[end:])
    assert never_recorded(back, batch) == 0
    assert 300 - len(back) <= 2000 // 48 + 2
    assert len(report.lost) == 1
    assert f"byte {start} of the file" in report.lost[0]


@pytest.mark.parametrize("size", [10, 33, 200, 5000, 1 << 20, 1 << 31])
@pytest.mark.parametrize("level", [0, 6])
def test_a_damaged_length_costs_only_its_container(size: int, level: int) -> None:
    batch = numbered(300)
    whole = bytearray(written(batch, max_container_size=2000, compression_level=level))
    start, _ = container_places(bytes(whole))[2]
    whole[start + 8 : start + 12] = size.to_bytes(4, "little")
    back, report = parsed(bytes(whole))
    assert never_recorded(back, batch) == 0
    assert 300 - len(back) <= 2000 // 48 + 2
    assert report.bad or report.lost
    assert f"byte {start} of the file" in (report.first_bad + "".join(report.lost))


@pytest.mark.parametrize("group_bytes", [1, 3000, 1 << 20])
def test_no_frame_is_put_together_over_a_missing_container(monkeypatch: pytest.MonkeyPatch, group_bytes: int) -> None:
    """Wherever that is in what is unpacked together."""
    monkeypatch.setattr(blf, "_GROUP_BYTES", group_bytes)
    batch = numbered(300)
    whole = written(batch, max_container_size=2000)
    places = container_places(whole)
    for start, end in places[1:-1]:
        back, report = parsed(whole[:start] + whole[end:])
        assert never_recorded(back, batch) == 0
        assert 300 - len(back) <= 2000 // 48 + 3
        assert report.bad


def with_container(unpacked: int, packed: bytes) -> bytes:
    header = struct.pack("<4sL8xQQLL8H8H", b"LOGG", 144, 0, 0, 0, 0, *[0] * 16)
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(packed), 10, 2, unpacked) + packed
    return header.ljust(144, b"\0") + container


def test_a_container_that_unpacks_to_more_than_it_states_is_dropped_in_little_memory() -> None:
    bomb = zlib.compress(bytes(15 << 20))
    for stated, packed, why in (
        (100, bomb, "this container states that it holds 100 bytes, and holds more"),
        (2**32 - 1, bomb, "this container states that it holds 4294967295 bytes;"),
        (16 << 20, bomb, "this container states that it holds 16777216 bytes, and holds 15728640;"),
        (15 << 20, bomb[:-9], "this container breaks off after"),
    ):
        back, report = parsed(with_container(stated, packed))
        assert len(back) == 0
        assert why in report.lost[0]
        assert f"its {len(packed):,} bytes are lost" in report.lost[0]
    other = bytearray(with_container(8, bytes(8)))
    other[160] = 7
    assert "this container has an unknown compression method, 7" in parsed(bytes(other))[1].lost[0]


ONE = struct.pack("<4sHHLLLHHQHBBL8s", b"LOBJ", 32, 1, 48, 1, 2, 0, 0, 7, 1, 0, 8, 0x123, b"abcdefgh")


def with_containers(*contents: bytes) -> bytes:
    """Return a file whose last container is damaged and states 48,000 bytes."""
    held = [*((len(content), zlib.compress(content)) for content in contents), (48_000, b"?" * 96)]
    files = [with_container(size, packed) for size, packed in held]
    return files[0][:144] + b"".join(file[144:] + bytes(len(file) % 4) for file in files)


def test_what_a_damaged_container_held_is_estimated_from_all_that_was_read() -> None:
    """Also from half an object that does not go on in the next container."""
    back, report = parsed(with_containers(ONE * 2 + ONE[:24], ONE * 3))
    assert len(back) == 5
    assert f"about {round(48_000 * 5 / (120 + 144)):,} frames are lost" in report.lost[0]


def test_an_object_longer_than_any_container_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blf, "LARGEST_BLF_CONTAINER_BYTES", 50_000)
    monkeypatch.setattr(blf, "_GROUP_BYTES", 1)
    endless = b"LOBJ" + struct.pack("<HHLL", 32, 1, 1_000_000, 1)
    back, report = parsed(with_containers(ONE * 2 + endless, bytes(30_000), bytes(30_000), ONE * 3))
    assert len(back) == 5
    assert report.first_bad == "byte 96 of the uncompressed data: no object ends within 60016 bytes"
    assert f"about {round(48_000 * 5 / (240 + 60_016))} frames are lost" in report.lost[0]


@pytest.mark.parametrize("when", [(3079, 1), (65535, 1), (2262, 1), (1000, 1), (2023, 13)])
def test_a_date_that_cannot_be_is_a_remark(when: tuple[int, int]) -> None:
    whole = bytearray(written(usable(6, 20)))
    whole[40:44] = struct.pack("<HH", *when)
    back, report = parsed(bytes(whole))
    assert len(back) == 20
    assert report.absolute_time is False
    assert f"no date that can be: year {when[0]}" in report.remarks()[1]


@pytest.mark.parametrize("channel", [0, 1])
def test_times_beyond_64_bits_are_bad_objects(channel: int) -> None:
    frame = struct.pack("<HBBL8s", channel, 0, 8, 0x123, b"abcdefgh")
    objects = b"".join(
        struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32 + len(frame), 1, flags, 0, 0, ticks) + frame
        for flags, ticks in ((2, 5), (2, 2**63), (1, 2**62), (1, 7))
    )
    back, report = parsed(with_container(len(objects), zlib.compress(objects)))
    assert back.frames["time_ns"].tolist() == [5, 70_000]
    assert report.bad == 2
    assert "2262" in report.first_bad


def test_an_object_of_canoe_for_can_fd_has_every_flag_and_its_data() -> None:
    def an_object(flags: int, direction: int, dlc: int, valid: int) -> bytes:
        fields = (2, dlc, valid, 0, 0x80000123, 0, flags, 0, 0, 0, 0, 0, direction, 0, 0)
        body = struct.pack("<BBBBLLLLLLLHBBL", *fields) + bytes(range(1, 65))[:valid]
        return struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32 + len(body), 101, 2, 0, 0, 7) + body

    cases = {
        (0x1000, 0, 9, 12): FrameFlag.FD,
        (0x3000, 0, 15, 64): FrameFlag.FD | FrameFlag.BITRATE_SWITCH,
        (0x5000, 1, 8, 8): FrameFlag.FD | FrameFlag.ERROR_STATE | FrameFlag.TRANSMITTED,
        (0, 1, 4, 4): FrameFlag.TRANSMITTED,
        (0x10, 0, 4, 0): FrameFlag.REMOTE,
    }
    objects = b"".join(an_object(*case) for case in cases)
    back, report = parsed(with_container(len(objects), zlib.compress(objects)))
    assert back.frames["flags"].tolist() == [int(FrameFlag.EXTENDED | flags) for flags in cases.values()]
    assert back.frames["length"].tolist() == [12, 64, 8, 4, 4] and not report.bad
    assert [bytes(frame).rstrip(b"\0") for frame in back.frames["data"]] == [
        bytes(range(1, valid + 1)) for *_, valid in cases
    ]


def test_many_kinds_of_objects_are_counted_together() -> None:
    objects = b"".join(struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32, 500 + i, 2, 0, 0, 0) for i in range(10_000))
    _, report = parsed(with_container(len(objects), zlib.compress(objects)))
    assert len(report.skipped) == MOST_KINDS + 1
    assert sum(report.skipped.values()) == 10_000


def test_objects_that_are_no_frames_are_named(tmp_path: Path) -> None:
    path = tmp_path / "marked.blf"
    with can.BLFWriter(path) as writer:
        for message in messages_from_frames(usable(3, 20).frames):
            message.channel = 0
            writer(message)
            writer.log_event("marker")
    reading = read_log(path)
    assert sum(map(len, reading)) == 20
    assert reading.report.skipped == {"object of type 96": 20}


def test_a_file_that_ends_within_its_header_is_refused() -> None:
    with pytest.raises(RecordingError, match="ends within its header"):
        parsed(b"LOGG" + bytes(20))


def test_groups_of_containers_join_to_the_same_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = written(usable(4, 500), max_container_size=700)
    expected = content(parsed(whole)[0])
    for size in (1, 5000):
        monkeypatch.setattr(blf, "_GROUP_BYTES", size)
        assert content(parsed(whole)[0]) == expected


def test_ten_microsecond_ticks_and_short_objects() -> None:
    """An object in 10 us ticks and one that is too short for its type, packed by hand."""

    def an_object(kind: int, flags: int, ticks: int, body: bytes) -> bytes:
        return struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32 + len(body), kind, flags, 0, 0, ticks) + body

    frame = struct.pack("<HBBL8s", 2, 1, 8, 0x80000123, b"abcdefgh")
    objects = (
        an_object(1, 1, 150_000, frame) + an_object(1, 1, 150_001, frame[:8]) + an_object(86, 2, 1_500_020_000, frame)
    )
    packed = zlib.compress(objects)
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(packed), 10, 2, len(objects)) + packed
    header = struct.pack("<4sL8xQQLL8H8H", b"LOGG", 144, 0, 0, 0, 0, 2023, 11, 2, 14, 22, 13, 20, 500, *[0] * 8)
    back, report = parsed(header.ljust(144, b"\0") + container)
    assert back.frames["time_ns"].tolist() == [1_700_000_002_000_000_000, 1_700_000_002_000_020_000]
    assert back.frames["flags"].tolist() == [FrameFlag.EXTENDED | FrameFlag.TRANSMITTED] * 2
    assert back.buses == ("can1",)
    assert report.bad == 1
    assert "too short" in report.first_bad


def test_zeros_between_containers_cost_themselves_only() -> None:
    whole = written(usable(8, 6000))
    begin = whole.index(b"LOBJ\x10\0", 2000)
    back, report = parsed(whole[:begin] + bytes(4096) + whole[begin:])
    assert content(back) == content(parsed(whole)[0])
    assert "only zeros; 4,096 bytes are skipped" in report.lost[0]
    assert report.file_bytes.open == report.balance.open == 0
