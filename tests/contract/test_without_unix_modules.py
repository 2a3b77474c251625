"""The commands of an analysis run where Python has no Unix-only module, as on Windows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from view_client import taken_from, viewing

ROOT = Path(__file__).parents[2]

PROGRAM = """
import asyncio, multiprocessing, os, signal, socket, subprocess, sys, uvicorn  # they have ways of their own
for name in "crypt curses fcntl grp nis posix pty pwd readline resource spwd syslog termios tty".split():
    sys.modules[name] = None
del os.nice, signal.SIGHUP, socket.AF_CAN, socket.CAN_RAW, socket.TCP_USER_TIMEOUT
from wheelsoil.cli.app import main
main()
"""
"""Takes away what Windows does not have, then runs a command."""

COMMANDS = {
    "info": ["run-1.mcap"],
    "process": ["run-1.mcap"],
    "fit": ["."],
    "diagnose": [".", "--effects", "vasilev,torque_zero", "--most-causes", "1"],
    "export": ["run-1.mcap", "-o", "tables"],
    "report": [".", "-o", "report.html", "--no-diagnosis"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(ROOT / "recordings" / "clay", tmp_path_factory.mktemp("no_unix") / "clay", 1)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_does_without(name: str, folder: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, name, *COMMANDS[name]]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_page_of_view_does_without(folder: Path) -> None:
    with viewing(folder, program=PROGRAM) as view:
        assert all(run["state"] == "ready" for campaign in view.settled() for run in campaign["runs"])
