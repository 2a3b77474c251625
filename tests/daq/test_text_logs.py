"""ASC and TRC: what python-can writes comes back, and every line of a damaged log is accounted for."""

from __future__ import annotations

import io
from pathlib import Path
from tempfile import NamedTemporaryFile

import can
import pytest
from frames_support import content
from fuzz.readers import FORMATS, whole_file
from hypothesis import given
from hypothesis import strategies as st

from daq import RecordingError
from daq.can import FrameBatch, FrameFlag, concatenate
from daq.can.frames import frames_from_messages
from daq.logs import LOG_FORMATS, LogReport, read_log, shapes

READERS = {known.suffixes[0]: known.read for known in LOG_FORMATS}
WRITERS = {".asc": can.ASCWriter, ".trc": can.TRCWriter}
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


@st.composite
def messages(draw: st.DrawFn, fd: bool) -> can.Message:
    extended = draw(st.booleans())
    kind = draw(st.sampled_from(["data", "data", "data", "remote", "fd"] if fd else ["data"]))
    length = draw(st.sampled_from(FD_LENGTHS[1:]) if kind == "fd" else st.integers(0, 8))
    return can.Message(
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=kind == "remote",
        is_fd=kind == "fd",
        bitrate_switch=kind == "fd" and draw(st.booleans()),
        is_rx=draw(st.booleans()),
        dlc=length,
        data=None if kind == "remote" else draw(st.binary(min_size=length, max_size=length)),
        channel=draw(st.integers(0, 3)),
    )


def written(suffix: str, sent: list[can.Message]) -> str:
    with NamedTemporaryFile("r", suffix=suffix) as file:
        with WRITERS[suffix](file.name) as writer:
            for i, message in enumerate(sent):
                message.timestamp = 1_700_000_000 + i * 0.0013
                writer.on_message_received(message)
        return file.read()


def read(suffix: str, text: bytes) -> tuple[FrameBatch, LogReport]:
    report = LogReport("text", suffix)
    batches = list(READERS[suffix](io.BytesIO(text), report))
    return concatenate(batches) if batches else FrameBatch.empty(), report


@given(st.data(), st.sampled_from([".asc", ".trc"]))
def test_what_python_can_writes_comes_back(data: st.DataObject, suffix: str) -> None:
    sent = data.draw(st.lists(messages(fd=suffix == ".asc"), min_size=1, max_size=25))
    batch, report = read(suffix, written(suffix, sent).encode())
    expected = frames_from_messages(sent, [0] * len(sent))
    for column in ("can_id", "flags", "data"):
        back, wanted = batch.widened().frames[column], FrameBatch(expected, ("can0",)).widened().frames[column]
        assert (back == wanted).all(), column
    remote = (expected["flags"] & FrameFlag.REMOTE) != 0  # the writer leaves out their length
    assert (batch.frames["length"][~remote] == expected["length"][~remote]).all()
    first = suffix == ".trc"  # which calls the first bus 1, and python-can's number 0 is written as 1
    assert [batch.buses[i] for i in batch.frames["bus"]] == [f"can{m.channel}" for m in sent], first
    assert not report.bad and not report.skipped


def rows_of(batch: FrameBatch) -> list[object]:
    return list(zip(batch.frames["time_ns"].tolist(), content(batch), strict=True))


@given(st.data(), st.sampled_from([".asc", ".trc"]), st.sampled_from(["\n", "\r\n"]))
def test_a_damaged_line_costs_itself_at_most_and_is_counted(data: st.DataObject, suffix: str, newline: str) -> None:
    sent = data.draw(st.lists(messages(fd=suffix == ".asc"), min_size=3, max_size=12))
    lines = [line for line in written(suffix, sent).splitlines() if line.strip()]
    before, _ = read(suffix, newline.join(lines).encode())
    first = len(lines) - len(sent) - (suffix == ".asc")  # that ends with a line of its own
    hit = data.draw(st.integers(first, first + len(sent) - 1))
    at = data.draw(st.integers(0, len(lines[hit]) - 1))
    characters = st.sampled_from(["", "x", " ", "\0", ";", "99", "é", "Z"])
    new = data.draw(characters | st.text("0123456789ABCDEF ", max_size=4))
    lines[hit] = lines[hit][:at] + new + lines[hit][at + 1 :]
    after, report = read(suffix, newline.join(lines).encode())
    is_comment = lines[hit].lstrip().startswith(";" if suffix == ".trc" else "//")
    assert report.frames + report.bad + sum(report.skipped.values()) == len(sent) - is_comment
    rest = rows_of(before)
    del rest[hit - first]
    found = rows_of(after)
    if len(found) == len(sent):
        del found[hit - first]
    assert found == rest


def test_an_impossible_line_takes_none_with_it_that_looks_like_it() -> None:
    lines = ["      0         0.000 DT  1     0000 Tx -  4 0  00 00 00 00"]
    lines += [f"      {i}         {i}.000 DT  1     0000 Tx -  4    00 00 00 00" for i in range(1, 4)]
    for order in (lines, lines[::-1], lines[1:3] + lines[:1] + lines[3:]):
        head = ";$FILEVERSION=2.1\n;$STARTTIME=43008.9\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
        batch, report = read(".trc", (head + "\n".join(order)).encode())
        assert (len(batch), report.bad) == (3, 1)


@pytest.mark.parametrize("at", range(12))
def test_no_letter_is_a_decimal_digit(at: int) -> None:
    good = "123456789012"
    times = [good[:at] + "A" + good[at + 1 :], good, good, good]
    batch, report = read(".trc", "\n".join(f"     1)  {ms}  12345678  4  01 02 03 04" for ms in times).encode())
    assert (len(batch), report.bad) == (3, 1)


@pytest.mark.parametrize(
    ("line", "frames", "bad"),
    [
        ("12345678  4  ZZ 00 00 00", 1, 1),
        ("FFFFFFFF  4  00 00 00 08", 1, 0),
        ("12345678 12  01 02 03 04 05 06 07 08", 2, 0),
    ],
)
def test_only_the_state_of_the_bus_is_an_event_without_a_word(line: str, frames: int, bad: int) -> None:
    """A length of 9 to 15 is that of eight bytes."""
    lines = ["     1)         0  12345678  4  01 02 03 04", f"     2)       100  {line}"]
    batch, report = read(".trc", "\n".join(lines).encode())
    assert (len(batch), report.bad) == (frames, bad)


@pytest.mark.parametrize(
    ("line", "frames", "bad"),
    [
        ("0.1 1 123 Rx d 8 01 02 03", 0, 1),
        ("0.1 1 123 Rx d 2 01 02 Length = 5", 1, 0),
        ("0.1 1 123 Rx d 2 01 2", 0, 1),
        ("0.1 1 1234 Rx d 1 01", 0, 1),
        ("0.1 1 1FFFFFFFFx Rx d 1 01", 0, 1),
        ("inf 1 123 Rx d 1 01", 0, 1),
        ("nan 1 123 Rx d 1 01", 0, 1),
        ("-0.1 1 123 Rx d 1 01", 0, 1),
        ("0.1 1 123 Rx d -1", 0, 1),
        ("0.1 1 123 Rx d 0", 1, 0),
        ("0.1 1 123 Rx r 8", 1, 0),
        ("9999999999.1 1 123 Rx d 1 01", 0, 1),
        ("0.1 1 123 R", 0, 1),
        ("0.1 CANFD 1 Rx 123 name 1 0 9 12 " + "11 " * 12, 1, 0),
        ("0.1 CANFD 1 Rx 123 1 0 9 12 " + "11 " * 11, 0, 1),
        ("0.1 1  Statistic: D 0 R 0", 0, 0),
        ("0.1 CAN 1 Status:chip status error active", 0, 0),
        ("0.1 J1939TP FEE3p 6 0 0 - Rx d 23 A0", 0, 0),
        ("something else", 0, 1),
        ("// a comment", 0, 0),
    ],
)
def test_lines_of_an_asc_file(line: str, frames: int, bad: int) -> None:
    head = "date Sat Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\n"
    batch, report = read(".asc", f"{head}{line}\n".encode())
    assert (len(batch), report.bad) == (frames, bad)


@pytest.mark.parametrize("name", ["candump", "asc", "trc", "frames in csv", "busmaster"])
def test_a_bad_line_is_named_by_its_number_in_any_block(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shapes, "BLOCK_BYTES", 300)
    lines = whole_file(name, tmp_path).splitlines()
    lines.insert(len(lines) - 2, b"something else")
    path = tmp_path / f"run{FORMATS[name].suffix}"
    path.write_bytes(b"\n".join([*lines, b""]))
    reading = read_log(path)
    assert sum(map(len, reading)) > 0 and reading.report.first_bad.startswith(f"line {len(lines) - 2}: ")


@pytest.mark.parametrize(("length", "frames"), [(1024, 1), (1025, 0)])
def test_a_line_of_more_than_a_kilobyte_is_no_frame(length: int, frames: int) -> None:
    line = b"0.1 1 123 Rx d 1 01 Length = ".ljust(length, b"5")
    batch, report = read(".asc", b"base hex timestamps absolute\n" + line + b"\n")
    assert (len(batch), report.bad) == (frames, 1 - frames)


def test_an_fd_frame_without_data_that_states_a_length_asks_for_it() -> None:
    batch, _ = read(".asc", b"base hex timestamps absolute\n0.1 CANFD 1 Rx 123 1 0 9 0\n0.2 CANFD 1 Rx 123 1 0 0 0\n")
    assert batch.frames["length"].tolist() == [12, 0]
    assert (batch.frames["flags"] & FrameFlag.REMOTE != 0).tolist() == [True, False]


def test_a_letter_among_the_digits_of_a_time_makes_a_line_bad() -> None:
    good, bad = " 0.100000 1 123 Rx d 1 01", " 0.1A0000 1 123 Rx d 1 01"
    batch, report = read(".asc", "\n".join(["base hex timestamps absolute", bad, *[good] * 4]).encode())
    assert len(batch) == 4 and report.bad == 1 and report.first_bad.startswith("line 2")


def test_the_base_of_an_asc_file_holds_for_its_data_too() -> None:
    text = "base dec  timestamps absolute\n 0.1 1 291 Rx d 3 1 20 255\n 0.2 1 292 Rx d 1 256\n"
    batch, report = read(".asc", text.encode())
    assert batch.frames["can_id"].tolist() == [0x123] and report.bad == 1
    assert batch.frames["data"][0][:3].tolist() == [1, 20, 255]


@pytest.mark.parametrize("year", ["0000", "1900", "2300", "9999"])
def test_a_date_that_is_none_is_a_remark(tmp_path: Path, year: str) -> None:
    path = tmp_path / "drive.asc"
    path.write_text(f"date Sat Sep 30 15:06:13.191 {year}\nbase hex timestamps absolute\n 0.1 1 123 Rx d 1 01\n")
    reading = read_log(path)
    assert sum(map(len, reading)) == 1
    assert reading.report.absolute_time is False and "a date that is none" in reading.report.remarks()[1]


@given(st.binary(max_size=400), st.sampled_from([".asc", ".trc"]))
def test_noise_is_bad_lines_or_our_error(noise: bytes, suffix: str) -> None:
    head = b"base hex timestamps absolute\n" if suffix == ".asc" else b";$FILEVERSION=1.1\n;$STARTTIME=43008.9\n"
    try:
        batch, report = read(suffix, head + noise)
    except RecordingError:
        return
    lines = [line for line in noise.split(b"\n") if line.strip()]
    assert len(batch) + report.bad + sum(report.skipped.values()) <= len(lines)


def test_a_line_without_end_takes_no_time(tmp_path: Path) -> None:
    path = tmp_path / "drive.asc"
    path.write_bytes(b"base hex timestamps absolute\n 0.1 1 123 Rx d 1 01\n" + b"0" * 30_000_000)
    reading = read_log(path)
    assert sum(map(len, reading)) == 1 and reading.report.bad
