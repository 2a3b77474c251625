"""Commands on single-wheel tables: two wheels compared, the report, the fit of sinkage, the error of form."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok

from model.effects import EFFECTS
from model.wheel_soil import SOILS, Conditions, Wheel, WheelSoilModel

SLIPS = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.6])
FEW = ("--effects", "vasilev,grouser", "--most-causes", "1")
WHEEL = "[wheel]\nradius_m = 0.1\nwidth_m = 0.08\n"


def made(folder: Path, name: str, effects: dict[str, dict[str, float]], column: str = "") -> Path:
    """Write a table of a wheel on the lunar soil, without noise."""
    values = {k: v for key, own in effects.items() for k, v in EFFECTS[key].keyed(own).items()}
    model = WheelSoilModel(Wheel(0.1, 0.08), SOILS["lunar"], [EFFECTS[key] for key in effects])
    said = model.predict(Conditions(SLIPS, np.full(6, 25.0)), values)
    head = "slip,vertical_load_n,drawbar_pull_n,driving_torque_nm,sinkage_m" + (",lug_height_m" if column else "")
    rows = [
        f"{s},25,{d:.6g},{t:.6g},{z:.6g}{f',{column}' if column else ''}"
        for s, d, t, z in zip(SLIPS, said.drawbar_pull_n, said.driving_torque_nm, said.sinkage_m, strict=True)
    ]
    path = folder / name
    path.write_text("\n".join([head, *rows, ""]))
    return path


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    path = tmp_path / "wheel.toml"
    path.write_text(WHEEL)
    return path


@pytest.mark.slow
def test_two_wheels_are_compared(tmp_path: Path, wheel: Path) -> None:
    smooth = made(tmp_path, "smooth.csv", {}, "0")
    lugged = made(tmp_path, "lugged.csv", {"grouser": {"height_m": 0.01}}, "0.01")
    args = ("--vehicle", wheel, "--soil", "lunar", *FEW, "--paired", "--error-of-form", 1)
    found = ok("diagnose", "--table", smooth, "--table", lugged, *args, "--json").json
    assert found["schema"] == "wheelsoil/paired/1"
    assert (found["first"], found["second"]) == ("smooth", "lugged")
    assert found["p_value"] < 1e-3
    assert found["own_cause"] > 0.9
    assert next(iter(found["families"])) == "grouser"
    assert found["difference"]["t"][-1] > 0
    printed = ok("diagnose", "--table", smooth, "--table", lugged, *args).out
    assert "What smooth taught does not hold for lugged" in printed
    again = tmp_path / "again.csv"
    again.write_text("\n".join(smooth.read_text().splitlines()[:-1]))
    same = ok("diagnose", "--table", smooth, "--table", again, *args, "--json").json
    assert same["p_value"] > 0.5
    assert "taught holds for" in same["sentence"]


def test_a_comparison_takes_two_wheels(tmp_path: Path, wheel: Path) -> None:
    alone = invoke(
        "diagnose", "--table", made(tmp_path, "a.csv", {}), "--vehicle", wheel, "--soil", "lunar", "--paired"
    )
    assert alone.code == 2
    assert "--paired compares two wheels" in alone.err


@pytest.mark.slow
def test_a_report_of_a_table(tmp_path: Path, wheel: Path) -> None:
    table = made(tmp_path, "rows.csv", {"vasilev": {"H_m": 0.02}})
    page = tmp_path / "rows.html"
    ok("report", "--table", table, "--vehicle", wheel, "--soil", "lunar", "--channels", "dp,t,z", "-o", page)
    numbers = json.loads(page.with_suffix(".json").read_text())
    assert not numbers["left_out"]
    assert numbers["sections"]["verdict"]["verdict"] in ("named", "one_of")
    assert numbers["sections"]["rows"]["rows"]["slip"] == pytest.approx(SLIPS)
    assert "error of form" in numbers["sections"]["verdict"]["sentence"]
    assert numbers["sections"]["coefficients"]["vasilev"]


def test_a_report_of_two_wheels_without_a_diagnosis(tmp_path: Path, wheel: Path) -> None:
    tables = ("--table", made(tmp_path, "a.csv", {}), "--table", made(tmp_path, "b.csv", {"vasilev": {"H_m": 0.02}}))
    page = tmp_path / "two.html"
    ok("report", *tables, "--vehicle", wheel, "--soil", "lunar", "--no-diagnosis", "-o", page)
    numbers = json.loads(page.with_suffix(".json").read_text())
    assert set(numbers["left_out"]) == {"fit", "coefficients", "criteria"}
    assert set(numbers["sections"]["rows"]) == {"a", "b"}


def test_the_sinkage_is_fitted_too(tmp_path: Path, wheel: Path) -> None:
    table = made(tmp_path, "rows.csv", {"vasilev": {"H_m": 0.02}})
    args = ("--table", table, "--vehicle", wheel, "--soil", "lunar", "--slip-threshold", 0, "--json")
    found = ok("fit", *args, "--channels", "dp,t,z").json
    vasilev = found["models"]["vasilev"]
    assert vasilev["estimates"]["H_m"]["value"] == pytest.approx(0.02, rel=1e-3)
    assert vasilev["criteria"]["z"]["R0_N"] < 1e-5 < found["models"]["wong"]["criteria"]["z"]["R0_N"]
    assert set(ok("fit", *args).json["models"]["vasilev"]["criteria"]) == {"dp", "t"}


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--error-of-form", "0"), "--error-of-form is out of range"),
        (("--error-of-form", "80"), "--error-of-form is out of range"),
        (("--plan",), "--plan reads no measurement"),
    ],
)
def test_options_that_do_not_fit_a_table(tmp_path: Path, wheel: Path, args: tuple[str, ...], said: str) -> None:
    table = made(tmp_path, "rows.csv", {})
    refused = invoke("diagnose", "--table", table, "--vehicle", wheel, "--soil", "lunar", *args)
    assert refused.code == 2
    assert said in refused.err


@pytest.mark.parametrize("option", [("--paired",), ("--error-of-form", "2")])
def test_options_of_tables_need_one(option: tuple[str, ...]) -> None:
    refused = invoke("diagnose", "recordings/clay", *option)
    assert refused.code == 2
    assert f"{option[0]} is of single-wheel tables" in refused.err


@pytest.mark.parametrize(
    "columns", ["slip,vertical_load_n,drawbar_pull_n", "slip,vertical_load_n,drawbar_pull_n,sinkage_m"]
)
def test_one_row_decides_nothing(tmp_path: Path, wheel: Path, columns: str) -> None:
    table = tmp_path / "one.csv"
    table.write_text(f"{columns}\n0.1,25,5{',0.004' if 'sinkage' in columns else ''}\n")
    found = ok("diagnose", "--table", table, "--vehicle", wheel, "--soil", "lunar", "--json").json
    assert found["verdict"] == "nothing_detectable"
    assert "1 rows at 1 slip and load decide nothing: measure at three slips or more" in found["sentence"]
    assert found["cannot_tell"]["slip_sinkage"]
