"""Rut readings of runs.toml in `fit` and `sinkage`: a campaign with ten readings and no sinkage signal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from wheelsoil.cli.app import run as wheelsoil
from wheelsoil.simulation import SimulationOptions, simulate_campaign

H_M = 0.06


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ruts") / "clay"
    simulate_campaign(
        folder, SimulationOptions(effects={"vasilev": {"H_m": H_M}}, runs=3, duration_s=30.0, seed=2, rut=10)
    )
    return folder


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert wheelsoil([*arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_a_fit_takes_the_readings_beside_the_forces(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forces = answer(capsys, "fit", str(campaign), "--channels", "dp,t")["models"]["vasilev"]  # type: ignore[index]
    found = answer(capsys, "fit", str(campaign), "--channels", "dp,t,z")["models"]["vasilev"]  # type: ignore[index]
    assert 0 <= found["samples"] - forces["samples"] <= 10
    assert found["estimates"]["H_m"]["value"] == pytest.approx(H_M, rel=0.15)
    assert found["criteria"]["z"]["R0_N"] < 0.015


def test_the_report_draws_each_reading(campaign: Path, tmp_path: Path) -> None:
    assert wheelsoil(["report", str(campaign), "-o", str(tmp_path / "r.html")]) == 0
    page = json.loads((tmp_path / "r.json").read_text())
    seen = page["sections"]["fit"]["residual"]["z"]["recommended"]
    assert len(seen["centre"]) >= 5 and max(seen["count"]) < 5
    drawing = (tmp_path / "r.html").read_text().partition('id="drawing-residual-z"')[2].partition("</figure>")[0]
    assert "Readings; braking" in drawing and drawing.count("<circle") >= len(seen["centre"])


def test_readings_alone_are_too_few_to_fit(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert wheelsoil(["fit", str(campaign), "--channels", "z"]) == 1
    assert "too few driven samples" in capsys.readouterr().err


def test_sinkage_from_forces_is_compared_with_the_readings(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = answer(capsys, "sinkage", str(campaign))
    agreement = found["agreement"]
    assert agreement["rows"] >= 4  # type: ignore[index]
    assert not agreement["refuted"]  # type: ignore[index]
    assert found["bound"]["rows"] >= 8  # type: ignore[index]
