"""Every command as it is on Windows, emulated (see `tests/emulated_windows`): to its result, or one sentence why not.

The sample's folder and run have umlauts, spaces and a colon, its text files end their lines with CRLF, those in TOML
begin with a byte-order mark, and output is cp1252. One emulated process runs one command after the other: a process for
each would import everything anew.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import mypy
import pytest
from cli_support import kept_demo, ok
from view_client import taken_from, viewing
from zero_support import Bench, write_lifted

from wheelsoil.cli.app import COMMANDS

ROOT = Path(__file__).parents[2]
PATHS = (ROOT / "tests" / "emulated_windows", ROOT)
EMULATED = {"PYTHONPATH": os.pathsep.join(map(str, PATHS)), "PYTHONIOENCODING": "cp1252"}
PROGRAM = "from wheelsoil.cli.app import main; main()"
COMMANDS_IN_TURN = """
import gc, io, json, os, sys, traceback
import sitecustomize
from wheelsoil.cli.app import main

asked, answers = sys.stdin, sys.stdout
for line in asked:
    folder, sys.argv, sitecustomize.HELD, environment = json.loads(line)
    os.chdir(folder)
    os.environ.update(environment)
    sys.stdout, sys.stderr = streams = [io.TextIOWrapper(io.BytesIO(), "cp1252") for _ in range(2)]
    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    for stream in streams:
        stream.flush()
    print(json.dumps([code, *(stream.buffer.getvalue().decode("cp1252") for stream in streams)]), file=answers)
    answers.flush()
    gc.collect()  # what a command has left open is no fault of the next one
"""

NEEDS_UNIX = {"log": ["vehicle.toml"], "doctor": ["vehicle.toml"]}
ELSEWHERE = {"view", "replay"}
"""`view` has a test of its own here; `replay` needs an adapter, and is a test on the virtual bus below."""

RESULTS: dict[str, list[str]] = {
    "info": ["run-1.mcap"],
    "process": [".", "-o", "Läufe.csv"],
    "fit": [".", "--choice", "choice.toml"],
    "sinkage": ["."],
    "diagnose": [".", "-o", "Modell.toml", "--json", "--jobs", "2"],
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


@dataclass(frozen=True)
class Done:
    """What a command left."""

    code: int
    out: str
    err: str


class Windows:
    """An emulated process, which runs commands in turn."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-c", COMMANDS_IN_TURN]
        self.process = subprocess.Popen(
            command, env=os.environ | EMULATED, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.folder = folder

    def __call__(self, *args: str, folder: Path | None = None, held: str = "", **environment: str) -> Done:
        """Run a command in a folder; another program holds a file."""
        assert self.process.stdin is not None and self.process.stdout is not None
        kept = {"WHEELSOIL_CACHE": str(self.folder.parent / "cache")}
        given = (str(folder or self.folder), ["wheelsoil", *args], [held] * bool(held), kept | environment)
        print(json.dumps(given), file=self.process.stdin, flush=True)
        return Done(*json.loads(self.process.stdout.readline()))


@pytest.fixture(scope="module")
def windows(folder: Path) -> Iterator[Windows]:
    """Return what runs a command under the emulation."""
    session = Windows(folder)
    with session.process:
        yield session
        assert session.process.stdin is not None
        session.process.stdin.close()


@pytest.fixture(scope="module")
def folder(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("windows")
    folder = taken_from(campaign, root / "Größe 2", 2)
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


@pytest.fixture
def kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have commands of this process keep their results, apart from those of the emulated one."""
    monkeypatch.setenv("WHEELSOIL_CACHE", str(folder.parent / "kept here"))


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
    """The types of the standard library know which of its names a system has; most files import nothing of that."""
    options = ["--config-file=", "--platform=win32", "--follow-imports=skip", "--ignore-missing-imports"]
    types = Path(mypy.__path__[0]) / "typeshed" / "stdlib"
    asking = [stub for stub in types.rglob("*.pyi") if "sys.platform" in stub.read_text(encoding="utf-8")]
    names = {".".join(stub.relative_to(types).with_suffix("").parts).removesuffix(".__init__") for stub in asking}
    names -= {"pathlib"}  # only methods
    imports = re.compile(rf"^ *(?:import|from) (?:{'|'.join(map(re.escape, names))})\b", re.MULTILINE)
    sources = [path for room in ROOMS for path in (ROOT / room).rglob("*.py")]
    chosen = [path for path in sources if imports.search(path.read_text(encoding="utf-8"))]
    assert len(sources) > len(chosen) > len(OF_LINUX | ASKS_FIRST)
    command = [sys.executable, "-m", "mypy", *options, "--cache-dir", tmp_path, *chosen]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lacking = re.findall(r'^(\S+?):\d+: error: (?:Module|"socket") has no attribute', done.stdout, re.MULTILINE)
    assert {name.replace("\\", "/") for name in lacking} == OF_LINUX | ASKS_FIRST


ROOMS = ("daq", "processing", "model", "wheelsoil")


LONG = {"fleet"}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in RESULTS])
def test_it_comes_to_its_result(
    name: str, folder: Path, windows: Windows, tmp_path_factory: pytest.TempPathFactory
) -> None:
    args = RESULTS[name]
    kept = {"WHEELSOIL_CACHE": str(kept_demo(tmp_path_factory) / "kept")} if name == "demo" else {}
    done = windows(name, *args, **kept)
    assert done.code == 0, done.err
    written = [folder / path for option, path in pairwise(args) if option in ("-o", "--store")]
    assert all(path.exists() for path in written)
    assert done.out or written


def test_the_program_prints_what_the_code_page_has(folder: Path) -> None:
    called = [sys.executable, "-c", PROGRAM, "info", "run-1.mcap"]
    done = subprocess.run(called, cwd=folder, env=os.environ | EMULATED, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode("cp1252")
    assert "run-1.mcap" in done.stdout.decode("cp1252")


@pytest.mark.parametrize("name", NEEDS_UNIX)
def test_what_needs_unix_says_so_in_a_sentence(name: str, windows: Windows) -> None:
    done = windows(name, *NEEDS_UNIX[name])
    assert done.code == 2
    said = done.err.splitlines()
    assert said[0].startswith("wheelsoil: this system has no locks on folders") and "next: log on Linux" in said[-1]


@pytest.mark.usefixtures("kept")
def test_a_diagnosis_is_the_same(folder: Path, windows: Windows) -> None:
    done = windows("diagnose", ".", "--json", "--jobs", "2")
    assert done.code == 0, done.err
    assert "one core is used" in done.err
    there, here = json.loads(done.out), ok("diagnose", folder, "--json", "--jobs", 1).json
    assert isinstance(here, dict)
    assert there["verdict"] == here["verdict"] and there["sentence"] == here["sentence"]
    assert there["causes"] == here["causes"]


@pytest.mark.usefixtures("kept")
def test_a_report_lacks_nothing(folder: Path, windows: Windows) -> None:
    done = windows("report", ".", "-o", "whole.html", "--json")
    assert done.code == 0, done.err
    said = json.loads(done.out)
    assert said["failed"] == []
    here = ok("report", folder, "-o", folder / "here.html", "--json", "--jobs", 1).json
    assert isinstance(here, dict)
    assert said["left_out"] == here["left_out"] and said["result"] == here["result"]


def test_a_frame_is_replayed_onto_the_virtual_bus(windows: Windows) -> None:
    done = windows("replay", "run-1.mcap", "--interface", "virtual", "--speed", "0", "--to", "1")
    assert done.code == 0, done.err
    without = windows("replay", "run-1.mcap", "--interface", "socketcan", "--channel", "can0=can0", "--to", "1")
    assert without.code in (2, 4) and "Traceback" not in without.err


@pytest.mark.parametrize(
    ("held", "args", "told"),
    [
        ("table.csv", ["process", "run-1.mcap", "-o", "table.csv"], ""),
        ("plan.csv", ["diagnose", "--plan", ".", "-o", "plan.csv"], "cos"),
        (
            "soil.toml",
            ["soil", "--plate", "plates.csv", "--base", "terrain.toml", "-o", "soil.toml"],
            "k_phi",
        ),
        ("page.html", ["report", ".", "-o", "page.html", "--no-diagnosis"], ""),
    ],
)
def test_a_file_that_another_program_holds_costs_no_result(
    held: str, args: list[str], told: str, folder: Path, windows: Windows
) -> None:
    (folder / held).write_text("before", encoding="utf-8")
    before = set(folder.iterdir())
    done = windows(*args, "--force", held=held)
    assert done.code == 2
    assert held in done.err and "another program" in done.err and "Traceback" not in done.err
    assert told in done.out
    assert (folder / held).read_text(encoding="utf-8") == "before" and set(folder.iterdir()) == before


def test_a_path_may_be_long(folder: Path, windows: Windows) -> None:
    deep = folder
    for _ in range(4):
        deep = deep / ("x" * 60)
    shutil.copytree(folder, deep, ignore=lambda *_: ["x" * 60, "store", "demo"])
    done = windows("process", "run-1.mcap", "-o", "deep.csv", folder=deep)
    assert done.code == 0, done.err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a program cannot send Ctrl-C to another one there")
def test_the_page_of_view_does_without(folder: Path) -> None:
    with viewing(folder, program=PROGRAM, **EMULATED) as view:
        assert all(run["state"] == "ready" for campaign in view.settled() for run in campaign["runs"])
