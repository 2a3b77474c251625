"""One contract for every subcommand: help, JSON, exit codes, what goes where, what is imported when."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import SHORT, busy, invoke, kept_demo, ok
from doctor_support import free_port
from zero_support import Bench, write_lifted

import wheelsoil.cli
from wheelsoil import __version__
from wheelsoil.cli.app import COMMANDS, load

HEAVY = ("numpy", "pandas", "scipy", "cantools", "can", "mcap", "pyarrow", "rich", "pydantic", "jinja2")
PROGRAM = [sys.executable, "-c", "from wheelsoil.cli.app import main; main()"]
ABSENT = {"log", "doctor"} if sys.platform == "win32" else set[str]()

every_command = pytest.mark.parametrize("name", COMMANDS)
every_part = pytest.mark.parametrize(
    "name", [*COMMANDS, *(f"{name} {part}" for name in COMMANDS for part in getattr(load(name), "commands", ()))]
)


def test_every_command_that_is_written_is_listed():
    folder = Path(wheelsoil.cli.__file__).parent
    texts = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    defined = r"(?m)^(?:def )?(\w+)(?:_command\(|_app = )"
    written = {(name, file) for file, text in texts.items() for name in re.findall(defined, text)}
    assert written == {(name, entry.module) for name, entry in COMMANDS.items()}


@every_part
def test_help_says_what_it_does_and_every_option_has_a_text(name):
    result = ok(*name.split(), "--help")
    assert result.out.startswith(f"Usage: wheelsoil {name}")
    assert not result.err
    group, _, part = name.partition(" ")
    for parameter in (load(group).commands[part] if part else load(group)).params:
        assert getattr(parameter, "help", None), f"{name}: {parameter.name} has no help"


@every_command
def test_an_unknown_option_is_a_usage_error(name):
    result = invoke(name, "--no-such-option")
    assert result.code == 2
    assert not result.out
    assert "no-such-option" in result.err
    assert "Traceback" not in result.err


@every_command
def test_its_file_names_it(name):
    module = importlib.import_module(f"wheelsoil.cli.{COMMANDS[name].module}")
    assert f"``wheelsoil {name}``" in (module.__doc__ or "")


def test_the_root_lists_all_and_knows_its_version():
    listed = ok("--help").out
    assert all(name in listed and entry.summary in " ".join(listed.split()) for name, entry in COMMANDS.items())
    assert re.fullmatch(rf"wheelsoil {re.escape(__version__)} \(core: (compiled|numpy: .+)\)\n", ok("--version").out)
    wrong = invoke("proces")
    assert wrong.code == 2
    assert "nearest: process" in wrong.err
    assert invoke().code == 2


def test_python_runs_it_as_a_module():
    done = subprocess.run([sys.executable, "-m", "wheelsoil", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == ok("--version").out


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from wheelsoil.cli.app import run; run(['--help']); run(['--version']); "
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


EXTRAS = ("arviz_base", "asammdf", "distributed", "duckdb", "h5py", "isal", "nptdms", "numba", "rosbags", "s3fs")


def test_no_command_loads_an_extra_that_it_does_not_need(campaign: Path, tmp_path: Path) -> None:
    """python-can would import asammdf, and with it pandas."""
    for name in EXTRAS:
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name} is imported')\n", encoding="utf-8")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from wheelsoil.cli.app import run\n"
        "for command in ('info', 'process'):\n"
        "    assert not run([command, sys.argv[1], '--json'])\n"
        "    print('next')"
    )
    done = subprocess.run([sys.executable, "-c", code, str(campaign / "run-1.mcap")], capture_output=True, text=True)
    assert done.returncode == 0, done
    first, second, rest = done.stdout.split("next\n")
    assert json.loads(first) and json.loads(second) and not rest


def test_a_sample_is_the_recorded_one_and_overwrites_nothing(tmp_path: Path) -> None:
    kept = Path(__file__).parents[2] / "recordings" / "clay"
    ok("sample", "-o", tmp_path / "clay")
    names = sorted(path.name for path in kept.iterdir())
    assert sorted(path.name for path in (tmp_path / "clay").iterdir()) == names
    assert all((tmp_path / "clay" / name).read_bytes() == (kept / name).read_bytes() for name in names)
    again = invoke("sample", "-o", tmp_path / "clay")
    assert again.code == 2 and "exists already" in again.err


def _json_runs(campaign: Path, folder: Path) -> dict[str, list[object]]:
    """Return, per command that prints JSON, arguments that make it do so."""
    first = campaign / "run-1.mcap"
    log = folder / "run.log"
    ok("simulate", "-o", folder / "logs", "--runs", 1, "--duration", 15, "--format", "candump")
    shutil.copy(folder / "logs" / "run-1.log", log)
    (folder / "vehicle.toml").write_text('[[bus]]\nchannel = "contract"\ninterface = "virtual"\n')
    lifted = folder / "lifted"  # away from the vehicle.toml above
    lifted.mkdir()
    plates = folder / "plates.csv"
    rows = [f"{r},{z / 1000},{(1e6 / r + 5e5) * (z / 1000)}" for r in (0.1, 0.2) for z in range(1, 60)]
    plates.write_text("\n".join(["radius_m,sinkage_m,pressure_pa", *rows]))
    return {
        "info": [campaign],
        "process": [first],
        "fit": [campaign],
        "sinkage": [campaign],
        "diagnose": [campaign, "--effects", "vasilev,torque_zero", "--most-causes", 1],
        "report": [campaign, "-o", folder / "r.html", "--no-diagnosis"],
        "import": [log, "--vehicle", campaign / "vehicle.toml", "-o", folder / "imported.mcap"],
        "export": [first, "-o", folder / "tables"],
        "recover": [first, "-o", folder / "recovered.mcap"],
        "log": [folder / "vehicle.toml", "--duration", 0.2, "-o", folder / "logged.mcap"],
        "doctor": [folder / "vehicle.toml", "--listen", 0.2, "-o", folder, "--page-port", free_port()],
        "zero": [write_lifted(lifted / "spin.mcap", Bench(), 0), "-o", folder / "zero.toml"],
        "replay": [first, "--interface", "virtual", "--speed", 0, "--to", 1],
        "demo": ["-o", folder / "demo", *SHORT],
        "cache": [],
    }


def test_json_is_strict_and_alone_on_stdout(campaign, tmp_path, tmp_path_factory, monkeypatch):
    shutil.copytree(kept_demo(tmp_path_factory) / "kept", tmp_path / "kept")
    monkeypatch.setenv("WHEELSOIL_CACHE", str(tmp_path / "kept"))
    runs = _json_runs(campaign, tmp_path)
    offering = {name for name in COMMANDS if any("--json" in p.opts for p in load(name).params)}
    assert offering - {"soil"} == set(runs)  # soil: tests/wheelsoil/test_soil_command.py
    for name, args in ((name, args) for name, args in runs.items() if name not in ABSENT):
        with busy("contract"):
            result = ok(name, *args, "--json")
        assert result.json, name


def test_a_reader_that_goes_away_is_no_fault(campaign):
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {' '.join(map(_quoted, PROGRAM))} info --all-ids {campaign} | head -c 10"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.returncode in (0, 141)


@pytest.mark.skipif("log" in ABSENT, reason="this system has no logger")
def test_ctrl_c_ends_with_130_and_a_closed_recording(tmp_path):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[[bus]]\nchannel = "interrupted"\ninterface = "virtual"\n')
    target = tmp_path / "run.mcap"
    process = subprocess.Popen([*PROGRAM, "log", str(vehicle), "-o", str(target)], stderr=subprocess.PIPE, text=True)
    _wait_for(lambda: target.exists() and target.stat().st_size > 0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    (facts,) = ok("info", target, "--json").json
    assert facts["exit_status"] == "interrupted"
    assert facts["loss"] == []


def _wait_for(true: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.05)


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"
