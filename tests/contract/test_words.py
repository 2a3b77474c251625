"""Words that docs/style.md replaces do not come back, and the pages stay short."""

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
MOST = 5
FOLDERS = ("benchmarks", "dbc", "docs", "recordings", "studies", "tests")
GENERATED = {
    "benchmarks/results.md",
    *(
        f"docs/{name}.md"
        for name in (
            "blind_results",
            "growth_results",
            "health_codes",
            "mutants",
            "paper",
            "recovery",
            "wheels_results",
        )
    ),
}
MOST_WORDS, MOST_OF_A_DECISION, MOST_LINES_OF_README = 50_000, 450, 95


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


def test_hand_written_pages_are_short() -> None:
    """A program writes the other pages."""
    pages = [*ROOT.glob("*.md"), *(page for folder in FOLDERS for page in (ROOT / folder).rglob("*.md"))]
    words = {page.relative_to(ROOT).as_posix(): len(page.read_text(encoding="utf-8").split()) for page in pages}
    words = {name: count for name, count in words.items() if name not in GENERATED}
    assert sum(words.values()) <= MOST_WORDS, sorted(words.items(), key=lambda item: -item[1])[:10]
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= MOST_LINES_OF_README


def test_a_decision_has_a_number_a_date_and_one_screen() -> None:
    folder = ROOT / "docs" / "decisions"
    index = (folder / "README.md").read_text(encoding="utf-8")
    numbers = []
    for page in set(folder.glob("*.md")) - {folder / "README.md"}:
        text = page.read_text(encoding="utf-8")
        head = re.match(r"# (\d+)\. .+\n\d{4}-\d\d-\d\d · (accepted|replaced)", text)
        assert head, f"{page.name}: expected '# 7. Title', then '2026-11-21 · accepted'"
        assert all(f"**{part}" in text for part in ("Context.", "Decision", "Consequences.")), page.name
        assert len(text.split()) <= MOST_OF_A_DECISION, page.name
        assert re.search(rf"\b{head[1]} \[[^]]+\]\({page.name}\)", index), (
            f"{page.name} is not in README.md of its folder"
        )
        numbers.append(int(head[1]))
    assert sorted(numbers) == list(range(1, len(numbers) + 1))
