from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import data_dir

from daq import ConfigError, DataError
from daq.series import (
    parse_rename,
    parse_where,
    read_plate_tests,
    read_shear_tests,
    read_wheel_table,
    read_wheel_tables,
)


def _write(folder: Path, text: str, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# --- single-wheel tests ----------------------------------------------------------------------------------------------


def test_a_wheel_table_with_all_there_is(tmp_path: Path) -> None:
    text = (
        "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm,sinkage_m,group,drawbar_pull_n_sigma\n"
        "0.1,100,5,2,0.01,dry,0.5\n0.2,110,6,,0.02,wet,\n0.3,120,7,4,,dry,0.7\n"
    )
    table = read_wheel_table(_write(tmp_path, text))
    assert len(table) == 3
    assert table.vertical_load_n.tolist() == [100, 110, 120]
    assert np.isnan(table.driving_torque_nm).tolist() == [False, True, False]
    assert np.isnan(table.sinkage_m).tolist() == [False, False, True]
    assert (table.group.tolist(), table.group_names) == ([0, 1, 0], ("dry", "wet"))
    assert list(table.sigma) == ["drawbar_pull_n"]
    assert np.isnan(table.sigma["drawbar_pull_n"]).tolist() == [False, True, False]


def test_a_bare_wheel_table_is_one_group_without_torque(tmp_path: Path) -> None:
    table = read_wheel_table(_write(tmp_path, "slip,vertical_load_n,drawbar_pull_n\n0.1,100,5\n"))
    assert np.isnan(table.driving_torque_nm).all()
    assert np.isnan(table.sinkage_m).all()
    assert table.group_names == ("",)
    assert table.sigma == {}


@given(st.lists(st.sampled_from(["0.1", "0.2", "0.3"]), min_size=1, max_size=8))
def test_each_wheel_has_its_own_rows(tmp_path_factory: pytest.TempPathFactory, radii: list[str]) -> None:
    rows = [f"0.1,{100 + i},5,{radius}" for i, radius in enumerate(radii)]
    text = "\n".join(["slip,vertical_load_n,drawbar_pull_n,radius_m", *rows, ""])
    tables = read_wheel_tables(_write(tmp_path_factory.mktemp("table"), text))
    assert [table.sizes["radius_m"] for table in tables] == list(map(float, dict.fromkeys(radii)))
    for table in tables:
        own = [i for i, radius in enumerate(radii) if float(radius) == table.sizes["radius_m"]]
        assert list(table.lines) == [i + 2 for i in own] and table.vertical_load_n.tolist() == [i + 100 for i in own]


@pytest.mark.parametrize(
    ("rows", "kind", "words"),
    [
        ("0.1,-5,5", DataError, "'vertical_load_n' has impossible values"),
        ("0.1,0,5", DataError, "a positive load"),
        ("0.1,nan,5", DataError, "line 2: 'nan'"),
        ("15,100,5", DataError, "a slip from -1 to 1"),
        ("15,-100,5", DataError, "2 faults"),
        ("0.1,abc,5", DataError, "line 2: 'abc'"),
    ],
)
def test_impossible_wheel_rows(tmp_path: Path, rows: str, kind: type[Exception], words: str) -> None:
    path = _write(tmp_path, f"slip,vertical_load_n,drawbar_pull_n\n{rows}\n")
    with pytest.raises(kind, match=words):
        read_wheel_table(path)


def test_a_negative_sigma_is_refused(tmp_path: Path) -> None:
    path = _write(tmp_path, "slip,vertical_load_n,drawbar_pull_n,slip_sigma\n0.1,100,5,-1\n")
    with pytest.raises(DataError, match="slip_sigma"):
        read_wheel_table(path)


def test_the_public_test_bed_by_its_own_names() -> None:
    table = read_wheel_table(
        data_dir("cmu-terramech-testbed", "wheel_trials.csv"),
        rename=parse_rename(
            ["vertical_load_n=load_N,drawbar_pull_n=drawbar_pull_N,sinkage_m=sinkage_mm*0.001,group=Vry_nominal_mm_s"]
        ),
        where=parse_where(["wheel=smooth,beta_deg=0"]),
    )
    assert len(table) == 27
    assert len(table.group_names) == 9
    driven = table.slip > 0.85
    assert np.mean(table.drawbar_pull_n[driven]) == pytest.approx(1.51, abs=0.01)  # physics: 1.51 N, 25.73 mm
    assert np.mean(table.sinkage_m[driven]) == pytest.approx(0.02573, abs=1e-5)


# --- plates ----------------------------------------------------------------------------------------------------------


def test_a_force_becomes_a_pressure_on_a_round_plate(tmp_path: Path) -> None:
    (test,) = read_plate_tests(_write(tmp_path, "sinkage_m,force_n\n0,0\n0.01,50\n"), radius_m=0.05)
    assert test.width_m == 0.05
    assert test.pressure_pa.tolist() == pytest.approx([0, 50 / (math.pi * 0.05**2)])
    assert test.name == "table"


def test_several_plates_in_one_file(tmp_path: Path) -> None:
    text = (
        "test,sinkage_m,force_n,width_m,length_m\na,0,0,0.1,0.3\na,0.01,30,0.1,0.3\nb,0,0,0.2,0.4\nb,0.01,80,0.2,0.4\n"
    )
    first, second = read_plate_tests(_write(tmp_path, text))
    assert (first.name, first.width_m, first.pressure_pa[1]) == ("table: a", 0.1, pytest.approx(1000))
    assert (second.name, second.width_m, second.pressure_pa[1]) == ("table: b", 0.2, pytest.approx(1000))


@pytest.mark.parametrize(
    ("text", "keywords", "kind", "words"),
    [
        ("sinkage_m,pressure_pa\n0,0\n", {}, ConfigError, "size of the plate is not known"),
        ("sinkage_m,pressure_pa\n0,0\n", {"radius_m": 0.1, "width_m": 0.1}, ConfigError, "not both"),
        ("sinkage_m,pressure_pa,radius_m\n0,0,0.1\n", {"width_m": 0.1}, ConfigError, "not both"),
        ("sinkage_m,pressure_pa\n0,0\n", {"radius_m": -0.1}, ConfigError, "must be positive"),
        ("sinkage_m,pressure_pa,radius_m\n0,0,0\n", {}, ConfigError, "must be positive"),
        ("sinkage_m,force_n\n0,0\n", {"width_m": 0.1}, ConfigError, "length"),
        ("sinkage_m,load\n0,0\n", {"radius_m": 0.1}, ConfigError, "'force_n' is missing"),
        ("sinkage_m,pressure_pa,radius_m\n0,0,0.1\n1,2,0.2\n", {}, DataError, "'radius_m' changes within one test"),
        ("sinkage_m,pressure_pa\n0,0\n12,5\n", {"radius_m": 0.1}, DataError, r"--rename sinkage_m=sinkage_m\*0.001"),
    ],
)
def test_bad_plate_tables(
    tmp_path: Path, text: str, keywords: dict[str, float], kind: type[Exception], words: str
) -> None:
    path = _write(tmp_path, text)
    with pytest.raises(kind, match=words):
        read_plate_tests(path, **keywords)  # type: ignore[arg-type]


# --- shear -----------------------------------------------------------------------------------------------------------

SHEAR = "displacement_m,shear_stress_pa,normal_stress_pa\n"


def test_each_normal_stress_is_a_test(tmp_path: Path) -> None:
    tests = read_shear_tests(_write(tmp_path, SHEAR + "0,0,1000\n0.01,5,1000\n0,0,2000\n0.01,9,2000\n"))
    assert [test.normal_stress_pa for test in tests] == [1000, 2000]
    assert tests[1].shear_stress_pa.tolist() == [0, 9]


def test_a_measured_normal_stress_may_breathe(tmp_path: Path) -> None:
    (test,) = read_shear_tests(_write(tmp_path, SHEAR + "0,0,1000\n0.01,5,1020\n0.02,6,990\n"))
    assert test.normal_stress_pa == pytest.approx(1003.333, rel=1e-5)
    tests = read_shear_tests(_write(tmp_path, SHEAR + "0,0,1000\n0.01,5,1000\n0,0,930\n0.01,6,930\n"))
    assert [test.normal_stress_pa for test in tests] == [1000, 930]


def test_named_shear_tests(tmp_path: Path) -> None:
    text = "test," + SHEAR + "x,0,0,1000\nx,0.01,5,1000\ny,0,0,1000\ny,0.01,4,1000\n"
    assert [test.name for test in read_shear_tests(_write(tmp_path, text))] == ["table: x", "table: y"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("test," + SHEAR + "x,0,0,1000\nx,0.01,5,2000\n", "changes within one test"),
        (SHEAR + "0,0,-5\n0.1,1,-5\n", "normal stress is negative"),
        (SHEAR + "0,0,5\n10,1,5\n", "not in metres"),
    ],
)
def test_bad_shear_tables(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        read_shear_tests(_write(tmp_path, text))
