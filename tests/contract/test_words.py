"""Words that docs/style.md replaces do not come back."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
REPLACED = re.compile(
    r"\b(told|foretold|foretell|reckon(?:ed)?|likeliest|look-alikes?|stands? still|the whole way|cry wolf|at work"
    r"|cannot tell|beforehand)\b",
    re.IGNORECASE,
)
MOST = 20


def texts() -> list[str]:
    """Return the strings of the packages that hold more than a word, and the documents."""
    code = [path for room in ("daq", "processing", "model", "wheelsoil") for path in (ROOT / room).rglob("*.py")]
    nodes = (node for path in code for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    strings = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    documents = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    return [text for text in strings if " " in text] + [path.read_text(encoding="utf-8") for path in documents]


def test_replaced_words_do_not_come_back() -> None:
    found = Counter(match.lower() for text in texts() for match in REPLACED.findall(text))
    assert found.total() <= MOST, found
