"""The lists of mutants still fit the source, so that `make mutants` measures what it says."""

from __future__ import annotations

import ast
import json
import random
from dataclasses import replace
from pathlib import Path

import pytest
from mutants.draws import Finder, drawn, places_of
from mutants.gate import Costs, most_expensive, needed
from mutants.mutant import ROOT, Mutant, all_mutants, is_there, problems
from mutants.random_sample import LEFT_OVER
from mutants.table import write_results

ONE = Mutant("room", "one", "a.py", "x = 1", "x = 2", "why", True, ("test_a.py",))


def test_every_mutant_applies_to_the_source() -> None:
    mutants = all_mutants()
    assert {mutant.room for mutant in mutants} >= {"daq", "processing", "model", "wheelsoil"}
    assert problems(mutants) == []


def test_a_mutant_changes_the_occurrence_that_it_names() -> None:
    assert ONE.applied("x = 1\ny = 3\n") == "x = 2\ny = 3\n"
    assert replace(ONE, occurrence=2).applied("x = 1\nx = 1\nx = 1\n") == "x = 1\nx = 2\nx = 1\n"
    for text, mutant in (("y\n", ONE), ("x = 1\nx = 1\n", ONE), ("x = 1\n", replace(ONE, occurrence=2))):
        with pytest.raises(ValueError, match="expected 'x = 1' once"):
            mutant.applied(text)


def test_what_is_wrong_with_a_list_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "test_a.py").touch()
    assert problems([ONE], tmp_path) == []
    bad = {
        "listed more than once": [ONE, ONE],
        "expected 'x = 9' once": [replace(ONE, old="x = 9")],
        "the same": [replace(ONE, new=ONE.old)],
        "expected the file b.py": [replace(ONE, file="b.py")],
        "expected the test test_b.py": [replace(ONE, tests=("test_b.py",))],
        "names no test": [replace(ONE, tests=())],
    }
    for said, mutants in bad.items():
        (found,) = problems(mutants, tmp_path)
        assert said in found


def test_a_partial_run_keeps_the_results_of_the_others(tmp_path: Path) -> None:
    results, counts, table = (tmp_path / name for name in ("results.json", "counts.md", "out/table.md"))
    results.write_text(json.dumps({"one": "test_a.py::test_x", "gone": "test_a.py::test_x"}))
    mutants = [ONE, replace(ONE, id="two"), replace(ONE, id="three")]
    write_results(mutants, {"two": "**survived**"}, results, counts, table)
    assert json.loads(results.read_text()) == {"one": "test_a.py::test_x", "two": "**survived**"}
    assert "| room | 1 | 2 | 1 |\n" in counts.read_text()
    assert "`two`, a.py: why: **survived**" in counts.read_text()
    assert "| `three` | why<br>a.py: ``x = 1`` &rarr; ``x = 2`` | not run yet |" in table.read_text()


def test_the_gate_keeps_a_test_for_everything_and_the_cheapest() -> None:
    covered: dict[str, set[object]] = {"alone": {1}, "aside": {1}, "dear": {2, 3, 4}, "cheap": {2, 3}}
    covered |= {"kept": {4}, "more": {1, 3}}
    price = {"alone": 1.0, "aside": 9.0, "dear": 9.0, "cheap": 1.0, "kept": 9.0, "more": 4.0}
    assert needed(covered, price, {"kept"}) == {"alone", "cheap"}
    assert needed(covered, price, set()) == {"alone", "cheap", "dear"}


def test_a_fixture_is_saved_where_all_go_that_take_it() -> None:
    costs = Costs({"a": 1.0, "b": 0.5, "c": 2.0}, [(6.0, {"a", "b"})])
    assert costs.saved({"a", "c"}) == {"a": 1.0, "c": 2.0}
    assert costs.saved({"a", "b"}) == {"a": 4.0, "b": 3.5}
    assert most_expensive(costs, {"a", "b", "c"}, 7.0) == {"a", "b"}
    assert most_expensive(costs, {"a", "c"}, 9.0) == {"a", "c"}


def test_what_is_left_to_the_slow_set_is_still_there() -> None:
    left = LEFT_OVER.read_text(encoding="utf-8").splitlines()
    assert [test for test in left if not is_there(ROOT, test)] == []
    assert not any(test.startswith("tests/contract/") for test in left)


def test_a_drawn_mutant_changes_no_text_and_no_type() -> None:
    lines = [
        '"""Text of 1 + 1."""',
        "from typing import TYPE_CHECKING",
        "if TYPE_CHECKING:",
        "    LEAST = 1",
        "__all__ = ['a' * 2]",
        "def f(x: Literal[2], y: int = 3) -> Literal[4]:",
        '    """Return 5."""',
        "    z = x",
        "    if not x < y and x is None:",
        "        x -= -1",
        "    print(f'{x + 7}', 'a' + 'b')",
        "    return x * (y)",
    ]
    source = "\n".join(lines)
    edits = [e for p in places_of("a.py", ast.parse(source)) for e in Finder(p, source, random.Random(0)).edits()]
    changed: dict[int, set[str]] = {}
    for edit in edits:
        mutated = edit.applied(source).split("\n")
        (line,) = [i for i, (old, new) in enumerate(zip(lines, mutated, strict=True)) if old != new]
        changed.setdefault(line, set()).add(mutated[line].strip())
    either = "<=" if "    if not x <= y and x is None:" in str(changed) else ">="
    assert changed == {
        5: {"def f(x: Literal[2], y: int = 4) -> Literal[4]:"},
        8: {
            "if x < y and x is None:",
            f"if not x {either} y and x is None:",
            "if not x < y or x is None:",
            "if not x < y and x is not None:",
        },
        9: {"pass", "x += -1", "x -= 1", "x -= -2"},
        10: {"pass"},
        11: {"return None", "return x / (y)"},
    }
    assert drawn({"a.py": source}, 1, 3) == drawn({"a.py": source}, 1, 9)[:3]
    assert [edit.lines for edit in drawn({"a.py": source}, 1, 9)].count(()) == 1 == len(changed) - 4
