"""The kept numbers on disk: one JSON file a case."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Container, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from golden.cases import Case
from golden.comparison import Difference, differences
from golden.inputs import Inputs
from golden.kept import kept

NUMBERS = Path(__file__).parent / "numbers"
CHANGES = Path(__file__).parent / "CHANGES.md"
NAMED = 3
"""How many cases a line of the changes names; the commit has all of them."""

_LIST_OF_NUMBERS = re.compile(r'\[\s+([^][{}"]*?)\s+\]')


def compared(case: Case, inputs: Inputs) -> tuple[list[Difference], Any]:
    """Run a case; return where it differs from what is kept, and what is to be kept of it now."""
    outputs = kept(case.outputs(inputs), case.name)
    path = NUMBERS / f"{case.name}.json"
    expected = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return list(differences(expected, outputs, case.name)), outputs


def keep(name: str, outputs: Any) -> None:
    """Write what a case gave, a series to a line."""
    text = json.dumps(outputs, indent=0, ensure_ascii=False, allow_nan=False)
    lines = _LIST_OF_NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    NUMBERS.mkdir(exist_ok=True)
    (NUMBERS / f"{name}.json").write_text(lines + "\n", encoding="utf-8")


def note(why: str, names: Sequence[str]) -> None:
    """Append to the list of changes why the numbers of some cases are renewed, and on which commit."""
    with CHANGES.open("a", encoding="utf-8") as file:
        cases = " ".join(names) if len(names) <= NAMED else f"{len(names)} cases"
        file.write(f"- {datetime.now(UTC):%Y-%m-%d}, on {_commit()}: {why} ({cases})\n")


def _commit() -> str:
    asked = ["git", "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(asked, cwd=NUMBERS.parent, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "an unknown commit"


def forget_unknown(names: Container[str]) -> list[str]:
    """Delete the numbers of cases that are no more; return their names."""
    gone = [path for path in sorted(NUMBERS.glob("*.json")) if path.stem not in names]
    for path in gone:
        path.unlink()
    return [path.stem for path in gone]
