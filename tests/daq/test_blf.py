from __future__ import annotations

import io
import zlib
from pathlib import Path

import can
import numpy as np
import pytest
from frames_support import content, some_frames
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.can.frames import FrameBatch, FrameFlag, concatenate, messages_from_frames
from daq.errors import RecordingError
from daq.logs import blf, read_log
from daq.logs.blf import read_blf
from daq.logs.report import LogReport


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
    return concatenate(list(read_blf(io.BytesIO(content_of_file), report))), report


def usable(seed: int, count: int, buses: tuple[str, ...] = ("can0", "can1")) -> FrameBatch:
    """Return frames as BLF keeps them: python-can writes no ESI of error frames, and no length of remote ones."""
    return some_frames(np.random.default_rng(seed), count, buses=buses)


@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 400),
    container=st.sampled_from([150, 1000, 128 << 10]),
    level=st.sampled_from([0, 6]),
)
@settings(max_examples=40, deadline=None)
def test_what_python_can_writes_is_read(seed: int, count: int, container: int, level: int) -> None:
    batch = usable(seed, count)
    back, report = parsed(written(batch, max_container_size=container, compression_level=level))
    assert content(back) == content(batch)
    assert np.abs(back.frames["time_ns"] - batch.frames["time_ns"]).max() < 1000
    assert report.remarks() == []


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
@settings(max_examples=60, deadline=None)
def test_of_a_cut_file_everything_before_the_cut_is_read(seed: int, share: float) -> None:
    batch = usable(seed, 300)
    whole = written(batch, max_container_size=2000)
    cut = 144 + int(share * (len(whole) - 145))
    back, report = parsed(whole[:cut])
    assert content(back) == content(batch)[: len(back)]
    assert len(back) >= 300 * (cut - 144) // len(whole) - 45  # a container holds fewer than 45 of these frames
    if len(back) < 300:
        assert report.bad or cut <= 144


@given(seed=st.integers(0, 10**6), places=st.lists(st.floats(0.0, 0.9999), min_size=1, max_size=4))
@settings(max_examples=60, deadline=None)
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
    assert "cannot be decompressed" in report.first_bad
    kept = content(batch)
    assert [frame for frame in content(back) if frame not in kept] == []


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
    import struct

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
