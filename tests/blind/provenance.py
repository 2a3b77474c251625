"""Which engine gave an answer: the trees of `model/` and `processing/` in git."""

from __future__ import annotations

import subprocess
from pathlib import Path

ENGINE = ("model", "processing")
Engine = dict[str, str | bool]


def engine_of(folder: Path | None = None) -> Engine:
    """Return the tree hashes of the engine at HEAD, and whether its files differ from them.

    Parameters
    ----------
    folder : Path, optional
        Inside the checkout; this file's by default.

    Returns
    -------
    mapping
        ``model`` and ``processing`` (tree hashes) and ``dirty``; outside a git checkout the hashes are "unknown".
    """
    place = folder or Path(__file__).parent
    try:
        top = Path(_git(place, "rev-parse", "--show-toplevel"))
        trees: Engine = {name: _git(top, "rev-parse", f"HEAD:{name}") for name in ENGINE}
        return trees | {"dirty": bool(_git(top, "status", "--porcelain", "--", *ENGINE))}
    except (OSError, subprocess.CalledProcessError):
        return dict.fromkeys(ENGINE, "unknown") | {"dirty": True}


def generator_of(folder: Path | None = None) -> str:
    """Return the tree hash of `tests/blind` at HEAD, with "+" where its files differ; "unknown" outside a checkout."""
    place = folder or Path(__file__).parent
    try:
        changed = _git(place, "status", "--porcelain", "--", ".")
        return _git(place, "rev-parse", "HEAD:./") + "+" * bool(changed)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def engine_words(engine: Engine) -> str:
    """Return an engine as the pages name it."""
    if "unknown" in engine.values():
        return "not known: no git checkout"
    trees = ", ".join(f"{name} {str(engine[name])[:12]}" for name in ENGINE)
    return trees + (" with changes that are not committed" if engine["dirty"] else "")


def _git(folder: Path, *words: str) -> str:
    found = subprocess.run(["git", *words], cwd=folder, check=True, capture_output=True, text=True)
    return found.stdout.strip()
