"""docs/health.md lists the codes and next steps as the health report has them."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.logger.health.report import NEXT_STEPS, Level, reason

PAGE = Path(__file__).parents[2] / "docs" / "health.md"


def test_the_table_is_the_code() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    head = lines.index("| code | level | meaning | mostly from | what to do |")
    table = {}
    for line in lines[head + 2 :]:
        if not line.startswith("|"):
            break
        name, level, meaning, cause, step = (cell.strip() for cell in line.strip("|").split(" | "))
        assert level.startswith(("amber", "red"))
        assert meaning
        assert cause
        table[name.strip("`")] = step
    assert list(table.items()) == list(NEXT_STEPS.items())


@pytest.mark.parametrize("code", NEXT_STEPS)
def test_every_next_step_can_name_the_bus(code: str) -> None:
    step = reason(code, Level.AMBER, "can7", "is so").next_step
    assert step
    assert "{" not in step
    assert NEXT_STEPS[code].count("{bus}") == step.count("can7")


def test_every_code_that_is_used_is_known_and_every_known_one_used() -> None:
    files = (PAGE.parents[1] / "daq" / "logger").rglob("*.py")
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    made = {"bus_error_passive", "bus_error_warning"}  # put together from the controller's state
    listed = 1
    assert {code for code in NEXT_STEPS if text.count(f'"{code}"') == listed} == made
