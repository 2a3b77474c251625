"""Every command as it is on Windows, emulated (see `tests/emulated_windows`): to its result, or one sentence why not.

The sample's folder and run have umlauts, spaces and a colon, its text files end their lines with CRLF, those in TOML
begin with a byte-order mark, and output is cp1252.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from cli_support import ok
from view_client import taken_from, viewing
from zero_support import Bench, write_lifted

from wheelsoil.cli.app import COMMANDS

ROOT = Path(__file__).parents[2]
PATHS = (ROOT / "tests" / "emulated_windows", ROOT)
EMULATED = {"PYTHONPATH": os.pathsep.join(map(str, PATHS)), "PYTHONIOENCODING": "cp1252"}
PROGRAM = "from wheelsoil.cli.app import main; main()"

NEEDS_UNIX = {"log": ["vehicle.toml"], "doctor": ["vehicle.toml"]}
ELSEWHERE = {"view", "replay"}
"""`view` has a test of its own here; `replay` needs an adapter, and is a test on the virtual bus below."""

RESULTS: dict[str, list[str]] = {
    "info": ["run-1.mcap"],
    "process": [".", "-o", "Läufe.csv"],
    "fit": [".", "--choice", "choice.toml"],
    "sinkage": ["."],
    "diagnose": [".", "-o", "Modell.toml"],
    "report": [".", "-o", "Bericht.html"],
    "export": ["run-1.mcap", "-o", "tables"],
    "recover": ["run-1.mcap", "-o", "recovered.mcap"],
    "import": ["logs/run-1.log", "--vehicle", "vehicle.toml", "-o", "imported.mcap"],
    "zero": ["lifted/spin.mcap", "-o", "zero.toml"],
    "soil": ["--plate", "plates.csv", "--base", "terrain.toml", "-o", "Boden.toml"],
    "simulate": ["-o", "simulated", "--runs", "1", "--duration", "15"],
    "sample": ["clay", "-o", "sample"],
    "demo": ["-o", "demo", "--runs", "1", "--duration", "20"],
    "fleet": ["run", ".", "--store", "store", "--effects", "vasilev,torque_zero", "--jobs", "1"],
    "cache": [],
}
"""Arguments with which a command comes to its result; what they write is beside `-o` or `--store`."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("windows")
    folder = taken_from(ROOT / "recordings" / "clay", root / "Größe 2", 2)
    given = "[[run]]\nfile = 'run-{0}.mcap'\nid = 'Lauf {0}: Ton'\nadded_load_kg = {1}\n"
    (folder / "runs.toml").write_text(given.format(1, 0) + given.format(2, 300), encoding="utf-8")
    chosen = "schema = 'wheelsoil/choice/1'\n[[run]]\nid = 'Lauf 2: Ton'\n"
    (folder / "choice.toml").write_text(chosen, encoding="utf-8")
    ok("simulate", "-o", folder / "logs", "--runs", 1, "--duration", 15, "--format", "candump")
    (folder / "lifted").mkdir()
    write_lifted(folder / "lifted" / "spin.mcap", Bench(), 0)
    rows = [f"{r},{r},{z / 1000},{(1e6 / r + 5e5) * (z / 1000)}" for r in (0.1, 0.2) for z in range(1, 60)]
    (folder / "plates.csv").write_text("\n".join(["test,radius_m,sinkage_m,pressure_pa", *rows]), encoding="utf-8")
    for path in folder.rglob("*"):
        if path.suffix in (".toml", ".dbc", ".csv", ".log"):
            mark = b"\xef\xbb\xbf" if path.suffix == ".toml" else b""
            path.write_bytes(mark + path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    return folder


def command(folder: Path, *args: str, **env: str) -> subprocess.CompletedProcess[bytes]:
    called = [sys.executable, "-c", PROGRAM, *args]
    given = os.environ | EMULATED | {"WHEELSOIL_CACHE": str(folder.parent / "cache")} | env
    return subprocess.run(called, cwd=folder, env=given, capture_output=True, check=False)


def test_every_command_is_met() -> None:
    assert {*RESULTS, *NEEDS_UNIX, *ELSEWHERE} == set(COMMANDS)


ASKS_FIRST = {
    "daq/logger/run_files.py",
    "daq/machine.py",
    "wheelsoil/fleet/packs.py",
    "wheelsoil/view/helper.py",
    "wheelsoil/web/listening.py",
}
"""Files that use what Windows lacks only after they have asked for it."""

OF_LINUX = {
    "daq/sources/socketcan.py",
    "daq/logger/doctor/host.py",
    "daq/logger/doctor/links.py",
    "daq/logger/host_monitor.py",
    "daq/logger/session_monitor.py",
    "wheelsoil/live/panel.py",
    "wheelsoil/live/server.py",
}
"""Files that only `log`, `doctor` and SocketCAN run."""


@pytest.mark.slow
def test_nothing_else_uses_what_windows_lacks(tmp_path: Path) -> None:
    """The types of the standard library know which of its names a system has."""
    options = ["--config-file=", "--platform=win32", "--follow-imports=skip", "--ignore-missing-imports"]
    command = [sys.executable, "-m", "mypy", *options, "--cache-dir", tmp_path, *ROOMS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lacking = re.findall(r'^(\S+?):\d+: error: (?:Module|"socket") has no attribute', done.stdout, re.MULTILINE)
    assert {name.replace("\\", "/") for name in lacking} == OF_LINUX | ASKS_FIRST


ROOMS = ("daq", "processing", "model", "wheelsoil")
LONG = {"demo", "fleet"}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in RESULTS])
def test_it_comes_to_its_result(name: str, folder: Path) -> None:
    args = RESULTS[name]
    done = command(folder, name, *args)
    assert done.returncode == 0, done.stderr.decode("cp1252")
    written = [folder / path for option, path in pairwise(args) if option in ("-o", "--store")]
    assert all(path.exists() for path in written)
    assert done.stdout or written


@pytest.mark.parametrize("name", NEEDS_UNIX)
def test_what_needs_unix_says_so_in_a_sentence(name: str, folder: Path) -> None:
    done = command(folder, name, *NEEDS_UNIX[name])
    assert done.returncode == 2
    said = done.stderr.decode("cp1252").splitlines()
    assert said[0].startswith("wheelsoil: this system has no locks on folders") and "next: log on Linux" in said[-1]


def test_a_diagnosis_is_the_same(folder: Path) -> None:
    done = command(folder, "diagnose", ".", "--json", "--jobs", "2")
    assert done.returncode == 0, done.stderr.decode("cp1252")
    assert b"one core is used" in done.stderr
    there, here = json.loads(done.stdout), ok("diagnose", folder, "--json", "--jobs", 1, "--no-cache").json
    assert isinstance(here, dict)
    assert there["verdict"] == here["verdict"] and there["sentence"] == here["sentence"]
    assert there["causes"] == here["causes"]


def test_a_report_lacks_nothing(folder: Path) -> None:
    done = command(folder, "report", ".", "-o", "whole.html", "--json")
    assert done.returncode == 0, done.stderr.decode("cp1252")
    said = json.loads(done.stdout)
    assert said["failed"] == []
    here = ok("report", folder, "-o", folder / "here.html", "--json", "--jobs", 1).json
    assert isinstance(here, dict)
    assert said["left_out"] == here["left_out"] and said["result"] == here["result"]


def test_a_frame_is_replayed_onto_the_virtual_bus(folder: Path) -> None:
    done = command(folder, "replay", "run-1.mcap", "--interface", "virtual", "--speed", "0", "--to", "1")
    assert done.returncode == 0, done.stderr.decode("cp1252")
    without = command(folder, "replay", "run-1.mcap", "--interface", "socketcan", "--channel", "can0=can0", "--to", "1")
    assert without.returncode in (2, 4) and b"Traceback" not in without.stderr


@pytest.mark.parametrize(
    ("held", "args", "told"),
    [
        ("table.csv", ["process", "run-1.mcap", "-o", "table.csv"], b""),
        ("plan.csv", ["diagnose", "--plan", ".", "-o", "plan.csv"], b"cos"),
        (
            "soil.toml",
            ["soil", "--plate", "plates.csv", "--base", "terrain.toml", "-o", "soil.toml"],
            b"k_phi",
        ),
        ("page.html", ["report", ".", "-o", "page.html", "--no-diagnosis"], b""),
    ],
)
def test_a_file_that_another_program_holds_costs_no_result(
    held: str, args: list[str], told: bytes, folder: Path
) -> None:
    (folder / held).write_text("before", encoding="utf-8")
    before = set(folder.iterdir())
    done = command(folder, *args, "--force", WHEELSOIL_HELD=held)
    assert done.returncode == 2
    assert held.encode() in done.stderr and b"another program" in done.stderr and b"Traceback" not in done.stderr
    assert told in done.stdout
    assert (folder / held).read_text(encoding="utf-8") == "before" and set(folder.iterdir()) == before


def test_a_path_may_be_long(folder: Path) -> None:
    deep = folder
    for _ in range(4):
        deep = deep / ("x" * 60)
    shutil.copytree(folder, deep, ignore=lambda *_: ["x" * 60, "store", "demo"])
    done = command(deep, "process", "run-1.mcap", "-o", "deep.csv")
    assert done.returncode == 0, done.stderr.decode("cp1252")


@pytest.mark.skipif(sys.platform == "win32", reason="a program cannot send Ctrl-C to another one there")
def test_the_page_of_view_does_without(folder: Path) -> None:
    with viewing(folder, program=PROGRAM, **EMULATED) as view:
        assert all(run["state"] == "ready" for campaign in view.settled() for run in campaign["runs"])
