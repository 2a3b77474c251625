"""Well-formed files that are easily read wrong are read as their writer meant them, or refused, but not in silence."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pytest
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from wrong_files import CASES, Case

from daq import ConfigError, DataError, SeriesSection, Severity, VehicleConfig
from daq.balance import UNACCOUNTED
from daq.gunzip import Gunzip, unpacked
from daq.logs import parse_columns, read_log
from daq.runs import Configuration
from daq.runs.run import log_run, series_run
from daq.series import read_series, read_shear_tests, read_wheel_tables, series_format
from daq.series.readers import delimited
from daq.series.readers.table_head import _is_lost, _usual_count


def all_of(path: Path, **layout: object) -> tuple[dict[str, list[float]], list[float], str]:
    """Return the columns, the times in s and what the report says."""
    series = read_series(path, SeriesSection.model_validate(layout))
    blocks = [block for together in series.blocks() for block in together]
    names = blocks[0].columns
    columns = {name: np.concatenate([block.columns[name] for block in blocks]).tolist() for name in names}
    time_s = np.concatenate([block.time_ns for block in blocks]) / 1e9
    assert series.report.balance.open == 0 and UNACCOUNTED not in series.report.balance.losses
    return columns, time_s.tolist(), "\n".join(series.report.remarks())


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_file_that_can_be_read_in_two_ways(case: Case, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(case.text, encoding="utf-8")
    if case.refused:
        with pytest.raises((ConfigError, DataError), match=case.said):
            if case.signals:
                vehicle = VehicleConfig.model_validate({"series": case.layout, "signals": case.signals})
                series_run(path, Configuration(vehicle)).channels()
            all_of(path, **case.layout)
        return
    columns, time_s, said = all_of(path, **case.layout)
    assert columns.keys() == case.columns.keys()
    for name, values in case.columns.items():
        np.testing.assert_allclose(columns[name], values)
    np.testing.assert_allclose(np.subtract(time_s, time_s[0]), np.subtract(case.time_s, case.time_s[0]))
    assert case.said in said


@pytest.mark.parametrize(("unit", "step", "count"), [("", 1, 4000), ("", 10, 50), ("s", 10, 4000)])
def test_slow_tables_are_read_where_they_may_be_right(tmp_path: Path, unit: str, step: int, count: int) -> None:
    """1 Hz for an hour, a few minutes of 0.1 Hz, and a unit that vehicle.toml states."""
    path = tmp_path / "run.csv"
    path.write_text("t [s],Fz [N]\n" + "".join(f"{step * i},{4000 + i % 9}\n" for i in range(count)), encoding="utf-8")
    layout = {"series": {"time_unit": unit} if unit else {}, "signals": {"vertical_load": "Fz [N]"}}
    run = series_run(path, Configuration(VehicleConfig.model_validate(layout)))
    assert len(run.channels()["vertical_load"]) == count


@pytest.mark.parametrize("case", [case for case in CASES if case.said and not case.refused], ids=lambda case: case.name)
def test_every_command_is_told_how_a_table_was_read(case: Case, tmp_path: Path) -> None:
    """Not only `info`: a run has notes on its file, doubts on what of it is lost."""
    path = tmp_path / "run.csv"
    path.write_text(case.text, encoding="utf-8")
    named = next(iter(case.columns))
    signals = {"vertical_load": {"signal": named, "unit": "N"}}
    layout = {"series": dict(case.layout), "signals": signals}
    run = series_run(path, Configuration(VehicleConfig.model_validate(layout)))
    list(run.channel_batches())
    notes = run.reading_notes()
    assert any(case.said in note.values["text"] for note in notes)
    lost = run.series.report.balance.losses or run.series.report.bad_cells  # type: ignore[union-attr]
    assert any(note.severity == Severity.DOUBT for note in notes) is bool(lost)


def test_a_log_with_lines_that_cannot_be_read_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    line = "({}) can0 123#0011\n"
    path.write_text(
        "".join(line.format(f"{1.7e9 + i / 10:.6f}") for i in range(50)) + "(1700000009.0) can0 12#XX\n" * 9
    )
    run = log_run(path, Configuration())
    for _ in range(2):
        frames = run.frame_batches()
        assert sum(map(len, frames)) == 50
        [note] = run.reading_notes(frames)
        assert note.severity == Severity.DOUBT and note.values["text"].startswith("9 unreadable")


@pytest.mark.parametrize(
    ("written", "unit", "noted"), [("kN", "N", True), ("N", "N", False), ("kN", "kilonewton", False)]
)
def test_a_unit_in_place_of_that_of_the_file_is_noted(tmp_path: Path, written: str, unit: str, noted: bool) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"time [s],Fz [{written}]\n" + "".join(f"{i / 10},{i}\n" for i in range(50)))
    signals = {"vertical_load": {"signal": "Fz", "unit": unit}}
    run = series_run(path, Configuration(VehicleConfig.model_validate({"signals": signals})))
    assert [note.values for note in run.signal_notes()] == (
        [{"role": "vertical_load", "unit": unit, "written": written}] if noted else []
    )


def test_a_gzipped_series_that_is_cut_keeps_what_stands_before_the_cut(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    text = "time [s],Fz [N]\n" + "".join(
        f"{i / 100},{value!r}\n" for i, value in enumerate(rng.normal(size=5000).tolist())
    )
    path = tmp_path / "run.csv.gz"
    packed = gzip.compress(text.encode())
    path.write_bytes(packed[: len(packed) // 2])
    columns, _, said = all_of(path)
    assert 2000 < len(columns["Fz [N]"]) < 3000 and "cut off" in said


def test_a_line_without_an_end_is_lost_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delimited, "_PIECE", 512)
    monkeypatch.setattr(delimited, "_LONGEST_LINE", 1024)
    rows = [f"{i / 100},{float(i)}" for i in range(200)]
    path = tmp_path / "run.csv"
    text = "\n".join(["time [s],Fz [N]", *rows[:100], "1" * 3000, *rows[100:], *[""] * 2000])
    path.write_text(text, encoding="utf-8")
    columns, _, said = all_of(path)
    assert columns["Fz [N]"] == [float(i) for i in range(200)] and "longer than 1024 bytes" in said


@pytest.mark.parametrize(("row", "lost"), [(["0.1", "2"], True), (["2"], False), (["today", "dry"], False)])
def test_two_numbers_above_a_header_are_a_row_that_is_lost(row: list[str], lost: bool) -> None:
    assert _is_lost(row, under_header=False, is_header=False) == lost


def test_headers_among_the_rows_are_no_rows_and_say_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head, other = "time [s],Fz [N]", "Fz [N],time [s]"
    (path := tmp_path / "run.csv").write_text("\n".join([head, "0.0,1", "0.1,2", other, "3,0.2", "4,0.3", head, ""]))
    columns, _, said = all_of(path)
    assert columns["Fz [N]"] == [1, 2, 3, 4] and "another order from line 4" in said
    monkeypatch.setattr(delimited, "_PIECE", 20)
    path.write_text("\n".join([head, "0.0,1", "0.1,2", "Zeit,Kraft", *(f"{i / 10},3" for i in range(2, 12)), ""]))
    columns, _, said = all_of(path)
    assert "a row of words is among the numbers, perhaps another header: Zeit, Kraft" in said
    assert columns["Fz [N]"] == [1, 2] and "rows behind another header, excluded: 11" in said


def test_rows_that_the_parser_refuses_together_are_lost_by_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_csv = arrow_csv.read_csv

    def refused(piece: pa.BufferReader, *options: object) -> pa.Table:
        if b"77.5" in piece.read():
            raise pa.ArrowInvalid("out of sync")
        piece.seek(0)
        return read_csv(piece, *options)

    monkeypatch.setattr(delimited, "_PIECE", 512)
    monkeypatch.setattr(arrow_csv, "read_csv", refused)
    path = tmp_path / "run.csv"
    path.write_text("time [s],Fz [N]\n" + "".join(f"{i / 100},{i + 0.5}\n" for i in range(200)), encoding="utf-8")
    columns, _, said = all_of(path)
    lost = re.search(r"rows unreadable, excluded: (\d+); the first is lines from \d+: out of sync", said)
    assert lost is not None and 20 < int(lost[1]) == 200 - len(columns["Fz [N]"])


@pytest.mark.parametrize(("full", "width"), [(25, 3), (15, 2)])
def test_a_table_is_as_wide_as_its_header_where_a_fifth_of_the_rows_are(full: int, width: int) -> None:
    cells = [["time [s]", "Fz [N]", "T [Nm]"], *[["0", "1", "2"]] * full, *[["0", "1"]] * (100 - full)]
    assert _usual_count(cells.__getitem__, [len(row) for row in cells], SeriesSection()) == width


def test_nothing_is_read_twice_where_a_gzipped_file_is_damaged(tmp_path: Path) -> None:
    path, text = tmp_path / "run.csv.gz", b"0.1,2\n" * 100
    path.write_bytes(gzip.compress(text) + b"no gzip")
    with unpacked(path, 10) as file:
        assert file.read() == text and isinstance(file.raw, Gunzip) and "is damaged" in file.raw.damage


def test_a_cut_tdms_file_says_how_much_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.tdms"
    with TdmsWriter(path) as writer:
        for part in (slice(0, 20), slice(20, 50)):
            writer.write_segment([ChannelObject("rack", "Fz", np.arange(50.0)[part], {"wf_increment": 0.01})])
    whole = path.read_bytes()
    path.write_bytes(whole[:-232])
    columns, _, said = all_of(path)
    assert len(columns["rack/Fz"]) == 21
    assert f"{len(whole) - 232:,} of {len(whole):,} bytes are there" in said and not capsys.readouterr().err


def test_arrays_of_a_bag_that_grow_are_columns_throughout(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    joint, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    path, none = tmp_path / "run.bag", np.zeros(0)
    with Writer(path) as writer:
        connection = writer.add_connection("/joints", joint.__msgtype__, typestore=store)
        for i in range(50):
            count = (0, 1, 1, 3)[min(i, 3)]
            message = joint(
                header=header(seq=0, stamp=stamp, frame_id=""),
                name=[],
                position=none,
                effort=none,
                velocity=np.arange(count) + float(i),
            )
            writer.write(connection, (i + 1) * 10**9, store.serialize_ros1(message, joint.__msgtype__))
    columns, _, _ = all_of(path)
    assert columns.keys() == {"velocity[0]", "velocity[1]", "velocity[2]"}
    assert np.isfinite(columns["velocity[2]"]).sum() == 47 and np.isfinite(columns["velocity[0]"]).sum() == 49


FRAMES = "Stamp,MsgId,Payload\n" + "".join(
    f"{i}.5,{can_id},0011\n" for i, can_id in enumerate((201, 1537, 773, 1024, 2015, 290))
)


@pytest.mark.parametrize(
    ("text", "first_id", "said"),
    [
        (FRAMES, 201, "MsgId read as decimal, because none of"),
        (FRAMES.replace("773", "30A"), 0x201, ""),
        (FRAMES.replace(",201,", ",2F1,"), 0x2F1, ""),
        (FRAMES.replace("1537", "201").replace("1024", "201").replace("2015", "201"), None, "hexadecimal or decimal"),
    ],
)
def test_identifiers_are_decimal_or_hexadecimal_by_all_of_them(
    tmp_path: Path, text: str, first_id: int | None, said: str
) -> None:
    path = tmp_path / "frames.csv"
    path.write_text(text)
    columns = parse_columns("time=Stamp,id=MsgId,data=Payload")
    if first_id is None:
        with pytest.raises(ConfigError, match=said):
            list(read_log(path, columns=columns))
        return
    reading = read_log(path, columns=columns)
    assert next(reading).frames["can_id"][0] == first_id
    assert said in "\n".join(reading.report.remarks())


def test_a_gzipped_table_of_frames_is_no_series(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv.gz"
    text = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2\n1000,000005EB,false,Rx,0,2,E8,45\n"
    path.write_bytes(gzip.compress(text.encode()))
    assert series_format(path) is None


@pytest.mark.parametrize("column", ["wheel_radius_m", "wheel_id", "tyre", "diameter_mm"])
def test_rows_of_two_wheels_are_two_wheels_or_an_error(tmp_path: Path, column: str) -> None:
    path = tmp_path / "table.csv"
    rows = "".join(f"0.{i},1000,10{i},{1 + i % 2}\n" for i in range(1, 9))
    path.write_text(f"slip,vertical_load_n,drawbar_pull_n,{column}\n{rows}")
    with pytest.raises(ConfigError, match="several wheels"):
        read_wheel_tables(path)
    path.write_text(path.read_text().replace(column, "wheel"))
    assert [len(one) for one in read_wheel_tables(path)] == [4, 4]


@pytest.mark.parametrize("with_columns", [True, False])
def test_the_torque_of_a_shear_ring_is_a_stress(tmp_path: Path, with_columns: bool) -> None:
    inner, outer = 0.1, 0.15
    angle, stress = np.linspace(0, 0.5, 9), 5000.0
    radius = np.linspace(inner, outer, 20_001)
    torque = np.trapezoid(stress * radius * 2 * np.pi * radius, radius)
    radii = (f",{inner},{outer}", ",inner_radius_m,outer_radius_m") if with_columns else ("", "")
    force = 2000.0 * np.pi * (outer**2 - inner**2)
    rows = "".join(f"{one},{torque},{force}{radii[0]}\n" for one in angle)
    path = tmp_path / "ring.csv"
    path.write_text(f"rotation_rad,torque_nm,normal_force_n{radii[1]}\n{rows}")
    if not with_columns:
        with pytest.raises(ConfigError, match="radii of the shear ring are not known"):
            read_shear_tests(path)
    (test,) = read_shear_tests(path, ring_m=None if with_columns else (inner, outer))
    assert test.shear_stress_pa == pytest.approx(np.full(9, stress), rel=1e-6)
    assert test.normal_stress_pa == pytest.approx(2000.0)
    assert test.displacement_m == pytest.approx(angle * 0.125)
