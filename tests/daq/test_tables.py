from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import ConfigError, DataError
from daq.series import SharedOptions, parse_rename, parse_where
from daq.series.tables import Source, read_table

numbers = st.floats(allow_nan=False, allow_infinity=False)


def _write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


@settings(deadline=None)
@given(
    st.lists(st.tuples(numbers, numbers), min_size=1, max_size=20),
    st.sampled_from(",;\t"),
    st.sampled_from(["\n", "\r\n"]),
    st.booleans(),
)
def test_numbers_come_back_as_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]], delimiter: str, end: str, trailing: bool
) -> None:
    tail = delimiter if trailing else ""
    lines = [f"a{delimiter} b {tail}", *(f"{a!r}{delimiter}{b!r}{tail}" for a, b in rows)]
    path = tmp_path_factory.mktemp("t") / "t.csv"
    path.write_bytes(b"\xef\xbb\xbf# note\r\n\r\n" + end.join(lines).encode() + b"\n")
    values = read_table(path).numbers(["a", "b"])
    assert np.column_stack([values["a"], values["b"]]).tolist() == [list(row) for row in rows]


def test_rename_takes_another_column_and_unit(tmp_path: Path) -> None:
    path = _write(tmp_path, "z_mm,F,a\n10,-3,x\n20,-5,y\n")
    table = read_table(path, rename=parse_rename(["sinkage_m=z_mm*0.001,force_n=F*-1"]))
    values = table.numbers(["sinkage_m", "force_n", "z_mm"])
    assert values["sinkage_m"].tolist() == [0.01, 0.02]
    assert values["force_n"].tolist() == [3, 5]
    assert values["z_mm"].tolist() == [10, 20]


def test_rename_may_keep_the_name(tmp_path: Path) -> None:
    table = read_table(_write(tmp_path, "sinkage_m\n12\n"), rename={"sinkage_m": Source("sinkage_m", 1e-3)})
    assert table.numbers(["sinkage_m"])["sinkage_m"].tolist() == [0.012]


def test_where_compares_numbers_as_numbers_and_words_as_words(tmp_path: Path) -> None:
    path = _write(tmp_path, "wheel,beta,y\nsmooth,0.0,1\nsmooth,15,2\ngrouser,0,3\n")
    assert read_table(path, where=parse_where(["wheel=smooth,beta=0"])).numbers(["y"])["y"].tolist() == [1]
    assert read_table(path, where=parse_where(["beta=0"])).numbers(["y"])["y"].tolist() == [1, 3]


def test_missing_cells_are_nan_where_the_column_is_optional(tmp_path: Path) -> None:
    table = read_table(_write(tmp_path, "a,b\n1,\n2,nan\n3,-\n4,7\n"))
    values = table.numbers(["a"], ["b", "c"])
    assert np.isnan(values["b"]).tolist() == [True, True, True, False]
    assert "c" not in values


def test_groups_keep_their_order_and_lines(tmp_path: Path) -> None:
    table = read_table(_write(tmp_path, "test,y\nb,1\na,2\nb,3\n"))
    parts = dict(table.groups("test"))
    assert list(parts) == ["b", "a"]
    assert parts["b"].lines == (2, 4)
    assert [name for name, _ in table.groups("no such column")] == [""]


@pytest.mark.parametrize(
    ("text", "keywords", "kind", "words"),
    [
        ("", {}, DataError, "the table is empty"),
        ("# only a note\n\n", {}, DataError, "the table is empty"),
        ("a,b\n", {}, DataError, "no rows"),
        ("a,a\n1,2\n", {}, DataError, "'a' is there twice"),
        ("a,b\n1\n", {}, DataError, "1 cells in a table of 2 columns"),
        ("a,b\n1,2,3\n", {}, DataError, "line 2"),
        ('a,b\n"1,2\n', {}, DataError, "not a CSV file"),
        ("slip,b\n1,2\n", {}, ConfigError, "'a' is missing"),
        ("a,b\n1,2\nx,2\n", {}, DataError, "line 3: 'x'"),
        ("a,b\n1,2\n,2\n", {}, DataError, "line 3: ''"),
        ("a,b\nNaN,2\n", {}, DataError, "line 2: 'NaN'"),
        ("a,b\ninf,2\n", {}, DataError, "line 2: 'inf'"),
        ("a;b\n1,5;2\n", {}, DataError, "decimal points instead of commas"),
        ("a,b\n1,2\n", {"rename": {"c": Source("bb")}}, ConfigError, "no column 'bb'"),
        ("a,b\n1,2\n", {"where": {"bb": "1"}}, ConfigError, "nearest: b"),
        ("a,b\n1,2\n", {"where": {"b": "3"}}, ConfigError, "no row is left"),
    ],
)
def test_bad_tables_are_distinguished(
    tmp_path: Path, text: str, keywords: dict[str, dict[str, object]], kind: type[Exception], words: str
) -> None:
    path = _write(tmp_path, text)
    with pytest.raises(kind, match=words):
        read_table(path, **keywords).numbers(["a", "b"])  # type: ignore[arg-type]


def test_all_faults_of_a_table_are_listed_together(tmp_path: Path) -> None:
    table = read_table(_write(tmp_path, "a,b,slipp\nx,y,1\n"))
    with pytest.raises(DataError, match="2 faults"):
        table.numbers(["a", "b"])
    with pytest.raises(ConfigError, match=r"2 faults(.|\n)*nearest: slipp(.|\n)*--rename slip=COLUMN"):
        table.numbers(["slip", "load"])


def test_many_bad_cells_are_counted(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="and 4 more"):
        read_table(_write(tmp_path, "a\n" + "x\n" * 9)).numbers(["a"])


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(ConfigError, match="cannot be read"):
        read_table(tmp_path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(ConfigError, match="save it as CSV"):
        read_table(binary)


@pytest.mark.parametrize("text", ["a", "=b", "a=", "a=b*c", "a=b*0", "a=b*inf"])
def test_rename_that_is_not_understood(text: str) -> None:
    with pytest.raises(ConfigError, match="--rename"):
        parse_rename([text])


def test_options_that_are_not_understood_are_listed_together() -> None:
    with pytest.raises(ConfigError, match="2 faults"):
        parse_where(["a", "b=1,c"])
    assert parse_rename([]) == {}
    assert parse_where(["a = x , b=2"]) == {"a": "x", "b": "2"}


def test_options_for_several_tables_hold_where_they_fit() -> None:
    options = SharedOptions(["sinkage_m=z_mm*0.001", "tau=t"], ["test=1"])
    assert options.fitting(["z_mm", "force_n"]) == ({"sinkage_m": Source("z_mm", 1e-3)}, {})
    with pytest.raises(ConfigError, match=r"2 faults(.|\n)*--rename: no table has a column 't'(.|\n)*'test'"):
        options.refuse_unused()
    assert options.fitting(["t", "test"]) == ({"tau": Source("t")}, {"test": "1"})
    options.refuse_unused()
    assert SharedOptions(["b=a"], ["b=3"]).fitting(["a"]) == ({"b": Source("a")}, {"b": "3"})
