"""Tables for people: they fit, and lose nothing."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import file_name, number, table_lines, without_powers

words = st.text(string.ascii_letters + "_./ ", max_size=40).map(str.strip)


@given(st.lists(st.tuples(words, words, words), min_size=1, max_size=5), st.integers(30, 100))
def test_a_table_fits_and_loses_nothing(rows, width):
    rows = [(name, more, value[:6].strip()) for name, more, value in rows]
    lines = table_lines(("name", "more", "value"), rows, left=2, width=width)
    free = table_lines(("name", "more", "value"), rows, left=2)
    if max(map(len, free)) <= width:
        assert lines == free
    else:
        assert max(map(len, lines)) <= max(width, 40 + 2 + 12 + 6)  # one column is broken, the other stays
    for line, row in zip(free[1:], rows, strict=True):
        assert line.split() == " ".join(row).split()
    kept = "".join("".join(row) for row in rows)
    assert sorted("".join(lines[1:]).replace(" ", "")) == sorted(kept.replace(" ", ""))


def test_a_long_name_goes_on_below_itself():
    lines = table_lines(
        ("model", "coefficient", "value"), [("chosen", "track_drift.log_stiffness", "1.5")], left=2, width=30
    )
    assert lines == ["model  coefficient       value", "chosen track_drift.log_    1.5", "       stiffness"]


def test_columns_move_closer_before_anything_is_broken():
    assert table_lines(("a", "b"), [("1234567890", "1")], width=12) == ["a          b", "1234567890 1"]


def test_a_number_that_is_none():
    assert (number(float("nan")), number(12345.678), number(0.5, 2)) == ("-", "12,350", "0.5")


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("k = 4.876e+05 N", "k = 487,600 N"),
        ("8.1e+03 to 9.20e+03 N", "8100 to 9200 N"),
        ("-2e-04 m", "-0.0002 m"),
        ("1.2e-09", "1.2e-09"),
        ("id 0x1e+05, run-2e+03a", "id 0x1e+05, run-2e+03a"),
    ],
)
def test_a_text_has_no_powers_of_ten(text: str, written: str) -> None:
    assert without_powers(text) == written


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("run 1", "run-1"),
        ("../a", "a"),
        ("..", "run"),
        ("CON", "_CON"),
        ("nul.x", "_nul.x"),
        ("com10", "com10"),
        ("a:b", "a-b"),
    ],
)
def test_a_file_name_is_one_on_every_system(text: str, name: str) -> None:
    assert file_name(text) == name
