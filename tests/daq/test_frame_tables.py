"""CAN frames in tables: of known programs by their header, of others by named columns; BusMaster's text."""

from __future__ import annotations

import base64
from pathlib import Path

import can
import numpy as np
import pytest
from cli_support import invoke, ok
from frames_support import content
from hypothesis import example, given
from hypothesis import strategies as st
from support import data_dir

from daq import ConfigError, RecordingError
from daq.can import FrameBatch, FrameFlag, concatenate
from daq.logs import LogReading, parse_columns, read_log
from daq.recording import RunRecording
from daq.series import series_format

SAVVYCAN = """\
Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
39747828,000005EB,false,Rx,0,8,E8,45,85,4B,4A,28,36,69,
39747900,18FEF100,true,Tx,1,3,01,02,03,
"""
CSS = """\
TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes
1689951599.925001;9;067;0;8;8;0;0;0;0;0;E19462F0C9F66E01
1660503551.3;2;18FF50E5;1;9;12;0;1;0;0;0;000102030405060708090A0B
"""
BUSMASTER = """\
***BUSMASTER Ver 2.4.0***
***PROTOCOL CAN***
***[START LOGGING SESSION]***
***START DATE AND TIME 8:8:2014 11:49:7:965***
***HEX***
***SYSTEM MODE***
***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***
11:49:12:9420 Rx 1 0x023 s 1 40
11:49:12:9440 Tx 2 0x18FEF100 x 8 03 E0 00 00 C0 00 00 00
11:49:12:9441 Rx 1 0x123 sr 0
11:49:12:9442 Rx 1 0x123 s 3 01 02
***[STOP LOGGING SESSION]***
"""


def read(path: Path, text: str, **options: object) -> tuple[FrameBatch, LogReading]:
    path.write_text(text)
    reading = read_log(path, **options)  # type: ignore[arg-type]
    return concatenate(list(reading)), reading


def test_savvycan(tmp_path: Path) -> None:
    batch, reading = read(tmp_path / "a.csv", SAVVYCAN)
    assert batch.frames["time_ns"].tolist() == [39_747_828_000, 39_747_900_000]
    data = bytes.fromhex("E845854B4A283669")
    assert content(batch)[0] == ("can0", 0x5EB, 0, 8, data.ljust(64, b"\0"))
    assert content(batch)[1][:4] == ("can1", 0x18FEF100, FrameFlag.EXTENDED, 3)
    assert batch.frames["flags"][1] & FrameFlag.TRANSMITTED and not reading.report.bad


def test_css_electronics(tmp_path: Path) -> None:
    batch, reading = read(tmp_path / "a.csv", CSS)
    assert batch.frames["time_ns"][0] == 1_689_951_599_925_001_000
    assert content(batch)[0][:4] == ("can9", 0x67, 0, 8)
    assert content(batch)[1][:4] == ("can2", 0x18FF50E5, FrameFlag.EXTENDED | FrameFlag.FD, 12)
    assert reading.report.absolute_time and not reading.report.bad


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        (
            "Time,Channel,ID,Flags,DLC,Data0,Data1,Data2,Data3,Data4,Data5,Data6,Data7,Counter,AbsTime\n"
            "0.18916,1,418381679,4,8,137,152,0,0,5,0,255,255,1,2011-07-21 11:07:12\n",
            ("can0", 0x18EFFF6F, FrameFlag.EXTENDED, "899800000500ffff"),
        ),
        ("time,addr,bus,data\n240.479,53,0,0acc0ade0074bf9e\n", ("can0", 53, 0, "0acc0ade0074bf9e")),
        ("time,addr,data\n240.479,53,0acc0ade0074bf9e\n", ("can0", 53, 0, "0acc0ade0074bf9e")),
        ("time,addr,bus,data\n15.46,0x440,1,0x4000800000000000\n", ("can1", 0x440, 0, "4000800000000000")),
    ],
)
def test_kvaser_and_cabana(tmp_path: Path, text: str, frame: tuple[str, int, int, str]) -> None:
    batch, reading = read(tmp_path / "a.csv", text)
    (found,) = content(batch)
    assert (*found[:3], found[4][: found[3]].hex()) == frame and not reading.report.bad


def test_busmaster(tmp_path: Path) -> None:
    batch, reading = read(tmp_path / "a.log", BUSMASTER)
    assert str(np.datetime64(int(batch.frames["time_ns"][0]), "ns")).startswith("2014-08-08T11:49:12.942")
    assert [frame[:4] for frame in content(batch)] == [
        ("can0", 0x23, 0, 1),
        ("can1", 0x18FEF100, FrameFlag.EXTENDED, 8),
        ("can0", 0x123, FrameFlag.REMOTE, 0),
    ]
    assert reading.report.bad == 1 and reading.report.first_bad.startswith("line 11")
    assert any("local time" in line for line in reading.report.remarks())
    good = "11:49:12:9420 Rx 1 0x023 s 1 40\n"
    bad = [good.replace("12:", "1A:"), good.replace("Rx 1", "Rx A"), good.replace("9420", "94:0")]
    batch, reading = read(tmp_path / "b.log", BUSMASTER.partition("11:49:12")[0] + "".join(bad) + good * 8)
    assert len(batch) == 8 and reading.report.bad == 3


@given(
    st.lists(
        st.tuples(
            st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 3), st.sampled_from(["", "x", "  ", "0x"])
        ),
        min_size=1,
        max_size=20,
    ),
    st.sampled_from(["hex", "dec"]),
    st.sampled_from([",", ";", "\t"]),
)
def test_named_columns_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    frames: list[tuple[int, bytes, int, str]],
    base: str,
    delimiter: str,
) -> None:
    rows = [
        delimiter.join([f"{i * 0.25:.2f}", str(bus), f"{can_id:X}" if base == "hex" else str(can_id), data.hex()])
        for i, (can_id, data, bus, _) in enumerate(frames)
    ]
    head = delimiter.join(["t", "channel", "number", "bytes"])
    path = tmp_path_factory.mktemp("table") / "log.csv"
    columns = parse_columns(f"time=t:s,id=number:{base},data=bytes,bus=channel")
    batch, reading = read(path, "\n".join([head, *rows]), columns=columns)
    assert [(f[1], f[4][: f[3]], f[0]) for f in content(batch)] == [(i, d, f"can{b}") for i, d, b, _ in frames]
    assert batch.frames["time_ns"].tolist() == [i * 250_000_000 for i in range(len(frames))]
    assert not reading.report.bad


@given(st.lists(st.lists(st.sampled_from(["", "0A", "7f", "G"]), min_size=3, max_size=3), min_size=1, max_size=6))
@example([["0A", "", "7f"]] * 3)
def test_of_bytes_in_columns_those_that_are_there_count(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    text = "\n".join(
        ["t,id,a,b,c", *(",".join([f"{i}.5", "12", *cells]) for i, cells in enumerate([["1"] * 3, *rows]))]
    )
    columns = parse_columns("time=t:s,id=id:hex,data=a:hex+b:hex+c:hex")
    batch, reading = read(tmp_path_factory.mktemp("table") / "log.csv", text + "\n", columns=columns)
    whole = ["".join(cells) for cells in rows if "G" not in cells]
    assert [data[:length].hex() for *_, length, data in content(batch)] == ["010101", *(one.lower() for one in whole)]
    assert reading.report.bad == len(rows) - len(whole)


@pytest.mark.parametrize(
    "row",
    [
        "inf,0x1,0,0,0,1,AA==",
        "nan,0x1,0,0,0,1,AA==",
        "1.0,0x1,0,0,0,-1,AA==",
        "1.0,0x1,0,0,0,9,AA==",
        "1.0,0x800,0,0,0,1,AA==",
        "1.0,0x20000000,1,0,0,1,AA==",
        "1.0,0x1,0,0,0,1,!",
        "1.0,0x1",
        "1e300,0x1,0,0,0,1,AA==",
    ],
)
def test_a_row_that_is_no_frame_is_counted_with_its_line(tmp_path: Path, row: str) -> None:
    head = "timestamp,arbitration_id,extended,remote,error,dlc,data"
    good = "1.5,0x2,0,0,0,1,AA=="
    batch, reading = read(tmp_path / "a.csv", "\n".join([head, good, row, good]))
    assert len(batch) == 2 and reading.report.bad == 1
    assert reading.report.first_bad.startswith("line 3")


def test_a_byte_below_zero_is_none(tmp_path: Path) -> None:
    columns = parse_columns("time=t:s,id=i:dec,data=a:dec+b:dec")
    for empty, before in (("", []), ("2,1,5,\n", [b"\5"])):  # an empty cell has the lines read one by one
        batch, reading = read(tmp_path / "a.csv", f"t,i,a,b\n1,1,5,-5\n{empty}3,1,5,6\n", columns=columns)
        assert [frame[4][: frame[3]] for frame in content(batch)] == [*before, b"\5\6"]
        assert reading.report.bad == 1 and reading.report.first_bad.startswith("line 2")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("time=Time", "--columns has no id="),
        ("time=Time,id=ID,data=D,buss=B", "nearest: bus"),
        ("time", "not understood"),
    ],
)
def test_wrong_columns_are_said(text: str, what: str) -> None:
    with pytest.raises(ConfigError, match=what):
        parse_columns(text)


def test_an_unknown_header_is_shown_with_what_to_type(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("Time,Bus,MessageID,Message\n1.5,0,705,00012cfe0bb20fc2\n")
    assert series_format(tmp_path / "log.csv") is None
    result = invoke("import", tmp_path / "log.csv", "-o", tmp_path / "out.mcap")
    assert result.code == 2 and "--columns time=Time,id=MessageID,data=Message" in result.err
    assert not (tmp_path / "out.mcap").exists()


def test_real_frames_of_a_table_of_its_own_kind(tmp_path: Path) -> None:
    path = data_dir("verified-can", "rav4_head.csv")
    columns = "time=Time,id=MessageID:dec,data=Message,bus=Bus,length=MessageLength"
    ok("import", path, "--columns", columns, "-o", tmp_path / "drive.mcap")
    recording = RunRecording.open(tmp_path / "drive.mcap")
    assert sum(recording.frame_counts.values()) == 12_000
    assert recording.frames().frames["can_id"][0] == 705


def test_what_python_can_writes_is_still_read(tmp_path: Path) -> None:
    with can.CSVWriter(tmp_path / "a.csv") as writer:
        for i in range(3):
            writer.on_message_received(
                can.Message(timestamp=1.7e9 + i, arbitration_id=i, is_extended_id=False, data=[i])
            )
    assert sum(map(len, read_log(tmp_path / "a.csv"))) == 3


_CELLS = st.tuples(
    st.integers(0, 0x7FF), st.booleans(), st.binary(max_size=8), st.integers(0, 9), st.sampled_from(["", "!", "0x"])
)


@given(
    rows=st.lists(_CELLS, min_size=2, max_size=12), program=st.sampled_from(["python-can", "SavvyCAN", "Kvaser", "CSS"])
)
@example(rows=[(1, True, b"\x01", 0, "")] * 2, program="CSS")
@example(rows=[(2, True, b"\x01", 0, "")] * 2, program="python-can")
def test_a_table_by_columns_is_the_table_line_by_line(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, bool, bytes, int, str]], program: str
) -> None:
    """A quotation mark has every line of a table read by itself; lengths and data may contradict each other."""
    rows = [(1, False, b"\x01", 1, ""), *rows]
    lines = [_line(program, i, *row) for i, row in enumerate(rows)]
    quoted = [",".join(['"' + cells[0] + '"', *cells[1:]]) for cells in (line.split(",") for line in lines)]
    folder = tmp_path_factory.mktemp("table")
    one, other = (read(folder / "a.csv", "\n".join([_HEADERS[program], *body, ""])) for body in (lines, quoted))
    assert content(one[0]) == content(other[0])
    assert all(not any(data[length:]) for *_, length, data in content(one[0])), "the bytes behind are zero"
    assert np.array_equal(one[0].frames["time_ns"], other[0].frames["time_ns"])
    assert one[1].report.bad == other[1].report.bad


_HEADERS = {
    "python-can": "timestamp,arbitration_id,extended,remote,error,dlc,data",
    "SavvyCAN": "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8",
    "Kvaser": "Time,ID,Channel,DLC,Flags,Data0,Data1,Data2,Data3,Data4,Data5,Data6,Data7",
    "CSS": "TimestampEpoch,BusChannel,ID,IDE,DataLength,Dir,EDL,BRS,ESI,RTR,DataBytes",
}


def _line(program: str, i: int, can_id: int, odd: bool, data: bytes, length: int, wrong: str) -> str:
    """Return a row whose length is the data's unless `odd`; `wrong` is put before the data of the third row."""
    length, wrong = length if odd else len(data), wrong if i == 2 else ""
    if program == "python-can":
        remote = int(odd and can_id % 2)
        return f"{i}.5,{can_id:#x},0,{remote},0,{length},{wrong}{base64.b64encode(data).decode()}"
    if program == "CSS":
        return f"{i}.5,1,{can_id:X},0,{length},0,{int(length > 8)},0,0,0,{wrong}{data.hex()}"
    base = "02X" if program == "SavvyCAN" else "d"
    cells = ",".join([*(f"{byte:{base}}" for byte in data), *[""] * (8 - len(data))])
    head = f"{can_id:X},false,Rx,0,{length}" if program == "SavvyCAN" else f"{can_id},1,{length},0"
    return f"{i}000,{head},{wrong}{cells}"


@pytest.mark.parametrize(
    ("stamps", "begin_ns"),
    [
        (("2024-01-02T03:04:05.5+00:00", "yesterday", "2024-01-02T03:04:06+00:00"), 1_704_164_645_500_000_000),
        (("1.5", "yesterday", "2.0"), 1_500_000_000),
    ],
)
def test_times_are_dates_or_numbers_and_what_is_neither_is_lost(
    tmp_path: Path, stamps: tuple[str, ...], begin_ns: int
) -> None:
    path = tmp_path / "run.csv"
    rows = [f"{stamp},0x1,0,0,0,1,aA==" for stamp in stamps]
    path.write_text("\n".join(["timestamp,arbitration_id,extended,remote,error,dlc,data", *rows, ""]))
    reading = read_log(path)
    times = [time_ns for batch in reading for time_ns in batch.frames["time_ns"].tolist()]
    assert times == [begin_ns, begin_ns + 500_000_000]
    assert (reading.report.bad, reading.report.first_bad) == (1, "line 3: no time: yesterday")


@pytest.mark.parametrize(
    ("rows", "first"),
    [
        (["1.5,0x1,0,0,0,1,aA==", "yesterday,0x1,0,0,0,1,aA==", "no frame"], "line 3: no time: yesterday"),
        (["1.5,0x1,0,0,0,1,aA==", "no frame", "yesterday,0x1,0,0,0,1,aA=="], "line 3: no frame"),
    ],
)
def test_of_lines_that_cannot_be_read_the_earliest_is_named(tmp_path: Path, rows: list[str], first: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["timestamp,arbitration_id,extended,remote,error,dlc,data", *rows, ""]))
    reading = read_log(path)
    assert sum(map(len, reading)) == len(rows) - 2 and reading.report.bad == 2
    assert reading.report.first_bad.startswith(first)
    path.write_text("\n".join(["timestamp,arbitration_id,extended,remote,error,dlc,data", "no frame", "nor this"]))
    with pytest.raises(RecordingError, match="2 unreadable, skipped; the first is line 2: no frame"):
        list(read_log(path))


@pytest.mark.parametrize("date", ["", "***START DATE AND TIME 31:2:2014 11:49:7:965***\n"])
def test_a_busmaster_log_without_a_date_counts_from_midnight(tmp_path: Path, date: str) -> None:
    text = BUSMASTER.replace("***START DATE AND TIME 8:8:2014 11:49:7:965***\n", date)
    batch, reading = read(tmp_path / "run.log", text)
    assert batch.frames["time_ns"][0] == (11 * 3600 + 49 * 60 + 12) * 10**9 + 942_000_000
    assert len(reading.report.faults) == bool(date)
