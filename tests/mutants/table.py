"""docs/mutants.md: each mutant and the test that kills it."""

from __future__ import annotations

import re
from pathlib import Path

from mutants.mutant import Mutant

HEAD = """# Mutants
A mutant is one deliberate error in the source. It is killed when a test fails; one that survives is an error that no
test would notice. Made by `make mutants` (how: [CONTRIBUTING.md](../CONTRIBUTING.md)); not written by hand.
"""
NOT_RUN = "not run yet"


def write_table(path: Path, mutants: list[Mutant], killed_by: dict[str, str]) -> None:
    """Write the table; mutants that were not run keep the row's last entry that was found for them."""
    old = path.read_text(encoding="utf-8") if path.exists() else ""
    before = dict(re.findall(r"^\| `(\S+)` \|.* \| (.*) \|$", old, re.M))
    results = {mutant.id: killed_by.get(mutant.id, before.get(mutant.id, NOT_RUN)) for mutant in mutants}
    parts = [HEAD]
    for room in dict.fromkeys(mutant.room for mutant in mutants):
        listed = [mutant for mutant in mutants if mutant.room == room]
        run = [results[m.id] for m in listed if results[m.id] != NOT_RUN]
        killed = sum(not result.startswith("**") for result in run)
        rest = f", {len(listed) - len(run)} not run yet" if len(run) < len(listed) else ""
        parts.append(f"## {room}: {killed} of {len(run)} killed{rest}\n\n| id | change | killed by |\n|---|---|---|\n")
        parts += [f"| `{m.id}` | {_change(m)} | {results[m.id]} |\n" for m in listed]
        parts.append("\n")
    path.write_text("".join(parts).rstrip("\n") + "\n", encoding="utf-8")


def _change(mutant: Mutant) -> str:
    return f"{mutant.why}<br>{mutant.file}: {_code(mutant.old)} &rarr; {_code(mutant.new)}"


def _code(text: str) -> str:
    one_line = " ".join(text.split()).replace("|", "\\|")
    return f"``{one_line}``" if one_line else "nothing"
