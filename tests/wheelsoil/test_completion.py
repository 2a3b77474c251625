"""Completion of the command line, by a real shell."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

COMPLETED = {
    "wheelsoil dia": "diagnose",
    "wheelsoil re": "replay recover report",
    "wheelsoil soil --pl": "--plate",
    "wheelsoil diagnose --effects torque_z": "torque_zero",
    "wheelsoil diagnose --without lyasko,drawbar_pull_z": "lyasko,drawbar_pull_zero",
    "wheelsoil fit --soil ding": "ding_clay",
    "wheelsoil fleet st": "status",
}
SOURCE = 'eval "$(_WHEELSOIL_COMPLETE=source_bash wheelsoil)"'
EACH = """
COMP_WORDS=({words}); COMP_CWORD={at}
_wheelsoil_completion wheelsoil
echo "${{COMPREPLY[@]}}"
"""


def test_the_shell_completes_commands_options_and_names() -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    paths = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    script = SOURCE + "".join(EACH.format(words=words, at=len(words.split()) - 1) for words in COMPLETED)
    done = subprocess.run([bash, "-c", script], env=os.environ | paths, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = dict(zip(COMPLETED, (" ".join(line.split()) for line in done.stdout.splitlines()), strict=True))
    assert found == COMPLETED
