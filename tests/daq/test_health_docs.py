"""docs/health.md lists the codes as the code has them."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.logger.health.codes import CODES, Code
from daq.logger.health.report import Level, reason

PAGE = Path(__file__).parents[2] / "docs" / "health.md"


def test_the_table_is_the_code() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    start = lines.index("| code | level | meaning | mostly from | what to do |") + 2
    table = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        name, *rest = (cell.strip() for cell in line.strip("|").split(" | "))
        table.append(Code(name.strip("`"), *rest))
    assert table == list(CODES.values())


@pytest.mark.parametrize("code", CODES)
def test_every_next_step_can_name_the_bus(code: str) -> None:
    step = reason(code, Level.AMBER, "can7", "is so").next_step
    assert step
    assert "{" not in step
    assert CODES[code].next_step.count("{bus}") == step.count("can7")


def test_every_code_that_is_used_is_known_and_every_known_one_used() -> None:
    folder = PAGE.parents[1] / "daq"
    files = (folder / "logger").rglob("*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in files if path.name != "codes.py")
    made = {"bus_error_passive", "bus_error_warning"}  # put together from the controller's state
    assert {code for code in CODES if f'"{code}"' not in text} == made
