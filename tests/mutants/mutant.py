"""Mutants: single deliberate errors in the source, listed in the TOML files of this folder."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CPU_SECONDS = "MUTANTS_CPU_SECONDS"
"""Environment variable: limit of the CPU time of a process, which does not depend on the load of the machine."""


@dataclass(frozen=True)
class Mutant:
    """One error.

    Attributes
    ----------
    room : str
        Name of its list.
    old, new : str
        Exact text of the source, and what stands there instead; `old` may span lines, which gives it its context.
    numeric : bool
        Whether a number comes out wrong, silently.
    tests : tuple of str
        Files (or single tests, ``file::name``) that should notice, the likeliest first.
    occurrence : int
        Which one of several, counted from 1; 0 where `old` stands in the file once.
    """

    room: str
    id: str
    file: str
    old: str
    new: str
    why: str
    numeric: bool
    tests: tuple[str, ...]
    occurrence: int = 0

    def applied(self, text: str) -> str:
        """Return the source with the error in it.

        Raises
        ------
        ValueError
            `old` is not in `text`, or stands there more than once and no `occurrence` says which.
        """
        parts = text.split(self.old)
        found = len(parts) - 1
        if found == 0 or (found > 1 and not self.occurrence) or self.occurrence > found:
            raise ValueError(
                f"{self.id}: expected {self.old!r} once in {self.file}, got {found} times: change {self.room}.toml"
            )
        at = self.occurrence or 1
        return self.old.join(parts[:at]) + self.new + self.old.join(parts[at:])


def all_mutants() -> list[Mutant]:
    """Return the mutants of every list in this folder."""
    return [
        _mutant(path, entry)
        for path in sorted(HERE.glob("*.toml"))
        for entry in tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    ]


def _mutant(path: Path, entry: dict[str, Any]) -> Mutant:
    try:
        return Mutant(room=path.stem, **entry | {"tests": tuple(entry.get("tests", ()))})
    except TypeError as error:
        raise SystemExit(f"{path.name}: {entry.get('id', 'a mutant without id')}: {error}") from None


def problems(mutants: list[Mutant], root: Path = ROOT) -> list[str]:
    """Return what is wrong with the lists: an id given twice, a text or a test that is no longer there."""
    ids = [mutant.id for mutant in mutants]
    wrong = [f"{name}: listed more than once" for name in sorted({name for name in ids if ids.count(name) > 1})]
    texts: dict[str, str] = {}
    for mutant in mutants:
        path = root / mutant.file
        if not path.is_file():
            wrong.append(f"{mutant.id}: expected the file {mutant.file}, got none")
            continue
        if mutant.file not in texts:
            texts[mutant.file] = path.read_text(encoding="utf-8")
        if mutant.old == mutant.new:
            wrong.append(f"{mutant.id}: old and new are the same")
        try:
            mutant.applied(texts[mutant.file])
        except ValueError as error:
            wrong.append(str(error))
        wrong += [
            f"{mutant.id}: expected the test {test}, got none" for test in mutant.tests if not is_there(root, test)
        ]
        if not mutant.tests:
            wrong.append(f"{mutant.id}: names no test")
    return wrong


def is_there(root: Path, test: str) -> bool:
    """Return whether a test, or a file of tests, is in a checkout."""
    name, _, function = test.partition("::")
    path = root / name
    return path.is_file() and (not function or f"def {function.split('[')[0]}(" in path.read_text(encoding="utf-8"))
