"""Files of decoded series: what was written comes back, in every format, and what cannot be read is said."""

from __future__ import annotations

import errno
import os
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from datetime import UTC, date, datetime
from decimal import Decimal
from itertools import islice
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

import daq.child_process
from daq import ConfigError, DataError, FloatArray, IntArray, RecordingError, SeriesSection, WheelsoilError
from daq.balance import UNACCOUNTED
from daq.limits import LAST_TIME_NS
from daq.series import Series, SeriesBlock, SeriesReport, read_series, series_format
from daq.series.apart import apart
from daq.series.readers import matlab
from daq.series.readers.bags import _numbers
from daq.series.readers.groups import Clock, Column, array_column, series_of
from daq.series.readers.tdms import _OpenFile
from daq.series.time_stamps import TimeStamps, time_columns

START_NS = 1_700_000_000_000_000_000
TIME_NS = START_NS + np.arange(50) * 10_000_000
VALUES = 100 * np.sin(np.arange(50.0))
SLOW_NS, SLOW = TIME_NS[::10], np.arange(5.0)


def read(path: Path, **layout: object) -> Series:
    return read_series(path, SeriesSection.model_validate(layout))


def columns(series: Series) -> dict[str, tuple[IntArray, FloatArray, str]]:
    """Return time stamps, values and unit of every column."""
    blocks = [block for together in series.blocks() for block in together]
    found = {}
    for topic, units in series.topics.items():
        own = [block for block in blocks if block.topic == topic]
        time_ns = np.concatenate([np.zeros(0, np.int64), *(block.time_ns for block in own)])
        for name, unit in units.items():
            found[name] = time_ns, np.concatenate([np.zeros(0), *(block.columns[name] for block in own)]), unit
    assert UNACCOUNTED not in series.report.balance.losses
    return found


def text(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@given(
    values=st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=30),
    delimiter=st.sampled_from(",;\t|"),
    comma=st.booleans(),
    preamble=st.booleans(),
    unit_row=st.booleans(),
    newline=st.sampled_from(["\n", "\r\n"]),
    factor=st.sampled_from([("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)]),
    bom=st.booleans(),
)
def test_a_delimited_table_comes_back(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[float],
    delimiter: str,
    comma: bool,
    preamble: bool,
    unit_row: bool,
    newline: str,
    factor: tuple[str, float],
    bom: bool,
) -> None:
    comma = comma and delimiter != ","
    unit, in_ns = factor
    time_ns = np.arange(len(values)) * 2_500_000
    lines = ["Logger 3.1", "Date: today"] if preamble else []
    names = ["Time", "FZ_RL"] if unit_row else [f"Time [{unit}]", "FZ_RL [kN]"]
    rows = [[repr(t / in_ns), repr(v)] for t, v in zip(time_ns.tolist(), values, strict=True)]
    rows = [[cell.replace(".", ",") if comma else cell for cell in row] for row in rows]
    lines += [delimiter.join(row) for row in [names, *([[unit, "kN"]] if unit_row else []), *rows]]
    path = tmp_path_factory.mktemp("table") / "run.csv"
    path.write_bytes((b"\xef\xbb\xbf" if bom else b"") + newline.join(lines).encode())
    series = read(path, decimal="," if comma else ".")
    (time, back, unit_back) = next(iter(columns(series).values()))
    assert unit_back == "kN"
    np.testing.assert_array_equal(time, time_ns)
    np.testing.assert_array_equal(back, values)
    assert series.report.share == 1
    assert series.report.remarks() == ["times have no date: they count from a zero of the logger's own"]


@pytest.mark.parametrize(
    ("stamp", "layout", "unzoned"),
    [
        (lambda t: f"{t / 1e9:.6f}", {}, False),
        (lambda t: str(t // 1_000_000), {}, False),
        (lambda t: str(t), {}, False),
        (lambda t: datetime.fromtimestamp(t / 1e9, UTC).isoformat(), {}, False),
        (lambda t: datetime.fromtimestamp(t / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S,%f"), {}, True),
        (lambda t: datetime.fromtimestamp(t / 1e9, UTC).strftime("%d.%m.%Y %H:%M:%S.%f"), {}, True),
        (
            lambda t: datetime.fromtimestamp(t / 1e9, UTC).strftime("%m/%d/%y %H:%M:%S.%f"),
            {"time_format": "%m/%d/%y %H:%M:%S.%f"},
            True,
        ),
    ],
)
def test_dates_are_understood(
    tmp_path: Path, stamp: Callable[[int], str], layout: dict[str, str], unzoned: bool
) -> None:
    rows = [f"{stamp(t)};{v!r}" for t, v in zip(TIME_NS.tolist(), VALUES.tolist(), strict=True)]
    series = read(text(tmp_path / "run.csv", "timestamp;v [m/s]", *rows), **layout)
    time_ns, values, _ = columns(series)["v [m/s]"]
    np.testing.assert_array_equal(time_ns, TIME_NS)
    np.testing.assert_array_equal(values, VALUES)
    assert series.report.absolute_time and series.report.unzoned is unzoned


@given(st.lists(st.dates(date(1990, 1, 1), date(2099, 1, 1)), min_size=1, max_size=5), st.sampled_from("dm"))
@example([date(2024, 12, 13)], "m")
@example([date(2024, 12, 12)], "d")
def test_of_day_and_month_the_day_is_the_one_that_is_above_12(days: list[date], first: str) -> None:
    form = "%d/%m/%Y 01:00:00" if first == "d" else "%m/%d/%Y 01:00:00"
    report = SeriesReport("run.csv", "")
    stamps, cells = TimeStamps("date", "", SeriesSection(), report), np.array([f"{day:{form}}" for day in days], object)
    if max(day.day for day in days) > 12:
        expected = [int(datetime(day.year, day.month, day.day, 1, tzinfo=UTC).timestamp()) * 10**9 for day in days]
        assert stamps.of(cells)[0].tolist() == expected and len(report.readings) == 1
    else:
        with pytest.raises(ConfigError, match="day or month may come first"):
            stamps.of(cells)


def test_each_column_belongs_to_the_time_before_it(tmp_path: Path) -> None:
    rows = [f"{i},{VALUES[i]},{10 * i if i < 5 else ''},{SLOW[i] if i < 5 else ''}" for i in range(50)]
    path = text(tmp_path / "run.csv", "t_fast [ms],Fz [N],t_slow [ms],v [m/s]", *rows)
    found = columns(read(path))
    np.testing.assert_array_equal(found["Fz [N]"][0], np.arange(50) * 1_000_000)
    np.testing.assert_array_equal(found["v [m/s]"][0], np.arange(5) * 10_000_000)
    np.testing.assert_array_equal(found["v [m/s]"][1], SLOW)


def test_of_times_side_by_side_the_first_counts() -> None:
    units = {"t_fast": "s", "t_gps": "s", "Fz": "N", "t_slow": "s", "v": "m/s"}
    assert time_columns(units, (), SeriesSection(), "run.csv") == {"Fz": "t_fast", "v": "t_slow"}


def test_a_rate_beside_times_is_refused_with_the_first_of_them() -> None:
    held = [array_column(name, np.arange(3.0), "s" if name != "Fz" else "N", "") for name in ("t", "time", "Fz")]
    with pytest.raises(ConfigError, match=r"times of its own \(t\)"):
        series_of(held, SeriesSection(rate_hz=10.0), SeriesReport("run.mat", "MATLAB"))


@pytest.mark.parametrize(("unit", "in_ns"), [("s", 10**9), ("ms", 10**6), ("us", 1000), ("ns", 1), ("min", 6 * 10**10)])
@pytest.mark.parametrize("kind", [np.int64, np.uint64, np.int32, np.uint8, np.float32, np.float64])
def test_whole_numbers_are_stamps_in_any_unit(unit: str, in_ns: int, kind: type[np.generic]) -> None:
    stamps = TimeStamps("time", unit, SeriesSection(), SeriesReport("run.parquet", ""))
    time_ns, usable = stamps.of(np.array([0, 1, 7, 200], kind))
    assert usable.all() and time_ns.dtype == np.int64 and time_ns.tolist() == [0, in_ns, 7 * in_ns, 200 * in_ns]


def test_stamps_beyond_what_nanoseconds_hold_are_not_used() -> None:
    stamps = TimeStamps("time [s]", "", SeriesSection(), SeriesReport("run.csv", ""))
    time_ns, usable = stamps.of(np.array([1.5, 4.6e9, 4.7e9, -4.7e9, np.nan]))
    assert usable.tolist() == [True, True, False, False, False] and time_ns[:2].tolist() == [15 * 10**8, 46 * 10**17]


@pytest.mark.parametrize(("seconds_left", "fits"), [(5.1, True), (5.0, False), (-1.0, False)])
def test_a_clock_ends_where_nanoseconds_do(seconds_left: float, fits: bool) -> None:
    held = [replace(array_column("Fz", VALUES), time="rack")]
    clock = {"rack": Clock(LAST_TIME_NS - round(seconds_left * 1e9), 10.0)}
    with nullcontext() if fits else pytest.raises(DataError, match=r"beyond the year 2116.*\n.*rack"):
        series_of(held, SeriesSection(), SeriesReport("run.tdms", "TDMS"), clock)


@pytest.mark.parametrize(("filled", "refused"), [(0, False), (1, False), (100, False), (101, True)])
def test_a_cell_without_a_name_is_refused_where_most_rows_fill_it(tmp_path: Path, filled: int, refused: bool) -> None:
    rows = [f"{i / 100},{i}," + "7" * (i < filled) for i in range(200)]
    path = text(tmp_path / "run.csv", "time [s],a", *rows)
    with pytest.raises(ConfigError, match="2 names, 3 cells") if refused else nullcontext():
        assert columns(read(path))["a"][1].tolist() == list(range(200))


def test_every_row_is_accounted_for(tmp_path: Path) -> None:
    path = text(
        tmp_path / "run.csv",
        "time [s],Fz [N],state",
        "0.0,1,go",
        "0.1,broken,go",
        "0.2,3",
        "nan,4,go",
        "inf,4,go",
        "0.15,5,go",
        "0.4,,stop",
    )
    series = read(path)
    time_ns, values, _ = columns(series)["Fz [N]"]
    np.testing.assert_array_equal(time_ns, [0, 100_000_000, 150_000_000, 400_000_000])
    np.testing.assert_array_equal(values, [1, np.nan, 5, np.nan])
    report = series.report
    lost = {kind: loss.count for kind, loss in report.balance.losses.items()}
    assert lost == {"unreadable": 1, "of table without a usable time": 2} and report.bad_cells == {"Fz [N]": 1}
    assert "line 4" in report.balance.losses["unreadable"].first and report.skipped == {"state": "text"}
    assert report.first_bad_cell == {"Fz [N]": "line 3: 'broken'"}


@given(
    st.lists(st.sampled_from(["1.5,2", "1.5", "", "time [s],Fz [N],Fx [N]", "over,2"]), max_size=8),
    st.integers(20, 40),
)
@example(["1.5,2", "1.5", "time [s],Fz [N],Fx [N]", "over,2"], 40)
def test_the_first_cell_without_a_number_is_found_where_it_is(rows: list[str], before: int) -> None:
    """Whatever is above it: rows with too few cells, empty lines, headers that are repeated."""
    body = ["1.5,2"] * before + rows + ["over,2"]
    timed = [f"{i / 100},{one}" if one[:1] in ("1", "o") else one for i, one in enumerate(body)]
    lines = ["time [s],Fz [N],Fx [N]", "0,1,2", *timed]
    with tempfile.TemporaryDirectory() as folder:
        series = read(text(Path(folder, "run.csv"), *lines))
        columns(series)
    first = next(i for i, line in enumerate(lines, 1) if line.endswith("over,2"))
    assert series.report.first_bad_cell == {"Fz [N]": f"line {first}: 'over'"}


def parquet(path: Path) -> None:
    metadata = {"unit": "kN"}
    fields = [pa.field("stamp", pa.timestamp("ns", "UTC")), pa.field("Fz", pa.float64(), metadata=metadata)]
    pq.write_table(
        pa.table([pa.array(TIME_NS, pa.int64()).cast(fields[0].type), pa.array(VALUES)], pa.schema(fields)), path
    )


def mat(path: Path) -> None:
    savemat(path, {"Fz": {"time": TIME_NS / 1e9, "data": VALUES, "unit": "kN"}, "note": "x"})


def simulink(path: Path) -> None:
    """Write what Simulink logs as a structure with time."""
    signals = np.zeros(1, [("values", object), ("dimensions", object), ("label", object)])
    signals[0] = (VALUES[:, None], 1.0, "Fz [kN]")
    savemat(path, {"logs": {"time": TIME_NS[:, None] / 1e9, "signals": signals, "blockName": "m/x"}})


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("rack/Fz")
        group["time"], group["values"] = TIME_NS / 1e9, VALUES
        group["values"].attrs["unit"] = "kN"
        file["label"] = "not a number"


def tdms(path: Path) -> None:
    properties = {"wf_start_time": np.datetime64(START_NS, "ns"), "wf_increment": 0.01, "unit_string": "kN"}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("rack", "Fz", VALUES[:20], properties)])
        writer.write_segment([ChannelObject("rack", "Fz", VALUES[20:])])


@pytest.mark.parametrize(
    ("write", "name", "column"),
    [
        (parquet, "run.parquet", "Fz"),
        (mat, "run.mat", "Fz"),
        (simulink, "run.mat", "logs.Fz [kN]"),
        (hdf5, "run.h5", "rack.Fz"),
        (hdf5, "run.mat", "rack.Fz"),
        (tdms, "run.tdms", "rack/Fz"),
    ],
)
def test_the_formats_of_other_programs_come_back(
    tmp_path: Path, write: Callable[[Path], None], name: str, column: str
) -> None:
    write(tmp_path / name)
    series = read(tmp_path / name)
    assert series.report.share == 0
    time_ns, values, unit = columns(series)[column]
    np.testing.assert_allclose(time_ns, TIME_NS, rtol=0, atol=1000)  # float seconds hold a date to 0.24 us
    np.testing.assert_array_equal(values, VALUES)
    assert unit == "kN" or column.endswith("[kN]")
    assert series.report.share == pytest.approx(1)
    assert ("MAT" in series.report.format) == name.endswith(".mat")
    columns(series)
    assert sum(series.report.rows.values()) == len(VALUES), "each reading counts anew"


def test_decimals_and_truth_values_of_a_parquet_file_are_numbers(tmp_path: Path) -> None:
    table = {
        "time [s]": pa.array([Decimal(i) / 100 for i in range(50)], pa.decimal128(9, 2)),
        "F [kN]": pa.array([None, *(Decimal(i) / 2 for i in range(49))], pa.decimal128(9, 1)),
        "on": pa.array([None, *[True, False] * 24, True]),
    }
    pq.write_table(pa.table(table), tmp_path / "run.parquet")
    found = columns(read(tmp_path / "run.parquet"))
    np.testing.assert_array_equal(found["F [kN]"][0], np.arange(50) * 10_000_000)
    np.testing.assert_array_equal(found["F [kN]"][1], [np.nan, *np.arange(49) / 2])
    np.testing.assert_array_equal(found["on"][1], [np.nan, *[1, 0] * 24, 1])


@pytest.mark.parametrize("zone", [None, "UTC", "+02:00"])
def test_stamps_of_a_parquet_file_are_utc_where_they_have_no_zone(tmp_path: Path, zone: str | None) -> None:
    stamps = pa.array(TIME_NS, pa.int64()).cast(pa.timestamp("ns", zone))
    pq.write_table(pa.table({"stamp": stamps, "Fz": VALUES}), tmp_path / "run.parquet")
    series = read(tmp_path / "run.parquet")
    np.testing.assert_array_equal(columns(series)["Fz"][0], TIME_NS)
    assert series.report.remarks() == ["dates have no time zone: they are taken for UTC"] * (zone is None)


def test_a_matrix_of_a_mat_file_is_as_many_columns_as_it_has_channels(tmp_path: Path) -> None:
    both = np.stack([VALUES, 2 * VALUES])
    savemat(tmp_path / "run.mat", {"time": TIME_NS / 1e9, "F": both.T, "G": both})
    found = columns(read(tmp_path / "run.mat"))
    assert set(found) == {"F[0]", "F[1]", "G[0]", "G[1]"}
    for name, values in zip("FG", (VALUES, 2 * VALUES), strict=True):
        np.testing.assert_array_equal(found[f"{name}[{'FG'.index(name)}]"][1], values)


def test_what_is_no_series_in_an_hdf5_file_says_why(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time"], file["F"], file["mass"], file["cube"] = TIME_NS / 1e9, VALUES, [1.0], np.zeros((3, 4, 5))
        file["G"], file["row"], file["column"] = np.stack([VALUES, 2 * VALUES]), VALUES[None], VALUES[:, None]
    series = read(tmp_path / "run.h5")
    skipped = {"mass": "less than two values", "cube": "an array of 3 dimensions"}
    assert series.report.skipped == skipped, "before a row is read"
    found = columns(series)
    assert set(found) == {"F", "G[0]", "G[1]", "row", "column"}
    for name, factor in (("G[1]", 2), ("row", 1), ("column", 1)):
        np.testing.assert_array_equal(found[name][1], factor * VALUES)
    assert series.report.skipped == skipped


def rpc3(path: Path, values: Sequence[FloatArray], scales: Sequence[float], points: int = 16) -> None:
    """Write an RPC III file after its description: header records of 128 bytes, then groups channel by channel."""
    count = len(values[0])
    groups = -(-count // points)
    header = {"FORMAT": "BINARY", "NUM_HEADER_BLOCKS": "4", "NUM_PARAMS": "", "FILE_TYPE": "TIME_HISTORY"}
    header |= {"DELTA_T": "0.01", "CHANNELS": str(len(values)), "PTS_PER_FRAME": str(points)}
    header |= {"PTS_PER_GROUP": str(points), "FRAMES": str(groups), "DATA_TYPE": "SHORT_INTEGER"}
    for i, scale in enumerate(scales, 1):
        header |= {f"DESC.CHAN_{i}": f"F{i}", f"UNITS.CHAN_{i}": "kN", f"SCALE.CHAN_{i}": repr(scale)}
    header["NUM_PARAMS"] = str(len(header))
    records = b"".join(struct.pack("<32s96s", k.encode(), v.encode()) for k, v in header.items())
    data = np.zeros((groups, len(values), points), "<i2")
    for i, (column, scale) in enumerate(zip(values, scales, strict=True)):
        padded = np.resize(np.rint(column / scale), groups * points)
        padded[count:] = 0
        data[:, i] = padded.reshape(groups, points)
    path.write_bytes(records.ljust(4 * 512, b"\0") + data.tobytes())


def test_rpc_iii_comes_back_to_its_resolution(tmp_path: Path) -> None:
    rpc3(tmp_path / "run.rsp", [VALUES, 2 * VALUES], [0.01, 0.02])
    found = columns(read(tmp_path / "run.rsp"))
    time_ns, values, unit = found["F2"]
    np.testing.assert_array_equal(time_ns, np.arange(64) * 10_000_000)
    np.testing.assert_allclose(values[:50], 2 * VALUES, atol=0.0101)
    assert unit == "kN" and (values[50:] == 0).all()


@pytest.mark.parametrize(
    ("key", "value", "what"),
    [
        *((key, "many", f"no number {key}") for key in ("CHANNELS", "DELTA_T", "SCALE.CHAN_1")),
        ("CHANNELS", "512", "no number SCALE.CHAN_2"),
        ("CHANNELS", "513", "CHANNELS = 513"),
    ],
)
def test_a_number_of_an_rpc_iii_header_that_is_none_is_named(tmp_path: Path, key: str, value: str, what: str) -> None:
    rpc3(tmp_path / "run.rsp", [np.resize(VALUES, 9000)], [0.01])
    before, name, behind = (tmp_path / "run.rsp").read_bytes().partition(key.encode().ljust(32, b"\0"))
    (tmp_path / "run.rsp").write_bytes(before + name + value.encode().ljust(96, b"\0") + behind[96:])
    with pytest.raises(RecordingError, match=f"the RPC III header has {what}"):
        read(tmp_path / "run.rsp")


def test_a_cut_rpc_iii_file_gives_its_whole_groups(tmp_path: Path) -> None:
    path = tmp_path / "run.rsp"
    rpc3(path, [VALUES], [0.01])
    path.write_bytes(path.read_bytes()[:-10])
    series = read(path)
    assert len(columns(series)["F1"][1]) == 48
    assert "48 of 64 points" in "\n".join(series.report.remarks())


@pytest.mark.parametrize("more", [0, 1, 31])
def test_what_is_behind_the_last_group_of_an_rpc_iii_file_is_noted(tmp_path: Path, more: int) -> None:
    path = tmp_path / "run.rsp"
    rpc3(path, [VALUES], [0.01])
    path.write_bytes(path.read_bytes() + bytes(more))
    series = read(path)
    assert len(columns(series)["F1"][1]) == 64
    assert series.report.known == (
        [f"{more} bytes behind the last whole group of samples are not read"] if more else []
    )


def test_what_no_column_takes_is_listed_with_its_reason(tmp_path: Path) -> None:
    held = {"cube": np.zeros((2, 2, 2)), "words": np.array(["a", "b"], object), "one": np.zeros(1)}
    expected = {"cube": "an array of 3 dimensions", "words": "no numbers", "one": matlab._SHORT}
    of_mat, of_hdf5 = (SeriesReport(name, "") for name in ("run.mat", "run.h5"))
    assert list(matlab._flattened("", held, {}, of_mat)) == [] and of_mat.skipped == expected
    columns: list[Column] = []
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, values in held.items():
            file[name] = values
        matlab._visit(file, "", columns, of_hdf5)
        file["counts"] = np.arange(3, dtype=np.uint16)
        assert not matlab._matlab_text(file["counts"])
    assert columns == [] and of_hdf5.skipped == expected
    of_bag = SeriesReport("run.bag", "")
    assert not list(_numbers("ranges", np.zeros(65), "/scan", of_bag)) and len(of_bag.skipped) == 1
    with TdmsWriter(tmp_path / "run.tdms") as writer:
        named = [("Fz", np.arange(3.0), {"wf_increment": 0.1}), ("name", ["a", "b", "c"], {})]
        writer.write_segment([ChannelObject("rack", name, cells, more) for name, cells, more in named])
    series = read(tmp_path / "run.tdms")
    assert series.topics == {"table": {"rack/Fz": ""}} and series.report.skipped == {"rack/name": "no numbers"}


def bag(folder: Path, storage: StoragePlugin | None) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE if storage else Stores.ROS1_NOETIC)
    joint, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp_of = store.types["builtin_interfaces/msg/Time"]
    path = folder / ("bag" if storage else "run.bag")
    extra = {} if storage else {"seq": 0}
    with Writer2(path, version=9, storage_plugin=storage) if storage else Writer1(path) as writer:
        connection = writer.add_connection("/wheel_states", joint.__msgtype__, typestore=store)
        for time_ns, value in zip(TIME_NS.tolist(), VALUES.tolist(), strict=True):
            stamp = stamp_of(sec=time_ns // 10**9, nanosec=time_ns % 10**9)
            parts = {name: np.array([0.0, 1.0, value]) for name in ("position", "velocity", "effort")}
            message = joint(header=header(stamp=stamp, frame_id="", **extra), name=["a", "b", "c"], **parts)
            pack = store.serialize_cdr if storage else store.serialize_ros1
            writer.write(connection, time_ns + 5_000_000, pack(message, joint.__msgtype__))
    return path


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3, None])
def test_bags_come_back_by_topic_and_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: StoragePlugin | None
) -> None:
    monkeypatch.setattr("daq.series.readers.bags._ROWS_TOGETHER", 20)
    path = bag(tmp_path, storage)
    series = read(path)
    assert series.topics.keys() == {"/wheel_states"}
    time_ns, values, _ = columns(series)["velocity[2]"]
    np.testing.assert_array_equal(time_ns, TIME_NS)
    np.testing.assert_array_equal(values, VALUES)
    if storage is StoragePlugin.MCAP:
        (inner,) = path.glob("*.mcap")
        np.testing.assert_array_equal(columns(read(inner))["velocity[2]"][1], VALUES)


def test_a_bag_that_breaks_off_keeps_what_was_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, messages = bag(tmp_path, None), AnyReader.messages
    series = read(path)

    def some(reader: AnyReader, connections: object = ()) -> Iterator[object]:
        yield from islice(messages(reader, connections), 20)  # type: ignore[arg-type]
        raise ValueError("a bad chunk")

    monkeypatch.setattr(AnyReader, "messages", some)
    assert columns(series)["velocity[2]"][1].tolist() == VALUES[:20].tolist()
    assert series.report.damage == "after 20 messages the bag cannot be read: a bad chunk"
    assert series.report.balance.lost("behind the damage") == 30
    with pytest.raises(RecordingError, match=r"the bag cannot be read\n.*run\.bag\n.*a bad chunk"):
        read(path)


def test_signs_in_a_text_do_not_part_a_table(tmp_path: Path) -> None:
    rows = [f"{i / 100},{i},{';' * (1 + i % 3)}" for i in range(60)]
    found = columns(read(text(tmp_path / "run.csv", "time [s],a,note", *rows)))
    assert found["a"][1].tolist() == list(range(60))


@pytest.mark.parametrize(
    ("lines", "layout", "what"),
    [
        (("a,b", "1,2", "3,4"), {}, "no column looks like a time"),
        (("a,b", "1,2", "3,4"), {"time": "tme"}, "no column is called 'tme'"),
        (("time,b", "1,2", "3,4"), {}, "the unit of time is not stated"),
        (("time [parsec],b", "1.5,2", "3,4"), {"time": "time [parsec]"}, "the unit of time is not known"),
        (("time,b", "yesterday,2", "today,4"), {}, "the time stamps are not understood"),
        (("just some text", "and more of it"), {}, "not a table"),
        (("time [s],b",), {}, "no row of numbers"),
        (("time [s],b", "nan,1", "nan,2"), {}, "no row could be read"),
    ],
)
def test_what_is_no_series_is_said(tmp_path: Path, lines: tuple[str, ...], layout: dict[str, str], what: str) -> None:
    path = text(tmp_path / "run.csv", *lines)
    with pytest.raises(DataError, match=what):
        columns(read(path, **layout))
    path.write_text("\n".join(lines), encoding="utf-16")
    with pytest.raises(DataError, match="the file is UTF-16 text"):
        read(path, **layout)


@pytest.mark.parametrize("decimals", [1, 2])
def test_seconds_may_be_rounded_so_that_stamps_repeat(tmp_path: Path, decimals: int) -> None:
    rows = [f"{row // 3 / 50:.{decimals}f},{row}" for row in range(300)]
    series = read(text(tmp_path / "run.csv", "time,a", *rows))
    assert columns(series)["a"][0][-1] == round(99 / 50, decimals) * 1e9
    assert any("taken for s" in reading for reading in series.report.readings)
    with pytest.raises(DataError, match="the unit of time is not stated"):
        columns(read(text(tmp_path / "run.csv", "time,a", "0.5,1", "0.5,2")))


@pytest.mark.parametrize("piece", [4 << 20, 60])
@pytest.mark.parametrize("null", ["-", "--", "n/a", "NULL", ""])
def test_a_cell_without_a_number_is_none_and_a_word_is_a_bad_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, null: str, piece: int
) -> None:
    """Far behind the head, and whatever pieces the file is read in."""
    monkeypatch.setattr("daq.series.readers.delimited._PIECE", piece)
    rows = [f"{row / 100},{-1.5 * row},{row % 7}" for row in range(300)]
    rows[250], rows[270] = f"2.5,{null},{null}", "2.7,-405.0,word"
    series = read(text(tmp_path / "run.csv", "time [s],a,b", *rows))
    found = columns(series)
    assert series.report.bad_cells == {"b": 1} and series.report.first_bad_cell == {"b": "line 272: 'word'"}
    for name, none in (("a", [250]), ("b", [250, 270])):
        assert np.flatnonzero(np.isnan(found[name][1])).tolist() == none
    assert np.array_equal(np.delete(found["a"][1], 250), -1.5 * np.delete(np.arange(300), 250))


def test_a_rate_stands_for_a_missing_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.series.readers.delimited._PIECE", 20)
    rows = [f"{row},{2 * row}" for row in range(30)]
    time_ns, values, _ = columns(read(text(tmp_path / "run.csv", "a,b", *rows), rate_hz=200.0))["b"]
    assert time_ns.tolist() == list(range(0, 150_000_000, 5_000_000)) and values.tolist() == list(range(0, 60, 2))
    pq.write_table(pa.table({"b": [2.0, 4.0]}), tmp_path / "run.parquet")
    time_ns, values, _ = columns(read(tmp_path / "run.parquet", rate_hz=200.0))["b"]
    assert time_ns.tolist() == [0, 5_000_000] and values.tolist() == [2, 4]


@pytest.mark.parametrize("write", [parquet, tdms, *(pytest.param(one, marks=pytest.mark.slow) for one in (mat, hdf5))])
@pytest.mark.parametrize("kept", [0.98, 0.5, 0.05])
def test_a_cut_file_is_our_error_or_a_remark(tmp_path: Path, write: Callable[[Path], None], kept: float) -> None:
    suffix = {parquet: ".parquet", mat: ".mat", hdf5: ".h5", tdms: ".tdms"}[write]
    path = tmp_path / f"run{suffix}"
    write(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    try:
        found = columns(read(path))
    except (RecordingError, DataError) as error:
        assert str(path) in str(error)
    else:
        assert all(len(values) <= len(VALUES) for _, values, _ in found.values())


@pytest.mark.parametrize(
    ("waiting", "times", "rows"),
    [(1 << 28, 0, 1 << 16), (4 << 20, 3, 1 << 16), (4 << 20, 3, 1000), (220_000, 3, 1 << 16), (0, 0, 1 << 16)],
)
def test_channels_of_a_tdms_file_come_as_its_library_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waiting: int, times: int, rows: int
) -> None:
    """At once, in the order of the file or, where too much would wait, each by itself; again after half a reading."""
    monkeypatch.setattr("daq.series.readers.tdms._MOST_WAITING_BYTES", waiting)
    monkeypatch.setattr("daq.series.readers.groups.BLOCK_ROWS", rows)
    in_order, data_chunks = [], TdmsFile.data_chunks
    monkeypatch.setattr(TdmsFile, "data_chunks", lambda file: in_order.append(file) or data_chunks(file))
    path, rng, clock = tmp_path / "run.tdms", np.random.default_rng(1), {"wf_increment": 0.001}
    with TdmsWriter(path) as writer:
        for segment in range(30):
            fast = [ChannelObject("fast", name, rng.normal(size=3000), clock) for name in "xy"]
            slow = [ChannelObject("slow", "z", rng.integers(0, 9, 100), clock), ChannelObject("slow", "note", ["text"])]
            writer.write_segment(fast + slow[segment % 2 :])
    series = read(path)
    assert set(series.report.skipped) == {"slow/note"}
    whole = columns(series)
    next(series.blocks())
    again = columns(series)
    assert len(in_order) == times
    handles = Path("/proc/self/fd")
    assert not handles.is_dir() or str(path) not in {os.path.realpath(one) for one in handles.iterdir()}, "it is closed"
    for group in TdmsFile.read(path).groups():
        for channel in group.channels():
            if channel.name != "note":
                for found in (whole, again):
                    assert np.array_equal(found[f"{group.name}/{channel.name}"][1], channel[:])


@pytest.mark.parametrize(("megabytes", "at_once"), [(1, True), (65, False)])
def test_a_tdms_file_that_may_take_256_mb_as_numbers_is_not_read_at_once(
    tmp_path: Path, megabytes: int, at_once: bool
) -> None:
    path = tmp_path / "run.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("g", "x", np.zeros(megabytes << 19, np.int16), {"wf_increment": 0.001})])
    opened = _OpenFile(path)
    opened.close()
    assert opened.whole == at_once


def test_a_tdms_file_that_is_written_again_is_read_as_it_is_now(tmp_path: Path) -> None:
    path, clock = tmp_path / "run.tdms", {"wf_increment": 0.001}
    opened = []
    for factor in (1.0, 2.0):
        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("g", "x", factor * VALUES, clock)])
        os.utime(path, (factor, factor))
        opened += [] if opened else [read(path)]
    assert columns(opened[0])["g/x"][1].tolist() == (2 * VALUES).tolist()


def test_a_damaged_tdms_file_that_its_library_cannot_read_at_once_is_read_in_parts(tmp_path: Path) -> None:
    path, clock = tmp_path / "run.tdms", {"wf_increment": 0.001}
    with TdmsWriter(path) as writer:
        for count in (30, 40):
            writer.write_segment([ChannelObject("g", name, np.arange(float(count)), clock) for name in "xy"])
    head, _, tail = path.read_bytes().rpartition(b"'y'")
    path.write_bytes(head + b"'y?" + tail)
    with pytest.raises(KeyError):
        TdmsFile.read(path)
    assert columns(read(path))["g/x"][1].tolist() == [*range(30), *range(40)]


@pytest.mark.slow
def test_the_process_that_opens_a_file_goes_on_to_its_rows_and_only_one_waits(tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        hdf5(tmp_path / name)
    children, before = Path(f"/proc/self/task/{os.getpid()}/children"), set[str]()
    if not children.is_file():
        pytest.skip("this kernel does not list children")

    def started() -> set[str]:
        return set(children.read_text().split()) - before

    before = started()
    one, other = read(tmp_path / "a.h5"), read(tmp_path / "b.h5")
    [waiting] = started()
    rows = other.blocks()
    next(rows)
    assert started() == {waiting}
    assert list(rows) == [()] and not started()
    for series in (one, other):
        assert columns(series)["rack.Fz"][1] == pytest.approx(VALUES)
    assert not started()


@given(st.binary(max_size=300))
def test_noise_is_our_error(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    folder = tmp_path_factory.mktemp("noise")
    heads = (
        b"PAR1",
        b"TDSm",
        b"FORMAT\0",
        b"#ROSBAG V2.0\n",
        b"time,a\n1,",
    )
    for i, head in enumerate(heads):
        path = folder / f"run{i}.csv"
        path.write_bytes(head + data)
        try:
            columns(read(path, time_unit="s"))
        except WheelsoilError as error:
            assert isinstance(error, (RecordingError, DataError, ConfigError))


def test_logs_of_frames_are_no_series(tmp_path: Path) -> None:
    log = text(tmp_path / "log.csv", "timestamp,arbitration_id,extended,remote,error,dlc,data", "1.0,0x1,0,0,0,1,AA==")
    assert series_format(log) is None
    assert series_format(tmp_path / "missing.csv") is None
    assert series_format(tmp_path) is None


def test_an_error_on_the_way_says_after_which_row() -> None:
    def rows() -> Iterator[tuple[SeriesBlock, ...]]:
        yield (series.report.taken(SeriesBlock("a", np.arange(3), {}), np.ones(3, np.bool_)),)
        raise OSError("it is gone")

    series = Series({"a": {}}, rows, SeriesReport("run.x", "X"))
    with pytest.raises(RecordingError, match=r"run\.x, after row 3"):
        list(series.blocks())


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO])
def test_a_table_that_cannot_be_opened_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    path = text(tmp_path / "run.csv", "time [s],a", "0.0,1", "0.5,2")
    series = read(path)

    def refused(*_: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr("daq.series.readers.delimited.unpacked", refused)
    with pytest.raises(RecordingError) as caught:
        list(series.blocks())
    assert caught.value.faults[0].found == os.strerror(number)


def test_a_parquet_file_with_a_broken_name_is_our_error(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"time": [0.0, 0.1], "Fz": [1.0, 2.0]}), path)
    path.write_bytes(path.read_bytes().replace(b"Fz", b"F\xff"))
    with pytest.raises(RecordingError, match="the file cannot be read"):
        read(path)


@pytest.mark.parametrize("head", [b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n"])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_noise_in_a_file_for_a_c_library_is_our_error(tmp_path: Path, head: bytes, seed: int) -> None:
    path = tmp_path / "run.mat"
    path.write_bytes(head + np.random.default_rng(seed).bytes(500))
    with pytest.raises((RecordingError, DataError), match="file cannot be read"):
        columns(read(path))


@pytest.mark.parametrize(
    ("crash", "found"),
    [
        ("import os; os.abort()", "signal SIGABRT"),
        pytest.param("while True: pass", "it gave nothing for", marks=pytest.mark.slow),
        ("raise ValueError('the block at 12 is none')", "the block at 12 is none"),
        pytest.param("[bytearray(1 << 30) for _ in range(64)]", "GB of memory", marks=pytest.mark.slow),
    ],
)
def test_a_library_that_breaks_down_is_an_error(
    tmp_path: Path, crash: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "breaking.py").write_text(f"def read(path, layout, report):\n    {crash}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(daq.child_process, "LIBRARY_PATIENCE_S", 3.0 if "nothing" in found else 60.0)
    mat(tmp_path / "run.mat")
    with pytest.raises(RecordingError, match=found) as caught:
        apart("breaking:read")(tmp_path / "run.mat", SeriesSection(), SeriesReport("run.mat", "MATLAB"))
    assert "run.mat" in str(caught.value)


def test_channel_groups_of_an_mf4_file_that_share_their_name_keep_all_their_channels(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="the extra wheelsoil[mf4] is not installed")
    path, time_s = tmp_path / "run.mf4", np.arange(200) / 50.0
    with asammdf.MDF(version="4.10") as file:
        for name, unit, rows in (("FZ", "kN", 200), ("v", "m/s", 100)):
            channel = asammdf.Signal(np.sin(time_s[:rows]), time_s[:rows], unit=unit, name=name)
            file.append([channel], acq_name="wheel")
        file.save(path)
    series = read_series(path)
    assert series.topics == {"wheel": {"FZ": "kN"}, "wheel_2": {"v": "m/s"}}
    found = {name: one for blocks in series.blocks() for block in blocks for name, one in block.columns.items()}
    assert found["FZ"] == pytest.approx(np.sin(time_s)[-len(found["FZ"]) :])
    assert series.report.rows == {"wheel": 200, "wheel_2": 100}
