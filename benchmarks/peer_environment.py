"""A virtual environment of its own for peers that must not be installed beside wheelsoil.

python-can imports asammdf where it finds it, which makes every start seconds slower.
"""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PEERS = ("asammdf==8.8.28", "foxglove-sdk==0.30.3", "lmfit==1.3.4", "polars==2.1.0", "duckdb==2.0.1")
_FOLDER = ROOT / ".venv-bench"
_STAMP = _FOLDER / "peers.txt"
_PYTHON = _FOLDER / "bin" / "python"


class PeersMissingError(Exception):
    """The peers cannot be installed here, for instance because there is no network."""


def run_beside_peers(module: str, *arguments: str) -> Any:
    """Run a module of this package where the peers and wheelsoil are installed; return what it prints as JSON.

    Raises
    ------
    PeersMissingError
        If the peers cannot be installed.
    """
    _install()
    command = [str(_PYTHON), "-m", f"benchmarks.{module}", *arguments]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def _install() -> None:
    """Make the environment on first use, with the same versions of numpy and the rest as everywhere."""
    wanted = "\n".join(PEERS)
    if _STAMP.exists() and _STAMP.read_text(encoding="utf-8") == wanted:
        return
    print(f"installing {', '.join(PEERS)} into {_FOLDER.name}", file=sys.stderr)
    if not _PYTHON.exists():
        venv.create(_FOLDER, with_pip=True)
    pip = [str(_PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command = [*pip, "--constraint", str(ROOT / "constraints.txt"), "--editable", str(ROOT), *PEERS]
    if subprocess.run(command, check=False, stdout=sys.stderr).returncode:
        raise PeersMissingError(f"pip cannot install {', '.join(PEERS)}")
    _STAMP.write_text(wanted, encoding="utf-8")
