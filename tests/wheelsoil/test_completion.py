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


@pytest.mark.parametrize(
    "words",
    [["wheelsoil dia", "wheelsoil diagnose --effects torque_z"], pytest.param([*COMPLETED], marks=pytest.mark.slow)],
)
def test_the_shell_completes_commands_options_and_names(words: list[str]) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    paths = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    script = SOURCE + "".join(EACH.format(words=one, at=len(one.split()) - 1) for one in words)
    done = subprocess.run([bash, "-c", script], env=os.environ | paths, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = dict(zip(words, (" ".join(line.split()) for line in done.stdout.splitlines()), strict=True))
    assert found == {one: COMPLETED[one] for one in words}
