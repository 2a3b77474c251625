"""The logger as a service: what systemd says of the unit, and what the command of the unit says to systemd."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from pathlib import Path

import pytest

from daq import LoggerSection, VehicleConfig, load_toml
from daq.recording import Recording

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
UNIT = DEPLOY / "wheelsoil-log.service"
PROGRAM = Path(sys.executable).with_name("wheelsoil")
EXPOSURE_BELOW = 2.5
TERMINATED = 143
SANDBOX = ROOT / "tests" / "service_sandbox.py"

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def unit_value(key: str) -> str:
    """Return the value of a key that the unit has once."""
    (value,) = re.findall(rf"^{key}=(.*)$", UNIT.read_text(encoding="utf-8"), re.M)
    return str(value)


@pytest.fixture
def placed(tmp_path: Path) -> Path:
    """Return the unit with its program where this environment has it."""
    text = UNIT.read_text(encoding="utf-8").replace("/opt/wheelsoil/bin/wheelsoil", str(PROGRAM))
    (tmp_path / UNIT.name).write_text(text, encoding="utf-8")
    return tmp_path / UNIT.name


@needs_systemd
def test_systemd_takes_every_line_of_the_unit(placed: Path) -> None:
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", str(placed)], capture_output=True, text=True)
    assert done.stdout + done.stderr == ""
    assert done.returncode == 0


@needs_systemd
def test_systemd_finds_little_that_the_service_could_harm(placed: Path) -> None:
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", str(placed)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"})
    (exposure,) = re.findall(r"Overall exposure level for \S+: ([\d.]+)", done.stdout)
    assert float(exposure) < EXPOSURE_BELOW
    (stated,) = re.findall(r"exposure ([\d.]+)", (ROOT / "docs" / "field-logger.md").read_text(encoding="utf-8"))
    assert float(exposure) == pytest.approx(float(stated), abs=0.3)  # versions of systemd differ a little


def test_the_settings_agree_with_ours() -> None:
    (limit,) = re.findall(r"^net\.core\.rmem_max = (\d+)$", (DEPLOY / "90-wheelsoil.conf").read_text(), re.M)
    assert int(limit) == LoggerSection().receive_buffer_kb * 1024
    network = configparser.ConfigParser()
    network.read(DEPLOY / "80-can.network")
    (bus,) = load_toml(ROOT / "dbc" / "vehicle.toml", VehicleConfig).bus
    assert network["Match"]["Name"] == bus.channel
    assert network["CAN"]["BitRate"] == "1M"
    assert bus.bitrate == 1_000_000
    assert f"sys-subsystem-net-devices-{bus.channel}.device" in UNIT.read_text()


def command_of_the_unit(folder: Path) -> list[str]:
    """Return ExecStart with this machine's places: a virtual bus, a token, the loopback address and a free port."""
    (folder / "vehicle.toml").write_text('[[bus]]\nchannel = "service"\ninterface = "virtual"\n')
    (folder / "page-token").write_text("a-token-of-a-test\n")
    here = {
        "/opt/wheelsoil/bin/wheelsoil": str(PROGRAM),
        "/etc/wheelsoil": str(folder),
        "/var/lib/wheelsoil": str(folder / "runs"),
        "${CREDENTIALS_DIRECTORY}": str(folder),
        "0.0.0.0": "127.0.0.1",
    }
    command = unit_value("ExecStart")
    for there, place in here.items():
        assert there in command
        command = command.replace(there, place)
    return [*shlex.split(command), "--page-port", "0"]


class Manager:
    """A service manager: the socket, and the messages with their times."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self.messages: list[tuple[float, str]] = []

    def hear_until(self, wanted: str, seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not any(wanted in text.splitlines() for _, text in self.messages):
            self._socket.settimeout(max(end - time.monotonic(), 0.01))
            self.messages.append((time.monotonic(), self._socket.recv(4096).decode()))

    def hear_for(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left_s := end - time.monotonic()) > 0:
            self._socket.settimeout(left_s)
            try:
                self.messages.append((time.monotonic(), self._socket.recv(4096).decode()))
            except TimeoutError:
                return

    def close(self) -> None:
        self._socket.close()


@contextmanager
def started(command: list[str], folder: Path, watchdog_s: float) -> Iterator[tuple[Manager, subprocess.Popen[str]]]:
    """Start a command as the service manager does, with no more privileges than the unit has."""
    manager = Manager(folder / "notify")
    environment = {
        **os.environ,
        "NOTIFY_SOCKET": str(folder / "notify"),
        "WATCHDOG_USEC": str(round(watchdog_s * 1e6)),
    }
    process = subprocess.Popen(
        [sys.executable, str(SANDBOX), str(UNIT), *command],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield manager, process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate(timeout=30)
        manager.close()


def test_the_command_of_the_unit_tells_the_service_manager(tmp_path: Path) -> None:
    """Ready once a file is written, alive while it runs, stopping when it is asked to; closed files in the end."""
    with started(command_of_the_unit(tmp_path), tmp_path, watchdog_s=2.0) as (manager, process):
        manager.hear_until("READY=1")
        (recording,) = (tmp_path / "runs").rglob("*.mcap")
        assert recording.parent.name == "between"  # --wait: runs begin on the page
        manager.hear_for(5.0)
        process.send_signal(getattr(signal, unit_value("KillSignal")))
        manager.hear_until("STOPPING=1")
        _, err = process.communicate(timeout=30)
    assert process.returncode == TERMINATED, err
    assert str(TERMINATED) in unit_value("SuccessExitStatus").split()
    alive = [at for at, text in manager.messages if "WATCHDOG=1" in text.splitlines()]
    assert len(alive) >= 3
    assert Recording.open(recording).loss == ()


ATTEMPTS = """
import ctypes, json, mmap, re
def refused(act):
    try:
        return act() == -1
    except OSError:
        return True
capabilities = re.search(r"CapEff:\\s*(\\S+)", open("/proc/self/status").read())[1]
print(json.dumps({
    "capabilities": int(capabilities, 16),
    "filter": refused(lambda: ctypes.CDLL(None).ptrace(0, 0, 0, 0)),
    "memory": refused(lambda: mmap.mmap(-1, 4096, prot=7).close()),
}))
"""


def test_the_sandbox_of_these_tests_refuses_what_the_unit_refuses() -> None:
    """Without it the tests around this one would show nothing of the unit's limits."""
    command = [sys.executable, str(SANDBOX), str(UNIT), sys.executable, "-c", ATTEMPTS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    tried = json.loads(done.stdout)
    assert tried["capabilities"] == 0
    assert tried["filter"] or not (find_library("seccomp") and shutil.which("systemd-analyze"))
    assert tried["memory"] or kernel_version() < (6, 3)


def kernel_version() -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", os.uname().release)[:2])


def test_a_wrong_vehicle_file_is_not_tried_again(tmp_path: Path) -> None:
    command = command_of_the_unit(tmp_path)
    (tmp_path / "vehicle.toml").write_text("[[bus]]\nchanel = 1\n")
    with started(command, tmp_path, watchdog_s=2.0) as (manager, process):
        _, err = process.communicate(timeout=30)
        manager.hear_for(0.1)
    assert str(process.returncode) == unit_value("RestartPreventExitStatus"), err
    assert not manager.messages
    assert not (tmp_path / "runs").exists()
