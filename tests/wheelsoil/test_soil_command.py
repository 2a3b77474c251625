"""``wheelsoil soil``: from tables of a laboratory to a terrain.toml."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_soil import plate_tests, shear_tests
from measured_plates import TESTBED, measured_plates, write_table
from support import data_dir

from daq import TerrainConfig, load_toml
from wheelsoil.cli.app import run
from wheelsoil.cli.soil import spread

# --- a laboratory on the computer ------------------------------------------------------------------------------------


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    """Plates of two widths as forces, and shear tests, of one known terrain."""
    rng = np.random.default_rng(11)
    for i, test in enumerate(plate_tests(rng, widths_m=(0.05, 0.1), scatter=(0.05, 0.02), noise=0.01)):
        force = test.pressure_pa * np.pi * test.width_m**2
        write_table(tmp_path / f"plate{i}.csv", ["z_mm", "force_n"], [test.sinkage_m * 1e3, force])
    shears = shear_tests(rng, scatter=(0.03, 0.1), noise=0.01)
    columns = [
        np.concatenate([getattr(test, name) for test in shears]) for name in ("displacement_m", "shear_stress_pa")
    ]
    stress = np.concatenate([np.full(test.displacement_m.size, test.normal_stress_pa) for test in shears])
    number = np.concatenate([np.full(test.displacement_m.size, i) for i, test in enumerate(shears)])
    write_table(
        tmp_path / "shear.csv",
        ["displacement_m", "shear_stress_pa", "normal_stress_pa", "test"],
        [*columns, stress, number],
    )
    return tmp_path


def _plate_args(folder: Path) -> list[str]:
    files = sorted(str(path) for path in folder.glob("plate*.csv"))
    return ["--plate", *files, "--radius", *["0.05"] * 3, *["0.1"] * 3, "--rename", "sinkage_m=z_mm*0.001"]


def test_tables_become_a_terrain(laboratory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = laboratory / "terrain.toml"
    shear = ["--shear", str(laboratory / "shear.csv")]
    assert run(["soil", *_plate_args(laboratory), *shear, "-o", str(target), "--name", "test field"]) == 0
    out = capsys.readouterr().out
    assert "k_c" in out
    assert "95 % interval" in out
    assert "6 tests, 4 degrees of freedom" in " ".join(out.split())
    terrain = load_toml(target, TerrainConfig)
    assert terrain.soil.name == "test field"
    assert terrain.uncertainty is not None
    sigma = np.sqrt(np.diag(np.array(terrain.uncertainty.covariance)))
    found = np.array([terrain.soil.cohesion_kpa, terrain.soil.friction_angle_deg, terrain.soil.shear_modulus_m])
    assert np.all(np.abs(found - [4.14, np.degrees(np.arctan(0.4)), 0.012]) < 3 * sigma[:3])
    plates = np.array([terrain.soil.sinkage_exponent, terrain.soil.cohesive_modulus_kn])
    assert np.all(np.abs(plates - [0.8, 13.19]) < 3 * sigma[3:5])
    assert "plate tests: plate0" in target.read_text(encoding="utf-8")


def test_what_is_not_tested_comes_from_the_base(laboratory: Path) -> None:
    shear = ["--shear", str(laboratory / "shear.csv")]
    first, second = laboratory / "first.toml", laboratory / "second.toml"
    assert run(["soil", *_plate_args(laboratory), *shear, "-o", str(first)]) == 0
    assert run(["soil", *shear, "--base", str(first), "-o", str(second)]) == 0
    one, two = load_toml(first, TerrainConfig), load_toml(second, TerrainConfig)
    assert two.soil.cohesive_modulus_kn == pytest.approx(one.soil.cohesive_modulus_kn)
    assert (one.soil.name, two.soil.name) == ("first", "second")
    assert np.array(two.uncertainty.covariance) == pytest.approx(np.array(one.uncertainty.covariance), rel=1e-6)  # type: ignore[union-attr]


def test_json_holds_every_number(laboratory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["soil", *_plate_args(laboratory), "--json"]) == 0
    captured = capsys.readouterr()
    facts = json.loads(captured.out)
    assert facts["schema"] == "wheelsoil/soil/1"
    assert [p["name"] for p in facts["parameters"]] == ["cohesive_modulus", "frictional_modulus", "sinkage_exponent"]
    for parameter in facts["parameters"]:
        low, high = parameter["interval95"]
        assert low < parameter["value"] < high
    assert len(facts["plates"]) == 6
    assert facts["plates"][0]["window"]["zero"] == "given"
    assert facts["plates"][0]["window"]["points"] == 60
    assert np.shape(facts["joint"][0]["covariance"]) == (3, 3)


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        ([], 2, "there is no test"),
        (["--plate", "{0}/none.csv", "--radius", "0.05"], 2, "no such file"),
        (["--plate", "{0}/plate0.csv", "--radius", "0.05"], 2, "column 'sinkage_m' is missing"),
        (["--plate", "{0}/plate0.csv", "--rename", "sinkage_m=z_mm", "--radius", "0.05"], 1, "not in metres"),
        (["--plate", "{0}/plate0.csv", "--rename", "sinkage_m=z_mm*0.001"], 2, "size of the plate is not known"),
        (["--plate", "{0}/plate0.csv", "{0}/plate1.csv", "--radius", "1", "2", "3"], 2, "3 values of --radius"),
        (["--shear", "{0}/shear.csv", "--where", "test=99"], 2, "no row is left"),
        (["--shear", "{0}/shear.csv", "--where", "tset=1"], 2, "nearest: test"),
        (["--shear", "{0}/shear.csv", "-o", "{0}/t.toml"], 2, "no plate test"),
        (["--shear", "{0}/shear.csv", "-o", "{0}/no/t.toml"], 2, "no such folder"),
        (["--shear", "{0}/shear.csv", "-o", "{0}/shear.csv"], 2, "exists already"),
        (["--shear", "{0}/shear.csv", "--shear-to", "0.001"], 1, "too few samples"),
        (["--shear", "{0}/shear.csv", "--base", "{0}/shear.csv"], 2, "not valid TOML"),
        (["--plate", "{0}/plate0.csv", "--zero", "never"], 2, "never"),
    ],
)
def test_bad_input_ends_in_a_message(
    laboratory: Path, capsys: pytest.CaptureFixture[str], args: list[str], code: int, words: str
) -> None:
    assert run(["soil", *(arg.format(laboratory) for arg in args)]) == code
    assert words in capsys.readouterr().err


def test_what_a_fit_that_failed_noted_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    z = np.linspace(0.001, 0.03, 60)
    rows = [f"{depth},{1e5 if depth > 0.0299 else 1.0}" for depth in z]
    (tmp_path / "step.csv").write_text("\n".join(["sinkage_m,pressure_pa", *rows]), encoding="utf-8")
    assert run(["soil", "--plate", str(tmp_path / "step.csv"), "--radius", "0.05"]) == 1
    assert "stopped: at_bounds; n: ended at its bound 8" in capsys.readouterr().err


def test_one_width_writes_no_terrain(laboratory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["--plate", str(laboratory / "plate0.csv"), "--radius", "0.05", "--rename", "sinkage_m=z_mm*0.001"]
    shear = ["--shear", str(laboratory / "shear.csv")]
    assert run(["soil", *args, *shear, "-o", str(laboratory / "t.toml")]) == 1
    captured = capsys.readouterr()
    assert "kPa/m^n" in captured.out
    assert "the plate tests do not part k_c from k_phi" in captured.err
    assert "one plate width (b = 0.05 m)" in captured.err
    assert not (laboratory / "t.toml").exists()


def test_greedy_options_take_all_that_follows() -> None:
    args = ["--plate", "a", "b", "--json", "--radius=1", "2", "--shear", "c", "-o", "d"]
    expected = "--plate a --plate b --json --radius=1 --radius 2 --shear c -o d"
    assert " ".join(spread(args)) == expected


# --- measured plates: a public single-wheel test bed ------------------------------------------------------------------


def _fitted(files: Sequence[Path], capsys: pytest.CaptureFixture[str], *options: str) -> tuple[dict[str, Any], str]:
    capsys.readouterr()
    assert run(["soil", "--plate", *map(str, files), *options, "--json"]) == 0
    captured = capsys.readouterr()
    return json.loads(captured.out), captured.err


def test_measured_plates_by_the_authors_window(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts, notes = _fitted(measured_plates(tmp_path, whole=False), capsys)
    assert len(facts["plates"]) == 9
    with data_dir(*TESTBED, "index.csv").open(encoding="utf-8") as file:
        checks = {row["run"]: row for row in csv.DictReader(file) if row["check_n"]}
    for plate in facts["plates"]:
        check = checks[plate["name"]]
        assert plate["exponent"] == pytest.approx(float(check["check_n"]), abs=0.005)
        assert plate["stiffness"] == pytest.approx(float(check["check_k_kPa"]) * 1e3, rel=0.02)
    assert np.median([plate["stiffness"] for plate in facts["plates"]]) == pytest.approx(9.6e6, rel=0.02)
    assert np.median([plate["exponent"] for plate in facts["plates"]]) == pytest.approx(1.44, abs=0.01)
    k_c = facts["parameters"][0]
    assert k_c["symbol"] == "k_c"
    assert k_c["interval95"][1] < 0  # pressure rises with the size of the plate
    assert "contradicts k = k_c/b + k_phi" in notes
    assert "contains 0" not in notes


def test_measured_plates_from_the_whole_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts, notes = _fitted(measured_plates(tmp_path, whole=True), capsys, "--zero", "contact")
    with data_dir(*TESTBED, "index.csv").open(encoding="utf-8") as file:
        zeros = {row["run"]: -float(row["z_zero_mm"]) * 1e-3 for row in csv.DictReader(file)}
    for plate in facts["plates"]:  # found without the authors' hand-set zeros, 0.4 mm deeper in the mean
        assert plate["window"]["zero_m"] == pytest.approx(zeros[plate["name"]], abs=1.2e-3)
        assert plate["window"]["unloading"] > 100
    assert np.median([plate["exponent"] for plate in facts["plates"]]) == pytest.approx(1.44, abs=0.08)
    assert np.median([plate["stiffness"] for plate in facts["plates"]]) == pytest.approx(9.6e6, rel=0.1)
    assert facts["parameters"][0]["interval95"][1] < 0
    assert "contradicts" in notes


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_shear_tests_that_leave_a_parameter_open_say_which_test_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "shear.csv"
    displacement = np.linspace(0, 0.05, 20)
    rows = [(j, 5.0, 1e300, 1) for j in displacement]
    rows += [(j, 1e-300 * (1 - np.exp(-j / 0.01)), 1e301, 2) for j in displacement]
    path.write_text(
        "displacement_m,shear_stress_pa,normal_stress_pa,test\n" + "".join(f"{a},{b},{c},{d}\n" for a, b, c, d in rows)
    )
    assert run(["soil", "--shear", str(path)]) == 2
    error = capsys.readouterr().err
    assert "leave c, phi or K open" in error and "normal stresses 1e+300, 1e+301 Pa" in error
