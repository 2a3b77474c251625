"""``wheelsoil doctor``: exit codes, what people read, what programs read."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from cli_support import invoke, ok
from doctor_support import free_port, nodes, vehicle_folder


@pytest.fixture
def vehicle(tmp_path: Path) -> Path:
    return vehicle_folder(tmp_path)


def options(folder: Path) -> list[object]:
    return ["--out", folder / "runs", "--listen", 0.5, "--page-port", free_port()]


def test_a_vehicle_that_is_well_ends_with_0(vehicle: Path) -> None:
    with nodes(vehicle):
        result = ok("doctor", vehicle, *options(vehicle.parent))
    assert "pass  DBC coverage" in result.out
    assert "\nfail" not in result.out
    assert result.out.splitlines()[0].startswith("ready to log: ") and ", 0 fail" in result.out
    assert "listening for 0.5 s" in result.err
    assert not (vehicle.parent / "runs").exists()


def test_a_silent_bus_ends_with_1_and_says_what_to_do(vehicle: Path) -> None:
    result = invoke("doctor", vehicle, *options(vehicle.parent), "--json")
    assert result.code == 1
    told = result.json
    assert told["schema"] == "wheelsoil/doctor/1"
    assert not told["ready"]
    (silent,) = [line for line in told["lines"] if line["verdict"] == "fail"]
    assert silent["check"] == "traffic"
    assert "60 ohm" in silent["next_step"]
    assert sum(told["count"].values()) == len(told["lines"])


def test_a_faulty_file_is_a_failed_check_and_a_missing_one_is_usage(vehicle: Path) -> None:
    vehicle.write_text("[[bus]]\nchanel = 1\n")
    result = invoke("doctor", vehicle, *options(vehicle.parent))
    assert result.code == 1
    assert result.out.startswith("not ready to log: ")
    assert "\nNext: " in result.out
    steps = [line for line in result.out.splitlines() if line.startswith(" ")]
    assert max(map(len, steps)) <= 96 and "\x1b" not in result.out
    assert "nearest: channel" in result.out
    assert "pass  folder" in result.out
    missing = invoke("doctor", vehicle.parent / "none.toml")
    assert missing.code == 2
    assert not missing.out
    assert "listening" not in result.err + missing.err


def test_a_missing_interface_is_a_failed_check(tmp_path: Path) -> None:
    vehicle = vehicle_folder(tmp_path, channel='"nocan0"', interface='"socketcan"')
    result = invoke("doctor", vehicle, *options(tmp_path))
    assert result.code == 1
    assert "fail  interface" in result.out  # not there, or of a kernel without SocketCAN
    assert "fail  signals" not in result.out  # of a bus that is not there nothing more is said


def test_a_folder_of_somebody_else_is_a_failed_check(vehicle: Path) -> None:
    """Even root has no more rights here than the service would."""
    root = Path(__file__).parents[2]
    sandbox = [root / "tests" / "service_sandbox.py", root / "deploy" / "wheelsoil-log.service"]
    theirs = vehicle.parent / "runs"
    theirs.mkdir(mode=0)
    program = Path(sys.executable).with_name("wheelsoil")
    command = [sys.executable, *sandbox, program, "doctor", vehicle, *options(vehicle.parent), "--json"]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    theirs.chmod(0o700)
    assert done.returncode == 1, done.stderr
    failed = {line["check"]: line for line in json.loads(done.stdout)["lines"] if line["verdict"] == "fail"}
    assert {"folder", "other logger", "disk speed", "traffic"} == set(failed)
    assert "Permission denied" in failed["folder"]["found"]
