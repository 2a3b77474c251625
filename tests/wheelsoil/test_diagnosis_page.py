"""The worked example of docs/diagnosis.md is what the program prints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli_support import ok

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_every_line_that_the_page_shows_is_printed():
    example = PAGE.split("## An example, line by line")[1].split("\n## ")[0]
    shown = [line for block in re.findall(r"```\n(.*?)```", example, re.S) for line in block.splitlines()]
    printed = ok("diagnose", ROOT / "recordings" / "sandy", "--verbose").out.splitlines()
    wanted = [line for line in shown if line.strip() not in ("", "...")]
    assert len(wanted) >= 29
    assert [line for line in wanted if line not in printed] == []
