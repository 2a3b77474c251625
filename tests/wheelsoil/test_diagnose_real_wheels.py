"""The public single-wheel tests through ``diagnose --table``: what they decide, pinned (docs/real_data.md).

The authors' hand-tuned soil is not used: studies/real_data/terrain.toml holds what plates and tables say.
"""

from __future__ import annotations

import csv
import importlib.util
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import ok
from support import data_dir

from daq import TerrainConfig, load_toml
from daq.series import PlateTest
from model.bevameter import WindowOptions, fit_pressure_sinkage
from model.diagnosis import Bench, DiagnosisOptions, ParameterEstimate, compare_wheels, diagnose_bench
from model.diagnosis.core import rms
from model.diagnosis.single_wheel import CauseUse, Weighing, parameter_draws, predict_held_out, skid_law, weigh
from studies.published_wheels.verdicts import published_bench

REAL = Path(__file__).parents[2] / "studies" / "real_data"
DP, BOTH = ("dp",), ("dp", "z")


@pytest.fixture(scope="module")
def study() -> Any:
    data_dir("cmu-terramech-testbed")
    spec = importlib.util.spec_from_file_location("study", REAL / "study.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def smooth(study: Any) -> Bench:
    return study.bench("smooth")


@pytest.fixture(scope="module")
def grousered(study: Any) -> Bench:
    return study.bench("grousered")


@dataclass(frozen=True)
class Diagnosed:
    """What a command says of the smooth wheel, and how it weighed the sets of causes."""

    said: dict[str, Any]
    weighing: Weighing


def _diagnosed(study: Any, channels: str) -> Diagnosed:
    columns = [part for text in study.RENAME for part in ("--rename", text)]
    rows = [part for text in ("wheel=smooth", "beta_deg=0") for part in ("--where", text)]
    files = ["--vehicle", REAL / "smooth.toml", "--terrain", REAL / "terrain.toml"]
    table = ["diagnose", "--table", data_dir(*study.TABLE), *columns, *rows, *files]
    found: list[Weighing] = []

    def noted(*given: Any) -> Weighing:
        found.append(weigh(*given))
        return found[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("model.diagnosis.single_wheel.diagnose.weigh", noted)
        said = ok(*table, "--channels", channels, "--most-causes", 2, "--json").json
    return Diagnosed(said, found[0])


@pytest.fixture(scope="module")
def blind(study: Any) -> Diagnosed:
    """By drawbar pull alone."""
    return _diagnosed(study, "dp")


@pytest.fixture(scope="module")
def seeing(study: Any) -> Diagnosed:
    """With sinkage."""
    return _diagnosed(study, "dp,z")


def _probability(diagnosis: dict[str, Any], family: str) -> float:
    return next((c["probability"] for c in diagnosis["candidates"] if c["name"] == family), 0.0)


def _vasilev(weighing: Weighing) -> ParameterEstimate:
    return parameter_draws(weighing, CauseUse("vasilev"), np.random.default_rng(0))["H_m"].estimate("H_m", "m")


def test_the_soil_is_that_of_the_plates() -> None:
    """terrain.toml: mean and scatter of nine single fits; no number of the wheel tests."""
    source = data_dir("cmu-terramech-testbed", "pressure_sinkage")
    with (source / "index.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["body"].startswith("circular plate")]
    plates = []
    for row in rows:
        kinematics = np.loadtxt(source / f"{row['run']}.txt", delimiter=",")
        t_s, force = np.loadtxt(source / f"{row['run']}_ft.csv", delimiter=",", skiprows=1, usecols=(0, 3)).T
        time = kinematics[:, 6] + 18_000 - float(row["bag_start_unix"])
        kept = (time >= float(row["window_start_s"])) & (time <= float(row["window_end_s"]))
        radius = float(row["body"].split()[2]) / 2e3
        load = -np.interp(time[kept], t_s, force) - float(row["Fz_offset_N"])
        sinkage = -kinematics[kept, 4] * 1e-3 + float(row["z_zero_mm"]) * 1e-3
        plates.append(PlateTest(sinkage, load / (np.pi * radius**2), radius, row["run"]))
    fits = fit_pressure_sinkage(plates, WindowOptions()).plates
    scatter = np.cov([np.log(fit.stiffness) for fit in fits], [fit.exponent for fit in fits])
    terrain = load_toml(REAL / "terrain.toml", TerrainConfig)
    assert terrain.uncertainty is not None
    assert terrain.uncertainty.covariance is not None
    k, n = terrain.soil.frictional_modulus_kn, terrain.soil.sinkage_exponent
    assert np.exp(np.mean([np.log(fit.stiffness) for fit in fits])) / 1e3 == pytest.approx(k, rel=0.01)
    assert np.mean([fit.exponent for fit in fits]) == pytest.approx(n, abs=0.005)
    stated = np.array(terrain.uncertainty.covariance)
    assert stated[5, 5] / k**2 == pytest.approx(scatter[0, 0], rel=0.03)
    assert stated[3, 3] == pytest.approx(scatter[1, 1], rel=0.03)
    assert stated[3, 5] / k == pytest.approx(scatter[0, 1], rel=0.03)


@pytest.mark.slow
def test_drawbar_pull_alone_does_not_name_slip_sinkage(blind: Diagnosed) -> None:
    found = blind.said
    assert found["verdict"] == "one_of"
    assert found["causes"][0]["name"] == "interface_friction"
    assert _probability(found, "slip_sinkage") < 0.2
    assert found["adequacy"]["ok"]
    assert any("has not seen" in note for note in found["notes"])
    assert any("rows with s < 0 excluded" in note for note in found["notes"])


@pytest.mark.slow
def test_with_sinkage_slip_sinkage_leads_and_a_usual_stress_peak_bars_its_name(seeing: Diagnosed) -> None:
    found = seeing.said
    assert found["verdict"] == "one_of"
    assert [cause["name"] for cause in found["causes"]] == ["slip_sinkage", "interface_friction", "stress_peak_shift"]
    assert found["causes"][0]["barred"]["code"] == "peak_may_shift"
    assert all(run["separates"] == ["slip_sinkage", "stress_peak_shift"] for run in found["next_run"])
    assert _probability(found, "slip_sinkage") >= 0.95
    others = [c["name"] for c in found["candidates"] if c["name"] not in ("slip_sinkage", "none")]
    assert others[0] == "interface_friction"
    assert "stress peak usually lies ahead of the wheel's bottom" in found["sentence"]
    assert found["gain"]["log_likelihood_gain"] > 0
    assert found["gain"]["held_out"]["extended"]["R0_N"] < 0.65 * found["gain"]["held_out"]["base"]["R0_N"]


@pytest.mark.slow
def test_the_form_of_slip_sinkage_stays_open(seeing: Diagnosed) -> None:
    friction = CauseUse("interface_friction")
    evidence = [
        next(w.log_evidence for w in seeing.weighing.sets if set(w.hypothesis) == {CauseUse(form), friction})
        for form in ("vasilev", "lyasko", "ding")
    ]
    assert max(evidence) - min(evidence) < 2.5


@pytest.mark.slow
def test_left_out_speeds(seeing: Diagnosed) -> None:
    problem = seeing.weighing.problem
    best = seeing.weighing.sets[0]
    assert {use.key for use in best.hypothesis} == {"vasilev", "interface_friction"}
    extended = predict_held_out(problem, best.optima, np.random.default_rng(1))
    wong = predict_held_out(problem, seeing.weighing.of_set(()).optima, np.random.default_rng(1))
    assert rms(extended, "z") < 2.5e-3
    assert rms(extended, "dp") < 0.95
    assert rms(wong, "z") > 5e-3
    assert rms(wong, "dp") > 1.7


@pytest.mark.slow
def test_slip_sinkage_is_too_large_by_drawbar_pull_alone(blind: Diagnosed, seeing: Diagnosed) -> None:
    """And its interval says so: it holds what the measured sinkage gives."""
    without, known = _vasilev(blind.weighing), _vasilev(seeing.weighing)
    assert without.value > 1.5 * known.value
    assert without.interval95[0] < known.interval95[1]
    assert known.interval95[0] < without.interval95[1]
    assert known.value == pytest.approx(0.0133, abs=0.002)
    assert without.sigma > 3 * known.sigma


@pytest.mark.slow
def test_calibration_does_not_carry_over(smooth: Bench, grousered: Bench) -> None:
    found = compare_wheels(smooth, grousered, DiagnosisOptions(channels=DP, most_causes=1))
    assert found.p_value < 1e-3
    assert found.own_cause > 0.8
    assert found.difference["dp"] == pytest.approx([0.0, 1.2, 1.9, 2.7, 3.1], abs=0.4)
    assert found.families()["grouser"] < 0.5


@pytest.mark.parametrize(
    "channels", [pytest.param(DP, marks=pytest.mark.study), pytest.param(BOTH, marks=pytest.mark.slow)]
)
def test_the_grousered_wheel_has_a_cause_of_its_own(smooth: Bench, grousered: Bench, channels: tuple[str, ...]) -> None:
    found = compare_wheels(smooth, grousered, DiagnosisOptions(channels=channels))
    assert found.p_value < 1e-3
    assert found.own_cause >= (0.95 if channels == BOTH else 0.8)
    named = [family for family, p in found.families().items() if p > 0.9]
    assert named == (["slip_sinkage", "exit_angle"] if channels == BOTH else [])
    assert "grouser" not in list(found.families())[:3]


@pytest.mark.parametrize("wheel", ["smooth", "grousered"])
def test_braked_wheels_have_their_own_law(study: Any, wheel: str) -> None:
    law = skid_law(study.bench(wheel))
    assert law is not None
    assert law.left_out_rms_m <= 1.2e-3
    assert law.H2_m == pytest.approx(0.0355, abs=0.002)


@pytest.mark.parametrize(
    ("wheel", "channels", "led_by", "verdict"),
    [
        pytest.param("ding smooth", ("dp",), "slip_sinkage", "one_of", marks=pytest.mark.study),
        pytest.param("ding lugged", ("dp",), "slip_sinkage", "one_of", marks=pytest.mark.study),
        pytest.param("ding lugged", ("dp", "t", "z"), "slip_sinkage", "one_of", marks=pytest.mark.slow),
        pytest.param("hurrell, lugs undeclared", ("dp",), "grouser", "named", marks=pytest.mark.slow),
    ],
)
def test_published_wheels_are_decided_as_docs_published_wheels_says(
    wheel: str, channels: tuple[str, ...], led_by: str, verdict: str
) -> None:
    """Slip sinkage is never named from drawbar pull alone; lugs that nobody declared are seen."""
    data_dir("published-single-wheel")
    found = diagnose_bench([published_bench(wheel)], DiagnosisOptions(channels=channels, error_of_form=0.025))
    assert (found.verdict, found.causes[0].name) == (verdict, led_by)


@pytest.mark.slow
def test_only_braked_rows(smooth: Bench) -> None:
    """No law of a driven wheel is asked for rows with s < 0."""
    braked = replace(smooth, rows=smooth.rows[smooth.rows.slip < -0.1], lines=())
    found = diagnose_bench([braked], DiagnosisOptions(most_causes=1))
    assert "slip_sinkage" in found.not_identifiable
    assert all(candidate.name != "slip_sinkage" for candidate in found.candidates)
    assert found.candidates[0].name == "skid_sinkage"
