from __future__ import annotations

import gzip
import io
import os
import subprocess
import sys
from pathlib import Path

import can
import numpy as np
import pytest
from frames_support import START_NS, classical, content, same, some_frames
from hypothesis import example, given
from hypothesis import strategies as st
from property_settings import examples

import daq.logs.shapes as shapes_module
from daq import DataError, RecordingError
from daq.can import FrameBatch, FrameFlag, concatenate, messages_from_frames, split
from daq.logs import LogReport, read_log, write_candump
from daq.logs.candump import candump_text, read_candump

BUSES = ("can0", "can1", "vcan17")


def parsed(text: bytes) -> tuple[FrameBatch, LogReport]:
    report = LogReport("text", "candump")
    return concatenate(list(read_candump(io.BytesIO(text), report))), report


@given(seed=st.integers(0, 10**6), count=st.integers(1, 400), bus_count=st.integers(1, 3))
@examples(40)
def test_what_is_written_comes_back(seed: int, count: int, bus_count: int) -> None:
    frames = some_frames(np.random.default_rng(seed), count, buses=BUSES[:bus_count])
    back, report = parsed(candump_text(frames))
    assert content(back) == content(frames)
    assert (back.frames["time_ns"] == frames.frames["time_ns"]).all()
    assert report.remarks() == []
    assert report.frames == count


HEX = st.text("0123456789abcdefABCDEF", max_size=20)
JUNK = st.one_of(
    st.text(max_size=30),
    st.builds("({}.{}) {} {}#{}".format, st.integers(0, 10**11), st.integers(0, 10**7), st.text(max_size=3), HEX, HEX),
    st.builds("(1.0) can0 123#{}".format, st.text("0123456789abcdefghRr# _", max_size=18)),
    st.builds("(1.5) can{} 1234567{}##{}{} {}".format, st.integers(0, 9), HEX, HEX, HEX, st.sampled_from("RTx ")),
)


@given(seed=st.integers(0, 10**6), junk=st.lists(JUNK, max_size=30))
@examples(60)
def test_a_block_reads_like_its_lines_one_by_one(seed: int, junk: list[str]) -> None:
    rng = np.random.default_rng(seed)
    good = candump_text(some_frames(rng, 30)).splitlines()
    strange = [line.encode().replace(b"\n", b" ").replace(b"\r", b" ") for line in junk]
    lines = [(good + strange)[i] for i in rng.permutation(len(good) + len(strange))]
    whole, report = parsed(b"\n".join(lines))
    singles = [parsed(line) for line in lines]
    assert content(whole) == [frame for batch, _ in singles for frame in content(batch)]
    assert report.bad == sum(single.bad for _, single in singles)
    bad_lines = [number for number, (_, single) in enumerate(singles, 1) if single.bad]
    assert report.first_bad.startswith(f"line {bad_lines[0]}:" if bad_lines else "")


def test_python_can_reads_and_writes_the_same(tmp_path: Path) -> None:
    frames = some_frames(np.random.default_rng(3), 500)
    usable = frames[(frames.frames["flags"] & (FrameFlag.ERROR | FrameFlag.REMOTE)) == 0]
    path = tmp_path / "theirs.log"
    with can.CanutilsLogWriter(path) as writer:
        for message in messages_from_frames(usable.frames):
            message.channel = "can0"
            writer(message)
    ours = concatenate(list(read_log(path)))
    assert content(ours) == content(usable)
    write_candump([usable], tmp_path / "ours.log")
    theirs = list(can.CanutilsLogReader(tmp_path / "ours.log"))
    again = [(m.arbitration_id, bytes(m.data), m.is_extended_id, m.is_fd, m.bitrate_switch) for m in theirs]
    flags = usable.frames["flags"]
    assert again == [
        (frame[1], frame[4][: frame[3]], bool(flag & 1), bool(flag & 8), bool(flag & 16))
        for frame, flag in zip(content(usable), flags.tolist(), strict=True)
    ]
    assert [round(m.timestamp * 1e6) for m in theirs] == (usable.frames["time_ns"] // 1000).tolist()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("(1.000001) can0 123#", (0x123, 0, 0, b"")),
        ("(1.000001) can0 123#R", (0x123, FrameFlag.REMOTE, 0, b"")),
        ("(1.000001) can0 1ABCDEF0#r5", (0x1ABCDEF0, FrameFlag.REMOTE | FrameFlag.EXTENDED, 5, b"")),
        ("(1.000001) can0 00000123#01", (0x123, FrameFlag.EXTENDED, 1, b"\1")),
        ("(1.000001) can0 20000080#0004000000000000", (0x80, FrameFlag.ERROR, 8, b"\0\4" + bytes(6))),
        ("(1.000001) can0 7ff##3AABB", (0x7FF, FrameFlag.FD | 48, 2, b"\xaa\xbb")),
        ("(1.000001) can0 7FF##0", (0x7FF, FrameFlag.FD, 0, b"")),
        ("(1.000001)  can0  123#11 T", (0x123, FrameFlag.TRANSMITTED, 1, b"\x11")),
        ("(1.000001) can0 123#1122334455667788_B R", (0x123, 0, 8, bytes.fromhex("1122334455667788"))),
        ("(0000000001.000001000) can0 123#\r", (0x123, 0, 0, b"")),
    ],
)
def test_each_kind_of_line(line: str, expected: tuple[int, int, int, bytes]) -> None:
    batch, report = parsed(line.encode())
    [frame] = batch.frames
    length = 0 if frame["flags"] & FrameFlag.REMOTE else frame["length"]
    assert (frame["can_id"], frame["flags"], frame["length"], frame["data"][:length].tobytes()) == expected
    assert frame["time_ns"] == 1_000_001_000
    assert report.bad == 0


@pytest.mark.parametrize(
    "line",
    [
        "hello",
        "(1.0) can0 123",
        "(1.0) can0 800#00",  # no 11-bit identifier
        "(1.0) can0 40000000#00",
        "(1.0) can0 123#0",
        "(1.0) can0 123#112233445566778899",
        "(1.0) can0 123##0" + "00" * 65,
        "(9999999999.0) can0 123#00",  # beyond what 64-bit nanoseconds hold
        "(1.0) can0 123#00 x",
    ],
)
def test_lines_that_are_no_frames_are_counted(line: str) -> None:
    text = f"(1.0) can0 123#00\n# a comment\n\n{line}\n(2.0) can0 123#00\n".encode()
    batch, report = parsed(text)
    assert len(batch) == 2
    assert (report.bad, report.first_bad) == (1, f"line 4: {line[:80]}")


def test_times_that_go_back_are_counted_and_kept() -> None:
    text = b"(10.0) a 1#\n(12.0) a 1#\n(11.5) a 1#\n(13.0) a 1#\n(9.0) a 1#\n"
    batch, report = parsed(text)
    assert batch.frames["time_ns"].tolist() == [10**10, 12 * 10**9, 115 * 10**8, 13 * 10**9, 9 * 10**9]
    assert report.out_of_order == 2
    assert report.first_out_of_order == "line 3: 0.500000 s earlier than the frame before it"
    assert report.absolute_time is False


@given(st.lists(st.tuples(st.sampled_from("abcdefghijklmnopqrstuvwxyz"), st.booleans()), min_size=1, max_size=80))
@example([*((letter, False) for letter in "abcdefghijklmnopqrstuvwxyz"), ("a", True), ("b", True)] * 2)
def test_lines_of_one_length_and_many_shapes_are_all_read(lines: list[tuple[str, bool]]) -> None:
    batch, report = parsed("\n".join(f"(1.0) {bus} 1{'?' if bad else '2'}3#00" for bus, bad in lines).encode())
    assert [batch.buses[bus] for bus in batch.frames["bus"]] == [bus for bus, bad in lines if not bad]
    assert report.bad == sum(bad for _, bad in lines) and report.balance.open == 0


def test_blocks_of_any_size_read_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    text = candump_text(some_frames(np.random.default_rng(5), 300, buses=BUSES)) + b"broken\n(1.0) can0 1#"
    whole, report = parsed(text)
    for size in (1, 7, 100, 4096):
        monkeypatch.setattr(shapes_module, "BLOCK_BYTES", size)
        pieces, again = parsed(text)
        assert content(pieces) == content(whole)
        assert again.remarks() == report.remarks()


def test_batches_are_no_larger_than_asked(tmp_path: Path) -> None:
    frames = some_frames(np.random.default_rng(5), 1000)
    path = tmp_path / "a.log"
    assert write_candump(split(frames, 300), path) == 1000
    batches = list(read_log(path, batch_frames=64))
    assert max(map(len, batches)) == 64
    assert same(concatenate(batches).widened().frames, frames.frames)


def test_gzipped_text_and_what_a_cut_leaves_of_it(tmp_path: Path) -> None:
    frames = classical(some_frames(np.random.default_rng(6), 3000))
    packed = gzip.compress(candump_text(frames[:1000])) + gzip.compress(candump_text(frames[1000:]))
    path = tmp_path / "run.LOG.gz"
    path.write_bytes(packed)
    reading = read_log(path)
    assert content(concatenate(list(reading))) == content(frames)
    assert reading.report.remarks() == []
    path.write_bytes(packed[: len(packed) - 2000])
    cut = read_log(path)
    got = content(concatenate(list(cut)))
    assert 1000 < len(got) < len(frames)
    assert got == content(frames)[: len(got)]
    assert "cut off" in " ".join(cut.report.remarks())


def test_writing_says_what_is_wrong(tmp_path: Path) -> None:
    frames = some_frames(np.random.default_rng(6), 3)
    with pytest.raises(RecordingError, match="cannot be written"):
        write_candump([frames], tmp_path / "no" / "such" / "folder.log")
    frames.frames["time_ns"] = -1
    with pytest.raises(DataError, match="before 1970"):
        write_candump([frames], tmp_path / "a.log")


def test_nanoseconds_are_rounded_to_microseconds() -> None:
    frames = some_frames(np.random.default_rng(6), 2)
    frames.frames["time_ns"] = [START_NS + 1499, START_NS + 999_999_500]
    assert parsed(candump_text(frames))[0].frames["time_ns"].tolist() == [START_NS + 1000, START_NS + 10**9]


@pytest.mark.slow
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Peak memory of reading 80 MB is that of reading 10 MB, so that 5 GB stay far below 1 GB."""
    batch = classical(some_frames(np.random.default_rng(6), 250_000))
    peaks = []
    for copies in (1, 8):
        path = tmp_path / f"{copies}.log"
        write_candump([batch] * copies, path)
        script = (
            "import sys; from daq.logs import read_log; from memory_support import peak_rss_mb;"
            "n = sum(len(b) for b in read_log(sys.argv[1]));"
            "print(n, peak_rss_mb())"
        )
        said = subprocess.run(
            [sys.executable, "-c", script, path],
            capture_output=True,
            check=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        ).stdout
        count, peak_mb = said.split()
        assert int(count) == copies * len(batch)
        peaks.append(float(peak_mb))
    assert peaks[1] < peaks[0] + 30
    assert peaks[1] < 400
