"""docs/health_codes.md is made of the codes. Write it anew: python tests/daq/test_health_docs.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.logger.health.codes import CODES
from daq.logger.health.report import Level, reason

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "health_codes.md"
HEAD = """# Every code of the logger's health

Written by `python tests/daq/test_health_docs.py`. `{bus}` is the bus of the reason. See also [health.md](health.md).

| code | level | meaning | mostly from | what to do |
|---|---|---|---|---|
"""


def page() -> str:
    return HEAD + "".join(f"| `{code}` | {' | '.join(known)} |\n" for code, known in CODES.items())


def test_the_page_is_made_of_the_codes() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()
    assert all(known.level.startswith(("amber", "red")) and all(known) for known in CODES.values())


def test_amber_is_worse_than_green_and_red_than_amber() -> None:
    assert Level.GREEN < Level.AMBER < Level.RED


@pytest.mark.parametrize("code", CODES)
def test_every_next_step_can_name_the_bus(code: str) -> None:
    step = reason(code, Level.AMBER, "can7", "is so").next_step
    assert step
    assert "{" not in step
    assert CODES[code].next_step.count("{bus}") == step.count("can7")


def test_every_code_that_is_used_is_known_and_every_known_one_used() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "daq" / "logger").rglob("*.py"))
    made = {"bus_error_passive", "bus_error_warning"}  # put together from the controller's state
    listed = 1
    assert {code for code in CODES if text.count(f'"{code}"') == listed} == made


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
