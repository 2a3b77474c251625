"""Tables come back with their numbers, text and units."""

from __future__ import annotations

import csv
import resource

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daq import ConfigError, DataError, HardwareError
from daq.series import write_blocks, write_table

COLUMNS = {
    "time_ns": np.array([1_700_000_000_000_000_001, 2, -3]),
    "slip": np.array([0.1, np.nan, -1 / 3]),
    "Wheel.Speed [rpm]": np.array([1e300, 5e-324, -0.0]),
    "used": np.array([True, False, True]),
    "reason": np.array(["", "GAP, long", 'say "no"']),
}
UNITS = {"time_ns": "ns", "slip": "", "Wheel.Speed [rpm]": "1/min"}


def test_parquet_round_trip(tmp_path):
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(write_table(tmp_path / "t.parquet", COLUMNS, UNITS))
    for name, column in COLUMNS.items():
        np.testing.assert_array_equal(table[name].to_numpy(), column)
        assert table.schema.field(name).metadata[b"unit"].decode() == UNITS.get(name, "")


@settings(max_examples=30, deadline=None)
@given(arrays(np.float64, st.integers(0, 20)))
def test_csv_keeps_every_digit(csv_folder, values):
    path = write_table(csv_folder / "t.csv", {"v": values, "n": np.arange(len(values))}, {"v": "N"})
    with path.open(newline="") as file:
        head, *rows = list(csv.reader(file))
    assert head == ["v [N]", "n"]
    np.testing.assert_array_equal([float(row[0] or "nan") for row in rows], values)


@pytest.fixture(scope="module")
def csv_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("csv")


def test_csv_text(tmp_path):
    with write_table(tmp_path / "t.CSV", COLUMNS, UNITS).open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time_ns [ns]", "slip", "Wheel.Speed [rpm] [1/min]", "used", "reason"]
    assert [row[4] for row in rows[1:]] == COLUMNS["reason"].tolist()
    assert rows[1][0] == "1700000000000000001"


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_blocks_of_rows_make_the_table_that_the_whole_makes(tmp_path, suffix):
    import pyarrow.csv
    import pyarrow.parquet

    rows = [slice(0, 1), slice(1, 3), slice(3, 3)]
    blocks = ({name: column[part] for name, column in COLUMNS.items()} for part in rows)
    paths = (
        write_table(tmp_path / f"whole{suffix}", COLUMNS, UNITS),
        write_blocks(tmp_path / f"b{suffix}", blocks, UNITS),
    )
    read = pyarrow.parquet.read_table if suffix == ".parquet" else pyarrow.csv.read_csv
    whole, parts = map(read, paths)
    assert whole.schema.equals(parts.schema, check_metadata=True)
    assert str(whole.to_pydict()) == str(parts.to_pydict())  # NaN is not equal to itself


def test_a_bad_block_is_refused_wherever_it_comes(tmp_path):
    good, bad = {"a": np.zeros(2), "b": np.zeros(2)}, {"a": np.zeros(2), "b": np.zeros(3)}
    with pytest.raises(DataError, match="one length"):
        write_blocks(tmp_path / "t.parquet", [good, bad])


def test_mat_round_trip(tmp_path):
    from scipy.io import loadmat

    columns = {**COLUMNS, "units": np.zeros(3), "x" * 70: np.ones(3), "x" * 69 + "y": np.ones(3) * 2}
    found = loadmat(write_table(tmp_path / "t.mat", columns, UNITS), squeeze_me=True, simplify_cells=True)
    names = found["names"]
    assert sorted(names.values()) == sorted(columns)
    for short, name in names.items():
        np.testing.assert_array_equal([x if len(np.shape(x)) == 0 else "" for x in found[short]], columns[name])
    units = {names[short]: unit for short, unit in found["units"].items() if len(unit)}
    assert units == {name: unit for name, unit in UNITS.items() if unit}


def test_faults_are_reported(tmp_path):
    with pytest.raises(ConfigError, match=r"\.parquet, \.csv, \.mat"):
        write_table(tmp_path / "t.xlsx", COLUMNS)
    with pytest.raises(ConfigError, match="a file without a suffix"):
        write_table(tmp_path / "t", COLUMNS)
    for suffix in (".parquet", ".csv", ".mat"):
        with pytest.raises(ConfigError, match="cannot be made"):
            write_table(tmp_path / "nowhere" / f"t{suffix}", COLUMNS)
        (tmp_path / f"folder{suffix}").mkdir()
        with pytest.raises(ConfigError, match="cannot be made"):
            write_table(tmp_path / f"folder{suffix}", COLUMNS)
    with pytest.raises(DataError, match="of one length"):
        write_table(tmp_path / "t.csv", {"a": np.zeros(2), "b": np.zeros(3)})
    with pytest.raises(DataError, match="nearest: slip"):
        write_table(tmp_path / "t.csv", COLUMNS, {"slipp": "1"})


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".mat"])
def test_a_full_disk_is_reported(tmp_path, suffix):
    """RLIMIT_FSIZE makes the kernel refuse to write on, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    columns = {"v": np.random.default_rng(0).random(100_000)}
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
        with pytest.raises(HardwareError, match="free the disk"):
            write_table(tmp_path / f"t{suffix}", columns)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("suffix", ["parquet", "csv", "mat"])
@pytest.mark.parametrize("failure", [KeyboardInterrupt, OSError, DataError])
def test_a_table_that_is_not_finished_leaves_what_was_there(tmp_path, suffix, failure):
    def blocks():
        yield {"a": np.arange(5.0)}
        raise failure("in the middle")

    path = tmp_path / f"t.{suffix}"
    for before in (None, b"an older table"):
        if before is not None:
            path.write_bytes(before)
        with pytest.raises(HardwareError if failure is OSError else failure):
            write_blocks(path, blocks())
        assert [one.read_bytes() for one in tmp_path.iterdir()] == ([] if before is None else [before])


def test_a_table_is_written_through_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    link = tmp_path / "t.csv"
    link.symlink_to(tmp_path / "there" / "real.csv")
    assert write_table(link, {"a": np.arange(2)}) == link
    assert link.is_symlink()
    assert (tmp_path / "there" / "real.csv").read_text() == '"a"\n0\n1\n'
