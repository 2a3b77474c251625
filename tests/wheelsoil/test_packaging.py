"""The wheel carries what the checkout has, and a module that hides one of ours is named."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_built_wheel_finds_its_dbc_files(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", tmp_path, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    [wheel] = tmp_path.glob("*.whl")
    unpacked = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(unpacked)
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import wheelsoil\n"
        "from daq.can.databases import load_database, shipped_dbc\n"
        "for name in ('wft.dbc', 'wheel_speed.dbc', 'gnss.dbc'):\n"
        "    path = shipped_dbc(name); assert str(path).startswith(sys.argv[1]), path; load_database(path)\n"
        "from importlib.resources import files\n"
        "assert (files('wheelsoil') / 'report' / 'template.html.j2').is_file()\n"
        "from wheelsoil.live import app, hub\n"
        "from wheelsoil.web import guard\n"
        "assert (files('wheelsoil.web') / 'static' / 'common.css').is_file()\n"
        "app.make_app(hub.Hub('x'), lambda command: True, guard.Rules.of('localhost', '127.0.0.1', None))\n"
    )
    done = subprocess.run([sys.executable, "-c", script, str(unpacked)], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_module_that_hides_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text("x = 1\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", "import wheelsoil"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert str(tmp_path / "model.py") in done.stderr and "rename your file" in done.stderr
