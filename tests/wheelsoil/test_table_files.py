"""Tables of several wheels: columns and wheel files are honoured or refused, never read as one wheel."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_support import invoke
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from property_settings import examples

from daq import ConfigError, DataError, VehicleConfig, parse_toml
from daq.series import read_wheel_table, read_wheel_tables
from model.diagnosis import Lugs
from wheelsoil.workflows import TableFiles, bench_of, read_benches

HEAD = "slip,vertical_load_n,drawbar_pull_n"
ROWS = "0.1,100,5\n0.3,100,12\n0.5,100,14\n"


def table(folder: Path, text: str, name: str = "rows.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def wheel_file(folder: Path, name: str = "wheel.toml", radius: float = 0.1, more: str = "") -> str:
    path = folder / name
    path.write_text(f"[wheel]\nradius_m = {radius}\nwidth_m = 0.08\n{more}\n")
    return str(path)


def two_wheels(folder: Path, columns: str, first: str, second: str) -> Path:
    rows = [f"{s},100,5,{cells}" for cells in (first, second) for s in (0.1, 0.3)]
    return table(folder, "\n".join([f"{HEAD},{columns}", *rows, ""]))


def test_columns_alone_describe_the_wheels(tmp_path: Path) -> None:
    path = two_wheels(
        tmp_path, "wheel,radius_m,width_m,lug_height_m", "smooth,0.157,0.165,0", "lugged,0.157,0.165,0.01"
    )
    smooth, lugged = map(bench_of, read_benches([path], TableFiles(soil="lunar")))
    assert (smooth.name, lugged.name) == ("rows, smooth", "rows, lugged")
    assert (smooth.tyre, lugged.tyre) == ("smooth", "lugged")
    assert lugged.lugs == Lugs(0.01)
    assert smooth.lugs is None
    assert smooth.wheel.radius_m == 0.157
    assert smooth.lines == (2, 3)
    assert lugged.lines == (4, 5)


def test_a_wheel_file_for_each_name(tmp_path: Path) -> None:
    path = two_wheels(tmp_path, "wheel", "smooth", "lugged")
    files = (f"smooth={wheel_file(tmp_path, 'a.toml')}", f"lugged={wheel_file(tmp_path, 'b.toml', 0.2)}")
    found = read_benches([path], TableFiles(files, soil="lunar"))
    assert [one.wheel.radius_m for one in found] == [0.1, 0.2]
    with pytest.raises(ConfigError, match="a wheel has no file"):
        read_benches([path], TableFiles(files[:1], soil="lunar"))


def test_a_wheel_file_for_each_table(tmp_path: Path) -> None:
    paths = [table(tmp_path, f"{HEAD}\n{ROWS}", name) for name in ("a.csv", "b.csv")]
    files = (wheel_file(tmp_path, "a.toml"), wheel_file(tmp_path, "b.toml", 0.2))
    found = read_benches(paths, TableFiles(files, soil="lunar"))
    assert [(one.name, one.wheel.radius_m) for one in found] == [("a", 0.1), ("b", 0.2)]
    again = read_benches([paths[0], paths[0]], TableFiles(files, soil="lunar"))
    assert [one.name for one in again] == ["a (1)", "a (2)"]
    with pytest.raises(ConfigError, match="2 times --vehicle for 3 tables"):
        read_benches([*paths, paths[0]], TableFiles(files, soil="lunar"))


@pytest.mark.parametrize(
    ("columns", "cells", "more", "said"),
    [
        ("wheel", ("smooth", "lugged"), "", "rows of several wheels, and one wheel file"),
        ("radius_m", ("0.1", "0.2"), "", "column 'radius_m' contradicts the wheel file"),
        ("width_m", ("0.1", "0.1"), "", "column 'width_m' contradicts the wheel file"),
        ("lug_height_m", ("0.01", "0.01"), 'tyre = "smooth"', "contradicts lug_height_m"),
        ("lug_height_m", ("0.01", "0.01"), "lug_height_m = 0.02", "column 'lug_height_m' contradicts the wheel file"),
    ],
)
def test_what_contradicts_is_refused(
    tmp_path: Path, columns: str, cells: tuple[str, str], more: str, said: str
) -> None:
    path = two_wheels(tmp_path, columns, *cells)
    with pytest.raises(ConfigError, match=said):
        read_benches([path], TableFiles((wheel_file(tmp_path, more=more),), soil="lunar"))


def test_a_column_that_no_table_has_is_refused(tmp_path: Path) -> None:
    paths = [two_wheels(tmp_path, "lug_height_m", "0", "0")] * 2
    with pytest.raises(ConfigError, match="--where: no table has a column 'gravel'"):
        read_benches(paths, TableFiles((wheel_file(tmp_path),), soil="lunar"), where=["gravel=1"])


def test_a_height_that_varies_makes_two_wheels_of_one_file(tmp_path: Path) -> None:
    path = two_wheels(tmp_path, "lug_height_m", "0", "0.01")
    found = read_benches([path], TableFiles((wheel_file(tmp_path),), soil="lunar"))
    assert [one.wheel_section.tread for one in found] == ["smooth", "lugged"]
    assert [one.name for one in found] == ["rows, lug_height_m 0", "rows, lug_height_m 0.01"]


def test_one_wheel_is_asked_for_where_one_is_expected(tmp_path: Path) -> None:
    path = two_wheels(tmp_path, "lug_height_m", "0", "0.01")
    with pytest.raises(ConfigError, match="the rows are of several wheels"):
        read_wheel_table(path)
    said = invoke("fit", "--table", path, "--vehicle", wheel_file(tmp_path), "--soil", "lunar")
    assert said.code == 2
    assert "several wheels" in said.err
    assert "next: choose the rows of one" in said.err


def test_sinkage_takes_each_wheel_of_a_table_in_turn(tmp_path: Path) -> None:
    lines = [f"{s},25,3,0.8,{r},0.1" for r in (0.1, 0.2) for s in (0.1, 0.3, 0.5)]
    head = "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm,radius_m,width_m"
    (tmp_path / "two.csv").write_text("\n".join([head, *lines]))
    found = invoke("sinkage", "--table", tmp_path / "two.csv", "--json").json
    assert [(one["wheel"], one["wheel_size"]["radius_m"], len(one["bins"])) for one in found] == [
        ("two, radius_m 0.1", 0.1, 3),
        ("two, radius_m 0.2", 0.2, 3),
    ]
    said = invoke("sinkage", "--table", tmp_path / "two.csv").out
    assert said.startswith("wheel two, radius_m 0.1\n") and "\nwheel two, radius_m 0.2\n" in said


SIZE = st.sampled_from(["", "0.1", "0.15"])


@examples(40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.sampled_from("ab"), SIZE, SIZE), min_size=1, max_size=8))
def test_rows_of_one_part_agree_and_none_is_lost(tmp_path: Path, wheels: list[tuple[str, str, str]]) -> None:
    rows = [f"0.{i},100,5,{','.join(cells)}" for i, cells in enumerate(wheels)]
    path = table(tmp_path, "\n".join([f"{HEAD},wheel,radius_m,width_m", *rows, ""]))
    parts = read_wheel_tables(path)
    assert len(parts) == len(set(wheels))
    assert sorted(line for part in parts for line in part.lines) == list(range(2, 2 + len(wheels)))
    for part in parts:
        cells = {wheels[line - 2] for line in part.lines}
        assert len(cells) == 1
        name, radius, width = cells.pop()
        assert part.wheel == name
        declared = {k: float(v) for k, v in (("radius_m", radius), ("width_m", width)) if v}
        assert part.sizes == declared


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("lug_height_m = 0.1", "not below radius_m"),
        ('tyre = "lugged"\nlug_height_m = 0.0', "contradicts lug_height_m"),
        ("lug_count = 12", "needs lug_height_m"),
    ],
)
def test_lugs_that_cannot_be(tmp_path: Path, more: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_toml(Path(wheel_file(tmp_path, more=more)).read_text(), VehicleConfig, "wheel.toml")


def test_lug_columns_that_cannot_be(tmp_path: Path) -> None:
    path = table(tmp_path, f"{HEAD},radius_m,lug_height_m\n0.1,100,5,0.1,0.1\n")
    with pytest.raises(DataError, match="lugs lower than the wheel's radius"):
        read_wheel_table(path)


def test_declared_lugs_shear_a_circle_between_rim_and_tips() -> None:
    """30 lugs of 10 mm on 157 mm hold 53 % of what is between them; 100 hold all of it."""
    assert Lugs(0.01).sheared_m(0.157) == 0.01
    assert Lugs(0.01, 30).sheared_m(0.15735) == pytest.approx(0.01 * 30 * 3**0.5 * 0.01 / (2 * 3.14159265 * 0.15735))
    assert Lugs(0.01, 100).sheared_m(0.157) == 0.01
