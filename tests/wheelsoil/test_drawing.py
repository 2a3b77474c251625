"""Lines of a drawing end where they leave its axes."""

from __future__ import annotations

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelsoil.report import Curve, Plane, drawn

PLANE = Plane((0.0, 10.0), (-1.0, 1.0), "slip", "pull")
numbers = st.floats(-5.0, 5.0) | st.just(float("nan"))


def pieces(values: list[float]) -> list[list[tuple[float, float]]]:
    """Return the pieces of a line as they are drawn, in the units of the axes."""
    y = np.array(values)
    drawing = drawn("key", "Title", "", PLANE, [Curve("line", np.arange(len(y), dtype=float), y, "model")])
    paths = re.findall(r'class="line model" d="M([^"]+)"', drawing.wide)
    wide, high = (720 - 58 - 170) / 10.0, (340 - 34 - 44) / 2.0
    points = [[tuple(map(float, point.split())) for point in path.split("L")] for path in paths]
    return [[((x - 58) / wide, 1.0 - (y - 34) / high) for x, y in piece] for piece in points]


@given(st.lists(numbers, min_size=2, max_size=11))
def test_a_line_stays_within_the_axes_and_on_itself(values: list[float]) -> None:
    for piece in pieces(values):
        for x, y in piece:
            assert -1.001 <= y <= 1.001
            left = min(int(x), len(values) - 2)
            near = [np.interp(x, np.arange(len(values)), values), *values[left : left + 2]]
            assert np.nanmin(np.abs(np.array(near) - y)) < 0.06, "pixels have one decimal"


def test_a_line_ends_where_it_leaves_the_axes_and_comes_back() -> None:
    leaving, coming = pieces([0.0, 2.0, 2.0, 0.0])
    assert np.allclose([leaving[0], leaving[-1]], [(0.0, 0.0), (0.5, 1.0)], atol=0.01)
    assert np.allclose([coming[0], coming[-1]], [(2.5, 1.0), (3.0, 0.0)], atol=0.01)
    assert pieces([2.0, 3.0, 2.0]) == []
