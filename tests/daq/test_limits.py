"""What a hostile file may cost: a clear error, little memory and little time, from every reader."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from database_texts import ARXML, KCD, SYM
from fuzz.readers import whole_file
from nptdms import ChannelObject, TdmsWriter

from daq import (
    ConfigError,
    DataError,
    RecordingError,
    RunsConfig,
    VehicleConfig,
    WheelsoilError,
    every_error_as,
    load_toml,
)
from daq.can import CLASSIC_DTYPE, Coverage, FrameBatch, FrameFlag, coverage, load_database
from daq.errors import DatabaseError
from daq.limits import LARGEST_CHUNK_BYTES, MOST_COLUMNS, MOST_IDS, MOST_RUNS
from daq.logs import read_log
from daq.recording.chunks import DamagedError, PackedChunk, unpacked
from daq.series import read_series
from daq.series.tables import read_table

DBC = """VERSION ""

BU_: A

BO_ 256 M: {length} A
 SG_ s : {start}|{bits}@1+ ({scale},0) [0|0] "" A

BO_ 257 N: 8 A
 SG_ t : 0|8@1+ (1,0) [0|0] "" A

"""
USUAL = {"length": 8, "start": 0, "bits": 8, "scale": 1}


@pytest.mark.parametrize("change", [{"length": 400_000_000}, {"start": 400_000_000}, {"bits": "9" * 5000}])
def test_a_dbc_beyond_every_message_is_refused_with_its_line(change: dict[str, object]) -> None:
    text = DBC.format(**USUAL | change).encode()
    with pytest.raises(DatabaseError) as caught:
        load_database(text, "a.dbc")
    fault = caught.value.faults[0]
    assert fault.found.startswith("line 5" if "length" in change else "line 6")
    assert "4095" in fault.what or "32760" in fault.what
    assert len(str(caught.value)) < 2000
    lenient = load_database(text, "a.dbc", lenient=True)
    assert [len(message.signals) for message in lenient.messages] == ([1] if "length" in change else [0, 1])
    assert lenient.left_out


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("M: 8 A", "M:\n400000000 A", 5),
        ("SG_ s : 0|", "SG_ s\n:\n2147483648 |", 6),
        ("BO_ 257", "SG_MUL_VAL_ 256 s s 0-5, 7-4294967295;\nBO_ 257", 8),
    ],
)
def test_a_dbc_may_break_its_lines_anywhere(old: str, new: str, line: int) -> None:
    with pytest.raises(DatabaseError, match="this DBC is refused") as caught:
        load_database(DBC.format(**USUAL).replace(old, new, 1).encode(), "a.dbc")
    assert caught.value.faults[0].found.startswith(f"line {line}: ")


def test_what_a_comment_says_is_no_statement() -> None:
    text = DBC.format(**USUAL) + 'CM_ "BO_ 1 x: 99999999 A\nSG_ s : 99999999|1";\n'
    assert len(load_database(text.encode(), "a.dbc").messages) == 2


@pytest.mark.parametrize(
    ("kind", "old", "new", "line"),
    [
        ("kcd", 'length="8"', 'length="400000000"', 3),
        ("kcd", 'offset="16"', 'offset="2147483648"', 4),
        ("kcd", 'offset="16"', 'offset="2_147_483_648"', 4),
        ("kcd", 'length="12"', 'length="400000000"', 4),
        ("kcd", "<NetworkDefinition", '<!DOCTYPE x [<!ENTITY a "aaaa">]>\n<NetworkDefinition', 1),
        ("sym", "unsigned 12", "unsigned 400000000", 5),
        ("sym", "Len=8", "Len=\n400000000", 11),
        ("sym", "Fz 16", "Fz\n2147483648", 12),
        ("sym", "Sig=Fz 16", "Var=a unsigned 0,2147483648", 12),
        ("sym", "Sig=Fz 16", "Mux=a 2147483648,8 1", 12),
        ("sym", "ID=123h", "ID=0h-1FFFFFFFh", 10),
        ("arxml", "<START-POSITION>16", "<START-POSITION>2147483648", 14),
        ("arxml", "<START-POSITION>0", "<START-POSITION>0x80000000", 10),
        ("arxml", "<LENGTH>12", "<LENGTH>1e9", 16),
        ("arxml", "<LENGTH>8", f"<LENGTH>{'9' * 5000}", 12),
        ("arxml", "<FRAME-LENGTH>8", "<FRAME-LENGTH>400000000", 8),
    ],
)
def test_every_format_of_database_has_the_same_limits(kind: str, old: str, new: str, line: int) -> None:
    text = {"kcd": KCD, "sym": SYM, "arxml": ARXML}[kind]
    assert load_database(text.encode(), f"a.{kind}").messages[0].signals[0].length_bits == 12
    assert text.count(old) == 1
    with pytest.raises(DatabaseError, match=f"this {kind.upper()} is refused") as caught:
        load_database(text.replace(old, new).encode(), f"a.{kind}")
    assert caught.value.faults[0].found.startswith(f"line {line}: ")
    assert "lenient" not in caught.value.faults[0].next_step and len(str(caught.value)) < 2000


@pytest.mark.parametrize("place", ["40000", "524280"])
def test_what_only_the_loaded_signal_shows_is_refused(place: str) -> None:
    text = ARXML.replace("<START-POSITION>16", f"<START-POSITION>{place}")
    text = text.replace("<FRAME-LENGTH>8", "<FRAME-LENGTH>4095").replace("<LENGTH>8", "<LENGTH>65535")
    with pytest.raises(DatabaseError):
        load_database(text.encode(), "a.arxml")


@pytest.mark.parametrize("scale", ["9" * 400, "1e400", "9" * 5000])
def test_a_scale_without_end_names_its_message(scale: str) -> None:
    with pytest.raises(DatabaseError, match=r"a.dbc, message M"):
        load_database(DBC.format(**USUAL | {"scale": scale}).encode(), "a.dbc")


def test_cycle_times_as_texts_are_numbers_or_unknown() -> None:
    text = DBC.format(**USUAL) + 'BA_DEF_ BO_ "GenMsgCycleTime" STRING ;\nBA_DEF_DEF_ "GenMsgCycleTime" "";\n'
    text += 'BA_ "GenMsgCycleTime" BO_ 256 "100";\nBA_ "GenMsgCycleTime" BO_ 257 "fast";\n'
    assert [message.cycle_time_s for message in load_database(text.encode()).messages] == [0.1, None]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a = " + "[" * 50_000, "RecursionError"),
        ("a = " + "9" * 4400, "4300"),
        ("[vehicle]\nmass_kg = " + "9" * 4200, "(4,200 characters)"),
        ("a." * 20_000 + "b = 1", "at most 32"),
        ("a = 1\n" * 1_000_000, "4,194,304 bytes"),
        ("\n".join(f"a{i} = 1" for i in range(10_000)), "9,900 more faults"),
    ],
)
def test_toml_without_end_is_refused(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_toml(path, VehicleConfig)
    assert what.replace("9,900", "9900") in str(caught.value)
    assert str(path) in str(caught.value)


def test_runs_without_end_are_refused(tmp_path: Path) -> None:
    (tmp_path / "runs.toml").write_text('[[run]]\nfile = "a.log"\n' * (MOST_RUNS + 1))
    with pytest.raises(ConfigError, match=f"at most {MOST_RUNS} items"):
        load_toml(tmp_path / "runs.toml", RunsConfig)


def test_a_table_that_lies_on_its_side_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "table.csv"
    path.write_text(",".join(f"c{i}" for i in range(100_000)) + "\n")
    with pytest.raises(DataError, match=f"at most {MOST_COLUMNS:,}") as caught:
        read_table(path)
    assert "line 1" in caught.value.faults[0].where
    path.write_text("a,a,b\n1,2,3\n")
    with pytest.raises(DataError, match="column 'a' is there twice"):
        read_table(path)
    path.write_text("a,b\n1,2\n")
    monkeypatch.setattr("daq.series.tables.MOST_COLUMNS", 2)
    assert list(read_table(path).columns) == ["a", "b"]


def test_groups_of_a_table_keep_their_rows_in_order(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("test,x\nb,1\na,2\nb,3\n")
    assert [(name, part.columns["x"], part.lines) for name, part in read_table(path).groups("test")] == [
        ("b", ("1", "3"), (2, 4)),
        ("a", ("2",), (3,)),
    ]


ZEROS = bytes(64 << 20)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("stated", [1000, len(ZEROS) - 1, len(ZEROS) + 1, LARGEST_CHUNK_BYTES + 1])
def test_a_chunk_that_lies_about_its_size_is_damaged(
    compression: str, stated: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = (
        zstandard.ZstdCompressor(write_content_size=False).compress(ZEROS)
        if compression == "zstd"
        else lz4.frame.compress(ZEROS, store_size=False)
    )
    with pytest.raises(DamagedError):
        unpacked(PackedChunk(data, compression, stated, 0))
    monkeypatch.setattr("daq.recording.chunks.LARGEST_CHUNK_BYTES", len(ZEROS))
    assert unpacked(PackedChunk(data, compression, len(ZEROS), 0)) == ZEROS


BOMB = """
import sys
from daq.recording import Recording
found = Recording.open(sys.argv[1])
frames = sum(len(batch) for batch in found.frame_batches())
from memory_support import peak_rss_mb
print(frames, len(found.loss), peak_rss_mb())
"""


@pytest.mark.parametrize("compression", ["zstd", pytest.param("lz4", marks=pytest.mark.slow)])
def test_chunks_that_unpack_to_gigabytes_take_little_memory(compression: str, tmp_path: Path) -> None:
    """Twelve chunks with one frame each beside 60 MB of nothing, and one that is larger than any may be."""
    from daq import RunInfo
    from daq.recording import RecordingWriter

    path = tmp_path / "bomb.mcap"
    with RecordingWriter(path, run=RunInfo(id="bomb"), compression=compression) as writer:  # type: ignore[arg-type]
        frames = np.zeros(1, CLASSIC_DTYPE)
        frames["time_ns"] = 1_700_000_000_000_000_000
        writer.write_frames(FrameBatch(frames, ("can0",)))
    whole = path.read_bytes()
    start, packed = first_chunk(whole)
    content = unpacked(packed)
    compress = zstandard.ZstdCompressor().compress if compression == "zstd" else lz4.frame.compress
    chunks = []
    for size in [60 << 20] * 12 + [LARGEST_CHUNK_BYTES]:
        filled = content + struct.pack("<BQ", 0x80, size) + bytes(size)
        chunk = PackedChunk(bytes(compress(filled)), compression, len(filled), 0)
        chunks.append(chunk.head(1_700_000_000_000_000_000, 1_700_000_000_000_000_000) + chunk.data)
    path.write_bytes(whole[:start] + b"".join(chunks))
    done = subprocess.run(
        [sys.executable, "-c", BOMB, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": "tests:."},
    )
    read, losses, peak_mb = done.stdout.split()
    assert (int(read), int(losses) >= 1) == (12, True)
    assert float(peak_mb) < 600


@pytest.mark.parametrize("step", ["1e-320", "1e308", "inf", "1e-12"])
@pytest.mark.parametrize("kind", ["rpc iii", "tdms"])
def test_a_rate_that_no_measurement_has_is_refused(kind: str, step: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{'.rsp' if kind == 'rpc iii' else '.tdms'}"
    if kind == "rpc iii":
        written, stated = (b"DELTA_T".ljust(32, b"\0") + text.encode().ljust(96, b"\0") for text in ("0.01", step))
        path.write_bytes(whole_file(kind, tmp_path).replace(written, stated))
    else:
        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("rack", "Fz", np.arange(50.0), {"wf_increment": float(step)})])
    with pytest.raises(DataError, match="a rate that no measurement has"):
        read_series(path)


def first_chunk(whole: bytes) -> tuple[int, PackedChunk]:
    at = 8
    while whole[at] != 0x06:
        at += 9 + int.from_bytes(whole[at + 1 : at + 9], "little")
    size = 9 + int.from_bytes(whole[at + 1 : at + 9], "little")
    unpacked_size = int.from_bytes(whole[at + 25 : at + 33], "little")
    name_size = int.from_bytes(whole[at + 37 : at + 41], "little")
    name = whole[at + 41 : at + 41 + name_size].decode()
    return at, PackedChunk(whole[at + 49 + name_size : at + size], name, unpacked_size, 0)


@pytest.mark.parametrize(
    "line", ["inf,0x1,0,0,0,1,aA==", "nan,0x1,0,0,0,1,aA==", "1.0,0x1,0,0,0,-1,aA==", "1e300,0x1,0,0,0,1,aA=="]
)
def test_a_line_that_no_frame_can_hold_is_an_error_or_a_remark(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"timestamp,arbitration_id,extended,remote,error,dlc,data\n1.0,0x1,0,0,0,1,aA==\n{line}\n")
    try:
        reading = read_log(path)
        list(reading)
        assert reading.report.bad
    except RecordingError as error:
        assert str(path) in str(error)


def test_identifiers_without_end_are_counted_together() -> None:
    frames = np.zeros(30_000, CLASSIC_DTYPE)
    frames["can_id"], frames["flags"] = np.arange(len(frames)) + 1000, FrameFlag.EXTENDED
    frames["can_id"][-10:] = 1000
    database = load_database(DBC.format(**USUAL).replace("BO_ 256", f"BO_ {0x80000000 + 30_000}").encode())
    whole = Coverage()
    for part in np.array_split(frames, 3):
        whole = whole + coverage(FrameBatch(part, ("can0",)), {"can0": (database,)})
    assert len(whole.ids) == MOST_IDS + 1
    assert (whole.known, whole.unknown) == (1, 29_999)
    assert whole.ids[0].frames == 11


def test_errors_of_ours_pass_a_boundary_and_others_get_file_and_place() -> None:
    ours = DataError("ours")
    with pytest.raises(DataError) as caught, every_error_as(RecordingError, "x", lambda: "place"):
        raise ours
    assert caught.value is ours
    with pytest.raises(WheelsoilError) as other, every_error_as(RecordingError, "it fails", lambda: "a.log, after 3"):
        raise ZeroDivisionError
    assert str(other.value).startswith("it fails\n  where: a.log, after 3\n  found: ZeroDivisionError\n")
    with pytest.raises(KeyboardInterrupt), every_error_as(RecordingError, "x", lambda: ""):
        raise KeyboardInterrupt
