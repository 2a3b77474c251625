"""Nothing has to be scrolled sideways: what commands print fits a terminal, and a pipe."""

import subprocess
import sys
from pathlib import Path

import pytest
from cli_support import ok

from wheelsoil.workflows import Choice

RECORDINGS = Path(__file__).parents[2] / "recordings"
WHOLE = ("file", "sha256")
"""Facts that are not broken: a path, a hash."""


def too_wide(text, width):
    return [line for line in text.splitlines() if len(line) > width and not line.startswith(WHOLE)]


@pytest.mark.parametrize("width", [80, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("command", ["info", "process", "fit", "diagnose"])
def test_a_campaign_fits(command, width, campaign, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", str(width))
    choice = tmp_path / "choice.toml"
    choice.write_text(Choice(effects=("track_drift", "stress_peak_shift"), channels=("dp", "t")).to_toml())
    more = {
        "fit": ["--soil-prior", "--choice", choice],
        "diagnose": ["--effects", "lyasko,track_drift", "--most-causes", 1],
    }
    shown = ok(command, campaign, *more.get(command, []))
    assert shown.out
    assert too_wide(shown.out + shown.err, width) == []


@pytest.mark.slow
def test_a_plan_fits(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    clay = RECORDINGS / "clay"
    files = ["--vehicle", clay / "vehicle.toml", "--terrain", clay / "terrain.toml"]
    shown = ok("diagnose", "--plan", *files, "--planned-runs", 2, "--planned-duration", 20)
    assert "detectable" in shown.out
    assert too_wide(shown.out, 80) == []


@pytest.mark.parametrize("command", ["info", pytest.param("process", marks=pytest.mark.slow)])
def test_a_pipe_gets_96_columns(command, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    run = RECORDINGS / "clay" / "run-1.mcap"
    script = "import sys; from wheelsoil.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script, command, run], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout
    assert too_wide(done.stdout + done.stderr, 96) == []
