"""Facts travel as values: no code finds one by the words of a sentence or of a label."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[2]
ROOMS = ("daq", "processing", "model", "wheelsoil")
_ASKS = ("startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition", "split", "find", "index")
_WORDS = re.compile(r"[^\W\d_]{2,}[:,.]? |^[A-Z][a-z]+:")
"""What only a sentence or a label has: a word with a space behind it, or a heading."""
_NAMES = {"three decimals", "by sigma", "percent change"}
"""Values of a declared `Literal`."""
_FILLERS = {"material", "bench", "one", "said", "left_out", "cannot_tell"}
_USERS_TYPE = {
    "daq/can/databases.py: left_out",
    "daq/runs/open.py: left_out",
    "model/diagnosis/core/campaign.py: Bench",
    "wheelsoil/report/build.py: left_out",
    "wheelsoil/view/messages.py: left_out",
}
"""Names of the public API, and of what the page sends."""
_IN_SCRIPTS = re.compile(
    r"""\.(?:startsWith|endsWith|includes|indexOf|split|replace|replaceAll)\(\s*(["'])((?:(?!\1).)*)\1|[!=]==\s*(["'])((?:(?!\3).)*)\3"""
)


def asked_in(code: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the texts that a module looks for in another one, or compares with it, with their lines."""
    for node in ast.walk(code):
        looked: list[ast.expr] = []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _ASKS:
            looked = node.args[:1]
        elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn | ast.Eq | ast.NotEq):
            looked = [node.left, *node.comparators]
            if isinstance(node.ops[0], ast.In | ast.NotIn) and not isinstance(
                looked[1], ast.Tuple | ast.Set | ast.List
            ):
                looked = looked[:1]
        for one in looked:
            for part in one.elts if isinstance(one, ast.Tuple | ast.Set | ast.List) else [one]:
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.lineno, part.value


@pytest.mark.parametrize("room", ROOMS)
def test_no_code_asks_a_sentence_for_a_fact(room: str) -> None:
    found = [
        f"{path.relative_to(HOUSE)}:{line}: {text!r}"
        for path in sorted((HOUSE / room).rglob("*.py"))
        for line, text in asked_in(ast.parse(path.read_text(encoding="utf-8")))
        if _WORDS.search(text) and text not in _NAMES
    ]
    assert not found, "give the fact a field: " + "; ".join(found)


def test_no_name_is_a_filler_or_has_two_meanings() -> None:
    found = {
        f"{path.relative_to(HOUSE)}: {name}"
        for room in ROOMS
        for path in (HOUSE / room).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (name := _name_given(node)).lower() in _FILLERS
    }
    assert found == _USERS_TYPE, "name the thing: docs/style.md"


def _name_given(node: ast.AST) -> str:
    """Return the name that a statement, an argument or a definition gives; "" of anything else."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return node.id
    if isinstance(node, ast.arg):
        return node.arg
    return node.name if isinstance(node, ast.FunctionDef | ast.ClassDef) else ""


def test_no_script_asks_a_sentence_for_a_fact() -> None:
    found = [
        f"{path.relative_to(HOUSE)}: {text!r}"
        for path in sorted((HOUSE / "wheelsoil").rglob("*.js"))
        for match in _IN_SCRIPTS.finditer(path.read_text(encoding="utf-8"))
        for text in [match[2] or match[4] or ""]
        if _WORDS.search(text)
    ]
    assert not found, "give the fact a field: " + "; ".join(found)
