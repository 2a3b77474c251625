"""Which test kills each mutant: kept in results.json, counted in docs/mutants.md, listed in out/mutants.md."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mutants.mutant import HERE, ROOT, Mutant

RESULTS = HERE / "results.json"
COUNTS = ROOT / "docs" / "mutants.md"
TABLE = ROOT / "out" / "mutants.md"
HEAD = """# Mutants
A mutant is one deliberate error in the source. It is killed when a test fails; one that survives is an error that no
test would notice. Made by `make mutants` (how: [CONTRIBUTING.md](../CONTRIBUTING.md)), which lists each mutant with the
test that kills it in `out/mutants.md`; not written by hand.

| list | killed | run | not run yet |
|---|---|---|---|
"""
SURVIVED = "**"
"""What a result begins with that is no test."""


def write_results(
    mutants: Sequence[Mutant],
    killed_by: Mapping[str, str],
    results: Path = RESULTS,
    counts: Path = COUNTS,
    table: Path = TABLE,
) -> None:
    """Renew the three files; mutants that were not run keep the last result that was found for them."""
    before = json.loads(results.read_text(encoding="utf-8")) if results.exists() else {}
    known = before | dict(killed_by)
    known = {mutant.id: known[mutant.id] for mutant in mutants if mutant.id in known}
    results.write_text(json.dumps(known, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    counts.write_text(HEAD + "".join(_counts(mutants, known)), encoding="utf-8")
    table.parent.mkdir(exist_ok=True)
    table.write_text("".join(_table(mutants, known)), encoding="utf-8")


def _counts(mutants: Sequence[Mutant], known: Mapping[str, str]) -> Iterator[str]:
    for room in dict.fromkeys(mutant.room for mutant in mutants):
        listed = [mutant.id for mutant in mutants if mutant.room == room]
        run = [known[name] for name in listed if name in known]
        killed = sum(not result.startswith(SURVIVED) for result in run)
        yield f"| {room} | {killed} | {len(run)} | {len(listed) - len(run)} |\n"
    for mutant in mutants:
        if known.get(mutant.id, "").startswith(SURVIVED):
            yield f"\n`{mutant.id}`, {mutant.file}: {mutant.why}: {known[mutant.id]}\n"


def _table(mutants: Sequence[Mutant], known: Mapping[str, str]) -> Iterator[str]:
    yield "| list | id | change | killed by |\n|---|---|---|---|\n"
    for mutant in mutants:
        change = f"{mutant.why}<br>{mutant.file}: {_code(mutant.old)} &rarr; {_code(mutant.new)}"
        yield f"| {mutant.room} | `{mutant.id}` | {change} | {known.get(mutant.id, 'not run yet')} |\n"


def _code(text: str) -> str:
    one_line = " ".join(text.split()).replace("|", "\\|")
    return f"``{one_line}``" if one_line else "nothing"
