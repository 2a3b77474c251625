"""Every command of docs/field-logger.md: ours are run in their order, the system's are read by a shell."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from cli_support import invoke
from doctor_support import free_port, nodes, vehicle_folder

from daq import VehicleConfig, load_toml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "field-logger.md").read_text(encoding="utf-8")
LINES = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S) for line in block.splitlines()]
OURS = [line for line in LINES if line.startswith("wheelsoil ")]
THE_SYSTEMS = [line for line in LINES if not line.startswith("wheelsoil ")]


def placed(line: str, folder: Path, bus: str) -> list[str]:
    """Return a command's words with the places, the bus and the times of a test."""
    line = line.replace("/etc/wheelsoil", str(folder)).replace("/var/lib/wheelsoil", str(folder / "runs"))
    words = shlex.split(line.replace("can0=", f"{bus}=").replace("--duration 60", "--duration 6"))[1:]
    if words[0] in ("log", "doctor"):
        words += ["--page-port", str(free_port())]
    return words


@pytest.mark.slow
def test_our_commands_take_a_test_day_from_the_doctor_to_the_bench(tmp_path: Path) -> None:
    vehicle = vehicle_folder(tmp_path)
    (bus,) = (bus.channel for bus in load_toml(vehicle, VehicleConfig).bus)
    (tmp_path / "runs").mkdir()
    names = [shlex.split(line)[1] for line in OURS]
    assert names == ["doctor", "log", "zero", "log", "zero", "info", "recover", "replay"]
    with nodes(vehicle):
        for line in OURS:
            result = invoke(*placed(line, tmp_path, bus))
            assert result.code == 0, f"{line}\n{result.out}\n{result.err}"
    assert "zero-after" in (tmp_path / "zero.toml").read_text()


@pytest.mark.parametrize("line", THE_SYSTEMS)
def test_the_systems_commands_are_whole_and_name_files_that_are_here(line: str) -> None:
    assert subprocess.run(["bash", "-n", "-c", line], capture_output=True).returncode == 0
    for word in shlex.split(line):
        if word.startswith(("deploy/", "dbc/")):
            assert list(ROOT.glob(word)), word


def test_the_token_command_makes_one_that_the_page_takes(tmp_path: Path) -> None:
    from wheelsoil.web.listening import checked_token

    (line,) = (line for line in LINES if "page-token" in line)
    assert shutil.which("install")
    there = line.replace("sudo ", "").replace("/etc/wheelsoil", str(tmp_path))
    subprocess.run(["bash", "-c", there], check=True)
    token = (tmp_path / "page-token").read_text().strip()
    assert checked_token(token, "192.0.2.1") == token
    assert (tmp_path / "page-token").stat().st_mode & 0o777 == 0o600


def test_what_it_says_of_the_unit_stands_there() -> None:
    unit = (ROOT / "deploy" / "wheelsoil-log.service").read_text(encoding="utf-8")
    assert "WatchdogSec=10" in unit
    assert "RestartPreventExitStatus=2\n" in unit
    assert "CapabilityBoundingSet=\n" in unit
    assert "/opt/wheelsoil/bin/wheelsoil log /etc/wheelsoil/vehicle.toml --out /var/lib/wheelsoil --wait" in unit
