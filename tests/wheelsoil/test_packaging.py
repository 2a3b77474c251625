"""The wheel carries what the checkout has, its types too, and a module that hides one of ours is named."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the interpreter of an environment with the built wheel; what it depends on comes from this one."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    [wheel] = folder.glob("*.whl")
    venv.create(folder / "env", symlinks=True)
    [packages] = (folder / "env").glob("lib/python*/site-packages")
    zipfile.ZipFile(wheel).extractall(packages)
    (packages / "dependencies.pth").write_text("\n".join(_installed()), encoding="utf-8")
    return folder / "env" / "bin" / "python"


def _installed() -> list[str]:
    return [folder for folder in sys.path if Path(folder).name == "site-packages"]


@pytest.mark.slow
def test_the_built_wheel_finds_its_files(python: Path, tmp_path: Path) -> None:
    script = (
        "import sys, wheelsoil\n"
        "from daq.can import load_database, shipped_dbc\n"
        "for name in ('wft.dbc', 'wheel_speed.dbc', 'gnss.dbc'):\n"
        "    path = shipped_dbc(name); assert str(path).startswith(sys.prefix), path; load_database(path)\n"
        "from importlib.resources import files\n"
        "assert (files('wheelsoil') / 'report' / 'template.html.j2').is_file()\n"
        "from wheelsoil.live import hub, server\n"
        "from wheelsoil.web import serving\n"
        "assert (files('wheelsoil.web') / 'static' / 'tokens.css').is_file()\n"
        "server.make_app(hub.Hub('x'), lambda command: True, serving.Rules.of('localhost', '127.0.0.1', None))\n"
        "from wheelsoil.cli.app import run\n"
        "assert not run(['sample', 'clay', '-o', 'clay']) and not run(['process', 'clay'])\n"
    )
    done = subprocess.run([python, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_page_on_a_package_index_has_no_link_to_a_file_of_the_source(python: Path) -> None:
    [metadata] = python.parents[1].glob("lib/python*/site-packages/wheelsoil-*.dist-info/METADATA")
    text = metadata.read_text(encoding="utf-8")
    assert "# wheelsoil" in text and "how to read it (`docs/report.md`)" in text
    assert not re.findall(r"\]\((?!https?:)", text)


@pytest.mark.slow
def test_the_example_of_the_public_api_is_typed_for_who_installs_the_wheel(python: Path, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    [example] = re.findall(r"```python\n(.*?)```", page, re.S)
    (tmp_path / "example.py").write_text(example, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--python-executable", python, "example.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_built_wheel_has_the_compiled_core(python: Path, tmp_path: Path) -> None:
    script = "import model; print(model.core_in_use(), model.__file__)"
    done = subprocess.run([python, "-I", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("compiled ") and str(python.parents[1]) in done.stdout


@pytest.mark.slow
def test_without_a_compiler_a_wheel_is_built_for_every_platform(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", tmp_path, ROOT]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "CC": "false"})
    [wheel] = tmp_path.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    assert not [name for name in zipfile.ZipFile(wheel).namelist() if "_compiled" in name]


def test_a_module_that_hides_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text("x = 1\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", "import wheelsoil"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert str(tmp_path / "model.py") in done.stderr and "rename your file" in done.stderr
