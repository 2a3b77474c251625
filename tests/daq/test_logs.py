"""Every format against python-can's own reader, and every way in which a log can be wrong."""

from __future__ import annotations

import gc
import gzip
import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import can
import numpy as np
import pytest
from frames_support import START_NS, classical, content, some_frames
from fuzz.readers import FORMATS, whole_file
from support import data_dir

from daq import ConfigError, RecordingError, RunInfo
from daq.can import FrameBatch, FrameFlag, concatenate, messages_from_frames
from daq.can.frames import frames_from_messages
from daq.logs import formats, import_logs, read_log, write_candump
from daq.logs.mf4 import merged
from daq.runs import Configuration

READERS: dict[str, Callable[[Path], Iterable[can.Message]]] = {
    ".asc": lambda path: can.ASCReader(path, relative_timestamp=True),
    ".trc": can.TRCReader,
    ".blf": can.BLFReader,
}
SAMPLES = (
    *("issue_1256.asc", "issue_1299.asc", "logfile.asc", "logfile_errorframes.asc", "single_frame.asc"),
    *("single_frame_us_locale.asc", "test_CanErrorFrames.asc", "test_CanFdMessage.asc", "test_CanFdMessage64.asc"),
    *("test_CanFdRemoteMessage.asc", "test_CanMessage.asc", "test_CanRemoteMessage.asc"),
    *("issue_1905.blf", "test_CanErrorFrameExt.blf", "test_CanFdMessage.blf", "test_CanFdMessage64.blf"),
    *("test_CanMessage.blf", "test_CanMessage2.blf"),
    *("test_CanMessage.trc", "test_CanMessage_V1_0_BUS1.trc", "test_CanMessage_V1_1.trc", "test_CanMessage_V1_3.trc"),
    *("test_CanMessage_V2_0_BUS1.trc", "test_CanMessage_V2_1.trc"),
)


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_equal_python_can(name: str) -> None:
    path = data_dir("python-can-logs", name)
    ours = concatenate(list(read_log(path)))
    theirs = list(READERS[path.suffix](path))
    assert theirs
    first = 1 if path.suffix == ".trc" else 0
    expected = frames_from_messages(theirs, [0] * len(theirs))
    buses = [f"can{(m.channel or 0) - (first if m.channel else 0)}" for m in theirs]
    assert [frame[1:] for frame in content(ours)] == [frame[1:] for frame in content(FrameBatch(expected, ("can0",)))]
    assert [frame[0] for frame in content(ours)] == buses
    assert (ours.frames["flags"] == expected["flags"]).all()
    start_ns = ours.frames["time_ns"][0] - round(theirs[0].timestamp * 1e9)
    times = np.array([round((m.timestamp - theirs[0].timestamp) * 1e9) for m in theirs])
    assert np.abs(ours.frames["time_ns"] - ours.frames["time_ns"][0] - times).max() < 1000
    if path.suffix == ".blf":
        assert abs(start_ns) < 1000


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("test_CanMessage.asc", "2017-09-30T22:06:15.692"),  # of its two dates, the later one
        ("logfile.asc", "2017-09-30T15:06:15.692"),
        ("issue_1299.asc", "2022-04-28T10:45:05.738199"),
        ("test_CanMessage.asc.gz", "2017-09-30T22:06:15.692"),
    ],
)
def test_asc_times_are_those_of_its_date(name: str, first: str) -> None:
    reading = read_log(data_dir("python-can-logs", name))
    time_ns = int(next(reading).frames["time_ns"][0])
    assert datetime.fromtimestamp(time_ns / 1e9, UTC) == datetime.fromisoformat(first + "+00:00")
    assert reading.report.absolute_time is True


@pytest.mark.parametrize(
    "name",
    [
        "car_3BA199E2_165_2",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("car_3BA199E2_165_4", "truck_j1939_stationary")),
    ],
)
def test_real_drives_equal_python_can(name: str, tmp_path: Path) -> None:
    path = data_dir("css-canedge", f"{name}.candump.log.gz")
    reading = read_log(path)
    ours = concatenate(list(reading))
    with gzip.open(path, "rt") as text:
        theirs = list(can.CanutilsLogReader(text))  # type: ignore[arg-type]
    frames = frames_from_messages(theirs, [round(m.timestamp * 1e6) * 1000 for m in theirs])
    frames["bus"] = [ours.buses.index(str(m.channel)) for m in theirs]
    assert (ours.frames == frames).all()
    assert reading.report.remarks() == []
    write_candump([ours], tmp_path / "again.log")
    with gzip.open(path, "rb") as packed:
        assert (tmp_path / "again.log").read_bytes() == packed.read().replace(b"\r\n", b"\n")


@pytest.mark.parametrize("name", ["car_3BA199E2_165_2", "truck_j1939_stationary"])
def test_mf4_equals_its_candump(name: str) -> None:
    pytest.importorskip("asammdf", reason="the extra wheelsoil[mf4] is not installed")
    ours = concatenate(list(read_log(data_dir("css-canedge", f"{name}.MF4"))))
    text = concatenate(list(read_log(data_dir("css-canedge", f"{name}.candump.log.gz"))))
    assert content(ours) == content(text)
    assert np.abs(ours.frames["time_ns"] - text.frames["time_ns"]).max() <= 1000


@pytest.mark.parametrize("name", ["drive.log", "drive.log.gz", "drive.blf"])
def test_the_share_that_is_read_grows_to_the_whole(tmp_path: Path, name: str) -> None:
    frames = classical(some_frames(np.random.default_rng(0), 200_000))
    if name == "drive.blf":
        with can.BLFWriter(tmp_path / name) as writer:
            for message in messages_from_frames(frames.frames):
                writer.on_message_received(message)
    else:
        write_candump([frames], tmp_path / "drive.log")
        if name.endswith(".gz"):
            (tmp_path / name).write_bytes(gzip.compress((tmp_path / "drive.log").read_bytes(), 1))
    reading = read_log(tmp_path / name)
    assert reading.report.share == 0
    shares = [reading.report.share for _ in reading]
    assert shares == sorted(shares) and shares[0] < 0.9 and shares[-1] == 1


def test_an_import_says_how_many_frames_and_what_share_it_has_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.logs.convert._BATCH_FRAMES", 100)
    logs, said = [tmp_path / "1.log", tmp_path / "2.log"], []
    for number, log in enumerate(logs):
        write_candump([classical(some_frames(np.random.default_rng(number), 500))[:300]], log)
    target, watch = tmp_path / "run.mcap", lambda *now: said.append(now)
    import_logs(logs, target, Configuration(), run=RunInfo(), watch=watch, view_rate_hz=None)
    frames, shares = zip(*said, strict=True)
    assert frames == (*[300] * 3, *[600] * 3), "as they are read, block by block"
    assert list(shares) == sorted(shares) and 0 < shares[0] < 0.6 and shares[-1] == 1


def test_mf4_without_asammdf_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    path = tmp_path / "drive.mf4"
    path.write_bytes(b"MDF     4.11    CE      ".ljust(4096, b"\0"))
    with pytest.raises(ConfigError, match=r"wheelsoil\[mf4\]"):
        list(read_log(path))


def test_streams_are_merged_by_time_with_one_piece_of_each_in_memory() -> None:
    rng = np.random.default_rng(1)
    whole = classical(some_frames(rng, 900)).frames
    whole["time_ns"] = np.sort(rng.integers(0, 400, len(whole)))
    owner = rng.integers(0, 3, len(whole))
    streams = [whole[owner == i] for i in range(3)]
    joined = np.concatenate(list(merged([iter(np.array_split(stream, 7)) for stream in streams])))
    assert (joined["time_ns"] == whole["time_ns"]).all()
    for i, stream in enumerate(streams):
        assert len(stream) == (owner == i).sum()
    key = np.lexsort((joined["can_id"], joined["time_ns"]))
    expected = np.concatenate(streams)
    assert (joined[key] == expected[np.lexsort((expected["can_id"], expected["time_ns"]))]).all()


@pytest.mark.parametrize(
    ("suffix", "writer"), [(".asc", can.ASCWriter), (".trc", can.TRCWriter), (".csv", can.CSVWriter)]
)
def test_what_python_can_writes_is_read(tmp_path: Path, suffix: str, writer: type[can.ASCWriter]) -> None:
    frames = classical(some_frames(np.random.default_rng(2), 200))
    is_plain = (frames.frames["flags"] & (FrameFlag.ERROR | FrameFlag.REMOTE)) == 0
    frames = frames[is_plain]
    path = tmp_path / f"theirs{suffix}"
    with writer(path) as log:
        for message in messages_from_frames(frames.frames):
            message.channel = 0
            log(message)
    back = concatenate(list(read_log(path)))
    assert content(back) == content(frames)


def test_messages_and_frames_are_the_same_thing() -> None:
    frames = some_frames(np.random.default_rng(4), 300).frames
    messages = messages_from_frames(frames)
    assert (frames_from_messages(messages, frames["time_ns"].tolist()) == frames).all()
    for message in messages:
        message._check()


def an_asc(*lines: str) -> str:
    return "\n".join(
        ["date Sat Sep 30 15:06:13.191 2017", "base hex  timestamps absolute", "no internal events", *lines]
    )


@pytest.mark.parametrize(
    ("name", "text", "first_bad"),
    [
        (
            "a.asc",
            an_asc(" 1.0 1 123 Rx d 1 68", " 1.5 1 XYZ Rx d 1 68", " 2.0 1 124 Rx d 1 69", ""),
            "line 5: 1.5 1 XYZ",
        ),
        (
            "a.trc",
            ";$FILEVERSION=1.1\n;$STARTTIME=44548.6\n 1) 1.0 Rx 0100 1 AA\n 2) 1.1 Rx 01ZZ 1 AA\n 3) 1.2\n"
            " 4) 2.0 Rx 0101 1 BB\n",
            "line 4: 2) 1.1 Rx 01ZZ",
        ),
        (
            "a.csv",
            "timestamp,arbitration_id,extended,remote,error,dlc,data\n1.0,0x1,0,0,0,1,aA==\nx,y\n2.0,0x2,0,0,0,1,aQ==\n",
            "line 3: x,y",
        ),
    ],
)
def test_a_bad_line_costs_only_itself(tmp_path: Path, name: str, text: str, first_bad: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    reading = read_log(tmp_path / name)
    assert sum(map(len, reading)) == 2
    assert reading.report.bad == (2 if name == "a.trc" else 1)
    assert reading.report.first_bad.startswith(first_bad)


BAD: list[tuple[str, bytes | None, str, str]] = [
    ("missing.log", None, "no such file", "there.log"),
    ("empty.blf", b"", "the log is empty", ""),
    ("empty.log.gz", gzip.compress(b""), "the log is empty", ""),
    ("cut.log.gz", gzip.compress(b"(1.0) can0 123#00\n")[:10], "the gzipped file is cut off", "copy it again"),
    ("bad.log.gz", gzip.compress(b"(1.0) can0 123#00\n")[:10] + bytes(30), "the gzipped file is damaged", "copy"),
    ("header.asc", an_asc().encode(), "no frame could be read as Vector ASC", ""),
    ("header.blf", b"LOGG".ljust(144, b"\0"), "no frame could be read as Vector BLF", ""),
    ("cut.blf", b"LOGG" + bytes(30), "ends within its header", "copy it again"),
    (
        "text.log",
        b"hello\nworld\n",
        "no frame could be read as candump",
        "2 unreadable, skipped; the first is line 1: hello",
    ),
    ("noise.log", bytes(range(256)) * 40, "no frame could be read as candump", "unreadable"),
    ("candump.blf", b"(1.0) can0 123#00\n", "this looks like candump -L text", "rename it to end in .log"),
    ("blf.log", b"LOGG".ljust(400, b"\0"), "this looks like Vector BLF", "rename it to end in .blf"),
    ("screen.log", b"  can0  123   [2]  11 22\n", "candump's screen output", "candump -L"),
    ("drive.log", b"\x89MCAP0\r\n", "an MCAP recording", "needs no import"),
    ("drive.asc", b"PAR1" + bytes(20), "a Parquet file", "wheelsoil reads"),
    ("vehicle.log", b'VERSION "1.0"\nNS_ :\n', "a DBC file", ""),
    ("old.mf4", b"MDF     3.30", "an MDF file older than version 4", ""),
    ("drive.mf4.gz", gzip.compress(b"MDF     4.11"), "a gzipped MF4 file", "gunzip"),
    ("what.ever", b"hello\n", "neither its suffix nor its content", "it is not PEAK TRC"),
    ("relative.asc", an_asc().replace("absolute", "relative").encode(), "relative to the line before", "absolute"),
    ("old.trc", b";$FILEVERSION=2.0\n 1 2.0 DT 0100 Rx 1 00\n", "this version of TRC", "FILEVERSION 2.0"),
]


@pytest.mark.parametrize(("name", "data", "what", "more"), BAD, ids=[row[0] for row in BAD])
def test_bad_logs_get_one_clear_message(tmp_path: Path, name: str, data: bytes | None, what: str, more: str) -> None:
    (tmp_path / "there.log").write_bytes(b"(1.0) can0 123#00\n")
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(RecordingError) as caught:
        list(read_log(tmp_path / name))
    assert what in str(caught.value)
    assert more in str(caught.value)
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("suffix", [known.suffixes[0] for known in formats.LOG_FORMATS])
def test_a_packed_log_has_the_format_of_the_suffix_before(suffix: str) -> None:
    assert formats.chosen_format(Path(f"run{suffix}.gz"), b"") is formats.chosen_format(Path(f"run{suffix}"), b"")


def test_formats_may_share_a_suffix(monkeypatch: pytest.MonkeyPatch) -> None:
    """The content decides between them; a log that says nothing of itself is of the first."""
    candump = next(known for known in formats.LOG_FORMATS if ".log" in known.suffixes)
    other = replace(candump, name="another log")
    monkeypatch.setattr(formats, "LOG_FORMATS", (*formats.LOG_FORMATS, other))
    monkeypatch.setattr(formats, "_TEXT", ((re.compile(rb"\*\*\*ANOTHER"), other), *formats._TEXT))
    assert formats.chosen_format(Path("a.log"), b"***ANOTHER 1.0\n") is other
    assert formats.chosen_format(Path("a.log"), b"(1.0) can0 123#\n") is candump
    with pytest.raises(RecordingError, match="this looks like another log"):
        formats.chosen_format(Path("a.blf"), b"***ANOTHER 1.0\n")


@pytest.mark.parametrize("name", ["candump", "asc", "trc", "blf", "frames in csv", "busmaster"])
def test_a_suffix_that_says_nothing_is_read_by_its_content(tmp_path: Path, name: str) -> None:
    known, nothing = tmp_path / f"run{FORMATS[name].suffix}", tmp_path / "run.data"
    known.write_bytes(whole_file(name, tmp_path))
    nothing.write_bytes(known.read_bytes())
    one, other = read_log(known), read_log(nothing)
    assert content(concatenate(list(one))) == content(concatenate(list(other)))
    assert one.report.format == other.report.format


def test_a_reading_that_is_not_started_or_not_finished_leaves_nothing_open(tmp_path: Path) -> None:
    frames = classical(some_frames(np.random.default_rng(2), 500))
    write_candump([frames], tmp_path / "run.log")
    read_log(tmp_path / "run.log")
    half = read_log(tmp_path / "run.log", batch_frames=100)
    assert len(next(half)) == 100
    del half
    gc.collect()  # an open file would warn here, and warnings are errors


@pytest.mark.parametrize(("count", "more"), [(8, []), (10, ["lost: 2 more parts, to byte 9: no container"])])
def test_of_many_lost_parts_eight_and_the_last_are_listed(count: int, more: list[str]) -> None:
    report = formats.LogReport("run.blf", "BLF")
    for i in range(count):
        report.note_lost(f"byte {i}", "no container")
    assert report.remarks() == [*(f"lost: byte {i}: no container" for i in range(8)), *more]


def test_reports_say_whether_times_have_a_date(tmp_path: Path) -> None:
    for start_ns, absolute in ((START_NS, True), (46_408 * 10**9, False)):
        frames = classical(some_frames(np.random.default_rng(2), 20))
        frames.frames["time_ns"] += start_ns - START_NS
        write_candump([frames], tmp_path / "run.log")
        reading = read_log(tmp_path / "run.log")
        assert reading.report.absolute_time is None
        list(reading)
        assert reading.report.absolute_time is absolute
        assert ("no date" in " ".join(reading.report.remarks())) is not absolute
