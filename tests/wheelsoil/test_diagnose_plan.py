"""What a campaign will tell apart, before a run is driven: from files alone."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from cli_support import invoke, ok

FEW = ["--effects", "vasilev,slope,drawbar_pull_zero,crosstalk", "--planned-duration", 25]


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    """Return a folder with the files of a campaign that nobody has driven."""
    folder = tmp_path / "spring"
    folder.mkdir()
    (folder / "vehicle.toml").write_text(
        "[vehicle]\nmass_kg = 3600\n[wheel]\nradius_m = 0.47\nwidth_m = 0.318\n"
        '[signals]\ndrawbar_pull = "A.B"\ndriving_torque = "A.C"\n'
    )
    (folder / "terrain.toml").write_text(
        '[soil]\nname = "clay"\ncohesion_kpa = 4.14\nfriction_angle_deg = 13\nshear_modulus_m = 0.01\n'
        "sinkage_exponent = 0.5\ncohesive_modulus_kn = 13.19\nfrictional_modulus_kn = 692.15\n"
    )
    return folder


def test_it_lists_detectable_and_separable_causes(planned, tmp_path):
    matrix = tmp_path / "cos.csv"
    result = ok("diagnose", "--plan", planned, "--planned-runs", 4, *FEW, "-o", matrix)
    said = " ".join(result.out.split())
    assert said.startswith("4 of the library's 27 families are considered. 1 are detectable in these runs")
    omitted = (
        "Not considered: closed form sinkage (of --sinkage literal only), body pitch (needs the role pitch), 21 that"
    )
    assert f"{omitted} --effects or --without omits." in said
    assert max(map(len, result.out.splitlines())) <= 100
    assert "slip sinkage (vasilev) +" in result.out
    rows = list(csv.reader(matrix.read_text().splitlines()))
    assert [row[0] for row in rows[1:]] == rows[0][1:]
    assert set(rows[0][1:]) == {"vasilev", "slope", "drawbar_pull_zero", "crosstalk"}
    cosine = [[float(cell) for cell in row[1:]] for row in rows[1:]]
    assert all(cosine[i][i] == 1 and cosine[i][j] == cosine[j][i] for i in range(4) for j in range(4))


def test_one_direction_costs_the_slope(planned):
    def told(*directions: str) -> dict:
        rows = [f'[[run]]\ndirection = "{d}"\nadded_load_kg = {100 * i}\n' for i, d in enumerate(directions)]
        (planned / "runs.toml").write_text("\n".join(rows))
        return ok("diagnose", "--plan", planned, *FEW, "--json").json

    both, one = told("out", "back"), told("out", "out")
    assert both["schema"] == "wheelsoil/plan/1"
    assert "slope" in one["cannot_tell"] and "slope" not in both["cannot_tell"]
    d_sep = [next(e["d_sep"] for e in plan["effects"] if e["key"] == "slope") for plan in (both, one)]
    assert d_sep[1] < d_sep[0]


def test_a_cause_that_is_not_identifiable_is_separable_at_no_size(planned):
    given = ["--effects", "slope,tyre_flattening,multi_pass", "--planned-duration", 25, "--planned-runs", 4]
    text = " ".join(ok("diagnose", "--plan", planned, *given).out.split())
    tyre = text.split("tyre flattening")[1].split("slope")[0]
    assert "not named" in tyre
    assert "Detectable, not identifiable (1) tyre flattening: the inflation pressure is not known" in text
    assert "Not detectable (1) multi pass: every run is on the same pass" in text
    assert "d_sep is 5, noise changes it by 1" in text


def test_files_may_be_named_one_by_one(planned):
    given = ["--vehicle", planned / "vehicle.toml", "--terrain", planned / "terrain.toml", "--planned-runs", 2]
    assert len(ok("diagnose", "--plan", *given, *FEW, "--json").json["effects"]) == 4


@pytest.mark.parametrize(
    ("args", "said"),
    [
        ([], "the vehicle is not known"),
        (["--planned-runs", 0, "--planned-duration", 1], "2 faults"),
        (["run-1.mcap"], "a plan takes no recording"),
        (["--table", "rows.csv"], "--plan reads no measurement"),
        (["--effects", "slop"], "nearest: slope"),
        (["--channels", "x"], "no channel 'x' to diagnose"),
        (["--most-causes", 7, "--without", "nonsense"], "2 faults"),
    ],
)
def test_what_is_wrong_is_said(args, said):
    result = invoke("diagnose", "--plan", *args)
    assert result.code == 2
    assert said in result.err
    assert "Traceback" not in result.err


def test_every_wrong_file_is_reported_at_once(planned):
    (planned / "vehicle.toml").write_text("[wheel]\nradius = 0.47\n")
    (planned / "terrain.toml").write_text("[soil]\n")
    (planned / "runs.toml").write_text('[[run]]\ndirection = "up"\n')
    result = invoke("diagnose", "--plan", planned)
    assert result.code == 2
    for words in ("wheel.radius", "soil.name", "direction"):
        assert words in result.err
