"""A force of the wrong sign is told by every command whose answer it spoils."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli_support import invoke

CLAY = Path(__file__).parents[2] / "recordings" / "clay"


@pytest.mark.parametrize("command", [("sinkage",), ("fit", "--channels", "dp"), ("diagnose", "--most-causes", "1")])
def test_a_torque_that_is_turned_is_told(tmp_path: Path, command: tuple[str, ...]) -> None:
    for name in ("run-1.mcap", "run-2.mcap"):
        shutil.copy(CLAY / name, tmp_path)
    for name in ("vehicle.toml", "terrain.toml"):
        text = (CLAY / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text.replace('"WFT_Moments.My"', '"-WFT_Moments.My"'), encoding="utf-8")
    found = invoke(command[0], tmp_path, *command[1:])
    said = " ".join(found.err.split())
    assert "run-1, run-2: torque and acceleration are opposed: check the sign of the torque" in said
