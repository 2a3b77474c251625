"""A force of the wrong sign is told by every command whose answer it spoils."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli_support import invoke


@pytest.mark.parametrize(
    "command", [("sinkage",), ("fit", "--channels", "dp"), ("diagnose", "--most-causes", "1", "--effects", "vasilev")]
)
def test_a_torque_that_is_turned_is_reported(campaign: Path, tmp_path: Path, command: tuple[str, ...]) -> None:
    for name in ("run-1.mcap", "run-2.mcap"):
        shutil.copy(campaign / name, tmp_path)
    for name in ("vehicle.toml", "terrain.toml"):
        text = (campaign / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text.replace('"WFT_Moments.My"', '"-WFT_Moments.My"'), encoding="utf-8")
    found = invoke(command[0], tmp_path, *command[1:])
    said = " ".join(found.err.split())
    assert "run-1, run-2: torque and acceleration are opposed: check the sign of the torque" in said
