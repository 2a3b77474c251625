"""What is printed of a value that is none of those that are allowed."""

from __future__ import annotations

import pytest
from cli_support import invoke


@pytest.mark.parametrize("args", [("sample", "loam"), ("fleet", "run", "x", "--store", "y", "--engine", "loam")])
def test_a_value_is_refused_without_the_words_of_a_library(args: tuple[str, ...]) -> None:
    said = invoke(*args)
    assert said.code == 2 and "'loam' is not one of '" in said.err
    assert "Value error" not in said.err
